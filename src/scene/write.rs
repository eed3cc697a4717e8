//! Writing a [`Scene`]: commented TOML for people, compact JSON for programs. Numbers read back to the bit.

use super::{Flags, Gravity, PerItem, Row, Scene};
use std::fmt;
use std::iter::Peekable;
use toml_writer::{ToTomlValue, TomlWrite, WriteTomlValue};

/// Lists longer than this are broken into lines of at most this many characters.
const LINE: usize = 100;

impl Scene {
    /// As compact JSON.
    pub fn to_json(&self) -> String {
        // Serializing to text fails only for a map with keys that are not text, and there is none.
        serde_json::to_string(self).unwrap_or_default()
    }

    /// As TOML with comments that give meaning and unit.
    pub fn to_toml(&self) -> String {
        let mut toml = Toml(String::new());
        toml.comment("Scene of sprung. SI units; particles and springs are numbered from 0.");
        toml.line("name", Some(&self.name), "");
        match &self.gravity {
            Some(Gravity::Constant(gravity)) => toml.line("gravity", Some(gravity), "m/s²"),
            Some(Gravity::Path(path)) => {
                toml.list("gravity.times", &path.times, "s");
                toml.list("gravity.values", &path.values, "m/s², linear in between");
            }
            None => {}
        }
        if let Some(mesh) = &self.mesh {
            toml.header("[mesh]", "vertices become particles, each edge once becomes a spring");
            toml.line("file", Some(&mesh.file), "");
            toml.line("scale", mesh.scale, "m per unit of the mesh");
            toml.line("weld", mesh.weld, "m: nearer vertices are one");
        }
        self.write_particles(&mut toml);
        self.write_springs(&mut toml);
        self.write_constraints(&mut toml);
        for entry in &self.forces {
            toml.header("[[forces]]", "a constant load on each of some particles");
            toml.list("particles", &entry.particles, "");
            toml.line("value", Some(&entry.value), "N");
        }
        if let Some(drag) = &self.drag {
            toml.header("[drag]", "-c v on every particle");
            toml.values("coefficient", Some(&drag.coefficient), "c in N·s/m");
        }
        if !self.time.is_empty() {
            toml.header("[time]", "");
            toml.line("dt", self.time.dt, "s");
            toml.line("duration", self.time.duration, "s");
        }
        toml.0
    }

    fn write_particles(&self, toml: &mut Toml) {
        let particles = &self.particles;
        toml.header("[particles]", "");
        if !particles.positions.is_empty() {
            toml.list("positions", &particles.positions, "m, one row per particle");
        }
        if let Some(velocities) = &particles.velocities {
            toml.list("velocities", velocities, "m/s, one row per particle");
        }
        toml.values("masses", particles.masses.as_ref(), "kg");
    }

    fn write_springs(&self, toml: &mut Toml) {
        let springs = &self.springs;
        toml.header("[springs]", "");
        if !springs.pairs.is_empty() {
            toml.list("pairs", &springs.pairs, "end points i, j");
        }
        toml.values("stiffness", springs.stiffness.as_ref(), "k in N, the force per unit strain: f = k (l/l0 - 1)");
        match &springs.rest_lengths {
            None => toml.comment("rest_lengths, l0 in m: absent, so the initial distances"),
            lengths => toml.values("rest_lengths", lengths.as_ref(), "l0 in m"),
        }
        toml.values("damping", springs.damping.as_ref(), "b in N·s/m, along the spring");
        let meaning = match &springs.tension_only {
            Some(Flags::Each(_)) => "which springs do not push",
            _ => "whether springs do not push",
        };
        toml.values("tension_only", springs.tension_only.as_ref(), meaning);
        for entry in &springs.actuation {
            toml.header("[[springs.actuation]]", "rest lengths that change in time");
            toml.list("springs", &entry.springs, "");
            toml.list("path.times", &entry.path.times, "s");
            toml.list("path.factors", &entry.path.factors, "of the rest length, linear in between");
        }
    }

    fn write_constraints(&self, toml: &mut Toml) {
        for entry in &self.constraints {
            toml.header("[[constraints]]", "prescribed coordinates");
            toml.list("particles", &entry.particles, "");
            if let Some(axes) = &entry.axes {
                toml.list("axes", axes.iter().map(|axis| axis.letter()), "");
            }
            toml.line("velocity", entry.velocity, "m/s: x(t) = x(0) + t·velocity");
            if let Some(path) = &entry.path {
                toml.list("path.times", &path.times, "s");
                toml.list("path.offsets", &path.offsets, "m: x(t) = x(0) + offset(t), linear in between");
            }
            if entry.velocity.is_none() && entry.path.is_none() {
                toml.comment("no motion: held where they are");
            }
        }
    }
}

impl WriteTomlValue for Row {
    fn write_toml_value<W: TomlWrite + ?Sized>(&self, writer: &mut W) -> fmt::Result {
        writer.value(self.as_slice())
    }
}

struct Toml(String);

impl Toml {
    fn comment(&mut self, comment: &str) {
        self.0.push_str(&format!("# {comment}\n"));
    }

    fn header(&mut self, header: &str, comment: &str) {
        self.0.push_str(&format!("\n{header}{}\n", trailing(comment)));
    }

    fn line(&mut self, key: &str, value: Option<impl WriteTomlValue>, comment: &str) {
        if let Some(value) = value {
            self.0.push_str(&format!("{key} = {}{}\n", value.to_toml_value(), trailing(comment)));
        }
    }

    fn values<T: WriteTomlValue>(&mut self, key: &str, values: Option<&PerItem<T>>, comment: &str) {
        match values {
            None => (),
            Some(PerItem::Uniform(value)) => self.line(key, Some(value), comment),
            Some(PerItem::Each(values)) => self.list(key, values, comment),
        }
    }

    /// A list on one line where it fits, else filled lines under its comment.
    fn list(&mut self, key: &str, items: impl IntoIterator<Item: WriteTomlValue>, comment: &str) {
        let mut items = items.into_iter().map(|item| item.to_toml_value()).peekable();
        let mut line = String::new();
        // Besides the items the line has ` = [`, `]` and `  # `.
        extend(&mut line, &mut items, LINE.saturating_sub(key.len() + comment.chars().count() + 9));
        if items.peek().is_none() {
            return self.0.push_str(&format!("{key} = [{line}]{}\n", trailing(comment)));
        }
        self.0.push_str(&format!("{key} = [{}\n", trailing(comment)));
        loop {
            // Besides the items two spaces and a comma.
            extend(&mut line, &mut items, LINE - 3);
            if line.is_empty() {
                break;
            }
            self.0.push_str(&format!("  {line},\n"));
            line.clear();
        }
        self.0.push_str("]\n");
    }
}

fn trailing(comment: &str) -> String {
    if comment.is_empty() { String::new() } else { format!("  # {comment}") }
}

/// Adds items to a line of at most `room` characters, the first one in any case.
fn extend<I: Iterator<Item = String>>(line: &mut String, items: &mut Peekable<I>, room: usize) {
    while let Some(item) = items.next_if(|item| line.is_empty() || line.len() + 2 + item.len() <= room) {
        if !line.is_empty() {
            line.push_str(", ");
        }
        line.push_str(&item);
    }
}

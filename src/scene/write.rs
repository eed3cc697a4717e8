//! Writing a [`Scene`]: commented TOML for people, compact JSON for programs. Numbers read back to the bit.

use super::{Flags, Gravity, Row, Scene, Values};
use std::iter::Peekable;
use toml_writer::ToTomlValue;

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
        toml.line("name", Some(self.name.to_toml_value()), "");
        match &self.gravity {
            Some(Gravity::Constant(gravity)) => toml.line("gravity", Some(row(gravity)), "m/s²"),
            Some(Gravity::Path(path)) => {
                toml.numbers("gravity.times", &path.times, "s");
                toml.list("gravity.values", path.values.iter().map(row), "m/s², linear in between");
            }
            None => {}
        }
        if let Some(mesh) = &self.mesh {
            toml.header("[mesh]", "vertices become particles, each edge once becomes a spring");
            toml.line("file", Some(mesh.file.to_toml_value()), "");
            toml.line("scale", mesh.scale.map(number), "m per unit of the mesh");
            toml.line("weld", mesh.weld.map(number), "m: nearer vertices are one");
        }
        self.write_particles(&mut toml);
        self.write_springs(&mut toml);
        self.write_constraints(&mut toml);
        for entry in &self.forces {
            toml.header("[[forces]]", "a constant load on each of some particles");
            toml.list("particles", entry.particles.iter().map(u32::to_string), "");
            toml.line("value", Some(row(&entry.value)), "N");
        }
        if let Some(drag) = &self.drag {
            toml.header("[drag]", "-c v on every particle");
            toml.values("coefficient", Some(&drag.coefficient), "c in N·s/m");
        }
        if !self.time.is_empty() {
            toml.header("[time]", "");
            toml.line("dt", self.time.dt.map(number), "s");
            toml.line("duration", self.time.duration.map(number), "s");
        }
        toml.0
    }

    fn write_particles(&self, toml: &mut Toml) {
        let particles = &self.particles;
        toml.header("[particles]", "");
        if !particles.positions.is_empty() {
            toml.list("positions", particles.positions.iter().map(row), "m, one row per particle");
        }
        if let Some(velocities) = &particles.velocities {
            toml.list("velocities", velocities.iter().map(row), "m/s, one row per particle");
        }
        toml.values("masses", particles.masses.as_ref(), "kg");
    }

    fn write_springs(&self, toml: &mut Toml) {
        let springs = &self.springs;
        toml.header("[springs]", "");
        if !springs.pairs.is_empty() {
            toml.list("pairs", springs.pairs.iter().map(|[i, j]| format!("[{i}, {j}]")), "end points i, j");
        }
        toml.values("stiffness", springs.stiffness.as_ref(), "k in N, the force per unit strain: f = k (l/l0 - 1)");
        match &springs.rest_lengths {
            None => toml.comment("rest_lengths, l0 in m: absent, so the initial distances"),
            lengths => toml.values("rest_lengths", lengths.as_ref(), "l0 in m"),
        }
        toml.values("damping", springs.damping.as_ref(), "b in N·s/m, along the spring");
        match &springs.tension_only {
            None => {}
            Some(Flags::Uniform(flag)) => {
                toml.line("tension_only", Some(flag.to_string()), "whether springs do not push")
            }
            Some(Flags::Each(flags)) => {
                toml.list("tension_only", flags.iter().map(bool::to_string), "which springs do not push");
            }
        }
        for entry in &springs.actuation {
            toml.header("[[springs.actuation]]", "rest lengths that change in time");
            toml.list("springs", entry.springs.iter().map(u32::to_string), "");
            toml.numbers("path.times", &entry.path.times, "s");
            toml.numbers("path.factors", &entry.path.factors, "of the rest length, linear in between");
        }
    }

    fn write_constraints(&self, toml: &mut Toml) {
        for entry in &self.constraints {
            toml.header("[[constraints]]", "prescribed coordinates");
            toml.list("particles", entry.particles.iter().map(u32::to_string), "");
            if let Some(axes) = &entry.axes {
                toml.list("axes", axes.iter().map(|axis| format!("{:?}", axis.letter())), "");
            }
            toml.line("velocity", entry.velocity.as_ref().map(row), "m/s: x(t) = x(0) + t·velocity");
            if let Some(path) = &entry.path {
                toml.numbers("path.times", &path.times, "s");
                toml.list(
                    "path.offsets",
                    path.offsets.iter().map(row),
                    "m: x(t) = x(0) + offset(t), linear in between",
                );
            }
            if entry.velocity.is_none() && entry.path.is_none() {
                toml.comment("no motion: held where they are");
            }
        }
    }
}

fn number(value: f64) -> String {
    value.to_toml_value()
}

fn row(row: &Row) -> String {
    let numbers: Vec<String> = row.as_slice().iter().copied().map(number).collect();
    format!("[{}]", numbers.join(", "))
}

struct Toml(String);

impl Toml {
    fn comment(&mut self, comment: &str) {
        self.0.push_str(&format!("# {comment}\n"));
    }

    fn header(&mut self, header: &str, comment: &str) {
        self.0.push_str(&format!("\n{header}{}\n", trailing(comment)));
    }

    fn line(&mut self, key: &str, value: Option<String>, comment: &str) {
        if let Some(value) = value {
            self.0.push_str(&format!("{key} = {value}{}\n", trailing(comment)));
        }
    }

    fn values(&mut self, key: &str, values: Option<&Values>, comment: &str) {
        match values {
            None => (),
            Some(Values::Uniform(value)) => self.line(key, Some(number(*value)), comment),
            Some(Values::Each(values)) => self.numbers(key, values, comment),
        }
    }

    fn numbers(&mut self, key: &str, values: &[f64], comment: &str) {
        self.list(key, values.iter().copied().map(number), comment);
    }

    /// A list on one line where it fits, else filled lines under its comment.
    fn list(&mut self, key: &str, items: impl Iterator<Item = String>, comment: &str) {
        let mut items = items.peekable();
        let mut line = String::new();
        // Besides the items the line has ` = [`, `]` and `  # `.
        extend(&mut line, &mut items, LINE.saturating_sub(key.len() + comment.chars().count() + 9));
        if items.peek().is_none() {
            return self.line(key, Some(format!("[{line}]")), comment);
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

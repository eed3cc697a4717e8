//! Writing a [`Scene`]: commented TOML to read and edit, compact JSON for programs. Numbers read back to the bit.

use super::{ActuationEntry, ConstraintEntry, Flags, ForceEntry, Gravity, Row, Scene, Values};
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
        toml.text("name", &self.name);
        match &self.gravity {
            Some(Gravity::Constant(gravity)) => toml.line("gravity", &row(gravity), "m/s²"),
            Some(Gravity::Path(path)) => {
                toml.list("gravity.times", path.times.iter().copied().map(number), "s");
                toml.list("gravity.values", path.values.iter().map(row), "m/s², linear in between");
            }
            None => {}
        }
        self.write_mesh(&mut toml);
        self.write_particles(&mut toml);
        self.write_springs(&mut toml);
        self.constraints.iter().for_each(|entry| write_constraint(&mut toml, entry));
        self.forces.iter().for_each(|entry| write_force(&mut toml, entry));
        if let Some(drag) = &self.drag {
            toml.header("[drag]", "-c v on every particle");
            toml.values("coefficient", Some(&drag.coefficient), "c in N·s/m");
        }
        self.write_time(&mut toml);
        toml.0
    }

    fn write_mesh(&self, toml: &mut Toml) {
        if let Some(mesh) = &self.mesh {
            toml.header("[mesh]", "vertices become particles, each edge once becomes a spring");
            toml.text("file", &mesh.file);
            if let Some(scale) = mesh.scale {
                toml.line("scale", &number(scale), "m per unit of the mesh");
            }
            if let Some(weld) = mesh.weld {
                toml.line("weld", &number(weld), "m: nearer vertices are one");
            }
        }
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
            Some(Flags::Uniform(flag)) => toml.line("tension_only", &flag.to_string(), "whether springs do not push"),
            Some(Flags::Each(flags)) => {
                toml.list("tension_only", flags.iter().map(bool::to_string), "which springs do not push");
            }
        }
        springs.actuation.iter().for_each(|entry| write_actuation(toml, entry));
    }

    fn write_time(&self, toml: &mut Toml) {
        if self.time.is_empty() {
            return;
        }
        toml.header("[time]", "");
        if let Some(dt) = self.time.dt {
            toml.line("dt", &number(dt), "s");
        }
        if let Some(duration) = self.time.duration {
            toml.line("duration", &number(duration), "s");
        }
    }
}

fn write_constraint(toml: &mut Toml, entry: &ConstraintEntry) {
    toml.header("[[constraints]]", "prescribed coordinates");
    toml.list("particles", entry.particles.iter().map(u32::to_string), "");
    if let Some(axes) = &entry.axes {
        toml.list("axes", axes.iter().map(|axis| format!("{:?}", axis.letter())), "");
    }
    if let Some(velocity) = &entry.velocity {
        toml.line("velocity", &row(velocity), "m/s: x(t) = x(0) + t·velocity");
    }
    if let Some(path) = &entry.path {
        toml.list("path.times", path.times.iter().copied().map(number), "s");
        toml.list("path.offsets", path.offsets.iter().map(row), "m: x(t) = x(0) + offset(t), linear in between");
    }
    if entry.velocity.is_none() && entry.path.is_none() {
        toml.comment("no motion: held where they are");
    }
}

fn write_force(toml: &mut Toml, entry: &ForceEntry) {
    toml.header("[[forces]]", "a constant load on each of some particles");
    toml.list("particles", entry.particles.iter().map(u32::to_string), "");
    toml.line("value", &row(&entry.value), "N");
}

fn write_actuation(toml: &mut Toml, entry: &ActuationEntry) {
    toml.header("[[springs.actuation]]", "rest lengths that change in time");
    toml.list("springs", entry.springs.iter().map(u32::to_string), "");
    toml.list("path.times", entry.path.times.iter().copied().map(number), "s");
    toml.list("path.factors", entry.path.factors.iter().copied().map(number), "of the rest length, linear in between");
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
        self.0.push('\n');
        self.0.push_str(header);
        self.end(comment);
    }

    fn text(&mut self, key: &str, value: &str) {
        self.line(key, &value.to_toml_value(), "");
    }

    fn line(&mut self, key: &str, value: &str, comment: &str) {
        self.0.push_str(&format!("{key} = {value}"));
        self.end(comment);
    }

    fn end(&mut self, comment: &str) {
        if !comment.is_empty() {
            self.0.push_str("  # ");
            self.0.push_str(comment);
        }
        self.0.push('\n');
    }

    fn values(&mut self, key: &str, values: Option<&Values>, comment: &str) {
        match values {
            None => (),
            Some(Values::Uniform(value)) => self.line(key, &number(*value), comment),
            Some(Values::Each(values)) => self.list(key, values.iter().copied().map(number), comment),
        }
    }

    /// A list on one line where it fits, else filled lines under its comment.
    fn list(&mut self, key: &str, items: impl Iterator<Item = String>, comment: &str) {
        let mut items = items.peekable();
        let mut line = String::new();
        // Beside the items ` = [`, `]` and `  # `.
        fill(&mut line, &mut items, LINE.saturating_sub(key.len() + comment.chars().count() + 9));
        if items.peek().is_none() {
            return self.line(key, &format!("[{line}]"), comment);
        }
        self.0.push_str(&format!("{key} = ["));
        self.end(comment);
        loop {
            // Beside them two spaces and a comma.
            fill(&mut line, &mut items, LINE - 3);
            if line.is_empty() {
                break;
            }
            self.0.push_str(&format!("  {line},\n"));
            line.clear();
        }
        self.0.push_str("]\n");
    }
}

/// Takes items into a line as long as it has at most `room` characters, the first one in any case.
fn fill<I: Iterator<Item = String>>(line: &mut String, items: &mut Peekable<I>, room: usize) {
    while let Some(item) = items.next_if(|item| line.is_empty() || line.len() + 2 + item.len() <= room) {
        if !line.is_empty() {
            line.push_str(", ");
        }
        line.push_str(&item);
    }
}

#[cfg(test)]
mod tests {
    use super::{LINE, Toml};
    use crate::scene::{ConstraintEntry, Path, Scene};

    fn list(comment: &str, lengths: &[usize]) -> String {
        let mut toml = Toml(String::new());
        toml.list("key", lengths.iter().map(|&length| "1".repeat(length)), comment);
        toml.0
    }

    /// A line of 100 characters is as long as one may be: `key = [`, 84 of items, `]` and `  # kg m`.
    #[test]
    fn lists_are_broken_where_they_would_be_too_long() {
        let fits = list("kg m", &[40, 42]);
        assert_eq!((fits.lines().count(), fits.trim_end().len()), (1, LINE));
        assert_eq!(list("kg m", &[40, 43]), format!("key = [  # kg m\n  {}, {},\n]\n", "1".repeat(40), "1".repeat(43)));
        // Two spaces, nine items of nine digits with what is between them, and a comma.
        let filled = list("", &[9; 20]);
        let lines: Vec<usize> = filled.lines().map(str::len).collect();
        assert_eq!(lines, ["key = [".len(), LINE, LINE, 2 + 9 + 2 + 9 + 1, 1]);
        // 33 digits with two characters between them are 97, and as many as go between two spaces and a comma.
        let digits = list("", &[1; 40]);
        assert_eq!(digits.lines().map(str::len).collect::<Vec<_>>(), ["key = [".len(), LINE, 2 + 3 * 7 - 2 + 1, 1]);
        // What is longer than a line gets one of its own.
        assert_eq!(list("", &[120, 1]).lines().map(str::len).collect::<Vec<_>>(), [7, 123, 4, 1]);
        assert_eq!(list("none", &[]), "key = []  # none\n");
    }

    #[test]
    fn what_does_not_move_is_said_to_be_held() {
        let held = ConstraintEntry { particles: vec![0], axes: None, velocity: None, path: None };
        let moved = ConstraintEntry { velocity: Some([1.0].into()), ..held.clone() };
        let led =
            ConstraintEntry { path: Some(Path { times: vec![0.0], offsets: vec![[2.0].into()] }), ..held.clone() };
        let text = Scene { constraints: vec![moved, held, led], ..Scene::default() }.to_toml();
        assert_eq!(text.matches("# no motion: held").count(), 1, "{text}");
        assert!(!text.contains("[time]"), "{text}");
    }
}

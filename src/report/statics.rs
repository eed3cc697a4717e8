//! Equilibria, normal modes and mechanisms as JSON, text and pages.

mod html;

pub use html::{buckling_motions, load_path_animation, load_path_plot, mechanism_motions, mode_motions};

use super::list;
use super::number::{count, pretty};
use crate::equilibrium::{CriticalLoad, Equilibrium, LoadPath, Signs, Stability};
use crate::mechanisms::Mechanisms;
use crate::modes::{Mode, Modes};
use crate::system::System;
use nalgebra::Vector3;
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::fmt::Write;

/// An equilibrium as it is written to JSON, with time, positions and velocities as a `final.json` of a state at rest has them. A number that is not
/// finite becomes `null`.
#[derive(Debug, Clone, Copy)]
pub struct EquilibriumRecord<'a> {
    /// The name of the scene.
    pub scene: &'a str,
    /// Its number of axes.
    pub dimension: usize,
    /// The equilibrium.
    pub found: &'a Equilibrium,
    /// The path to it under rising load, if one was followed.
    pub path: Option<&'a LoadPath>,
}

impl Serialize for EquilibriumRecord<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { scene, dimension, found, path } = self;
        let critical = || path.iter().flat_map(|path| &path.critical);
        let row = |vector: &Vector3<f64>| vector.as_slice()[..*dimension].to_vec();
        let positions = &found.state.positions;
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("scene", scene)?;
        map.serialize_entry("status", found.stability.name())?;
        map.serialize_entry("residual", &found.residual)?;
        map.serialize_entry("energy", &found.energy)?;
        map.serialize_entry("iterations", &found.iterations)?;
        map.serialize_entry("inertia", &found.inertia)?;
        map.serialize_entry("counted", &found.counted)?;
        map.serialize_entry("lowest_eigenvalue", &found.lowest.as_ref().map(|(value, _)| *value))?;
        map.serialize_entry("falling", &found.falling)?;
        map.serialize_entry("critical_loads", &list(critical(), |load| load.factor))?;
        map.serialize_entry("critical_kinds", &list(critical(), |load| load.kind.name()))?;
        map.serialize_entry("factorizations", &found.work.factorizations)?;
        map.serialize_entry("linear_buckling", &path.and_then(|path| path.linear_buckling))?;
        map.serialize_entry("time", &found.state.time)?;
        map.serialize_entry("positions", &list(positions, row))?;
        map.serialize_entry("velocities", &list(positions, |_| vec![0.0; *dimension]))?;
        map.end()
    }
}

/// The kind of an equilibrium in words.
pub fn verdict(found: &Equilibrium) -> String {
    let Signs { negative, zero, .. } = found.inertia;
    let uncounted = if found.counted { "" } else { ", by the lowest eigenvalues found; they were not counted" };
    let kind = match found.stability {
        Stability::Stable => "stable: the energy has a minimum here".to_string(),
        Stability::Indifferent if zero == 1 => "indifferent: 1 motion costs no energy".to_string(),
        Stability::Indifferent => format!("indifferent: {zero} motions cost no energy"),
        Stability::Unstable if negative == 1 => "unstable: a saddle of the energy with 1 direction down".to_string(),
        Stability::Unstable => format!("unstable: a saddle of the energy with {negative} directions down"),
        Stability::None => {
            return format!("none: nothing holds particles {} against their load", ranges(&found.falling));
        }
        Stability::NotConverged => return "not-converged: forces are left".to_string(),
    };
    kind + uncounted
}

/// An equilibrium in words.
pub fn equilibrium_text(scene: &str, found: &Equilibrium, path: Option<&LoadPath>) -> String {
    let verdict = verdict(found);
    let mut text = format!("{scene}: {verdict}\n");
    let _ = writeln!(text, "  largest force left    {} of the largest that acts", pretty(found.residual));
    if found.stability == Stability::Indifferent {
        let _ = writeln!(text, "  free motions          sprung mechanisms names them");
    }
    let _ = writeln!(text, "  energy                {} J", pretty(found.energy));
    let _ = writeln!(
        text,
        "  work                  {}, {}",
        count(found.iterations, "Newton step"),
        if found.counted {
            count(found.work.factorizations as usize, "factorization")
        } else {
            count(found.work.cg_iterations as usize, "iteration") + " of conjugate gradients"
        }
    );
    for CriticalLoad { factor, kind, .. } in path.iter().flat_map(|path| &path.critical) {
        let _ = writeln!(text, "  critical load         {factor:.9} of the full load: {}", kind.name());
    }
    if let Some(factor) = path.and_then(|path| path.linear_buckling) {
        let _ = writeln!(text, "  linear buckling       {factor:.6} of the full load: an estimate");
    }
    text
}

/// Numbers with runs of neighbours as ranges, at most six of them.
pub fn ranges(numbers: &[usize]) -> String {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for &number in numbers {
        match runs.last_mut() {
            Some([_, last]) if *last + 1 == number => *last = number,
            _ => runs.push([number, number]),
        }
    }
    let more = runs.len() > 6;
    let words = runs
        .iter()
        .take(6)
        .map(|[first, last]| if first == last { first.to_string() } else { format!("{first}–{last}") });
    words.collect::<Vec<_>>().join(", ") + if more { ", …" } else { "" }
}

/// Normal modes as they are written to JSON; a number that is not finite becomes `null`.
#[derive(Debug, Clone, Copy)]
pub struct ModesRecord<'a> {
    /// The name of the scene.
    pub scene: &'a str,
    /// The state in words.
    pub at: &'a str,
    /// The modes.
    pub found: &'a Modes,
}

impl Serialize for ModesRecord<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { scene, at, found } = self;
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("scene", scene)?;
        map.serialize_entry("at", at)?;
        map.serialize_entry("zero_modes", &found.zero_count)?;
        map.serialize_entry("rigid_motions", &found.rigid_motions)?;
        map.serialize_entry("parts", &found.parts)?;
        map.serialize_entry("hanging", &found.hanging)?;
        map.serialize_entry("eigenvalues", &list(&found.modes, |mode| mode.eigenvalue))?;
        map.serialize_entry("frequencies", &list(&found.modes, Mode::frequency))?;
        map.serialize_entry("damping_ratios", &list(&found.modes, |mode| mode.damping_ratio))?;
        map.serialize_entry("effective_masses", &list(&found.modes, |mode| mode.effective_mass))?;
        map.serialize_entry("residuals", &list(&found.modes, |mode| mode.residual))?;
        map.serialize_entry("error_bounds", &list(&found.modes, |mode| mode.error_bound))?;
        map.serialize_entry("gap", &found.gap)?;
        map.serialize_entry("imbalance", &found.imbalance)?;
        map.serialize_entry("complete", &found.complete)?;
        map.serialize_entry("proven", &found.proven)?;
        map.serialize_entry("counted_below", &found.counted_below)?;
        map.end()
    }
}

/// Out of balance by more than this a state is no equilibrium.
const BALANCED: f64 = 1e-6;

/// The parts that move as a whole, and those that hang by one spring, in words.
fn parts_remarks(found: &Modes) -> Vec<String> {
    const NAMED: usize = 20;
    let name = |part: &Vec<usize>| if part.len() == 1 { "particle" } else { "particles" };
    let mut remarks = Vec::new();
    if !found.parts.is_empty() {
        let parts: Vec<String> = found.parts.iter().take(NAMED).map(|part| ranges(part)).collect();
        let (verb, more) = match found.parts.len() {
            1 => ("moves", ""),
            n => ("move", if n > NAMED { "; …" } else { "" }),
        };
        remarks.push(format!(
            "{} {verb} freely: {} {}{more}",
            count(found.parts.len(), "loose part"),
            if let [part] = &found.parts[..] { name(part) } else { "particles" },
            parts.join("; ")
        ));
    }
    for part in found.hanging.iter().take(NAMED) {
        let verb = if part.len() == 1 { "hangs" } else { "hang" };
        remarks.push(format!("{} {} {verb} by one spring", name(part), ranges(part)));
    }
    if found.hanging.len() > NAMED {
        remarks.push(format!("… and {} more", found.hanging.len() - NAMED));
    }
    remarks
}

/// Parts of all mass, and damping ratios, below which a number in a table is rounding.
const MASS_ROUNDING: f64 = 1e-12;
const DAMPING_ROUNDING: f64 = 1e-15;

/// A number in a table; rounding is zero.
fn scientific(value: f64, rounding: f64) -> String {
    if value.abs() < rounding || value == 0.0 { "0".into() } else { format!("{value:.3e}") }
}

/// Normal modes as a table.
pub fn modes_text(scene: &str, at: &str, system: &System, found: &Modes) -> String {
    let (dimension, mass_in_all) = (system.dimension(), system.masses().iter().sum::<f64>());
    let mut text = format!("{scene}, at {at}: {}\n", count(found.modes.len(), "mode"));
    if found.imbalance > BALANCED {
        let part = pretty(found.imbalance);
        let _ = writeln!(
            text,
            "  not an equilibrium: {part} of the largest force is not balanced; --at equilibrium finds one"
        );
    }
    match found.zero_count {
        Some(0) => {}
        Some(zeros) => {
            let others = zeros.saturating_sub(found.rigid_motions);
            let _ = writeln!(
                text,
                "  {}: {}, {}{}",
                count(zeros, "zero mode"),
                count(found.rigid_motions, "rigid motion"),
                count(others, "mechanism"),
                if found.zero_modes.is_empty() { "; above the modes asked for" } else { "" }
            );
        }
        None => text += "  zero modes: not counted; above the modes asked for\n",
    }
    for remark in parts_remarks(found) {
        let _ = writeln!(text, "  {remark}");
    }
    let axes = ["x", "y", "z"];
    let _ = write!(text, "\n  {:>4} {:>12} {:>12} {:>10}", "mode", "Hz", "period, s", "damping");
    axes[..dimension].iter().for_each(|axis| {
        let _ = write!(text, " {:>10}", format!("mass {axis}, kg"));
    });
    let _ = writeln!(text, " {:>10}", "residual");
    for (number, mode) in found.modes.iter().enumerate() {
        let [frequency, period] = match (mode.frequency(), mode.growth_rate()) {
            (Some(frequency), _) => [format!("{frequency:.6}"), format!("{:.6}", frequency.recip())],
            (None, rate) => ["grows".into(), format!("{:.3e} /s", rate.unwrap_or(f64::NAN))],
        };
        let damping = mode.damping_ratio.map_or("-".into(), |ratio| scientific(ratio, DAMPING_ROUNDING));
        let _ = write!(text, "  {:>4} {frequency:>12} {period:>12} {damping:>10}", number + 1);
        mode.effective_mass[..dimension].iter().for_each(|mass| {
            let _ = write!(text, " {:>10}", scientific(*mass, MASS_ROUNDING * mass_in_all));
        });
        let _ = writeln!(text, " {:>10.1e}", mode.residual / mode.eigenvalue.abs().max(f64::MIN_POSITIVE));
    }
    let _ = match found.complete {
        true if found.counted_below == f64::INFINITY => writeln!(text, "\n  complete: no coordinate is free"),
        true => writeln!(
            text,
            "\n  complete: a factorization counts the eigenvalues below {:.6e} 1/s², and none is missing ({})",
            found.counted_below,
            if found.proven { "proven" } else { "to rounding" }
        ),
        false => writeln!(text, "\n  not counted: modes may be missing"),
    };
    text
}

/// Mechanisms as they are written to JSON: numbers and particles, without the motions. A number that is not finite becomes `null`.
#[derive(Debug, Clone, Copy, serde::Serialize)]
pub struct MechanismsRecord<'a> {
    /// The name of the scene.
    pub scene: &'a str,
    /// The mechanisms.
    #[serde(flatten)]
    pub found: &'a Mechanisms,
}

fn self_stresses(found: &Mechanisms) -> String {
    let states = if found.self_stresses == 1 { "state" } else { "states" };
    format!("{} {states} of self-stress", found.self_stresses)
}

/// The certainty of the rank in words.
fn certainty(found: &Mechanisms) -> String {
    let [above, below] = found.proven_gap.map(pretty);
    match (found.rank_is_exact, found.proven) {
        (true, _) => "proven".into(),
        (_, true) => format!("proven: so many singular values above {above}, the others below {below}"),
        _ => "to rounding".into(),
    }
}

/// So many mechanisms in a sentence on them.
fn all(count: usize) -> &'static str {
    if count == 1 { "it" } else { "all of them" }
}

/// Mechanisms in words.
pub fn mechanisms_text(scene: &str, found: &Mechanisms) -> String {
    let others = found.mechanisms.saturating_sub(found.rigid_motions);
    let verdict = match (found.mechanisms, others) {
        (0, _) => "stiff: every motion stretches a spring".to_string(),
        (_, 0) => "stiff but for rigid motions".to_string(),
        _ => format!("{} beside {}", count(others, "mechanism"), count(found.rigid_motions, "rigid motion")),
    };
    let mut text = format!("{scene}: {verdict}\n");
    let [springs, freedoms] = [count(found.springs, "spring"), count(found.degrees_of_freedom, "degree of freedom")];
    let _ = writeln!(text, "  rank {} of {springs} on {} ({})", found.rank, freedoms, certainty(found));
    if found.rank + found.self_stresses > found.springs {
        text += "  springs of zero length resist in every direction: each counts as one for every axis\n";
    }
    let _ = writeln!(text, "  {}", self_stresses(found));
    if !found.decided {
        let [kept, dropped] = found.gap.map(pretty);
        let _ = writeln!(
            text,
            "  undecided: singular values of {kept} and {dropped} are too close to the limit of rounding"
        );
    }
    match found.prestress_stable {
        Some(true) => _ = writeln!(text, "  prestress stiffens {}", all(others)),
        Some(false) if others > 0 => _ = writeln!(text, "  prestress does not stiffen {}", all(others)),
        _ => {}
    }
    if others > 0 && found.movers.is_empty() {
        text +=
            "  so many mechanisms are only counted: which particles move, and what prestress does, is not computed\n";
    }
    for movers in found.movers.iter().take(20) {
        let particles = if movers.len() == 1 { "particle" } else { "particles" };
        let _ = writeln!(text, "  moves: {particles} {}", ranges(movers));
    }
    if found.movers.len() > 20 {
        let _ = writeln!(text, "  … and {} more", found.movers.len() - 20);
    }
    if !found.added_springs.is_empty() {
        let added = found.added_springs.len();
        let pairs: Vec<String> = found.added_springs.iter().take(20).map(|[i, j]| format!("{i}–{j}")).collect();
        let springs =
            format!("{} between {}{}", count(added, "spring"), pairs.join(", "), if added > 20 { ", …" } else { "" });
        // Each takes one away.
        let _ = match others.saturating_sub(added) {
            0 => writeln!(text, "  removed by {springs}: the fewest that do"),
            left => writeln!(text, "  all but {left} removed by {springs}"),
        };
    }
    text
}

#[cfg(test)]
mod tests {
    use super::{mechanisms_text, modes_text, scientific};
    use crate::mechanisms::mechanisms;
    use crate::modes::modes;
    use crate::system::SystemBuilder;

    /// A row of free particles in a plane.
    fn row(particles: usize) -> SystemBuilder {
        let mut builder = SystemBuilder::new();
        builder.dimension = 2;
        (0..particles).for_each(|p| _ = builder.particle([p as f64, 0.0, 0.0], 1.0));
        builder
    }

    #[test]
    fn rounding_is_zero_in_tables() {
        assert_eq!([3.5e-13, -3.5e-13, 0.0, 1.5e-12].map(|mass| scientific(mass, 1e-12)), ["0", "0", "0", "1.500e-12"]);
        let (system, state) = SystemBuilder::new().build().unwrap();
        let text = modes_text("none", "start", &system, &modes(&system, &state, 3).unwrap());
        assert!(text.ends_with("\n  complete: no coordinate is free\n"), "{text}");
    }

    #[test]
    fn mechanisms_are_counted_in_sentences() {
        let (system, state) = row(2).build().unwrap();
        let mut found = mechanisms(&system, &state).unwrap();
        (found.rigid_motions, found.mechanisms, found.prestress_stable) = (3, 4, Some(false));
        assert!(mechanisms_text("one", &found).contains("  prestress does not stiffen it\n"));
        (found.mechanisms, found.prestress_stable) = (5, Some(true));
        found.added_springs = vec![[0, 1]];
        let text = mechanisms_text("two", &found);
        assert!(text.contains("  prestress stiffens all of them\n"), "{text}");
        assert!(text.contains("  all but 1 removed by 1 spring between 0–1\n"), "{text}");
        found.added_springs = vec![[0, 1]; 2];
        assert!(
            mechanisms_text("two", &found).contains("  removed by 2 springs between 0–1, 0–1: the fewest that do\n")
        );
    }
}

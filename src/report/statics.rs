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

/// An equilibrium as it is written to JSON, with time, positions and velocities as in `final.json`; a number that is not finite becomes `null`.
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
    let directions = count(negative, "direction");
    match found.stability {
        Stability::Stable => format!("stable: the energy has a minimum here{uncounted}"),
        Stability::Indifferent if zero == 1 => format!("indifferent: 1 motion costs no energy{uncounted}"),
        Stability::Indifferent => format!("indifferent: {zero} motions cost no energy{uncounted}"),
        Stability::Unstable => format!("unstable: a saddle of the energy with {directions} down{uncounted}"),
        Stability::None => format!("none: nothing holds particles {} against their load", ranges(&found.falling)),
        Stability::NotConverged => "not-converged: forces are left".into(),
    }
}

/// An equilibrium in words.
pub fn equilibrium_text(scene: &str, found: &Equilibrium, path: Option<&LoadPath>) -> String {
    let mut text = format!("{scene}: {}\n", verdict(found));
    let _ = writeln!(text, "  largest force left    {} of the largest that acts", pretty(found.residual));
    if found.stability == Stability::Indifferent {
        let _ = writeln!(text, "  free motions          sprung mechanisms names them");
    }
    let _ = writeln!(text, "  energy                {} J", pretty(found.energy));
    let solves = match found.counted {
        true => count(found.work.factorizations, "factorization"),
        false => count(found.work.cg_iterations, "iteration of conjugate gradients"),
    };
    let _ = writeln!(text, "  work                  {}, {solves}", count(found.iterations, "Newton step"));
    for CriticalLoad { factor, kind, .. } in path.iter().flat_map(|path| &path.critical) {
        let _ = writeln!(text, "  critical load         {factor:.9} of the full load: {}", kind.name());
    }
    if let Some(factor) = path.and_then(|path| path.linear_buckling) {
        let _ = writeln!(text, "  linear buckling       {factor:.6} of the full load: an estimate");
    }
    text
}

/// Numbers with runs of neighbours as ranges, at most six of them.
fn ranges(numbers: &[usize]) -> String {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for &number in numbers {
        match runs.last_mut() {
            Some([_, last]) if *last + 1 == number => *last = number,
            _ => runs.push([number, number]),
        }
    }
    let range =
        |&[first, last]: &[usize; 2]| if first == last { first.to_string() } else { format!("{first}–{last}") };
    list(runs.iter().take(6), range).join(", ") + if runs.len() > 6 { ", …" } else { "" }
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

/// Parts, motions and springs that are listed.
const LISTED: usize = 20;

/// Out of balance by more than this a state is no equilibrium.
const BALANCED: f64 = 1e-6;

/// The parts that move as a whole, and those that hang by one spring, in words.
fn parts_remarks(found: &Modes) -> Vec<String> {
    let name = |part: &Vec<usize>| if part.len() == 1 { "particle" } else { "particles" };
    let mut remarks = Vec::new();
    if !found.parts.is_empty() {
        let parts: Vec<String> = found.parts.iter().take(LISTED).map(|part| ranges(part)).collect();
        let (verb, more) = match found.parts.len() {
            1 => ("moves", ""),
            n => ("move", if n > LISTED { "; …" } else { "" }),
        };
        remarks.push(format!(
            "{} {verb} freely: {} {}{more}",
            count(found.parts.len(), "loose part"),
            if let [part] = &found.parts[..] { name(part) } else { "particles" },
            parts.join("; ")
        ));
    }
    for part in found.hanging.iter().take(LISTED) {
        let verb = if part.len() == 1 { "hangs" } else { "hang" };
        remarks.push(format!("{} {} {verb} by one spring", name(part), ranges(part)));
    }
    if found.hanging.len() > LISTED {
        remarks.push(format!("… and {} more", found.hanging.len() - LISTED));
    }
    remarks
}

/// A number in a table; below `rounding` it is zero.
fn scientific(value: f64, rounding: f64) -> String {
    if value.abs() < rounding || value == 0.0 { "0".into() } else { format!("{value:.3e}") }
}

/// Normal modes as a table.
pub fn modes_text(scene: &str, at: &str, system: &System, found: &Modes) -> String {
    let (dimension, mass_in_all) = (system.dimension(), system.masses().iter().sum::<f64>());
    let mut text = format!("{scene}, at {at}: {}\n", count(found.modes.len(), "mode"));
    if found.imbalance > BALANCED {
        let what = format!("{} of the largest force is not balanced", pretty(found.imbalance));
        let _ = writeln!(text, "  not an equilibrium: {what}; --at equilibrium finds one");
    }
    match found.zero_count {
        Some(0) => {}
        Some(zeros) => {
            let others = zeros.saturating_sub(found.rigid_motions);
            let [all, rigid, others] =
                [(zeros, "zero mode"), (found.rigid_motions, "rigid motion"), (others, "mechanism")]
                    .map(|(n, of)| count(n, of));
            let above = if found.zero_modes.is_empty() { "; above the modes asked for" } else { "" };
            let _ = writeln!(text, "  {all}: {rigid}, {others}{above}");
        }
        None => text += "  zero modes: not counted; above the modes asked for\n",
    }
    for remark in parts_remarks(found) {
        let _ = writeln!(text, "  {remark}");
    }
    let _ = write!(text, "\n  {:>4} {:>12} {:>12} {:>10}", "mode", "Hz", "period, s", "damping");
    for axis in &["x", "y", "z"][..dimension] {
        let _ = write!(text, " {:>10}", format!("mass {axis}, kg"));
    }
    let _ = writeln!(text, " {:>10}", "residual");
    for (number, mode) in found.modes.iter().enumerate() {
        let [frequency, period] = match (mode.frequency(), mode.growth_rate()) {
            (Some(frequency), _) => [format!("{frequency:.6}"), format!("{:.6}", frequency.recip())],
            (None, rate) => ["grows".into(), format!("{:.3e} /s", rate.unwrap_or(f64::NAN))],
        };
        let damping = mode.damping_ratio.map_or("-".into(), |ratio| scientific(ratio, 1e-15));
        let _ = write!(text, "  {:>4} {frequency:>12} {period:>12} {damping:>10}", number + 1);
        for mass in &mode.effective_mass[..dimension] {
            let _ = write!(text, " {:>10}", scientific(*mass, 1e-12 * mass_in_all));
        }
        let _ = writeln!(text, " {:>10.1e}", mode.residual / mode.eigenvalue.abs().max(f64::MIN_POSITIVE));
    }
    let certainty = if found.proven { "proven" } else { "to rounding" };
    let end: String = match (found.complete, found.counted_below) {
        (false, _) => "\n  not counted: modes may be missing\n".into(),
        (true, f64::INFINITY) => "\n  complete: no coordinate is free\n".into(),
        (true, below) => format!(
            "\n  complete: a factorization counts the eigenvalues below {below:.6e} 1/s², and none is missing ({certainty})\n"
        ),
    };
    text + &end
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
    let _ = writeln!(text, "  rank {} of {springs} on {freedoms} ({})", found.rank, certainty(found));
    if found.rank + found.self_stresses > found.springs {
        text += "  springs of zero length resist in every direction: each counts as one for every axis\n";
    }
    let _ = writeln!(text, "  {}", count(found.self_stresses, "state of self-stress"));
    if !found.decided {
        let [kept, dropped] = found.gap.map(pretty);
        let what = format!("singular values of {kept} and {dropped}");
        let _ = writeln!(text, "  undecided: {what} are too close to the limit of rounding");
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
    for movers in found.movers.iter().take(LISTED) {
        let particles = if movers.len() == 1 { "particle" } else { "particles" };
        let _ = writeln!(text, "  moves: {particles} {}", ranges(movers));
    }
    if found.movers.len() > LISTED {
        let _ = writeln!(text, "  … and {} more", found.movers.len() - LISTED);
    }
    if !found.added_springs.is_empty() {
        let added = found.added_springs.len();
        let pairs = list(found.added_springs.iter().take(LISTED), |[i, j]| format!("{i}–{j}")).join(", ");
        let more = if added > LISTED { ", …" } else { "" };
        let springs = format!("{} between {pairs}{more}", count(added, "spring"));
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

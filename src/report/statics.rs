//! Equilibria, normal modes and mechanisms as JSON, text and pages.

mod html;

pub use html::{buckling_motions, load_path_animation, load_path_plot, mechanism_motions, mode_motions};

use super::number::{count, pretty};
use crate::equilibrium::{Equilibrium, Signs, Stability};
use crate::mechanisms::Mechanisms;
use crate::modes::{Mode, Modes};
use serde::Serialize;
use std::fmt::Write;

/// Numbers of eigenvalues by sign.
#[derive(Debug, Clone, Copy, Serialize)]
struct SignsRecord {
    negative: usize,
    zero: usize,
    positive: usize,
}

impl From<Signs> for SignsRecord {
    fn from(Signs { negative, zero, positive }: Signs) -> Self {
        Self { negative, zero, positive }
    }
}

/// An equilibrium as it is written to JSON; a number that is not finite becomes `null`.
#[derive(Debug, Clone, Serialize)]
pub struct EquilibriumRecord<'a> {
    scene: &'a str,
    status: &'static str,
    residual: f64,
    energy: f64,
    iterations: usize,
    inertia: SignsRecord,
    counted: bool,
    lowest_eigenvalue: Option<f64>,
    falling: &'a [usize],
    critical_loads: Vec<f64>,
    critical_kinds: Vec<&'static str>,
    factorizations: u64,
    linear_buckling: Option<f64>,
    time: f64,
    positions: Vec<Vec<f64>>,
    velocities: Vec<Vec<f64>>,
}

impl<'a> EquilibriumRecord<'a> {
    /// Of a scene by its name, in so many dimensions, with the load factors at which its inertia changes and what happens there. Time, positions
    /// and velocities are those of a state at rest, as a `final.json` has them.
    pub fn new(scene: &'a str, dimension: usize, found: &'a Equilibrium, critical: &[(f64, &'static str)]) -> Self {
        Self {
            scene,
            status: found.stability.name(),
            residual: found.residual,
            energy: found.energy,
            iterations: found.iterations,
            inertia: found.inertia.into(),
            counted: found.counted,
            lowest_eigenvalue: found.lowest.as_ref().map(|(value, _)| *value),
            falling: &found.falling,
            critical_loads: critical.iter().map(|(factor, _)| *factor).collect(),
            critical_kinds: critical.iter().map(|(_, kind)| *kind).collect(),
            factorizations: found.work.factorizations,
            linear_buckling: None,
            time: found.state.time,
            positions: found.state.positions.iter().map(|x| x.as_slice()[..dimension].to_vec()).collect(),
            velocities: vec![vec![0.0; dimension]; found.state.positions.len()],
        }
    }

    /// With the first critical load by linear buckling.
    pub fn with_linear_buckling(self, linear_buckling: Option<f64>) -> Self {
        Self { linear_buckling, ..self }
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
pub fn equilibrium_text(scene: &str, found: &Equilibrium, critical: &[(f64, &'static str)]) -> String {
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
    for (factor, kind) in critical {
        let _ = writeln!(text, "  critical load         {factor:.9} of the full load: {kind}");
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
#[derive(Debug, Clone, Serialize)]
pub struct ModesRecord<'a> {
    scene: &'a str,
    at: &'a str,
    zero_modes: usize,
    rigid_motions: usize,
    parts: &'a [Vec<usize>],
    hanging: &'a [Vec<usize>],
    eigenvalues: Vec<f64>,
    frequencies: Vec<Option<f64>>,
    damping_ratios: Vec<Option<f64>>,
    effective_masses: Vec<[f64; 3]>,
    residuals: Vec<f64>,
    error_bounds: Vec<f64>,
    gap: [f64; 2],
    imbalance: f64,
    complete: bool,
    proven: bool,
    counted_below: f64,
}

impl<'a> ModesRecord<'a> {
    /// Of a scene by its name, at a state in words.
    pub fn new(scene: &'a str, at: &'a str, found: &'a Modes) -> Self {
        let modes = || found.modes.iter();
        Self {
            scene,
            at,
            zero_modes: found.zero_modes.len(),
            rigid_motions: found.rigid_motions,
            parts: &found.parts,
            hanging: &found.hanging,
            eigenvalues: modes().map(|mode| mode.eigenvalue).collect(),
            frequencies: modes().map(Mode::frequency).collect(),
            damping_ratios: modes().map(|mode| mode.damping_ratio).collect(),
            effective_masses: modes().map(|mode| mode.effective_mass).collect(),
            residuals: modes().map(|mode| mode.residual).collect(),
            error_bounds: modes().map(|mode| mode.error_bound).collect(),
            gap: found.gap,
            imbalance: found.imbalance,
            complete: found.complete,
            proven: found.proven,
            counted_below: found.counted_below,
        }
    }
}

/// Out of balance by more than this a state is no equilibrium.
const BALANCED: f64 = 1e-6;

/// The parts that move as a whole, and those that hang by one spring, in words.
fn parts_remarks(found: &Modes) -> Vec<String> {
    /// Parts named at most.
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

/// Normal modes as a table.
pub fn modes_text(scene: &str, at: &str, dimension: usize, found: &Modes) -> String {
    let mut text = format!("{scene}, at {at}: {}\n", count(found.modes.len(), "mode"));
    if found.imbalance > BALANCED {
        let part = pretty(found.imbalance);
        let _ = writeln!(
            text,
            "  not an equilibrium: {part} of the largest force is not balanced; --at equilibrium finds one"
        );
    }
    let zeros = found.zero_modes.len();
    if zeros > 0 {
        let others = zeros.saturating_sub(found.rigid_motions);
        let _ = writeln!(
            text,
            "  {}: {}, {}",
            count(zeros, "zero mode"),
            count(found.rigid_motions, "rigid motion"),
            count(others, "mechanism")
        );
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
        let damping = mode.damping_ratio.map_or("-".into(), |ratio| format!("{ratio:.3e}"));
        let _ = write!(text, "  {:>4} {frequency:>12} {period:>12} {damping:>10}", number + 1);
        mode.effective_mass[..dimension].iter().for_each(|mass| {
            let _ = write!(text, " {mass:>10.3e}");
        });
        let _ = writeln!(text, " {:>10.1e}", mode.residual / mode.eigenvalue.abs().max(f64::MIN_POSITIVE));
    }
    let _ = match found.complete {
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

/// Mechanisms as they are written to JSON; a number that is not finite becomes `null`.
#[derive(Debug, Clone, Serialize)]
pub struct MechanismsRecord<'a> {
    scene: &'a str,
    degrees_of_freedom: usize,
    springs: usize,
    rank: usize,
    mechanisms: usize,
    rigid_motions: usize,
    self_stresses: usize,
    gap: [f64; 2],
    decided: bool,
    proven: bool,
    proven_gap: [f64; 2],
    rank_is_exact: bool,
    prestress_stable: Option<bool>,
    movers: &'a [Vec<usize>],
    added_springs: &'a [[usize; 2]],
}

impl<'a> MechanismsRecord<'a> {
    /// Of a scene by its name.
    pub fn new(scene: &'a str, found: &'a Mechanisms) -> Self {
        let &Mechanisms { degrees_of_freedom, springs, rank, mechanisms, rigid_motions, self_stresses, gap, .. } =
            found;
        Self {
            scene,
            degrees_of_freedom,
            springs,
            rank,
            mechanisms,
            rigid_motions,
            self_stresses,
            gap,
            decided: found.decided,
            proven: found.proven,
            proven_gap: found.proven_gap,
            rank_is_exact: found.rank_is_exact,
            prestress_stable: found.prestress_stable,
            movers: &found.movers,
            added_springs: &found.added_springs,
        }
    }
}

/// The number of states of self-stress in words.
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
    let _ = writeln!(
        text,
        "  rank {} of {springs} on {} ({})",
        found.rank,
        freedoms.replace("degree of freedoms", "degrees of freedom"),
        certainty(found)
    );
    let _ = writeln!(text, "  {}", self_stresses(found));
    if !found.decided {
        let [kept, dropped] = found.gap.map(pretty);
        let _ = writeln!(
            text,
            "  undecided: singular values of {kept} and {dropped} are too close to the limit of rounding"
        );
    }
    match found.prestress_stable {
        Some(true) => text += "  prestress stiffens all of them\n",
        Some(false) if others > 0 => text += "  prestress does not stiffen all of them\n",
        _ => {}
    }
    for movers in found.movers.iter().take(20) {
        let _ = writeln!(text, "  moves: particles {}", ranges(movers));
    }
    if found.movers.len() > 20 {
        let _ = writeln!(text, "  … and {} more", found.movers.len() - 20);
    }
    if !found.added_springs.is_empty() {
        let pairs = found.added_springs.iter().take(20).map(|[i, j]| format!("{i}–{j}")).collect::<Vec<_>>().join(", ");
        let [added, needed] = [found.added_springs.len(), others];
        let claim = if added == needed { "the fewest that do" } else { "some mechanisms are left" };
        let _ = writeln!(text, "  removed by {} between {pairs}: {claim}", count(added, "spring"));
    }
    text
}

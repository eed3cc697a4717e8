//! Normal modes, mechanisms and load paths as what pages show.

use super::{BALANCED, all, parts_remarks, ranges};
use crate::equilibrium::{CriticalLoad, Equilibrium, LoadPath, Stability};
use crate::figure::{Animation, Axis, Guide, Plot, SceneTopology, Series, Track};
use crate::mechanisms::Mechanisms;
use crate::modes::{Mode, Modes};
use crate::report::list;
use crate::report::number::{count, pretty};
use crate::report::view::{Motion, Motions};
use crate::system::System;
use nalgebra::Vector3;

/// Normal modes, zero modes first.
pub fn mode_motions(scene: &str, at: &str, system: &System, found: &Modes) -> Motions {
    let dimension = system.dimension();
    let mut movable = [0.0; 3];
    for (p, mass) in system.masses().iter().enumerate() {
        system.dofs().free_axes(p).iter().for_each(|axis| movable[axis] += mass);
    }
    let axes = &["x", "y", "z"][..dimension];
    let columns = ["Hz", "period, s", "damping"].map(String::from).into_iter();
    let columns = columns.chain(axes.iter().map(|axis| format!("mass {axis}, %"))).collect();
    let motion = |name: String, mode: &Mode, is_zero: bool| {
        let ([frequency, period], remark) = match (is_zero, mode.frequency(), mode.growth_rate()) {
            (true, ..) => (["0".into(), "∞".into()], "moves without resistance".into()),
            (_, Some(frequency), _) => {
                let remark = format!("{} Hz, a period of {} s", pretty(frequency), pretty(frequency.recip()));
                ([pretty(frequency), pretty(frequency.recip())], remark)
            }
            (_, None, rate) => {
                let rate = pretty(rate.unwrap_or(f64::NAN));
                (["grows".into(), format!("{rate} /s")], format!("grows as exp({rate} t/s)"))
            }
        };
        let damping = if is_zero { None } else { mode.damping_ratio };
        let part = |(mass, all): (&f64, &f64)| match 100.0 * mass / all {
            part if part < 0.05 => "0".into(),
            part => format!("{part:.1}"),
        };
        let masses = mode.effective_mass[..dimension].iter().zip(&movable).map(part);
        let cells = [frequency, period, damping.map_or("–".into(), pretty)].into_iter().chain(masses).collect();
        Motion { name, cells, remark, shape: found.shape(mode) }
    };
    let zeros = found.zero_modes.iter().enumerate().map(|(k, mode)| motion(format!("zero {}", k + 1), mode, true));
    let others = found.modes.iter().enumerate().map(|(k, mode)| motion(format!("mode {}", k + 1), mode, false));
    let first = if found.modes.is_empty() { 0 } else { found.zero_modes.len() };
    let zero_modes = match (found.zero_count, found.zero_modes.len()) {
        (None, _) => "zero modes that were not counted".into(),
        (Some(zeros), shown) if shown < zeros => count(zeros, "zero mode") + ", above the modes asked for,",
        (Some(zeros), _) => count(zeros, "zero mode"),
    };
    let mut facts = vec![format!("At {at}: {zero_modes} and {}.", count(found.modes.len(), "mode"))];
    let remarks = parts_remarks(found);
    if !remarks.is_empty() {
        facts.push(format!("By parts: {}.", remarks.join("; ")));
    }
    let mut warnings = Vec::new();
    if found.complete && found.counted_below == f64::INFINITY {
        facts.push("No coordinate is free.".into());
    } else if found.complete {
        let below = pretty(found.counted_below);
        let certainty =
            if found.proven { "A bound of all rounding errors proves it." } else { "It holds to rounding." };
        facts.push(format!("A factorization counts the eigenvalues below {below} 1/s²: none is missing. {certainty}"));
    } else {
        warnings.push("The eigenvalues were not counted: modes may be missing.".into());
    }
    if found.imbalance > BALANCED {
        let part = pretty(found.imbalance);
        warnings.push(format!("The state is no equilibrium: {part} of the largest force is not balanced."));
    }
    let growing = found.modes.iter().filter(|mode| mode.eigenvalue < 0.0).count();
    if growing > 0 {
        warnings.push(format!("The state is unstable: {} with a negative ω².", count(growing, "growing mode")));
    }
    let motions = zeros.chain(others).collect();
    Motions { title: format!("Modes of {scene}"), facts, warnings, columns, motions, first }
}

/// Mechanisms besides rigid motions.
pub fn mechanism_motions(scene: &str, found: &Mechanisms) -> Motions {
    let motion = |(k, (vector, movers)): (usize, (&Vec<f64>, &Vec<usize>))| Motion {
        name: format!("motion {}", k + 1),
        cells: vec![movers.len().to_string(), ranges(movers)],
        remark: format!("moves {}", count(movers.len(), "particle")),
        shape: found.shape(vector),
    };
    let motions = found.motions.iter().zip(&found.movers).enumerate().map(motion).collect();
    let others = found.mechanisms.saturating_sub(found.rigid_motions);
    let [mechanisms, rigid] = [count(others, "mechanism"), count(found.rigid_motions, "rigid motion")];
    let self_stresses = count(found.self_stresses, "state of self-stress");
    let mut facts = vec![
        format!("{mechanisms} beside {rigid}; {self_stresses}."),
        "Small motions stretch no spring. Drawn large they are straight, and stretch springs that turn.".into(),
    ];
    if let Some(is_stable) = found.prestress_stable {
        let stiffens = if is_stable { "stiffens" } else { "does not stiffen" };
        facts.push(format!("Prestress {stiffens} {}.", all(others)));
    }
    let mut warnings = Vec::new();
    if !found.decided {
        warnings.push("A singular value is too close to the limit of rounding: the rank is not certain.".into());
    }
    if found.motions.len() < others {
        warnings.push(format!("{} of {others} were computed.", found.motions.len()));
    }
    let columns = ["particles", "which"].map(String::from).into();
    Motions { title: format!("Mechanisms of {scene}"), facts, warnings, columns, motions, first: 0 }
}

/// The direction in which a path loses its stiffness first; nothing where it never does.
pub fn buckling_motions(scene: &str, system: &System, path: &LoadPath) -> Motions {
    let motion = |critical: &CriticalLoad| {
        let mut shape = vec![Vector3::zeros(); system.particles()];
        system.dofs().scatter(&critical.direction, &mut shape);
        let remark = format!("{} at {} of the full load", critical.kind.name(), pretty(critical.factor));
        Motion { name: critical.kind.name().into(), cells: vec![pretty(critical.factor)], remark, shape }
    };
    let fact = "The direction in which −K is singular at the first critical load, about the equilibrium there.";
    Motions {
        title: format!("Buckling of {scene}"),
        facts: vec![fact.into()],
        warnings: Vec::new(),
        columns: vec!["load".into()],
        motions: path.critical.first().map(motion).into_iter().collect(),
        first: 0,
    }
}

/// The largest displacement from the first equilibrium of a path, for each of its equilibria.
fn displacements(path: &LoadPath) -> Vec<f64> {
    let start = path.steps.first().map(|(_, first)| first.state.positions.as_slice()).unwrap_or_default();
    list(&path.steps, |(_, found)| {
        found.state.positions.iter().zip(start).map(|(x, x0)| (x - x0).norm()).fold(0.0, f64::max)
    })
}

/// Displacements over the load, with the critical loads.
pub fn load_path_plot(scene: &str, path: &LoadPath) -> Plot {
    let is_stable = |found: &Equilibrium| matches!(found.stability, Stability::Stable | Stability::Indifferent);
    let of = |wanted: bool| {
        let steps = path.steps.iter().zip(displacements(path));
        let chosen = steps.filter(|((_, found), _)| is_stable(found) == wanted);
        chosen.map(|((factor, _), u)| (*factor, u)).collect::<Vec<_>>()
    };
    let (x, y) = (Axis::linear("part of the full load"), Axis::linear("largest displacement, m"));
    let mut plot = Plot::new(format!("Load path of {scene}"), x, y).with_series(Series::line("equilibria", of(true)));
    let unstable = of(false);
    if !unstable.is_empty() {
        plot = plot.with_series(Series::scatter("unstable, or not found", unstable));
    }
    let critical = path.critical.iter().map(|critical| (critical.kind.name(), critical.factor));
    let linear = path.linear_buckling.filter(|factor| *factor <= 2.0);
    for (name, x) in critical.chain(linear.map(|factor| ("linear buckling, an estimate,", factor))) {
        plot = plot.with_guide(Guide::Vertical { x, label: format!("{name} at {}", pretty(x)) });
    }
    plot
}

/// The equilibria of a path as frames over the load.
pub fn load_path_animation(scene: &str, topology: SceneTopology, path: &LoadPath) -> Animation {
    let mut animation = Animation::new(scene, topology);
    animation.clock = ["load", ""];
    let equilibria = count(path.steps.len(), "equilibrium").replace("equilibriums", "equilibria");
    animation.remarks = vec![format!("{equilibria} under rising load")];
    for critical in &path.critical {
        animation.remarks.push(format!("{} at {} of the full load", critical.kind.name(), pretty(critical.factor)));
    }
    for (factor, found) in &path.steps {
        animation.push(*factor, &found.state.positions);
    }
    let track = |title: &str, unit: &str, values: Vec<f64>| Track {
        title: title.into(),
        unit: unit.into(),
        times: animation.times.clone(),
        curves: vec![(title.into(), values)],
    };
    animation.tracks = vec![
        track("largest displacement", "m", displacements(path)),
        track("energy", "J", list(&path.steps, |(_, found)| found.energy)),
    ];
    animation
}

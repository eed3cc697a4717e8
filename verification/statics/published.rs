//! Frequencies that others published: a network of springs by ProDy, and a prestressed tensegrity by Muscle.

use super::caught;
use nalgebra::Vector3;
use serde::Deserialize;
use sprung::equilibrium::{EquilibriumOptions, equilibrium};
use sprung::mechanisms::mechanisms;
use sprung::modes::{Modes, modes};
use sprung::system::{Axes, Loads};
use sprung::{Constraint, Spring, State, System, SystemBuilder};
use std::fmt::Write;

/// `ubiquitin.json`, made by `ubiquitin.py`: positions in Å, all springs of 1 N/m.
#[derive(Deserialize)]
struct Network {
    positions: Vec<[f64; 3]>,
    pairs: Vec<[usize; 2]>,
    /// All but the six zeros, by ProDy.
    eigenvalues: Vec<f64>,
    /// The lowest, in five digits.
    published: Vec<f64>,
}

impl Network {
    fn read() -> Self {
        serde_json::from_str(include_str!("ubiquitin.json")).expect("the file is part of the program")
    }

    fn modes(&self) -> sprung::Result<Modes> {
        let mut builder = SystemBuilder::new();
        for &x in &self.positions {
            builder.particle(x, 1.0);
        }
        for &[i, j] in &self.pairs {
            let length =
                (0..3).map(|axis| (self.positions[i][axis] - self.positions[j][axis]).powi(2)).sum::<f64>().sqrt();
            builder.spring(i, j, Spring { stiffness: length, rest_length: length, damping: 0.0 });
        }
        let (system, state) = builder.build()?;
        modes(&system, &state, self.eigenvalues.len())
    }
}

fn largest_error(found: &Modes, known: &[f64]) -> f64 {
    let missing = found.zero_modes.len() != 6 || found.modes.len() < known.len() || !found.complete;
    let errors = found.modes.iter().zip(known).map(|(mode, known)| (mode.eigenvalue / known - 1.0).abs());
    if missing { f64::INFINITY } else { errors.fold(0.0, f64::max) }
}

/// Errors of all 222 eigenvalues over what the interval that is proven leaves.
fn outside(found: &Modes, known: &[f64]) -> f64 {
    // ProDy's dense solver is right to some units in the last place of the largest.
    let rounding = 1e-13 * known.last().copied().unwrap_or(1.0);
    let used =
        found.modes.iter().zip(known).map(|(m, known)| (m.eigenvalue - known).abs() / (m.error_bound + rounding));
    if found.proven { used.fold(0.0, f64::max) } else { f64::INFINITY }
}

/// A tensegrity simplex of three struts and nine cables under its weight, prestressed to 1.5 kN by struts that are 0.717 mm longer: the
/// experimental structure of J. Feron (UCLouvain), as the tests of his program hold it (github.com/JonasFeron/Muscle, `TestDynamicSimplex`,
/// MIT licence): positions in mm, Young's moduli in MPa, areas in mm², masses at the ends.
fn simplex() -> sprung::Result<(System, State)> {
    const PLACES: [[f64; 3]; 6] = [
        [0.0, -2043.8, 0.0],
        [0.0, 0.0, 0.0],
        [1770.0, -1021.9, 0.0],
        [590.0, -2201.9, 1950.0],
        [-431.9, -431.9, 1950.0],
        [1611.9, -431.9, 1950.0],
    ];
    const BARS: [[usize; 2]; 12] =
        [[2, 4], [1, 3], [0, 5], [1, 2], [0, 1], [0, 2], [4, 5], [3, 4], [3, 5], [2, 5], [1, 4], [0, 3]];
    let mut masses = [2.642, 2.642, 2.642, 3.06, 3.06, 3.06];
    for (bar, ends) in BARS.iter().enumerate() {
        ends.iter().for_each(|&end| masses[end] += 0.5 * if bar < 3 { 2.63 } else { 0.502 });
    }
    let mut builder = SystemBuilder::new();
    for (place, mass) in PLACES.iter().zip(masses) {
        builder.particle(place.map(|x| x / 1000.0), mass);
    }
    for (bar, &[i, j]) in BARS.iter().enumerate() {
        let length = (0..3).map(|axis| (PLACES[i][axis] - PLACES[j][axis]).powi(2)).sum::<f64>().sqrt() / 1000.0;
        let (stiffness, longer) = match bar {
            0..3 => (70_390.0 * 364.4, 0.717e-3),
            3..9 => (71_750.0 * 50.3, 0.0),
            _ => (72_190.0 * 50.3, 0.0),
        };
        builder.spring(i, j, Spring { stiffness, rest_length: length + longer, damping: 0.0 });
    }
    for (particle, axes) in [(0, &[0, 2][..]), (1, &[0, 1, 2]), (2, &[2])] {
        builder.constraints.push(Constraint { axes: Axes::of(axes), ..Constraint::hold([particle]) });
    }
    let (system, state) = builder.build()?;
    let weights = [45.7, 45.7, 45.7, 50.3, 50.3, 50.3].map(|weight| Vector3::new(0.0, 0.0, -weight));
    Ok((system.with_loads(Loads { forces: weights.to_vec(), ..Loads::default() })?, state))
}

/// The lowest frequency with lumped masses in Hz, in the digits that are given, and the mean force of the struts in N, to 1 N.
const LUMPED: [f64; 2] = [2.166, 0.001];
const STRUTS: [f64; 2] = [-1500.0, 1.0];
/// Its mode, the mechanism of the structure, in three digits of its largest component.
const MECHANISM: [[f64; 3]; 3] = [[3.3, 0.0, -1.0], [-1.7, -2.9, -1.0], [-1.7, 2.9, -1.0]];

/// Errors of the frequency, the force and the mode, over what is allowed.
fn prestressed() -> sprung::Result<[f64; 3]> {
    let (system, state) = simplex()?;
    let found = equilibrium(&system, &state, EquilibriumOptions::default())?;
    let at = sprung::force::SpringGeometry::at(&system, &found.state)?;
    let tensions: Vec<f64> =
        at.springs(&system).map(|((_, _, spring), at)| spring.stiffness * spring.strain(at)).collect();
    let struts = tensions[..3].iter().sum::<f64>() / 3.0;
    let modes = modes(&system, &found.state, 1)?;
    let is_known = modes.proven && mechanisms(&system, &state)?.mechanisms == 1;
    let frequency = modes.modes[0].frequency().filter(|_| is_known).unwrap_or(f64::NAN);
    let shape = modes.shape(&modes.modes[0]);
    let shape: Vec<f64> = shape[3..].iter().flat_map(|u| u.iter().copied().collect::<Vec<_>>()).collect();
    let known = MECHANISM.concat();
    let length = |u: &[f64]| u.iter().map(|u| u * u).sum::<f64>().sqrt();
    let cosine = shape.iter().zip(&known).map(|(a, b)| a * b).sum::<f64>() / length(&shape) / length(&known);
    let over = |value: f64, [known, allowed]: [f64; 2]| (value - known).abs() / allowed;
    // Components to half of their last digit: an angle of about 0.15/5.8.
    Ok([over(frequency, LUMPED), over(struts, STRUTS), cosine.abs().acos() / 0.026])
}

/// A table, and what fails.
pub fn table() -> (String, Vec<String>) {
    let network = Network::read();
    let found = caught(|| network.modes());
    let of_network = |error: &dyn Fn(&Modes) -> f64| found.as_ref().map(error).map_err(String::clone);
    let of_simplex = caught(prestressed);
    let of_simplex = |k: usize| of_simplex.as_ref().map(|used| used[k]).map_err(String::clone);
    let cases = [
        (
            "1UBI, ProDy",
            "222 eigenvalues of its elastic network, relative",
            1e-10,
            of_network(&|m| largest_error(m, &network.eigenvalues)),
        ),
        (
            "1UBI, ProDy",
            "their errors over the bounds that are proven here",
            1.0,
            of_network(&|m| outside(m, &network.eigenvalues)),
        ),
        (
            "1UBI, ProDy's tests",
            "30 eigenvalues in five digits, relative",
            5e-5,
            of_network(&|m| largest_error(m, &network.published)),
        ),
        ("simplex, Muscle", "lowest frequency at 1.5 kN, 2.166 Hz, over 0.001 Hz", 1.0, of_simplex(0)),
        ("simplex, Muscle", "force of the struts, −1500 N, over 1 N", 1.0, of_simplex(1)),
        ("simplex, Muscle", "mode, over half of the last digit", 1.0, of_simplex(2)),
    ];
    let mut text = String::from(
        "\nPublished by others: the elastic network of ubiquitin (`ubiquitin.json`), and a prestressed tensegrity whose lowest mode is a \
         mechanism that tension alone makes stiff (`published.rs`).\n\n| source | answer | largest error | allowed |\n|---|---|---|---|\n",
    );
    let mut failures = Vec::new();
    for (source, answer, allowed, error) in cases {
        match error {
            Ok(error) => {
                let _ = writeln!(text, "| {source} | {answer} | {error:.1e} | {allowed} |");
                if error.is_nan() || error > allowed {
                    failures.push(format!("{source}, {answer}: {error:e}"));
                }
            }
            Err(error) => failures.push(format!("{source}: {error}")),
        }
    }
    (text, failures)
}

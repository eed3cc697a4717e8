//! Published answers of the mass–spring cases of the *Guide de validation des progiciels de calcul de structures* (SFM, AFNOR 1990), as the
//! validation suite of code_aster holds them: reference values of `astest/sdld21a.comm`, `sdld23a.comm` and `sdld27a.comm` (EDF R&D, 2017
//! and 2019).

use super::caught;
use nalgebra::DMatrix;
use sprung::modes::modes;
use sprung::{Spring, State, System, SystemBuilder};
use std::f64::consts::TAU;
use std::fmt::Write;

/// Eight masses of 10 kg and nine springs of 1e5 N/m between two walls, with dampers in N·s/m: code_aster, SDLD02.
pub fn chain_of_eight(dampers: [f64; 9]) -> sprung::Result<(System, State)> {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    for p in 0..10 {
        builder.particle([f64::from(p), 0.0, 0.0], 10.0);
    }
    for (p, damping) in dampers.into_iter().enumerate() {
        builder.spring(p, p + 1, Spring { stiffness: 1e5, rest_length: 1.0, damping });
    }
    builder.hold(0).hold(9);
    builder.build()
}

/// SDLD21: dampers of 50 N·s/m; the displacement of the fourth mass in m under 1 N on it, `u e^{iωt}`, at frequencies in Hz. Five digits.
const RESPONSE: [[f64; 3]; 18] = [
    [5.0, 1.0237e-4, -8.5187e-6],
    [5.5, 4.5066e-4, -7.7914e-4],
    [6.0, -9.4101e-5, -1.0585e-5],
    [6.5, -4.1390e-5, -2.6083e-6],
    [7.0, -2.4232e-5, -1.2233e-6],
    [7.5, -1.5691e-5, -7.6742e-7],
    [8.0, -1.0509e-5, -5.8171e-7],
    [8.5, -6.9343e-6, -5.1279e-7],
    [9.0, -4.1841e-6, -5.2213e-7],
    [9.5, -1.7756e-6, -6.3356e-7],
    [10.0, 8.4143e-7, -1.0335e-6],
    [10.5, 5.1880e-6, -3.4375e-6],
    [11.0, -7.3293e-6, -1.2167e-5],
    [11.5, -3.5611e-6, -1.8100e-6],
    [12.0, -7.0575e-7, -9.6206e-7],
    [12.5, 1.1006e-6, -8.4775e-7],
    [13.0, 2.6424e-6, -9.3448e-7],
    [40.0, -2.5696e-6, -2.7554e-7],
];

/// SDLD27: the first damper of 250 N·s/m, the last of 25, the others of 50; damped frequencies in Hz and damping ratios, to four digits.
const COMPLEX: [[f64; 2]; 8] = [
    [5.53, 0.01521],
    [10.9, 0.02877],
    [15.93, 0.0396],
    [20.45, 0.04709],
    [24.34, 0.05098],
    [27.49, 0.05183],
    [29.84, 0.05115],
    [31.29, 0.05036],
];

/// SDLD23: dampers of 50 N·s/m, a force of constant spectral density from 3 to 13 Hz on the fourth mass: moments `2 ∫ ωᵏ |H|² df` of its
/// displacement, k = 0 to 4, 6 and 8, in steps of 0.025 Hz.
const MOMENTS: [(i32, f64); 7] = [
    (0, 3.170082e-7),
    (1, 1.0960802e-5),
    (2, 3.803552e-4),
    (3, 0.013252838),
    (4, 0.46431974),
    (6, 588.14036),
    (8, 8.2881638e5),
];

/// Relative errors that the cases themselves allow; those of damping ratios twice as large.
const ALLOWED: f64 = 1e-3;

fn responses(frequencies: &[f64]) -> sprung::Result<Vec<[f64; 2]>> {
    let (system, state) = chain_of_eight([50.0; 9])?;
    let found = modes(&system, &state, 8)?;
    let mut force = [0.0; 8];
    force[3] = 1.0;
    let all = found.harmonic_response(&force, frequencies)?;
    Ok(all.iter().map(|x| [x[3].re, x[3].im]).collect())
}

/// The largest error of a response, over its amplitude.
fn sdld21() -> sprung::Result<f64> {
    let found = responses(&RESPONSE.map(|[frequency, ..]| frequency))?;
    let error = |([re, im], [_, x, y]): (&[f64; 2], [f64; 3])| (re - x).hypot(im - y) / x.hypot(y);
    Ok(found.iter().zip(RESPONSE).map(error).fold(0.0, f64::max))
}

/// The largest relative error of a moment.
fn sdld23() -> sprung::Result<f64> {
    let step = 0.025;
    let frequencies: Vec<f64> = (0..=400).map(|k| 3.0 + step * f64::from(k)).collect();
    let density: Vec<f64> = responses(&frequencies)?.iter().map(|[re, im]| re * re + im * im).collect();
    let moment = |power: i32| {
        let value = |k: usize| density[k] * (TAU * frequencies[k]).powi(power);
        2.0 * step * (1..400).map(value).sum::<f64>() + step * (value(0) + value(400))
    };
    Ok(MOMENTS.iter().map(|&(power, known)| (moment(power) / known - 1.0).abs()).fold(0.0, f64::max))
}

/// The largest relative errors of frequencies and damping ratios: eigenvalues of the state space of all modes.
fn sdld27() -> sprung::Result<[f64; 2]> {
    let mut dampers = [50.0; 9];
    (dampers[0], dampers[8]) = (250.0, 25.0);
    let (system, state) = chain_of_eight(dampers)?;
    let a: DMatrix<f64> = modes(&system, &state, 8)?.state_space(&[0], &[0])?.a;
    let mut values: Vec<_> = a.complex_eigenvalues().iter().copied().filter(|value| value.im > 0.0).collect();
    values.sort_by(|a, b| a.im.total_cmp(&b.im));
    let mut errors = if values.len() == 8 { [0.0; 2] } else { [f64::INFINITY; 2] };
    for (value, [frequency, ratio]) in values.iter().zip(COMPLEX) {
        let found = [value.im / TAU / frequency, -value.re / value.re.hypot(value.im) / ratio];
        errors = [0, 1].map(|k| f64::max(errors[k], (found[k] - 1.0).abs()));
    }
    Ok(errors)
}

/// A table, and what fails.
pub fn table() -> (String, Vec<String>) {
    let mut text = String::from(
        "\nMass–spring cases of the SFM's guide of validation, with the reference values of code_aster (`astest/sdld21a.comm`, `sdld23a.comm`, `sdld27a.comm`). The chain of SDLD02 with dampers; the errors are \
         those that the digits of the references leave.\n\n| case | answer | largest relative error | allowed by the case |\n|---|---|---|---|\n",
    );
    let cases = [
        ("SDLD21", "harmonic response at 18 frequencies, complex", ALLOWED, caught(sdld21)),
        ("SDLD23", "spectral moments 0 to 4, 6, 8 of a random response", ALLOWED, caught(sdld23)),
        ("SDLD27", "damped frequencies of eight complex modes", ALLOWED, caught(|| Ok(sdld27()?[0]))),
        ("SDLD27", "their damping ratios", 2.0 * ALLOWED, caught(|| Ok(sdld27()?[1]))),
    ];
    let mut failures = Vec::new();
    for (case, answer, allowed, error) in cases {
        match error {
            Ok(error) => {
                let _ = writeln!(text, "| {case} | {answer} | {error:.1e} | {allowed} |");
                if error.is_nan() || error > allowed {
                    failures.push(format!("{case}, {answer}: error {error:e}"));
                }
            }
            Err(error) => failures.push(format!("{case}: {error}")),
        }
    }
    (text, failures)
}

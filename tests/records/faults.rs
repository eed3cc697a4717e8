//! What the checks say of planted faults, each in one entry, one spring, one term or everywhere.

#[path = "../common/faulty.rs"]
mod faulty;

use crate::record::{Row, beside, hold};
use faulty::Faulty;
use nalgebra::Matrix3;
use nalgebra_sparse::CscMatrix;
use sprung::integrate::StepMatrices;
use sprung::spring::Extension;
use sprung::verify::*;
use sprung::{Spring, Stiffness, SystemBuilder};

/// Particles without any symmetry, one held, springs stretched and compressed, two of them between the same particles.
fn crooked() -> Subject {
    let mut builder = SystemBuilder::new();
    for (p, x) in
        [[0.0, 0.0, 0.0], [1.1, 0.2, -0.1], [0.3, 0.9, 0.4], [0.5, 0.4, 1.2], [1.4, 1.3, 0.8]].into_iter().enumerate()
    {
        let at = builder.particle(x, 0.4 + 0.3 * ((p * 3) % 5) as f64);
        builder.velocities[at] = [0.3 * p as f64, -0.2, 0.1 * (p * p) as f64].into();
    }
    let links = [(0, 1, 90.0, 0.9), (0, 2, 130.0, 1.3), (1, 2, 55.0, 1.0), (0, 3, 200.0, 1.6), (3, 1, 75.0, 1.2)];
    for (i, j, stiffness, rest_length) in
        links.into_iter().chain([(2, 3, 310.0, 0.6), (4, 2, 40.0, 1.9), (2, 4, 8.0, 0.7)])
    {
        builder.spring(i, j, Spring { stiffness, rest_length, damping: 0.5 + 0.01 * stiffness });
    }
    builder.velocities[0] = [0.0; 3].into();
    builder.hold(0);
    let (system, state) = builder.build().unwrap();
    Subject { name: "crooked".into(), system, state, dt: 0.01 }
}

/// The same without the spring, or with a weaker one.
fn with_spring(spring: usize, factor: f64) -> Subject {
    let mut other = crooked();
    let mut builder = SystemBuilder::new();
    for (x, m) in other.state.positions.iter().zip(other.system.masses()) {
        builder.particle([x.x, x.y, x.z], *m);
    }
    for (s, (&[i, j], of)) in other.system.pairs().iter().zip(other.system.springs()).enumerate() {
        let stiffness = if s == spring { factor * of.stiffness } else { of.stiffness };
        builder.spring(i as usize, j as usize, Spring { stiffness, ..*of });
    }
    builder.hold(0);
    (other.system, other.state) = builder.build().unwrap();
    other
}

fn matrix(subject: &Subject, option: Stiffness) -> CscMatrix<f64> {
    StepMatrices::assemble(&subject.system, &subject.state, option, 0.01).unwrap().k.to_csc()
}

type Fault = fn(usize, usize, f64) -> f64;

const FAULTS: [(&str, Fault); 10] = [
    ("none", |_, _, value| value),
    ("sign", |_, _, value| -value),
    ("twice", |_, _, value| 2.0 * value),
    ("a seventh more", |_, _, value| value * 8.0 / 7.0),
    ("one entry", |r, c, value| if (r, c) == (1, 5) { 1.01 * value } else { value }),
    ("one sign", |r, c, value| if (r, c) == (2, 4) { -value } else { value }),
    ("a block", |r, c, value| if r / 3 == 1 && c / 3 == 0 { 0.0 } else { value }),
    ("the diagonal", |r, c, value| if r == c { 0.98 * value } else { value }),
    ("half precision", |_, _, value| f64::from(value as f32)),
    ("no number", |r, c, value| if (r, c) == (4, 4) { f64::NAN } else { value }),
];

/// Matrices with faults, each with its name.
fn wrong(k: &CscMatrix<f64>) -> Vec<(String, CscMatrix<f64>)> {
    let mut all: Vec<(String, CscMatrix<f64>)> = Vec::new();
    for (name, fault) in FAULTS {
        let mut k = k.clone();
        k.triplet_iter_mut().for_each(|(row, column, value)| *value = fault(row, column, *value));
        all.push((name.into(), k));
    }
    let mut skew = k.clone();
    skew.triplet_iter_mut().for_each(|(row, column, value)| *value *= if row < column { 1.1 } else { 0.9 });
    all.push(("transposed".into(), skew.transpose()));
    all.push(("another size".into(), CscMatrix::zeros(3, 3)));
    all.push(("not square".into(), CscMatrix::zeros(11, 12)));
    all.push(("empty".into(), CscMatrix::zeros(k.nrows(), k.ncols())));
    all
}

/// Besides, those of other options and of other springs.
fn wrong_stiffnesses(subject: &Subject) -> Vec<(String, CscMatrix<f64>)> {
    let mut all = wrong(&matrix(subject, Stiffness::Full));
    for option in Stiffness::ALL {
        all.push((option.name().into(), matrix(subject, option)));
    }
    for (spring, factor) in [(1, 0.7), (5, 1.4), (3, 1e-9), (7, 3.0)] {
        all.push((format!("spring {spring} times {factor}"), matrix(&with_spring(spring, factor), Stiffness::Full)));
    }
    all
}

fn row(key: String, check: &Check) -> Row {
    let passed = (check.passed(), check.share());
    Row::of(key, &serde_json::to_value((check, passed)).unwrap())
}

fn rows(key: &str, checks: &[Check]) -> Vec<Row> {
    checks.iter().enumerate().map(|(number, check)| row(format!("{key} {number}"), check)).collect()
}

/// Every check of K by every matrix.
fn stiffness(name: &str, checks: fn(&Subject, &CscMatrix<f64>) -> Vec<Check>) {
    hold(name, |seed| {
        let subject = beside(&crooked(), seed);
        wrong_stiffnesses(&subject).iter().flat_map(|(fault, k)| rows(fault, &checks(&subject, k))).collect()
    });
}

#[test]
fn entries_by_differences() {
    stiffness("faults_entries", |of, k| {
        vec![stiffness_entries(&of.system, &of.state, elastic_force(&of.system, &of.state), k, "crooked")]
    });
}

#[test]
fn entries_by_dual_numbers() {
    stiffness("faults_duals", |of, k| vec![stiffness_against_duals(&of.system, &of.state, k, "crooked")]);
}

#[test]
fn curves() {
    stiffness("faults_curves", |of, k| {
        if k.nrows() != of.system.dofs().len() || k.ncols() != k.nrows() {
            return Vec::new();
        }
        let k = Faulty(k.clone());
        v_curve(&of.system, &of.state, elastic_force(&of.system, &of.state), &k, "crooked")
    });
}

#[test]
fn the_jacobian_of_any_force() {
    hold("faults_jacobian", |seed| {
        let of = beside(&crooked(), seed);
        let mut rows = Vec::new();
        let point = reduce(&of.system, &of.state.positions);
        let groups = ColumnGroups::of_system(&of.system);
        let own = || JacobianOptions { springs: Some((&of.system, &of.state)), ..JacobianOptions::default() };
        let all = [
            JacobianOptions::default(),
            own(),
            JacobianOptions { groups: Some(groups), ..own() },
            JacobianOptions { length: Some(0.3), tolerance: 1e-4, ..JacobianOptions::default() },
        ];
        for (fault, k) in wrong_stiffnesses(&of) {
            for (number, options) in all.iter().enumerate() {
                let key = format!("{fault}, {number}");
                match check_jacobian(elastic_force(&of.system, &of.state), k.clone(), &point, options) {
                    Ok(report) => {
                        rows.push(row(format!("{key} check"), &report.to_check("crooked")));
                        rows.push(Row::shown(
                            key,
                            &(
                                report.compared,
                                report.wrong,
                                report.value,
                                report.overall.clone(),
                                report.passed(),
                                report.worst,
                                report.numeric.values(),
                            ),
                        ));
                    }
                    Err(error) => rows.push(Row::shown(key, &error.to_string())),
                }
            }
        }
        rows
    });
}

#[test]
fn terms_that_are_left_out() {
    hold("faults_dropped", |seed| {
        let of = beside(&crooked(), seed);
        let mut all = Vec::new();
        for option in Stiffness::ALL {
            for given in Stiffness::ALL {
                let k = StepMatrices::assemble(&of.system, &of.state, given, 0.01).unwrap().k;
                let force = elastic_force(&of.system, &of.state);
                let checks = dropped_terms(&of.system, &of.state, force, option, &k, "crooked");
                all.extend(rows(&format!("{} {}", option.name(), given.name()), &checks));
            }
        }
        all
    });
}

type Change = fn(usize, f64) -> f64;

type Blocks = fn(&Spring, &Extension) -> Matrix3<f64>;

#[test]
fn blocks_of_springs() {
    let blocks: [(&str, Blocks); 8] = [
        ("right", |spring, at| spring.stiffness_block(at, Stiffness::Full).matrix()),
        ("axial", |spring, at| spring.stiffness_block(at, Stiffness::Axial).matrix()),
        ("tension", |spring, at| spring.stiffness_block(at, Stiffness::Tension).matrix()),
        ("sign", |spring, at| -spring.stiffness_block(at, Stiffness::Full).matrix()),
        ("twice", |spring, at| 2.0 * spring.stiffness_block(at, Stiffness::Full).matrix()),
        ("skew", |spring, at| {
            let block = spring.stiffness_block(at, Stiffness::Full).matrix();
            block + Matrix3::new(0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0) * (0.01 * block.norm())
        }),
        ("a third of the transverse term missing", |spring, at| {
            let [full, axial] = [Stiffness::Full, Stiffness::Axial].map(|of| spring.stiffness_block(at, of).matrix());
            axial + (full - axial) * (2.0 / 3.0)
        }),
        ("no number", |_, _| Matrix3::from_element(f64::NAN)),
    ];
    hold("faults_blocks", |seed| {
        let of = beside(&crooked(), seed);
        let mut all = Vec::new();
        for (name, block) in blocks {
            all.extend(rows(&format!("{name} duals"), &blocks_against_duals(&of.system, &of.state, block, "crooked")));
            all.push(row(format!("{name} differences"), &spring_blocks(&of.system, &of.state, block, "crooked")));
        }
        all
    });
}

#[test]
fn damping() {
    hold("faults_damping", |seed| {
        let of = beside(&crooked(), seed);
        let g = StepMatrices::assemble(&of.system, &of.state, Stiffness::Full, 0.01).unwrap().g.to_csc();
        let mut all = vec![row("turns".into(), &damping_turns(&of.system, &of.state, "crooked"))];
        for (fault, g) in wrong(&g) {
            let force = damping_force(&of.system, &of.state);
            all.push(row(format!("{fault} entries"), &damping_entries(&of.system, &of.state, force, &g, "crooked")));
            if g.nrows() == g.ncols() {
                all.push(row(format!("{fault} dissipates"), &damping_dissipates(&of.system, &Faulty(g), "crooked")));
            }
        }
        all
    });
}

#[test]
fn forces_and_energies() {
    hold("faults_forces", |seed| {
        let of = beside(&crooked(), seed);
        let mut right = vec![0.0; of.system.dofs().len()];
        elastic_force(&of.system, &of.state)(&reduce(&of.system, &of.state.positions), &mut right);
        let faults: [(&str, Change); 6] = [
            ("right", |_, f| f),
            ("sign", |_, f| -f),
            ("twice", |_, f| 2.0 * f),
            ("a little", |row, f| if row == 4 { 1.0001 * f } else { f }),
            ("one missing", |row, f| if row == 7 { 0.0 } else { f }),
            ("no number", |_, _| f64::NAN),
        ];
        let mut all = Vec::new();
        for (name, fault) in faults {
            let force: Vec<f64> = right.iter().enumerate().map(|(row, &f)| fault(row, f)).collect();
            all.push(row(format!("{name} dual"), &force_against_energy(&of.system, &of.state, &force, "crooked")));
            let energy = elastic_energy(&of.system, &of.state);
            all.push(row(format!("{name} slope"), &energy_slope(&of.system, &of.state, energy, &force, "crooked")));
            let mut energy = elastic_energy(&of.system, &of.state);
            let half = |x: &[f64]| 0.5 * energy(x);
            all.push(row(format!("{name} half"), &energy_slope(&of.system, &of.state, half, &force, "crooked")));
        }
        all
    });
}

/// Solutions of one step with faults, and the condition of its matrix.
#[test]
fn solutions() {
    hold("faults_solutions", |seed| {
        let of = beside(&crooked(), seed);
        let StepMatrices { a, b, .. } = StepMatrices::assemble(&of.system, &of.state, Stiffness::Full, 0.02).unwrap();
        let a = a.to_csc();
        let dense = nalgebra::DMatrix::from(&a).lu();
        let solve = |x: &mut [f64]| {
            let solved = dense.solve(&nalgebra::DVector::from_column_slice(x)).unwrap();
            x.copy_from_slice(solved.as_slice());
        };
        let mut exact = b.clone();
        solve(&mut exact);
        let n = exact.len();
        let changed = |change: &dyn Fn(usize, f64) -> f64| -> Vec<f64> {
            exact.iter().enumerate().map(|(row, &x)| change(row, x)).collect()
        };
        let faults = [
            ("right", exact.clone()),
            ("one", changed(&|row, x| if row == 7 { x * (1.0 + 1e-9) } else { x })),
            ("all", changed(&|row, x| x * (1.0 + 1e-7 * row as f64))),
            ("half precision", changed(&|_, x| f64::from(x as f32))),
            ("sign", changed(&|_, x| -x)),
            ("nothing", vec![0.0; n]),
            ("no number", changed(&|row, x| if row == 2 { f64::NAN } else { x })),
            ("another size", vec![0.0; n + 1]),
        ];
        let mut all = Vec::new();
        for (name, x) in &faults {
            for (promise, words) in [(Promise::Stable, "stable"), (Promise::Tolerance(1e-6), "tolerance")] {
                let solved = Solved { method: "one", x, promise };
                let reference = Solved { method: "other", x: &exact, promise: Promise::Stable };
                let key = format!("{name} {words}");
                all.extend(rows(&key, &backward_errors(&a, &b, &solved, "crooked")));
                let agree = solutions_agree(&a, &b, &solved, &reference, &mut |x| solve(x), "crooked");
                all.push(row(format!("{key} agree"), &agree));
            }
            all.push(row(format!("{name} met"), &tolerance_is_met(&a, &b, x, 1e-8, "one", "crooked")));
            all.push(row(format!("{name} indefinite"), &indefinite_backward_error(&a, &b, x, "one", "crooked")));
        }
        let condition = Condition::estimate(&a, &mut |x| solve(x));
        for factor in [1.0, 0.2, 5.0, f64::NAN] {
            let condition = Condition { inverse_norm: factor * condition.inverse_norm, ..condition };
            all.push(row(format!("condition {factor}"), &condition_is_right(&a, &condition, "crooked")));
        }
        let residual: Vec<f64> = (0..n).map(|row| (row as f64).cos()).collect();
        let forward = [forward_bound(&residual, &mut |x| solve(x)), forward_bound(&vec![0.0; n], &mut |x| solve(x))];
        let estimates: Vec<f64> = (0..6)
            .map(|seed| {
                let entry = |row: usize, column: usize| ((row * 7 + column * 3 + seed * row * column + 1) as f64).sin();
                let apply = |x: &mut [f64]| {
                    let y: Vec<f64> = (0..5).map(|r| (0..5).map(|c| entry(r, c) * x[c]).sum()).collect();
                    x.copy_from_slice(&y);
                };
                let transposed = |x: &mut [f64]| {
                    let y: Vec<f64> = (0..5).map(|r| (0..5).map(|c| entry(c, r) * x[c]).sum()).collect();
                    x.copy_from_slice(&y);
                };
                one_norm_estimate(5, apply, transposed)
            })
            .collect();
        all.push(Row::shown("norms", &(forward, estimates, condition, condition.number())));
        all
    });
}

/// Errors over steps that shrink as they should, too slowly, too fast, and not at all.
#[test]
fn orders() {
    hold("faults_orders", |_| {
        let curve = |method: &str, order: u32, slope: f64, points: u32| ErrorCurve {
            method: method.into(),
            order,
            points: (1..=points)
                .map(|n| (0.1 / f64::from(n * n), 3.0 * (0.1 / f64::from(n * n)).powf(slope)))
                .collect(),
        };
        let curves = vec![
            curve("first", 1, 1.0, 4),
            curve("slow", 2, 1.7, 3),
            curve("fast", 2, 2.15, 5),
            curve("none", 4, 0.0, 2),
            curve("single", 1, 1.0, 1),
            curve("missing", 4, 4.0, 0),
        ];
        rows("orders", &order_checks("order", "curves", "error", curves))
    });
}

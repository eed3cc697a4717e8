//! Results of every kind that a report has to show: many and few checks, figures, failures, hostile names.

use nalgebra::Vector3;
use sprung::figure::{Axis, Drawing, Guide, Plot, Series};
use sprung::spring::{Extension, Spring};
use sprung::verify::{Check, Claim, Entry, Results};
use sprung::{State, Stiffness, System, SystemBuilder};

/// A name that breaks a page, a table or a document that does not escape it.
pub const HOSTILE: &str = "<script>alert(\"1\")</script> & 'so' ]]>";

/// A sheet of n × n particles, bulged and sheared, its corners held.
pub fn cloth(n: usize) -> (System, State) {
    let mut scene = SystemBuilder::new();
    let at = |r: usize, c: usize| r * n + c;
    for (r, c) in (0..n).flat_map(|r| (0..n).map(move |c| (r, c))) {
        let (x, z) = (c as f64 / n as f64, r as f64 / n as f64);
        scene.particle([x + 0.1 * z, 0.25 * (3.0 * x).sin() * (2.0 * z).cos(), z], 0.1);
    }
    let spring = |rest_length| Spring { stiffness: 40.0, rest_length, damping: 0.1 };
    for (r, c) in (0..n).flat_map(|r| (0..n).map(move |c| (r, c))) {
        for (dr, dc, length) in [(0, 1, 1.05), (1, 0, 1.0), (1, 1, 1.4)] {
            if r + dr < n && c + dc < n {
                scene.spring(at(r, c), at(r + dr, c + dc), spring(length / n as f64));
            }
        }
    }
    scene.hold(0);
    scene.hold(n - 1);
    scene.build().expect("a valid scene")
}

/// A planar zigzag of links.
pub fn chain(links: usize) -> (System, State) {
    let mut scene = SystemBuilder::new();
    for i in 0..=links {
        scene.particle([i as f64, if i % 2 == 0 { 0.0 } else { 0.35 }, 0.0], 1.0 + i as f64);
    }
    for i in 0..links {
        scene.spring(i, i + 1, Spring { stiffness: 10.0, rest_length: 0.9 + 0.05 * i as f64, damping: 0.0 });
    }
    scene.hold(0);
    scene.build().expect("a valid scene")
}

/// The measured error of central differences of one spring's force against its stiffness block, over the distance h.
fn v_curve(option: Stiffness, stretch: f64) -> Vec<(f64, f64)> {
    let spring = Spring { stiffness: 100.0, rest_length: 1.3, damping: 0.0 };
    let d = Vector3::new(0.6, 0.64, 0.48) * (stretch * spring.rest_length);
    let w = Vector3::new(0.36, -0.8, 0.48);
    let extension = |d: &Vector3<f64>| Extension::between(d, &Vector3::zeros()).expect("a length");
    let force = |h: f64| spring.elastic_force(&extension(&(d + w * h)));
    let exact = -spring.stiffness_block(&extension(&d), option).apply(&w);
    let step = |i: i32| 10f64.powf(-0.5 * f64::from(i));
    (1..24).map(step).map(|h| (h, ((force(h) - force(-h)) / (2.0 * h) - exact).norm() / exact.norm())).collect()
}

fn v_plot(stretch: f64) -> Plot {
    Plot::log_log("Central differences of the force against K w", "h (m)", "relative difference")
        .with_series(Series::line("full", v_curve(Stiffness::Full, stretch)).with_slope(2.0))
        .with_series(Series::line("axial", v_curve(Stiffness::Axial, stretch)))
        .with_guide(Guide::Slope { slope: 2.0, through: (1e-2, 1e-5) })
        .with_guide(Guide::Slope { slope: -1.0, through: (1e-8, 1e-9) })
        .with_guide(Guide::Level { y: 5e-11, label: "floor (u max(1, ‖x‖/l))^⅔".into() })
}

fn orders() -> Plot {
    let steps = || (0..7).map(|i| 0.04 / f64::from(1 << i));
    Plot::log_log("Error at the end over the step", "dt (s)", "relative position error")
        .with_series(Series::line("linear-backward-euler", steps().map(|h| (h, 0.4 * h)).collect()).with_slope(0.9973))
        .with_series(
            Series::line("second order, option III", steps().map(|h| (h, 0.9 * h * h)).collect()).with_slope(1.98),
        )
        .with_series(Series::failures("energy grew", vec![(0.08, f64::INFINITY), (0.16, f64::INFINITY)]))
        .with_guide(Guide::Slope { slope: 1.0, through: (1e-2, 2e-3) })
        .with_guide(Guide::Slope { slope: 2.0, through: (1e-2, 3e-5) })
        .with_guide(Guide::Vertical { x: 0.06, label: "stable_dt".into() })
}

fn eigenvalue() -> Plot {
    let points = (0..40).map(|i| (0.002 * f64::from(i), 3.0 - 0.9 * (0.05 * f64::from(i)).powi(2) * 4.0)).collect();
    Plot::new("Least eigenvalue of A", Axis::logarithmic("dt (s)"), Axis::linear("λ_min (N/m)"))
        .with_series(Series::line("full", points))
        .with_guide(Guide::Level { y: 0.0, label: "indefinite below".into() })
        .with_guide(Guide::Vertical { x: 0.046, label: "critical_dt".into() })
}

/// Results with all claims, six failures among them.
pub fn mixed() -> Results {
    let mut results: Results = passing();
    let (system, state) = cloth(12);
    let drawing = Drawing::strains("Springs with the worst entries", &system, &state)
        .highlight(100, "spring 100 (particles 36, 48): sign flipped")
        .highlight(101, "spring 101 (particles 36, 49): 30 % of the transverse term missing, as if it were stretched")
        .highlight(230, "spring 230: missing");
    let table = vec![
        Entry::new(108, Some(144), -31.25, 31.25, 1e-9).of_spring(100),
        Entry::new(109, Some(147), 7.0, 10.0, 1e-9).of_spring(101).with_verdict("30 % of the transverse term missing"),
        Entry::new(200, Some(236), 0.0, 12.5, 1e-9).of_spring(230),
        Entry::new(3, Some(3), 10.000001, 10.0, 1e-9),
    ];
    results.extend([
        Check::new(Claim::Convergence, "order", "all but its bound", 1.0 - 1e-14, 1.0, "a number of many digits"),
        Check::new(
            Claim::Jacobian,
            "K against central differences",
            "cloth with a wrong K",
            62.5,
            1.2e-8,
            "floor of the V-curve",
        )
        .with_table(table)
        .with_curves(v_plot(0.7))
        .with_drawing(drawing),
        Check::new(Claim::Solvers, "backward error of Cholesky", "crumpled", f64::NAN, 3.3e-15, "30 u"),
        Check::new(Claim::Solvers, "backward error of Cholesky", "no bound", 1e-17, f64::NAN, "30 u"),
        Check::new(Claim::Definiteness, "verdict at 1 + 1e-6", HOSTILE, 1.0, 0.0, "counts are exact"),
        Check::new(Claim::Failure, HOSTILE, "pendulum", f64::INFINITY, 1.0, HOSTILE),
        Check::new(Claim::Constraints, "path followed", "crane", 1.000001e-12, 1e-12, "rounding of the path"),
    ]);
    results
}

/// Results without a failure.
pub fn passing() -> Results {
    let (system, state) = chain(6);
    let modes = [0.0, 0.5, 1.0, -0.4, 0.2, 0.1, -0.05].map(|y| Vector3::new(0.0, y, 0.0));
    let sketch = Drawing::strains("Mode that buckles first", &system, &state).with_arrows(&modes);
    let why = "rounding in f and truncation of the difference meet at h ≈ u^⅓";
    let mut checks = Vec::new();
    for (i, scene) in ["chain", "cloth 12", "lattice 5", "far from the origin", "nearly collapsed"].iter().enumerate() {
        let value = 3e-11 * (1.0 + i as f64);
        checks.push(
            Check::new(Claim::Jacobian, "K against central differences", *scene, value, 1.2e-8, why)
                .with_curves(v_plot(0.6 + 0.3 * i as f64)),
        );
    }
    for i in 0..30 {
        let (value, scene) = (1e-16 * f64::from(i), format!("random scene {i}"));
        checks.push(Check::new(Claim::Assembly, "A w assembled and matrix-free", scene, value, 3.3e-15, "30 u |A||w|"));
    }
    checks.extend([
        Check::new(Claim::Consistency, "f against −∇U", "cloth 12", 2.2e-10, 1e-8, "central differences, h = u^⅓ l"),
        Check::new(
            Claim::Refill,
            "refilled against fresh",
            "cloth 12",
            0.0,
            0.0,
            "the same operations in the same order",
        ),
        Check::new(
            Claim::Refill,
            "refilled against fresh",
            "lattice 5",
            0.0,
            0.0,
            "the same operations in the same order",
        ),
        Check::new(Claim::Solvers, "backward error of Cholesky", "cloth 12", 1.9e-16, 3.3e-15, "30 u"),
        Check::new(Claim::Definiteness, "inertia at the critical step", "chain", 0.0, 0.0, "counts are exact")
            .with_curves(eigenvalue())
            .with_drawing(sketch),
        Check::new(
            Claim::KnownAnswers,
            "damped oscillation",
            "one spring",
            3.1e-13,
            1e-12,
            "one step in high precision",
        ),
        Check::new(Claim::Convergence, "observed order", "damped tetrahedron", 0.003, 0.2, "|p − 2|")
            .with_curves(orders()),
        Check::new(Claim::Conservation, "linear momentum", "rotor", 4e-16, 1e-13, "one rounding a particle and step"),
        Check::new(Claim::Constraints, "held particle", "cloth 12", 0.0, 0.0, "nothing is computed"),
        Check::new(
            Claim::Failure,
            "negative curvature reported",
            "compressed chain",
            0.0,
            0.0,
            "a verdict, not a number",
        ),
    ]);
    checks.into_iter().collect()
}

//! Closed forms.

use super::code_aster::chain_of_eight;
use super::mechanics::Model;
use super::{Section, caught, code_aster, list, published};
use nalgebra::{Complex, DMatrix, DVector, Vector3};
use sprung::equilibrium::{CriticalKind, EquilibriumOptions, Stability, equilibrium, load_path};
use sprung::modes::modes;
use sprung::system::{Axes, Loads};
use sprung::{Constraint, Spring, State, System, SystemBuilder};
use std::f64::consts::{PI, TAU};
use std::fmt::Write;

/// Largest relative error of a frequency in closed form.
const FREQUENCY: f64 = 1e-12;

/// An elastic cable between two supports at a height difference, by Irvine, Cable Structures (1981), 2.
#[derive(Debug, Clone, Copy)]
pub struct Cable {
    pub span: f64,
    /// How far the second support is below the first.
    pub drop: f64,
    pub rest: f64,
    /// Force at a strain of 1.
    pub stiffness: f64,
    pub weight: f64,
}

impl Cable {
    /// Place of the point at rest length s, below and beside the first support, where the cable pulls with H beside and V up.
    fn place(&self, [h, v]: [f64; 2], s: f64) -> [f64; 2] {
        let Self { rest, stiffness, weight, .. } = *self;
        let w = weight / rest;
        let up = v - w * s;
        let x = h * s / stiffness + h / w * ((v / h).asinh() - (up / h).asinh());
        let y = weight * s / stiffness * (v / weight - s / (2.0 * rest)) + (h.hypot(v) - h.hypot(up)) / w;
        [x, y]
    }

    /// H and V, by Newton's method on the place of the second support.
    pub fn pull(&self) -> [f64; 2] {
        let mut at = [0.5 * self.weight, 0.5 * self.weight];
        for _ in 0..100 {
            let miss = |at: [f64; 2]| {
                let [x, y] = self.place(at, self.rest);
                [x - self.span, y - self.drop]
            };
            let [f, g] = miss(at);
            let d = 1e-6 * self.weight;
            let by = |k: usize| {
                let (mut low, mut high) = (at, at);
                low[k] -= d;
                high[k] += d;
                let ([a, b], [c, e]) = (miss(low), miss(high));
                [(c - a) / (2.0 * d), (e - b) / (2.0 * d)]
            };
            let ([a, c], [b, e]) = (by(0), by(1));
            let determinant = a * e - b * c;
            let step = [(e * f - b * g) / determinant, (a * g - c * f) / determinant];
            // H stays positive.
            let part = if step[0] >= at[0] { 0.5 * at[0] / step[0] } else { 1.0 };
            at = [at[0] - part * step[0], at[1] - part * step[1]];
        }
        at
    }

    /// The place of the middle of the cable's rest length, and H.
    pub fn closed(&self) -> [f64; 3] {
        let pull = self.pull();
        let [x, y] = self.place(pull, 0.5 * self.rest);
        [x, y, pull[0]]
    }

    /// The same three numbers of a chain of links.
    pub fn chain(&self, links: usize) -> sprung::Result<[f64; 3]> {
        let gravity = 10.0;
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        builder.gravity(0.0, -gravity, 0.0);
        let mass = self.weight / gravity / links as f64;
        for p in 0..=links {
            let part = p as f64 / links as f64;
            builder.particle([self.span * part, -self.drop * part - 0.1 * self.span * (PI * part).sin(), 0.0], mass);
        }
        let rest_length = self.rest / links as f64;
        for p in 0..links {
            builder.spring(p, p + 1, Spring { stiffness: self.stiffness, rest_length, damping: 0.0 });
        }
        builder.hold(0).hold(links);
        let (system, state) = builder.build()?;
        let found =
            equilibrium(&system, &state, EquilibriumOptions { tolerance: 1e-12, ..EquilibriumOptions::default() })?;
        if found.stability != Stability::Stable {
            return Ok([f64::NAN; 3]);
        }
        let x = &found.state.positions;
        let first = x[1] - x[0];
        let tension = self.stiffness * (first.norm() / rest_length - 1.0);
        Ok([x[links / 2].x, -x[links / 2].y, tension * first.x / first.norm()])
    }
}

pub const CABLES: [Cable; 3] = [
    Cable { span: 10.0, drop: 0.0, rest: 12.0, stiffness: 1000.0, weight: 60.0 },
    Cable { span: 10.0, drop: 3.0, rest: 10.0, stiffness: 500.0, weight: 80.0 },
    Cable { span: 8.0, drop: -2.0, rest: 15.0, stiffness: 300.0, weight: 50.0 },
];

/// Relative errors of place and H of chains, one pair for each number of links, their orders, and the errors of the extrapolated place and H.
pub type Convergence = ([[f64; 2]; 4], [[f64; 2]; 3], [f64; 2]);

/// Chains of 10, 20, 40 and 80 links against the cable.
pub fn catenary(cable: &Cable) -> sprung::Result<Convergence> {
    let closed = cable.closed();
    let mut found = [[0.0; 3]; 4];
    for (found, links) in found.iter_mut().zip([10, 20, 40, 80]) {
        *found = cable.chain(links)?;
    }
    let error = |of: [f64; 3]| {
        [f64::hypot(of[0] - closed[0], of[1] - closed[1]) / cable.span, (of[2] - closed[2]).abs() / closed[2]]
    };
    let errors = found.map(error);
    let orders = [0, 1, 2].map(|k| [0, 1].map(|of| (errors[k][of] / errors[k + 1][of]).log2()));
    // Richardson's extrapolation, twice: what is left is of order 6.
    let once = |k: usize| [0, 1, 2].map(|of| (4.0 * found[k + 1][of] - found[k][of]) / 3.0);
    let (coarse, fine) = (once(1), once(2));
    let extrapolated = error([0, 1, 2].map(|of| (16.0 * fine[of] - coarse[of]) / 15.0));
    Ok((errors, orders, extrapolated))
}

/// The relative error of the limit point of a truss of two bars of a height over half its span, followed to a part beyond it in steps.
pub fn two_bars(height: f64, beyond: f64, steps: usize) -> sprung::Result<(f64, bool)> {
    let k = 1000.0;
    let length = f64::hypot(1.0, height);
    let limit = 2.0 * k * (1.0 - (1.0 / length).powf(2.0 / 3.0)).powf(1.5);
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    for x in [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, height, 0.0]] {
        builder.particle(x, 1.0);
    }
    for end in [0, 1] {
        builder.spring(end, 2, Spring { stiffness: k, rest_length: length, damping: 0.0 });
    }
    builder.hold(0).hold(1);
    // Down only: in the plane a high truss would give way to the side first.
    builder.constrain(Constraint { axes: Axes::of(&[0]), ..Constraint::hold([2]) });
    let (system, state) = builder.build()?;
    let forces = vec![Vector3::zeros(), Vector3::zeros(), Vector3::new(0.0, -beyond * limit, 0.0)];
    let system = system.with_loads(Loads { forces, ..Loads::default() })?;
    let path = load_path(&system, &state, steps)?;
    let is_one = path.critical.len() == 1 && path.critical[0].kind == CriticalKind::LimitPoint;
    let factor = path.critical.first().map_or(f64::NAN, |critical| critical.factor);
    Ok(((factor * beyond - 1.0).abs(), is_one))
}

/// As published, in Hz.
pub const PUBLISHED: [f64; 8] = [5.53, 10.89, 15.92, 20.46, 24.38, 27.57, 29.91, 31.35];

/// The frequencies of that chain, in Hz: found, and in closed form.
pub fn eight_frequencies() -> sprung::Result<Vec<[f64; 2]>> {
    let (system, state) = chain_of_eight([0.0; 9])?;
    let found = modes(&system, &state, 8)?;
    let closed = |j: usize| 2.0 * 1e4f64.sqrt() * (j as f64 * PI / 18.0).sin() / TAU;
    Ok(found.modes.iter().enumerate().map(|(k, mode)| [mode.frequency().unwrap_or(f64::NAN), closed(k + 1)]).collect())
}

/// The largest error of the harmonic response of that chain to a load on one mass, over the largest amplitude at that frequency, against
/// `(−ω²M + iωC + K) x = f`.
pub fn harmonic_error(mass: usize, frequencies: &[f64]) -> sprung::Result<f64> {
    let damping = 40.0;
    let (system, state) = chain_of_eight([damping; 9])?;
    let found = modes(&system, &state, 8)?;
    let mut force = [0.0; 8];
    force[mass] = 1.0;
    let response = found.harmonic_response(&force, frequencies)?;
    let model = Model::new(&system);
    let stiffness = model.stiffness(&state.positions);
    let mut largest = 0.0f64;
    for (x, frequency) in response.iter().zip(frequencies) {
        let omega = TAU * frequency;
        // Dampers lie beside springs: C is K times b over k/l0.
        let matrix = DMatrix::from_fn(8, 8, |i, j| {
            let inertia = if i == j { -10.0 * omega * omega } else { 0.0 };
            Complex::new(stiffness[(i, j)] + inertia, omega * damping / 1e5 * stiffness[(i, j)])
        });
        let load = DVector::from_fn(8, |row, _| Complex::from(force[row]));
        let exact = matrix.lu().solve(&load);
        let size = exact.iter().flat_map(|x| x.iter()).map(|x| x.re.hypot(x.im)).fold(0.0, f64::max);
        let off = match exact {
            Some(exact) => x.iter().zip(&exact).map(|(x, y)| (x.re - y.re).hypot(x.im - y.im)).fold(0.0, f64::max),
            None => f64::NAN,
        };
        largest = largest.max(if off.is_nan() { f64::INFINITY } else { off / size });
    }
    Ok(largest)
}

/// Scenes with eigenvalues ω² in closed form: found and exact, both ascending, and whether all that were asked for were found and counted.
pub fn closed_modes(
    system: &System,
    state: &State,
    mut exact: Vec<f64>,
    count: usize,
) -> sprung::Result<(f64, bool, usize)> {
    let found = modes(system, state, count)?;
    exact.sort_by(f64::total_cmp);
    let largest = exact.last().copied().unwrap_or(1.0);
    let zeros = exact.iter().filter(|value| value.abs() < 1e-12 * largest).count();
    let error = found.modes.iter().zip(&exact[zeros..]).map(|(mode, value)| (mode.eigenvalue - value).abs() / largest);
    let error = error.fold(0.0, f64::max);
    let doubles = exact[zeros..].windows(2).take(count).filter(|pair| (pair[1] - pair[0]) < 1e-9 * largest).count();
    Ok((error, found.complete && found.modes.len() == count && found.zero_modes.len() == zeros, doubles))
}

/// N masses on a circle, joined by springs at rest, in the plane: `4 (κ/m)(s² + sₙ² − 2 s² sₙ²)` with s = sin(π/N), sₙ = sin(πn/N), n from 0, and N zeros.
pub fn ring(corners: usize, count: usize) -> sprung::Result<(f64, bool, usize)> {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    let half = PI / corners as f64;
    for p in 0..corners {
        let angle = 2.0 * half * p as f64;
        builder.particle([angle.cos(), angle.sin(), 0.0], 2.0);
    }
    let rest_length = 2.0 * half.sin();
    for p in 0..corners {
        builder.spring(p, (p + 1) % corners, Spring { stiffness: 50.0 * rest_length, rest_length, damping: 0.0 });
    }
    let (system, state) = builder.build()?;
    let s = half.sin().powi(2);
    let mut exact = vec![0.0; corners];
    exact.extend((0..corners).map(|n| {
        let sn = (half * n as f64).sin().powi(2);
        100.0 * (s + sn - 2.0 * s * sn)
    }));
    closed_modes(&system, &state, exact, count)
}

/// N masses on a line whose last is joined to the first: `4 (κ/m) sin²(πn/N)`.
pub fn closed_chain(count_of_masses: usize, count: usize) -> sprung::Result<(f64, bool, usize)> {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    for p in 0..count_of_masses {
        builder.particle([p as f64, 0.0, 0.0], 2.0);
    }
    for p in 0..count_of_masses {
        let next = (p + 1) % count_of_masses;
        let rest_length = (next as f64 - p as f64).abs();
        builder.spring(p, next, Spring { stiffness: 50.0 * rest_length, rest_length, damping: 0.0 });
    }
    let (system, state) = builder.build()?;
    let exact = (0..count_of_masses).map(|n| 100.0 * (PI * n as f64 / count_of_masses as f64).sin().powi(2)).collect();
    closed_modes(&system, &state, exact, count)
}

/// A square net of side × side masses in a frame, under tension T, that moves across only: `4 T/(l m) (sin²(pπ/2(n + 1)) + sin²(qπ/2(n + 1)))`.
pub fn membrane(side: usize, count: usize) -> sprung::Result<(f64, bool, usize)> {
    let stretch = 1.25;
    let width = side + 2;
    let mut builder = SystemBuilder::new();
    for p in 0..width * width {
        builder.particle([stretch * (p % width) as f64, stretch * (p / width) as f64, 0.0], 0.5);
    }
    for j in 0..width {
        for i in 0..width {
            for (a, b) in [(1, 0), (0, 1)] {
                if i + a < width && j + b < width {
                    builder.spring(
                        j * width + i,
                        (j + b) * width + i + a,
                        Spring { stiffness: 8.0, rest_length: 1.0, damping: 0.0 },
                    );
                }
            }
        }
    }
    let is_edge = |p: usize| [0, side + 1].contains(&(p % width)) || [0, side + 1].contains(&(p / width));
    builder.constrain(Constraint::hold((0..width * width).filter(|p| is_edge(*p))));
    builder.constrain(Constraint { axes: Axes::of(&[0, 1]), ..Constraint::hold(0..width * width) });
    let (system, state) = builder.build()?;
    let part = 4.0 * 8.0 * (stretch - 1.0) / stretch / 0.5;
    let sine = |p: usize| (p as f64 * PI / (2.0 * (side + 1) as f64)).sin().powi(2);
    let exact = (1..=side).flat_map(|p| (1..=side).map(move |q| part * (sine(p) + sine(q)))).collect();
    closed_modes(&system, &state, exact, count)
}

/// Frequencies for the harmonic response, in Hz: at rest, on resonances and between.
pub const DRIVEN: [f64; 9] = [0.0, 2.0, 5.527, 8.0, 10.885, 17.0, 24.38, 31.35, 60.0];

/// The results as a table, with the failures.
pub fn section() -> Section {
    let mut failures = Vec::new();
    let mut text = String::from(
        "## Closed forms\n\nAn elastic cable between two supports (Irvine, Cable Structures, 1981) against chains of N links: relative errors of the place of the middle and of the horizontal \
         force H, their orders, and what is left after extrapolating twice.\n\n\
         | span | drop | rest length | k | weight | | N = 10 | 20 | 40 | 80 | orders | extrapolated |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for cable in CABLES {
        let Cable { span, drop, rest, stiffness, weight } = cable;
        match caught(|| catenary(&cable)) {
            Ok((errors, orders, extrapolated)) => {
                for (of, name) in ["place", "H"].into_iter().enumerate() {
                    let [a, b, c, d] = errors.map(|error| format!("{:.2e}", error[of]));
                    let orders = orders.map(|order| order[of]);
                    let _ = writeln!(
                        text,
                        "| {span} | {drop} | {rest} | {stiffness} | {weight} | {name} | {a} | {b} | {c} | {d} | {:.3}, {:.3}, {:.3} | {:.1e} |",
                        orders[0], orders[1], orders[2], extrapolated[of]
                    );
                    if !is_second_order(orders, extrapolated[of]) {
                        failures.push(format!(
                            "cable of span {span}, {name}: orders {orders:?}, extrapolated {:e}",
                            extrapolated[of]
                        ));
                    }
                }
            }
            Err(error) => failures.push(format!("cable of span {span}: {error}")),
        }
    }
    text.push_str("\nA truss of two bars, pushed down at its top: the limit point `2k (1 − (a/l0)^{2/3})^{3/2}` by `load_path`.\n\n| height over half the span | load followed to, of the limit | steps | relative error | one limit point |\n|---|---|---|---|---|\n");
    for (height, beyond, steps) in TRUSSES {
        match caught(|| two_bars(height, beyond, steps)) {
            Ok((error, is_one)) => {
                let _ = writeln!(
                    text,
                    "| {height} | {beyond} | {steps} | {error:.1e} | {} |",
                    if is_one { "yes" } else { "no" }
                );
                if !(error <= 1e-8 && is_one) {
                    failures.push(format!("truss of height {height}: error {error:e}, one limit point: {is_one}"));
                }
            }
            Err(error) => failures.push(format!("truss of height {height}: {error}")),
        }
    }
    text.push_str("\nCode_aster SDLD02: eight masses of 10 kg and nine springs of 1e5 N/m between walls. Frequencies in Hz; `2 √(k/m) sin(jπ/18)/2π`.\n\n| mode | found | published | relative error to the closed form |\n|---|---|---|---|\n");
    match caught(eight_frequencies) {
        Ok(pairs) => {
            for (k, ([found, closed], published)) in pairs.iter().zip(PUBLISHED).enumerate() {
                let error = (found / closed - 1.0).abs();
                let _ = writeln!(text, "| {} | {found:.6} | {published} | {error:.1e} |", k + 1);
                if !(error <= FREQUENCY && (found - published).abs() <= 0.0051) {
                    failures.push(format!("mode {} of the chain: {found}, not {closed}", k + 1));
                }
            }
            if pairs.len() != 8 {
                failures.push(format!("{} modes of the chain", pairs.len()));
            }
        }
        Err(error) => failures.push(format!("chain: {error}")),
    }
    text.push_str(&format!(
        "\nHarmonic response of that chain with dampers of 40 N·s/m beside its springs to a load on one mass, at {DRIVEN:?} Hz, against a dense solve of `(K + iωC − ω²M) x = f`: largest error over the \
         largest amplitude.\n\n| loaded mass | error |\n|---|---|\n"
    ));
    for mass in [0, 3, 7] {
        match caught(|| harmonic_error(mass, &DRIVEN)) {
            Ok(error) => {
                let _ = writeln!(text, "| {} | {error:.1e} |", mass + 1);
                if error > 1e-10 {
                    failures.push(format!("response to a load on mass {}: {error:e}", mass + 1));
                }
            }
            Err(error) => failures.push(format!("response to a load on mass {}: {error}", mass + 1)),
        }
    }
    for (table, wrong) in [code_aster::table(), published::table()] {
        text.push_str(&table);
        failures.extend(wrong);
    }
    text.push_str("\nScenes with double modes in closed form; the error is that of ω² over the largest ω².\n\n| scene | modes | of these equal to the one before | error | complete |\n|---|---|---|---|---|\n");
    for (name, count, of) in double_modes() {
        match caught(of) {
            Ok((error, is_complete, doubles)) => {
                let _ = writeln!(
                    text,
                    "| {name} | {count} | {doubles} | {error:.1e} | {} |",
                    if is_complete { "yes" } else { "no" }
                );
                if !(error <= FREQUENCY && is_complete) {
                    failures.push(format!("{name}: error {error:e}, complete: {is_complete}"));
                }
            }
            Err(error) => failures.push(format!("{name}: {error}")),
        }
    }
    text.push('\n');
    text.push_str(&list(&failures));
    Section { text, failures: failures.len() }
}

/// Second order as the links get shorter, towards the closed form.
pub fn is_second_order(orders: [f64; 3], extrapolated: f64) -> bool {
    orders[1..].iter().all(|order| (order - 2.0).abs() < 0.05) && extrapolated < 1e-6
}

/// Heights over half the span, the load followed to in limits, and steps.
pub const TRUSSES: [(f64, f64, usize); 6] =
    [(0.1, 1.7, 10), (0.3, 1.3, 7), (0.5, 1.5, 10), (0.8, 2.5, 5), (1.2, 1.1, 20), (0.02, 1.9, 3)];

type Double = (&'static str, usize, fn() -> sprung::Result<(f64, bool, usize)>);

pub fn double_modes() -> [Double; 6] {
    [
        ("ring of 7 in the plane", 7, || ring(7, 7)),
        ("ring of 24 in the plane", 24, || ring(24, 24)),
        ("ring of 100 in the plane", 21, || ring(100, 21)),
        ("closed chain of 40 on a line", 39, || closed_chain(40, 39)),
        ("closed chain of 301 on a line", 20, || closed_chain(301, 20)),
        ("membrane of 12 × 12", 30, || membrane(12, 30)),
    ]
}

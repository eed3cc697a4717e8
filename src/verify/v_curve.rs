//! K w against central differences over all steps h: the V-curve.
//!
//! On logarithmic axes the error falls with slope +2 as h shrinks, `h² f'''/6`, until rounding takes over with slope
//! −1, `ρ/h`. A right K shows both slopes and a floor as low as analysis says; a wrong K shows a plateau at the size of
//! its fault.
//!
//! Every particle moves along w by at most half of its shortest spring, so h is a fraction of a spring everywhere,
//! whatever the scale of the scene. The error of a component is taken relative to `S = Σ ‖K^s‖ ‖δ‖` over the springs of
//! its particle: weak parts of a scene count like stiff ones. K is applied to the displacement that is left after
//! rounding x ± h w, so that a scene far from the origin loses nothing but the exactness of the middle.

use super::check::{Check, worst};
use super::claim::Claim;
use super::force_error::{ForceError, Link, SECOND, U, block_rounding, truncation};
use super::reduced::{random_vector, reduce};
use super::reference;
use crate::figure::{Guide, Plot, Series};
use crate::force::{DegenerateSpring, SpringGeometry};
use crate::operator::LinearOperator;
use crate::system::{State, System};
use nalgebra::Vector3;

/// Length over rest length below which a spring is all but collapsed.
const COLLAPSED: f64 = 0.01;

/// Number of random directions, of which the worst counts at each h. In large scenes one has components enough.
fn directions(rows: usize) -> u64 {
    if rows <= 10_000 { 4 } else { 1 }
}

/// A point of the curve.
#[derive(Debug, Clone, Copy)]
struct Point {
    h: f64,
    /// The measured error.
    error: f64,
    /// The largest error that analysis allows.
    allowed: f64,
    /// What the leading term of the truncation error will be.
    truncation: f64,
    /// The bound of the rounding error; the error itself is usually some thirty times smaller.
    rounding: f64,
    /// The bound of the error of a middle that is off.
    offset: f64,
}

/// Measured errors over h, from large to the smallest that the rounding of x resolves.
#[derive(Debug, Clone)]
pub(super) struct VCurve(Vec<Point>);

impl VCurve {
    /// Measures `force`, over the free coordinates, against a product `K w`, at 2⁻³ to 2⁻⁴².
    pub fn measure(
        system: &System,
        state: &State,
        force: impl FnMut(&[f64], &mut [f64]),
        stiffness: &impl LinearOperator,
    ) -> Result<Self, DegenerateSpring> {
        let steps: Vec<f64> = (3..=42).map(|exponent| (-f64::from(exponent)).exp2()).collect();
        Self::measure_at(system, state, force, stiffness, &steps)
    }

    /// Measures at the given steps.
    pub fn measure_at(
        system: &System,
        state: &State,
        mut force: impl FnMut(&[f64], &mut [f64]),
        stiffness: &impl LinearOperator,
        steps: &[f64],
    ) -> Result<Self, DegenerateSpring> {
        let extensions = SpringGeometry::at(system, &state.positions)?;
        let error = ForceError::new(system, &extensions);
        let directions: Vec<_> =
            (0..directions(system.dofs().len())).map(|seed| Direction::new(system, &error, state, seed)).collect();
        let x = reduce(system, &state.positions);
        let resolved_from = directions.iter().map(|direction| direction.resolved_from).fold(0.0, f64::max);
        let points = steps.iter().copied().filter(|&h| h >= resolved_from).map(|h| {
            let of = |d: &Direction| Point { error: d.error(&x, h, &mut force, stiffness), ..d.predict(h) };
            let points: Vec<Point> = directions.iter().map(of).collect();
            let largest = |of: fn(&Point) -> f64| worst(points.iter().map(of));
            Point {
                h,
                error: largest(|point| point.error),
                allowed: largest(|point| point.allowed),
                truncation: largest(|point| point.truncation),
                rounding: largest(|point| point.rounding),
                offset: largest(|point| point.offset),
            }
        });
        Ok(Self(points.collect()))
    }

    /// The smallest measured error, and the smallest that analysis allows. NaN if any error is NaN.
    pub fn floor(&self) -> (f64, f64) {
        let smallest = |of: fn(&Point) -> f64| -worst(self.0.iter().map(|point| -of(point)));
        (smallest(|point| point.error), smallest(|point| point.allowed))
    }

    /// The step where analysis allows least, where a plateau is read: h, the measured error, the allowed one.
    pub fn plateau(&self) -> (f64, f64, f64) {
        let best = self.0.iter().min_by(|a, b| a.allowed.total_cmp(&b.allowed));
        best.map_or((f64::NAN, f64::NAN, f64::NAN), |point| (point.h, point.error, point.allowed))
    }

    /// Slope where truncation must dominate: at least ten times every rounding, and h so small that the next term,
    /// smaller by h², does not show. `None` where f is linear along w or too few steps are left.
    pub fn truncation_slope(&self) -> Option<f64> {
        let dominates = |p: &&Point| p.h <= 1.0 / 64.0 && p.truncation >= 10.0 * (p.rounding + p.offset);
        slope(self.0.iter().filter(dominates), 4)
    }

    /// Slope where rounding must dominate: ten times truncation and the middle's error, taking a thirtieth of its bound
    /// for it. Steps at which it vanishes are left out: along the axes d, l and n may be exact.
    pub fn rounding_slope(&self) -> Option<f64> {
        let dominates = |p: &&Point| p.rounding <= 3.0 && p.rounding / 30.0 >= 10.0 * worst([p.truncation, p.offset]);
        let vanishes = |p: &Point| p.error < 1e-3 * p.rounding;
        slope(self.0.iter().filter(dominates).filter(|p| !vanishes(p)), 10)
    }

    /// Points for a plot.
    pub fn series(&self, name: &str) -> Series {
        Series::line(name, self.0.iter().map(|point| (point.h, point.error)).collect())
    }
}

/// Slope of the least-squares line through the points on logarithmic axes, if there are enough of them.
fn slope<'p>(points: impl Iterator<Item = &'p Point>, least: usize) -> Option<f64> {
    let logs: Vec<(f64, f64)> = points.map(|point| (point.h.ln(), point.error.ln())).collect();
    let n = logs.len() as f64;
    let (x, y) = logs.iter().fold((0.0, 0.0), |(x, y), point| (x + point.0 / n, y + point.1 / n));
    let (xy, xx) = logs
        .iter()
        .fold((0.0, 0.0), |(xy, xx), point| (xy + (point.0 - x) * (point.1 - y), xx + (point.0 - x) * (point.0 - x)));
    (logs.len() >= least).then_some(xy / xx)
}

/// A direction w, and everything that is known about the error along it.
struct Direction<'a> {
    system: &'a System,
    error: &'a ForceError<'a>,
    w: Vec<f64>,
    /// w as one vector a particle.
    moves: Vec<Vector3<f64>>,
    /// S of every particle, in N.
    scale: Vec<f64>,
    /// `‖f'''/6‖/S`, the largest over all particles.
    leading: f64,
    /// The largest rounding bound `ρ/S`.
    rounding: f64,
    /// The largest `(2/√3) k m ‖δ‖/l²` over S, with m the rounding of the two ends' coordinates.
    offset: f64,
    /// The smallest h that the rounding of x resolves.
    resolved_from: f64,
}

impl<'a> Direction<'a> {
    fn new(system: &'a System, error: &'a ForceError<'a>, state: &State, seed: u64) -> Self {
        let dofs = system.dofs();
        let mut w = random_vector(dofs.len(), seed);
        let mut resolved_from: f64 = 0.0;
        for particle in 0..system.particles() {
            let shortest = error.shortest(particle);
            let reach = if shortest.is_finite() { shortest / (2.0 * 3.0_f64.sqrt()) } else { 0.0 };
            w[dofs.rows(particle)].iter_mut().for_each(|w| *w *= reach);
            if reach > 0.0 {
                resolved_from = resolved_from.max(128.0 * U * state.positions[particle].amax() / reach);
            }
        }
        let moves = (0..system.particles()).map(|particle| dofs.get(&w, particle)).collect();
        let none = Vec::new();
        let mut direction =
            Self { system, error, w, moves, scale: none, leading: 0.0, rounding: 0.0, offset: 0.0, resolved_from };
        direction.scale = direction.sum(|link, delta| {
            let (axial, transverse) =
                (1.0 / link.spring.rest_length, 1.0 / link.spring.rest_length - 1.0 / link.at.length);
            link.spring.stiffness * axial.max(transverse.abs()) * delta.norm()
        });
        direction.leading = direction.leading_truncation();
        direction.rounding = direction.largest(&(0..system.particles()).map(|p| error.rounding(p)).collect::<Vec<_>>());
        let offset = direction.sum(|link, delta| {
            let [xi, xj] = link.ends.map(|end| state.positions[end].norm());
            SECOND * link.spring.stiffness * 2.0 * U * (xi + xj) * delta.norm() / link.at.length.powi(2)
        });
        direction.offset = direction.largest(&offset);
        direction
    }

    /// A sum over the springs of every particle.
    fn sum(&self, of: impl Fn(&Link, Vector3<f64>) -> f64) -> Vec<f64> {
        let mut sums = vec![0.0; self.system.particles()];
        for link in self.error.links() {
            let [i, j] = link.ends;
            let value = of(link, self.moves[i] - self.moves[j]);
            sums[i] += value;
            sums[j] += value;
        }
        sums
    }

    /// The largest value over S among the free particles that springs pull.
    fn largest(&self, values: &[f64]) -> f64 {
        let counts = |particle: &usize| !self.system.dofs().rows(*particle).is_empty() && self.scale[*particle] > 0.0;
        let relative =
            (0..self.system.particles()).filter(counts).map(|particle| values[particle] / self.scale[particle]);
        worst(relative.chain([0.0]))
    }

    /// `‖Σ ± k n'''‖/6` with `n''' = (6c² − 3σ²) e_⊥ + 6cσ² n` for `e = δ/l = c n + e_⊥`, `σ = ‖e_⊥‖`.
    fn leading_truncation(&self) -> f64 {
        let mut third = vec![0.0; self.w.len()];
        for link in self.error.links() {
            let [i, j] = link.ends;
            let e = (self.moves[i] - self.moves[j]) / link.at.length;
            let n = link.at.direction;
            let c = n.dot(&e);
            let across = e - n * c;
            let sigma2 = across.norm_squared();
            let f = (across * (6.0 * c * c - 3.0 * sigma2) + n * (6.0 * c * sigma2)) * (link.spring.stiffness / 6.0);
            self.system.dofs().add(&mut third, i, &f);
            self.system.dofs().add(&mut third, j, &-f);
        }
        self.relative(&third)
    }

    /// The largest component of a reduced vector relative to S.
    fn relative(&self, reduced: &[f64]) -> f64 {
        let of_particle = |particle: usize| {
            let rows = self.system.dofs().rows(particle);
            let scale = self.scale[particle];
            reduced[rows].iter().map(move |value| if *value == 0.0 { 0.0 } else { value.abs() / scale })
        };
        worst((0..self.system.particles()).flat_map(of_particle))
    }

    fn predict(&self, h: f64) -> Point {
        let own = self.sum(|link, delta| {
            let delta = delta.norm();
            truncation(link.spring, link.at, h, delta) + block_rounding(link.spring, link.at) * delta * 3.0
        });
        let (rounding, offset) = (self.rounding / h, self.offset);
        let allowed = self.largest(&own) + rounding + offset;
        Point { h, error: f64::NAN, allowed, truncation: self.leading * h * h, rounding, offset }
    }

    fn error(
        &self,
        x: &[f64],
        h: f64,
        mut force: impl FnMut(&[f64], &mut [f64]),
        stiffness: &impl LinearOperator,
    ) -> f64 {
        let along = |sign: f64| -> Vec<f64> { x.iter().zip(&self.w).map(|(x, w)| x + sign * h * w).collect() };
        let evaluated = |x: &[f64], force: &mut dyn FnMut(&[f64], &mut [f64])| {
            let mut f = vec![0.0; x.len()];
            force(x, &mut f);
            f
        };
        let (ahead, behind) = (along(1.0), along(-1.0));
        let (after, before) = (evaluated(&ahead, &mut force), evaluated(&behind, &mut force));
        let moved: Vec<f64> = ahead.iter().zip(&behind).map(|(a, b)| (a - b) / (2.0 * h)).collect();
        let mut product = vec![0.0; x.len()];
        stiffness.apply(&moved, &mut product);
        let quotient = after.iter().zip(&before).map(|(a, b)| (a - b) / (2.0 * h));
        let difference: Vec<f64> = quotient.zip(&product).map(|(d, p)| d - p).collect();
        self.relative(&difference)
    }
}

/// Measures the V-curve of K w: floor, slope of truncation, slope of rounding. A slope is left out where analysis does
/// not expect one, as for a force that is linear along every direction (one-dimensional scenes).
///
/// `force` is f_el over the free coordinates, in N; `stiffness` is K under test, in N/m. Sees any fault of K above the
/// floor, about 1e-10 of the springs at its particle, and a force that is not smooth; is blind to a force law wrong in
/// f and K alike.
pub fn v_curve(
    system: &System,
    state: &State,
    force: impl FnMut(&[f64], &mut [f64]),
    stiffness: &impl LinearOperator,
    scene: &str,
) -> Vec<Check> {
    let check = |name: &str, value, bound, why: &str| Check::new(Claim::Jacobian, name, scene, value, bound, why);
    let floor_name = "floor of the V-curve of K w";
    if stiffness.order() != system.dofs().len() {
        return vec![check(floor_name, f64::NAN, 1.0, "K does not have one row for each free coordinate")];
    }
    let curve = match VCurve::measure(system, state, force, stiffness) {
        Ok(curve) => curve,
        Err(degenerate) => return vec![check(floor_name, f64::NAN, 1.0, &degenerate.to_string())],
    };
    let (floor, allowed) = curve.floor();
    let floor_why = "least over h of truncation k h² δ³/(2(l − hδ)³) and rounding 15 u k max(1, l/l0)/h of every spring, \
        relative to Σ ‖K^s‖ δ; of the order of u^(2/3), and u ‖x‖/l far from the origin";
    let (truncation, rounding) = (curve.truncation_slope(), curve.rounding_slope());
    let plot = Plot::log_log(
        "Error of K w against central differences",
        "h, fraction of the shortest spring",
        "relative error",
    )
    .concluding(format!("The least error is {floor:.1e}, where analysis allows {allowed:.1e}."))
    .with_series(curve.series("max over components"))
    .with_guide(Guide::Level { y: allowed, label: "floor by analysis".into() });
    let (h, error, _) = curve.plateau();
    let through = (h, error);
    let plot = plot.with_guide(Guide::Slope { slope: 2.0, through }).with_guide(Guide::Slope { slope: -1.0, through });
    let mut checks = vec![check(floor_name, floor, allowed, floor_why).with_curves(plot)];
    checks.extend(truncation.map(|slope| {
        let why = "the slope is 2: over the steps used truncation is ten times rounding, and the next term of the series h² times smaller";
        check("slope of truncation of K w", (slope - 2.0).abs(), 0.1, why)
    }));
    checks.extend(rounding.map(|slope| {
        let why = "the slope is −1: rounding errors scatter by a factor of about 2 around ρ/h, which over ten or more halvings of h \
            moves a fitted slope by less than 0.2";
        let is_collapsed = |link: &reference::Link| link.length < COLLAPSED * link.rest_length;
        check("slope of rounding of K w", (slope + 1.0).abs(), 0.2, why).unless(|| {
            let spring = reference::links(system, &state.positions).iter().position(is_collapsed)?;
            Some(format!("spring {spring} is all but collapsed: the rounding of its force goes in few large jumps"))
        })
    }));
    checks
}

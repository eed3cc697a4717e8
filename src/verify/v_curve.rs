//! The families of checks of K, and K w against central differences over all steps h: the V-curve.
//!
//! Every particle moves along w by at most half of its shortest spring, so h is a fraction of a spring everywhere,
//! whatever the scale of the scene. The error of a component is taken relative to `S = Σ ‖K^s‖ ‖δ‖` over the springs of
//! its particle: weak parts of a scene count like stiff ones. K is applied to the displacement that is left after
//! rounding x ± h w, so that a scene far from the origin loses nothing but the exactness of the middle.

use super::free_coordinates::{elastic_force, moved};
use super::jacobian::{JacobianOptions, check_jacobian};
use super::reference::{active_links, links, sizes};
use super::stiffness::{against_blocks, spring_blocks, stiffness_against_duals, stiffness_entries};
use super::{Check, Claim, ForceError, LARGE, Link, Measured, SECOND, TestCase, U, dual, expand, ratio, reduce, worst};
use crate::assembly::SymmetricMatrix;
use crate::error::{Result, check_length};
use crate::figure::{Guide, Plot, Series};
use crate::integrate::StepMatrices;
use crate::operator::LinearOperator;
use crate::spring::{Extension, Spring, Stiffness};
use nalgebra::{Matrix3, Vector3};

pub(super) fn jacobian(case: &TestCase) -> Measured {
    let TestCase { name, system, state, dt, .. } = case;
    let k = StepMatrices::assemble(system, state, Stiffness::Full, *dt)?.k;
    let block =
        |spring: &Spring, at: &Extension| -> Matrix3<f64> { spring.stiffness_block(at, Stiffness::Full).matrix() };
    let mut checks = v_curve(case, &k)?;
    checks.push(stiffness_entries(case, &k.to_csc())?);
    checks.push(stiffness_against_duals(case, &k.to_csc())?);
    checks.extend(spring_blocks(case, block));
    // Every column of a small matrix is also measured on its own, trusting no pattern.
    if system.dofs().len() <= 120 {
        let options = JacobianOptions { springs: Some((system, state)), ..JacobianOptions::default() };
        let report = check_jacobian(elastic_force(system, state), &k, &reduce(system, &state.positions), &options)?;
        checks.push(match report.unmeasurable() {
            Some(reason) => Check::not_judged(Claim::Jacobian, "Jacobian against its force", name, reason),
            None => report.to_check(name),
        });
    }
    Ok(checks)
}

/// A step, the measured error and the largest that analysis allows.
#[derive(Debug, Clone, Copy)]
struct Point {
    h: f64,
    error: f64,
    allowed: f64,
}

/// Measured errors over h, from large to the smallest that the rounding of x resolves, and the parts of the analysis: the worst of all directions.
struct VCurve {
    points: Vec<Point>,
    leading: f64,
    rounding: f64,
    offset: f64,
}

fn all_steps() -> Vec<f64> {
    (3..=42).map(|exponent| (-f64::from(exponent)).exp2()).collect()
}

impl VCurve {
    /// Measures `force`, over the free coordinates, against a product `K w` at the given steps.
    fn measure<F: FnMut(&[f64], &mut [f64]), P: Fn(&[f64], &mut [f64])>(
        case: &TestCase,
        mut force: F,
        product: P,
        steps: &[f64],
    ) -> Result<Self> {
        let TestCase { system, state, .. } = case;
        let error = ForceError::new(system, &state.positions)?;
        // Random directions, of which the worst counts at each h. A large scene has components enough for one.
        let count = if system.dofs().len() <= LARGE { 4 } else { 1 };
        let directions: Vec<_> = (0..count).map(|seed| Direction::new(&error, &state.positions, seed)).collect();
        let x = reduce(system, &state.positions);
        // The difference quotient less the product along a direction.
        let mut difference = |w: &[f64], h: f64| -> Vec<f64> {
            let (ahead, behind) = (moved(&x, w, h), moved(&x, w, -h));
            let [mut after, mut before, mut product_w] = [(); 3].map(|()| vec![0.0; x.len()]);
            force(&ahead, &mut after);
            force(&behind, &mut before);
            let quotient = |(a, b): (&f64, &f64)| (a - b) / (2.0 * h);
            product(&ahead.iter().zip(&behind).map(quotient).collect::<Vec<_>>(), &mut product_w);
            after.iter().zip(&before).map(quotient).zip(product_w).map(|(d, p)| d - p).collect()
        };
        let largest = |of: fn(&Direction) -> f64| worst(directions.iter().map(of));
        let resolved_from = largest(|direction| direction.resolved_from);
        let points = steps.iter().filter(|&&h| h >= resolved_from).map(|&h| {
            let errors: Vec<_> = directions.iter().map(|d| d.errors(h, &difference(&d.w, h))).collect();
            let [error, allowed] = [0, 1].map(|of: usize| worst(errors.iter().map(|errors| errors[of])));
            Point { h, error, allowed }
        });
        Ok(Self {
            points: points.collect(),
            leading: largest(|direction| direction.leading),
            rounding: largest(|direction| direction.rounding),
            offset: largest(|direction| direction.offset),
        })
    }

    /// The smallest measured error, and the smallest that analysis allows. NaN if any error is NaN.
    fn floor(&self) -> (f64, f64) {
        let smallest = |of: fn(&Point) -> f64| -worst(self.points.iter().map(|point| -of(point)));
        (smallest(|point| point.error), smallest(|point| point.allowed))
    }

    /// The step where analysis allows least, at which a plateau is read: h, the measured error, the allowed one.
    fn plateau(&self) -> (f64, f64, f64) {
        let best = self.points.iter().min_by(|a, b| a.allowed.total_cmp(&b.allowed));
        best.map_or((f64::NAN, f64::NAN, f64::NAN), |point| (point.h, point.error, point.allowed))
    }

    /// Slope where truncation is ten times all rounding and h hides the next term; `None` where f is linear along w or too few steps are left.
    fn truncation_slope(&self) -> Option<f64> {
        let dominates = |&&Point { h, .. }: &&Point| {
            h <= 1.0 / 64.0 && self.leading * h * h >= 10.0 * (self.rounding / h + self.offset)
        };
        slope(self.points.iter().filter(dominates), 4)
    }

    /// Slope where rounding, at a thirtieth of its bound, is ten times all else. Steps at which it vanishes are left out: along an axis n may be
    /// exact.
    fn rounding_slope(&self) -> Option<f64> {
        let dominates = |&&Point { h, error, .. }: &&Point| {
            let (rounding, others) = (self.rounding / h, worst([self.leading * h * h, self.offset]));
            let vanishes = error < 1e-3 * rounding;
            rounding <= 3.0 && rounding / 30.0 >= 10.0 * others && !vanishes
        };
        slope(self.points.iter().filter(dominates), 10)
    }

    fn series(&self, name: &str) -> Series {
        Series::line(name, self.points.iter().map(|point| (point.h, point.error)).collect())
    }
}

/// Slope of the least-squares line through the points on logarithmic axes, if there are enough of them.
fn slope<'p>(points: impl Iterator<Item = &'p Point>, least: usize) -> Option<f64> {
    let logs: Vec<(f64, f64)> = points.map(|point| (point.h.ln(), point.error.ln())).collect();
    let n = logs.len() as f64;
    let (mut x, mut y, mut xy, mut xx) = (0.0, 0.0, 0.0, 0.0);
    logs.iter().for_each(|point| (x, y) = (x + point.0 / n, y + point.1 / n));
    for point in &logs {
        xy += (point.0 - x) * (point.1 - y);
        xx += (point.0 - x) * (point.0 - x);
    }
    (logs.len() >= least).then_some(xy / xx)
}

/// A direction w, and the analysis of the error along it.
struct Direction<'a> {
    error: &'a ForceError<'a>,
    w: Vec<f64>,
    moves: Vec<Vector3<f64>>,
    /// S of every particle, in N.
    scale: Vec<f64>,
    /// `‖f'''/6‖/S`, the largest over all particles.
    leading: f64,
    /// The largest rounding bound `ρ/S`; the error itself is usually some thirty times smaller.
    rounding: f64,
    /// The largest `(2/√3) k m ‖δ‖/l²` over S, with m the rounding of the two ends' coordinates.
    offset: f64,
    /// The smallest h that the rounding of x resolves.
    resolved_from: f64,
}

impl<'a> Direction<'a> {
    fn new(error: &'a ForceError<'a>, positions: &[Vector3<f64>], seed: u64) -> Self {
        let w = error.direction(seed);
        let moves = expand(error.system, &w);
        let moving = (0..positions.len()).filter(|&particle| error.displacement(particle) > 0.0);
        let resolved = moving.map(|p| 128.0 * U * positions[p].amax() / error.displacement(p));
        let resolved_from = resolved.fold(0.0, f64::max);
        let mut direction =
            Self { error, w, moves, scale: Vec::new(), leading: 0.0, rounding: 0.0, offset: 0.0, resolved_from };
        direction.scale = direction.sum(|link, delta| link.axial.max(link.transverse(Stiffness::Full).abs()) * delta);
        direction.leading = direction.leading_truncation();
        direction.rounding = direction.largest(&error.rounding);
        direction.offset = direction.largest(&direction.sum(|link, delta| {
            let [xi, xj] = link.ends.map(|end| positions[end].norm());
            SECOND * link.curved * 2.0 * U * (xi + xj) * delta / link.length.powi(2)
        }));
        direction
    }

    /// A sum over the springs of every particle, by each and the norm of its δ.
    fn sum(&self, of: impl Fn(&Link, f64) -> f64) -> Vec<f64> {
        sizes(&self.error.links, self.moves.len(), |link| of(link, link.difference(&self.moves).norm()))
    }

    /// The largest value over S among the free particles that springs pull.
    fn largest(&self, values: &[f64]) -> f64 {
        let dofs = self.error.system.dofs();
        let counts = |particle: &usize| !dofs.rows(*particle).is_empty() && self.scale[*particle] > 0.0;
        let relative = (0..values.len()).filter(counts).map(|particle| values[particle] / self.scale[particle]);
        worst(relative.chain([0.0]))
    }

    /// `‖Σ ± k n'''‖/6` with `n''' = (6c² − 3σ²) e_⊥ + 6cσ² n` for `e = δ/l = c n + e_⊥`, `σ = ‖e_⊥‖`.
    fn leading_truncation(&self) -> f64 {
        let dofs = self.error.system.dofs();
        let mut third = vec![0.0; self.w.len()];
        for link in &self.error.links {
            let [i, j] = link.ends;
            let e = link.difference(&self.moves) / link.length;
            let n = link.direction;
            let c = n.dot(&e);
            let across = e - n * c;
            let sigma2 = across.norm_squared();
            let f = (across * (6.0 * c * c - 3.0 * sigma2) + n * (6.0 * c * sigma2)) * (link.curved / 6.0);
            dofs.add(&mut third, i, &f);
            dofs.add(&mut third, j, &-f);
        }
        self.relative(&third)
    }

    /// The largest component of a reduced vector relative to S.
    fn relative(&self, reduced: &[f64]) -> f64 {
        let dofs = self.error.system.dofs();
        worst(dofs.iter().zip(reduced).map(|(dof, value)| ratio(value.abs(), self.scale[dof.particle])))
    }

    /// The error of a measured difference at a step, and the allowed one.
    fn errors(&self, h: f64, difference: &[f64]) -> [f64; 2] {
        let springs = self.sum(|link, delta| link.truncation(h, delta) + link.block_rounding() * delta * 3.0);
        [self.relative(difference), self.largest(&springs) + self.rounding / h + self.offset]
    }
}

/// Measures the V-curve of K w: floor, slope of truncation, slope of rounding. A slope is left out where analysis does
/// not expect one, as for a force that is linear along every direction (one-dimensional scenes).
///
/// `stiffness` is K under test, in N/m. Sees any fault of K above the floor, about 1e-10 of the springs at its particle, and a force
/// that is not smooth; is blind to a force law wrong in f and K alike.
///
/// # Errors
/// Coincident ends of a spring; a K of another order.
pub fn v_curve(case: &TestCase, stiffness: &impl LinearOperator) -> Result<Vec<Check>> {
    let TestCase { name: scene, system, state, .. } = case;
    check_length("stiffness", stiffness.order(), system.dofs().len())?;
    let check = |name: &str, value, bound, why: &str| Check::new(Claim::Jacobian, name, scene, value, bound, why);
    let curve = VCurve::measure(case, elastic_force(system, state), |w, y| stiffness.apply(w, y), &all_steps())?;
    let (floor, allowed) = curve.floor();
    let why = "least over h of truncation k h² δ³/(2(l − hδ)³) and rounding 15 u k max(1, l/l0)/h of every spring, \
        relative to Σ ‖Kˢ‖ δ; of the order of u^(2/3), and u ‖x‖/l far from the origin";
    let (h, error, _) = curve.plateau();
    let through = (h, error);
    let title = "Error of K w against central differences";
    let plot = Plot::log_log(title, "h, fraction of the shortest spring", "relative error")
        .concluding(format!("The least error is {floor:.1e}, where analysis allows {allowed:.1e}."))
        .with_series(curve.series("max over components"))
        .with_guide(Guide::Level { y: allowed, label: "floor by analysis".into() })
        .with_guide(Guide::Slope { slope: 2.0, through })
        .with_guide(Guide::Slope { slope: -1.0, through });
    let mut checks = vec![check("floor of the V-curve of K w", floor, allowed, why).with_curves(plot)];
    if let Some(slope) = curve.truncation_slope() {
        let why = "the slope is 2: over the steps used truncation is ten times rounding, and the next term of the series h² times smaller";
        checks.push(check("slope of truncation of K w", (slope - 2.0).abs(), 0.1, why));
    }
    if let Some(slope) = curve.rounding_slope() {
        let why = "the slope is −1: rounding errors scatter by a factor of about 2 around ρ/h, which over ten or more halvings of h \
            moves a fitted slope by less than 0.2";
        checks.push(check("slope of rounding of K w", (slope + 1.0).abs(), 0.2, why).unless(|| {
            let links = links(system, &state.positions);
            if let Some(spring) = links.iter().position(Link::is_collapsed) {
                return Some(format!("spring {spring} is all but collapsed: the rounding of its force goes in few large jumps"));
            }
            let is_along_an_axis = |link: &Link| link.direction.iter().filter(|n| **n != 0.0).count() == 1;
            let reason = "all springs lie along an axis: moved a little across it their lengths do not change, and the rounding of their forces falls with h";
            links.iter().all(is_along_an_axis).then(|| reason.into())
        }));
    }
    Ok(checks)
}

/// The term that an option drops from `K^s`: `P K^s P` with `P = I − nnᵀ` and K^s by dual numbers, twice that where its sign is changed, or nothing.
fn dropped_block(option: Stiffness, link: &Link) -> Matrix3<f64> {
    let part = match option {
        Stiffness::Axial if link.rest_length > 0.0 => 1.0,
        Stiffness::Tension if link.elongation() < 0.0 => 1.0,
        Stiffness::Absolute if link.elongation() < 0.0 => 2.0,
        _ => return Matrix3::zeros(),
    };
    let n = link.direction;
    let across = Matrix3::identity() - n * n.transpose();
    across * dual::stiffness_block(link) * across * part
}

pub(super) fn all_dropped_terms(case: &TestCase) -> Measured {
    let mut checks = Vec::new();
    for option in [Stiffness::Tension, Stiffness::Axial, Stiffness::Absolute] {
        let k = StepMatrices::assemble(&case.system, &case.state, option, case.dt)?.k;
        checks.extend(dropped_terms(case, option, &k)?);
    }
    Ok(checks)
}

/// Shows that K under an option is the exact K less the transverse terms of exactly the right springs, under `absolute` less twice these.
///
/// `stiffness` is K under test, for `option`. Checks: every entry against dual-number blocks without those terms (rounding); the floor of the V-curve
/// once those terms are added back; and, where anything is dropped, the plateau of the V-curve without them. Sees a term dropped from the wrong
/// spring, in part, or not at all; is blind to a wrong force law.
///
/// # Errors
/// Coincident ends of a spring; a K of another order.
pub fn dropped_terms(case: &TestCase, option: Stiffness, stiffness: &SymmetricMatrix) -> Result<Vec<Check>> {
    let TestCase { name: scene, system, state, .. } = case;
    let name = |what: &str| format!("{what} under {}", option.name());
    let check = |what: &str, value, bound, why: &str| Check::new(Claim::Jacobian, name(what), scene, value, bound, why);
    let entries = name("K against dual numbers without the dropped terms");
    let expected = |link: &Link| dual::stiffness_block(link) - dropped_block(option, link);
    let mut checks = vec![against_blocks(case, &stiffness.to_csc(), &entries, expected)?];
    let links = active_links(system, &state.positions);
    let blocks: Vec<_> = links.iter().map(|link| (link.ends, dropped_block(option, link))).collect();
    let add_dropped = |w: &[f64], y: &mut [f64]| {
        let dofs = system.dofs();
        for ([i, j], block) in &blocks {
            let s = block * (dofs.get(w, *i) - dofs.get(w, *j));
            dofs.add(y, *i, &-s);
            dofs.add(y, *j, &s);
        }
    };
    let with_dropped = |w: &[f64], y: &mut [f64]| {
        stiffness.apply(w, y);
        add_dropped(w, y);
    };
    let (mut force, steps) = (elastic_force(system, state), all_steps());
    let completed = VCurve::measure(case, &mut force, with_dropped, &steps)?;
    let without = VCurve::measure(case, &mut force, |w, y| stiffness.apply(w, y), &steps)?;
    let (h, plateau, allowed) = without.plateau();
    // The error of a vanishing force against the dropped terms alone is their size.
    let dropped = VCurve::measure(case, |_, f| f.fill(0.0), add_dropped, &[h])?;
    let (_, expected, _) = dropped.plateau();
    let (floor, least) = completed.floor();
    let why = "with the dropped terms added back K is exact: least over h of truncation and rounding, of the order of u^(2/3)";
    checks.push(check("V-curve of K w with the dropped terms added", floor, least, why));
    if expected > 10.0 * allowed {
        let plot = Plot::log_log(name("Error of K w"), "h, fraction of the shortest spring", "relative error")
            .concluding(format!("As it is K w stays {plateau:.1e} off, with the dropped terms added {floor:.1e}."))
            .with_series(without.series("as it is"))
            .with_series(completed.series("with the dropped terms"))
            .with_guide(Guide::Level { y: expected, label: "size of the dropped terms".into() });
        let why = "the V-curve ends on a plateau as high as the dropped terms: relative difference of the two heights, \
            bounded by the floor of the exact V-curve over that height";
        let difference = (plateau / expected - 1.0).abs();
        checks.push(check("plateau of K w", difference, allowed / expected, why).with_curves(plot));
    }
    Ok(checks)
}

//! Floors, plateaus and slopes of curves that are written down, and errors along a direction that is.

use super::super::reference::{self, links, stiffness_product};
use super::*;
use crate::spring::{Spring, Stiffness};
use crate::system::SystemBuilder;

fn point(h: f64, error: f64, [allowed, truncation, rounding, offset]: [f64; 4]) -> Point {
    Point { h, error, allowed, truncation, rounding, offset }
}

fn is(value: f64, expected: f64) {
    assert!((value / expected - 1.0).abs() < 1e-12, "{value:e} is not {expected:e}");
}

#[test]
fn the_floor_is_least_and_the_plateau_where_least_is_allowed() {
    let curve = |last: f64| {
        VCurve(
            [(1.0, 3.0, 4.0), (0.5, 0.5, 2.0), (0.25, last, 0.125)]
                .map(|(h, e, a)| point(h, e, [a, 0.0, 0.0, 0.0]))
                .to_vec(),
        )
    };
    assert_eq!((curve(2.0).floor(), curve(2.0).plateau()), ((0.5, 0.125), (0.25, 2.0, 0.125)));
    let (floor, allowed) = curve(f64::NAN).floor();
    assert!(floor.is_nan() && allowed == 0.125);
    let (h, error, allowed) = VCurve(Vec::new()).plateau();
    assert!(h.is_nan() && error.is_nan() && allowed.is_nan());
}

/// The line of least squares through (0, 0), (1, 3) and (2, 3), in logarithms, rises by 3/2.
#[test]
fn slopes_are_those_of_least_squares() {
    let points = [(0.0, 0.0), (1.0, 3.0), (2.0, 3.0)].map(|(h, e): (f64, f64)| point(h.exp(), e.exp(), [0.0; 4]));
    is(slope(points.iter(), 3).unwrap(), 1.5);
    assert_eq!(slope(points.iter(), 4), None);
}

/// Errors of 5 h² at four steps, the last one just where truncation is ten times the rest; the others are all but on that line: h
/// is too large, rounding and the middle together are too much, or either of them.
#[test]
fn truncation_has_its_slope_where_it_dominates() {
    let at = |h: f64, [t, r, o]: [f64; 3]| point(h, 5.0 * h * h, [0.0, t, r, o]);
    let wild = |h: f64, [t, r, o]: [f64; 3]| point(h, 1e6, [0.0, t, r, o]);
    let mut points = vec![
        wild(1.0 / 32.0, [1.0, 1e-3, 1e-3]),
        at(1.0 / 64.0, [1.0, 1e-3, 1e-3]),
        at(1.0 / 128.0, [1.0, 1e-3, 1e-3]),
        at(1.0 / 256.0, [1.0, 1e-3, 1e-3]),
        at(1.0 / 512.0, [5.0, 0.25, 0.25]),
        wild(1.0 / 1024.0, [1.0, 0.08, 0.04]),
        wild(1.0 / 2048.0, [1.0, 0.2, 0.0]),
        wild(1.0 / 4096.0, [1.0, 0.0, 0.2]),
    ];
    is(VCurve(points.clone()).truncation_slope().unwrap(), 2.0);
    points.remove(1);
    assert_eq!(VCurve(points).truncation_slope(), None);
}

/// Ten errors of 10⁻⁶/h, one of them just a thousandth of its bound; the others are beside that line: the bound is above 3, truncation
/// or the middle is not ten times smaller than a thirtieth of it, or the error vanishes.
#[test]
fn rounding_has_its_slope_where_it_dominates() {
    let at = |error: f64, rounding: f64| point(1e-6 / error, error, [0.0, 1e-9, rounding, 1e-9]);
    let wild = |error: f64, [t, r, o]: [f64; 3]| point(1e-3, error, [0.0, t, r, o]);
    let mut points: Vec<Point> = (1..9).map(|n| at(0.01 * f64::from(n), 0.02)).collect();
    points.extend([at(0.1, 3.0), at(1e-3 * 2.0, 2.0)]);
    points.extend([
        wild(1e6, [1e-9, 3.1, 1e-9]),
        wild(1e6, [0.01, 1.0, 1e-9]),
        wild(1e6, [1e-9, 1.0, 0.01]),
        wild(1e-5, [1e-9, 1.0, 1e-9]),
    ]);
    is(VCurve(points.clone()).rounding_slope().unwrap(), -1.0);
    points.remove(0);
    assert_eq!(VCurve(points).rounding_slope(), None);
}

#[test]
fn large_scenes_have_one_direction() {
    assert_eq!([1, 10_000, 10_001].map(directions), [4, 4, 1]);
}

/// Two springs with d = (−3, −4, 0) and (0, 0, −2), l0 = 4 and 5 m, k = 8 and 10 N; the end of the second is held, and a fourth
/// particle hangs on nothing.
fn corner() -> (System, State) {
    let mut builder = SystemBuilder::new();
    for x in [[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 4.0, 2.0], [9.0, 9.0, 9.0]] {
        builder.particle(x, 1.0);
    }
    builder.spring(0, 1, Spring { stiffness: 8.0, rest_length: 4.0, damping: 0.0 });
    builder.spring(1, 2, Spring { stiffness: 10.0, rest_length: 5.0, damping: 0.0 });
    builder.hold(2);
    builder.build().unwrap()
}

/// Gives `then` a direction with these moves of the particles and these scales.
fn along<T>(moves: [[f64; 3]; 4], scale: [f64; 4], then: impl FnOnce(&Direction) -> T) -> T {
    let (system, state) = corner();
    let extensions = Extensions::at(&system, &state.positions).unwrap();
    let error = ForceError::new(&system, &extensions);
    let moves: Vec<Vector3<f64>> = moves.map(Vector3::from).to_vec();
    let w = reduce(&system, &moves);
    let known = Direction::new(&system, &error, &state, 0);
    then(&Direction { w, moves, scale: scale.to_vec(), leading: 7.0, rounding: 1e-20, offset: 3e-14, ..known })
}

const MOVES: [[f64; 3]; 4] = [[0.5, 0.0, 0.0], [0.0, -0.25, 1.0], [0.0; 3], [0.0; 3]];

#[test]
fn sums_over_the_springs_of_every_particle() {
    let sums = along(MOVES, [1.0; 4], |direction| direction.sum(|_, delta| delta.x + 2.0 * delta.y));
    assert_eq!(sums, [1.0, 0.5, -0.5, 0.0]);
}

/// A held particle does not count, and neither does one that no spring pulls.
#[test]
fn the_largest_of_the_free_particles_counts() {
    let scale = [2.0, 1.0, 1.0, 0.0];
    let largest = |values: [f64; 4]| along(MOVES, scale, |direction| direction.largest(&values));
    assert_eq!([largest([6.0, 1.0, 50.0, 50.0]), largest([1.0, 3.0, 50.0, 0.0]), largest([0.0; 4])], [3.0, 3.0, 0.0]);
    let relative = |reduced: [f64; 9]| along(MOVES, [2.0, 4.0, 1.0, 0.0], |direction| direction.relative(&reduced));
    assert_eq!(relative([1.0, -3.0, 0.0, 2.0, 0.0, 5.0, 0.0, 0.0, 0.0]), 1.5);
}

/// A sixth of the third derivative of the force on the second particle, from the closed form of `(d + s δ)/‖d + s δ‖`:
/// `(−21/1250, −106443/320000, 481/8000)`.
#[test]
fn the_leading_term_is_the_third_derivative() {
    let leading = along(MOVES, [1.0, 2.0, 1.0, 0.0], |direction| direction.leading_truncation());
    is(leading, 106_443.0 / 320_000.0 / 2.0);
}

/// Displacements of 4 m along the first spring and of 2 m along the second: truncation is `k h² δ³/2(l − hδ)³`, the blocks are rounded
/// by `12 u k (1/l0 + 1/l)`.
#[test]
fn what_analysis_allows_along_a_direction() {
    let h = 2f64.powi(-20);
    let moves = [[4.0, 0.0, 2.0], [0.0, 0.0, 2.0], [0.0; 3], [0.0; 3]];
    let predicted = along(moves, [2.0, 4.0, 1.0, 0.0], |direction| direction.predict(h));
    let first = 4.0 * h * h * (4.0 / (5.0 - 4.0 * h)).powi(3) + 12.0 * U * 3.6 * 4.0 * 3.0;
    let second = 5.0 * h * h * (1.0 / (1.0 - h)).powi(3) + 12.0 * U * 7.0 * 2.0 * 3.0;
    is(predicted.allowed, (first + second) / 4.0 + 1e-20 / h + 3e-14);
    is(predicted.truncation, 7.0 * h * h);
    is(predicted.rounding, 1e-20 / h);
    assert!(predicted.offset == 3e-14 && predicted.h == h && predicted.error.is_nan());
}

/// Of the force x³ the difference quotient is `3 x² w + h² w³`; the matrix under test is twice the identity. In the fifth row that is
/// `−3 − 1/1024 + 1/2` with a scale of 4.
#[test]
fn the_error_along_a_direction() {
    struct Twice;
    impl LinearOperator for Twice {
        fn order(&self) -> usize {
            9
        }
        fn apply(&self, w: &[f64], y: &mut [f64]) {
            y.iter_mut().zip(w).for_each(|(y, w)| *y = 2.0 * w);
        }
    }
    let x = [1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0];
    let cubes = |x: &[f64], f: &mut [f64]| f.iter_mut().zip(x).for_each(|(f, x)| *f = x * x * x);
    let error = along(MOVES, [2.0, 4.0, 1.0, 0.0], |direction| direction.error(&x, 0.25, cubes, &Twice));
    assert_eq!(error, (2.5 + 1.0 / 1024.0) / 4.0);
}

/// K of the corner from the formulas of the reference, times a factor.
struct Product(Vec<reference::Link>, System, f64);

impl LinearOperator for Product {
    fn order(&self) -> usize {
        self.1.dofs().len()
    }

    fn apply(&self, w: &[f64], y: &mut [f64]) {
        let mut full = vec![Vector3::zeros(); self.1.particles()];
        self.1.dofs().scatter(w, &mut full);
        self.1.dofs().gather(&stiffness_product(&self.0, Stiffness::Full, &full), y);
        y.iter_mut().for_each(|y| *y *= self.2);
    }
}

fn product(system: &System, state: &State, factor: f64) -> Product {
    Product(links(system, &state.positions), system.clone(), factor)
}

fn force<'s>(system: &'s System, state: &State) -> impl FnMut(&[f64], &mut [f64]) + use<'s> {
    super::super::elastic_force(system, state)
}

/// From an eighth of the shortest spring down to 2⁻⁴², as far as the positions resolve it: `128 u |x|/(2/2√3)` with the 9 m of
/// the particle on nothing left out is 2⁻⁴³·² for 4 m, and 2⁻³³·² when everything is 4096 m farther away.
#[test]
fn steps_go_as_far_as_positions_resolve_them() {
    let count = |far: f64| {
        let (system, mut state) = corner();
        state.positions.iter_mut().for_each(|x| x.x += far);
        let curve = VCurve::measure(&system, &state, force(&system, &state), &product(&system, &state, 1.0)).unwrap();
        (curve.0[0].h, curve.0[curve.0.len() - 1].h, curve.0.len())
    };
    assert_eq!(count(0.0), (0.125, 2f64.powi(-42), 40));
    assert_eq!(count(4096.0), (0.125, 2f64.powi(-33), 31));
}

#[test]
fn a_right_product_shows_both_slopes_and_a_wrong_one_its_fault() {
    let (system, state) = corner();
    let checks = |factor| v_curve(&system, &state, force(&system, &state), &product(&system, &state, factor), "corner");
    let right = checks(1.0);
    let names: Vec<&str> = right.iter().map(|check| check.name.as_str()).collect();
    assert_eq!(names, ["floor of the V-curve of K w", "slope of truncation of K w", "slope of rounding of K w"]);
    assert!(right.iter().all(Check::passed), "{:?}", right.iter().map(|c| (c.value, c.bound)).collect::<Vec<_>>());
    let guides = &right[0].curves[0].guides;
    let slopes: Vec<f64> =
        guides.iter().filter_map(|g| if let Guide::Slope { slope, .. } = g { Some(*slope) } else { None }).collect();
    assert_eq!(slopes, [2.0, -1.0]);
    let wrong = checks(1.0 + 1e-4);
    assert!(!wrong[0].passed() && wrong[0].value > 1e-5 && wrong[0].value < 1e-4, "{:e}", wrong[0].value);
}

#[test]
fn a_product_of_another_order_fails() {
    let (system, state) = corner();
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    let (other, at) = builder.build().unwrap();
    let checks = v_curve(&system, &state, force(&system, &state), &product(&other, &at, 1.0), "corner");
    assert!(checks.len() == 1 && checks[0].value.is_nan() && checks[0].why.contains("one row for each"));
}

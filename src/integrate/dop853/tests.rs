use super::*;
use crate::integrate::fixtures::{particles, scene};

/// A rooted tree of Butcher's theory: its order, its density γ and its elementary weight of every stage.
#[derive(Clone)]
struct Tree {
    order: usize,
    density: f64,
    weights: Row,
}

/// All trees of up to eight nodes. A tree is a root with a multiset of smaller trees: its density is its order times
/// theirs, its weight of stage i the product of theirs, each summed over `A_ij`.
fn trees() -> Vec<Tree> {
    let mut all = vec![Tree { order: 1, density: 1.0, weights: [1.0; STAGES] }];
    for order in 2..=8 {
        let smaller = all.clone();
        grow(&smaller, smaller.len(), order, order - 1, (1.0, [1.0; STAGES]), &mut all);
    }
    all
}

/// Adds all trees of an order whose root still gets branches of `left` nodes together, from the first `limit` trees.
fn grow(
    smaller: &[Tree],
    limit: usize,
    order: usize,
    left: usize,
    (density, weights): (f64, Row),
    all: &mut Vec<Tree>,
) {
    if left == 0 {
        all.push(Tree { order, density: density * order as f64, weights });
    }
    for (index, branch) in smaller.iter().enumerate().take(limit).filter(|(_, branch)| branch.order <= left) {
        let summed = A.map(|row| row.iter().zip(&branch.weights).map(|(a, w)| a * w).sum::<f64>());
        let weights = std::array::from_fn(|i| weights[i] * summed[i]);
        grow(smaller, index + 1, order, left - branch.order, (density * branch.density, weights), all);
    }
}

fn dot(a: &Row, b: &Row) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// All 200 order conditions, the nodes, and the orders of what is subtracted for the error estimates.
#[test]
fn coefficients_meet_the_order_conditions() {
    let trees = trees();
    assert_eq!(trees.len(), 200);
    for (row, c) in A.iter().zip(C) {
        assert!((sum(row) - c).abs() < 1e-14);
    }
    for tree in &trees {
        let error = dot(&A[END], &tree.weights) - 1.0 / tree.density;
        assert!(error.abs() < 1e-14, "order {}: {error:e}", tree.order);
    }
    for (row, order) in [(&E5, 5), (&E3, 3)] {
        let largest = |of: usize| {
            let errors = trees.iter().filter(|tree| tree.order == of).map(|tree| dot(row, &tree.weights).abs());
            errors.fold(0.0, f64::max)
        };
        assert!((1..=order).all(|order| largest(order) < 1e-14));
        assert!(largest(order + 1) > 1e-4, "{:e}", largest(order + 1));
    }
}

/// The interpolant is of order seven at every share, and the formula itself at the end.
#[test]
fn the_interpolant_meets_the_order_conditions() {
    for s in [0.0, 0.1, 0.37, 0.5, 0.82, 1.0f64] {
        let weights = weights(s);
        for tree in trees().iter().filter(|tree| tree.order <= 7) {
            let error = dot(&weights, &tree.weights) - s.powi(tree.order as i32) / tree.density;
            assert!(error.abs() < 1e-12, "{s}, order {}: {error:e}", tree.order);
        }
        if s == 1.0 {
            assert_eq!(weights, A[END]);
        }
    }
}

/// Sums of products that the method's conditions make zero are exactly zero, and no others; so are other sums within rounding.
#[test]
fn squares_have_the_zeros_of_the_matrix() {
    for i in 1..STAGES {
        for j in 0..STAGES {
            let exact: f64 = (0..STAGES).map(|k| A[i][k] * A[k][j]).sum();
            assert!((SQUARE[i][j] - exact).abs() < 1e-13);
            assert!(SQUARE[i][j] == 0.0 || exact.abs() > 1e-6, "{exact:e}");
        }
    }
    assert_eq!(chain(&A[END], &A), SQUARE[END]);
    let entries = |rows: &[Row; STAGES]| rows.iter().flatten().filter(|entry| **entry != 0.0).count();
    assert_eq!((entries(&SQUARE), entries(&A)), (82, 82));
    for (value, expected) in [(0.3, 0.3), (-0.3, -0.3), (1e-12, 1e-12), (-1e-12, -1e-12), (9e-13, 0.0), (-9e-13, 0.0)] {
        let (mut row, mut matrix, mut product) = ([0.0; STAGES], [[0.0; STAGES]; STAGES], [0.0; STAGES]);
        (row[3], matrix[3][5], product[5]) = (value, 1.0, expected);
        assert_eq!((sum(&row), chain(&row, &matrix)), (expected, product), "{value}");
    }
}

/// A damped particle of 2 kg on a spring of 50 N/m along the first axis, under gravity, with its known motion.
fn oscillator() -> (System, State, impl Fn(f64) -> [f64; 2]) {
    let mut builder = scene(&[([0.0; 3], 1.0), ([2.1, 0.0, 0.0], 2.0)], &[(0, 1, [100.0, 2.0, 4.0])]);
    let (system, mut state) = builder.gravity(3.0, 0.0, 0.0).hold(0).clone().build().unwrap();
    state.velocities[1].x = -0.7;
    // x'' + 2x' + 25x = 3 about the rest place: x = 0.12 + e^(−t) (a cos ωt + b sin ωt), ω² = 24.
    let omega = 24f64.sqrt();
    let a = 0.1 - 0.12;
    let b = (-0.7 + a) / omega;
    let motion = move |t: f64| {
        let (sin, cos) = (omega * t).sin_cos();
        let x = 0.12 + (-t).exp() * (a * cos + b * sin);
        let v = (-t).exp() * ((b * omega - a) * cos - (a * omega + b) * sin);
        [2.0 + x, v]
    };
    (system, state, motion)
}

/// Between the ends of a step motions are right to O(h⁸), at both ends to that of the step.
#[test]
fn samples_between_steps_are_of_eighth_order() {
    let (system, start, motion) = oscillator();
    let error = |h: f64, share: f64| {
        let mut stepper = Dop853::new(&system, &start).unwrap();
        stepper.try_step(&start, h).unwrap();
        let (mut after, mut sample) = (start.clone(), start.clone());
        stepper.accept(&mut after);
        assert_eq!((after.time, stepper.statistics().work.force_evaluations), (h, 12));
        stepper.interpolate(&start, &after, share * h, &mut sample);
        stepper.interpolate(&start, &after, share * h, &mut sample);
        assert_eq!(stepper.statistics().work.force_evaluations, 16);
        let [x, v] = motion(share * h);
        [(sample.positions[1].x - x).abs(), (sample.velocities[1].x - v).abs()]
    };
    for share in [0.25, 0.6, 0.9] {
        let ([x, v], [y, w]) = (error(0.5, share), error(0.25, share));
        for (coarse, fine) in [(x, y), (v, w)] {
            let order = (coarse / fine).log2();
            assert!((7.0..10.5).contains(&order), "{share}: {coarse:e} {fine:e} {order}");
        }
        assert!(y < 1e-6 && w < 1e-5, "{y:e} {w:e}");
    }
    for share in [0.0, 1.0] {
        let [x, v] = error(0.125, share);
        assert!(x < 1e-10 && v < 1e-9, "{x:e} {v:e}");
    }
}

/// The end of a step of a new stepper.
fn accepted(system: &System, start: &State, h: f64) -> State {
    let (mut stepper, mut end) = (Dop853::new(system, start).unwrap(), start.clone());
    stepper.try_step(start, h).unwrap();
    stepper.accept(&mut end);
    end
}

/// Beyond the stability limit, ωh = 8, samples are shorter steps: the interpolant would magnify the vibration.
#[test]
fn samples_of_unstable_steps_are_steps() {
    let (system, start, _) = oscillator();
    let mut stepper = Dop853::new(&system, &start).unwrap();
    let [mut after, mut sample] = [start.clone(), start.clone()];
    stepper.try_step(&start, 1.6).unwrap();
    stepper.accept(&mut after);
    for time in [0.4, 0.8] {
        stepper.interpolate(&start, &after, time, &mut sample);
        let expected = accepted(&system, &start, time);
        assert_eq!((sample.positions[1], sample.velocities[1]), (expected.positions[1], expected.velocities[1]));
    }
    assert_eq!(stepper.statistics().work.force_evaluations, 12 + 4 + 2 * 11);
}

/// Accelerations at the start of a step are reused after rejections and, where the interpolant has them, from the last step, but not after a restart.
#[test]
fn evaluations_are_not_repeated() {
    let (system, start, _) = oscillator();
    let mut stepper = Dop853::new(&system, &start).unwrap();
    let [mut state, mut sample] = [start.clone(), start.clone()];
    let mut counted = 0;
    let mut count = |stepper: &Dop853, expected: u64| {
        let forces = stepper.statistics().work.force_evaluations;
        assert_eq!(forces - counted, expected);
        counted = forces;
    };
    stepper.try_step(&state, 0.1).unwrap();
    count(&stepper, 12);
    stepper.reject();
    stepper.try_step(&state, 0.05).unwrap();
    count(&stepper, 11);
    stepper.accept(&mut state);
    stepper.try_step(&state, 0.05).unwrap();
    count(&stepper, 12);
    let before = state.clone();
    stepper.accept(&mut state);
    stepper.interpolate(&before, &state, state.time - 0.01, &mut sample);
    count(&stepper, 4);
    let mut kept = state.clone();
    stepper.try_step(&state, 0.05).unwrap();
    count(&stepper, 11);
    stepper.accept(&mut kept);
    let afresh = accepted(&system, &state, 0.05);
    assert!((afresh.positions[1] - kept.positions[1]).norm() < 1e-15, "{afresh:?} {kept:?}");
    stepper.interpolate(&state, &kept, state.time + 0.01, &mut sample);
    count(&stepper, 4);
    stepper.restart();
    stepper.try_step(&kept, 0.05).unwrap();
    count(&stepper, 12);
}

/// Where nothing moves there is no error.
#[test]
fn steps_at_rest_have_no_error() {
    let (system, mut state) = particles(&[1.0]);
    let mut stepper = Dop853::new(&system, &state).unwrap();
    stepper.step(&mut state, 0.5).unwrap();
    assert_eq!(stepper.local_error, 0.0);
}

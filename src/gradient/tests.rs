use super::jacobian::Jacobian;
use super::*;
use crate::linear::norm;
use crate::spring::Spring;
use crate::system::{Constraint, Curve, Loads, Motion, SystemBuilder};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};

const METHODS: [Method; 4] = [Method::BackwardEuler, Method::ImplicitMidpoint, Method::Bdf2, Method::Verlet];

/// A net of seven particles in motion, one held and, for implicit methods, one led, with parameters changed by h times `change`; where it is damped,
/// gravity changes in time.
struct Net {
    change: Parameters,
    has_moving: bool,
    damping: f64,
}

const EDGES: [[usize; 2]; 11] =
    [[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 6], [0, 2], [1, 3], [2, 4], [3, 5], [4, 6]];

impl Net {
    fn new(seed: u64, has_moving: bool, damping: f64) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut scalars = |count: usize| -> Vec<f64> { (0..count).map(|_| rng.random_range(-1.0..1.0)).collect() };
        let mut vectors = |count: usize| -> Vec<Vector3<f64>> {
            scalars(3 * count).chunks(3).map(Vector3::from_column_slice).collect()
        };
        let (gravity, loads, positions, velocities) = (vectors(1)[0], vectors(7), vectors(7), vectors(7));
        let change = Parameters {
            stiffness: scalars(11).iter().map(|x| 50.0 * x).collect(),
            rest_lengths: scalars(11).iter().map(|x| 0.3 * x).collect(),
            damping: scalars(11),
            masses: scalars(7),
            gravity,
            loads,
            positions,
            velocities,
        };
        Self { change, has_moving, damping }
    }

    fn build(&self, h: f64) -> (System, State) {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(99);
        let change = &self.change;
        let mut builder = SystemBuilder::new();
        let gravity = Vector3::new(0.0, -9.81, 0.0) + change.gravity * h;
        builder.gravity(gravity.x, gravity.y, gravity.z);
        for p in 0..7 {
            let x = Vector3::new(p as f64, 0.5 * (p % 2) as f64, 0.3 * (p % 3) as f64) + change.positions[p] * h;
            builder.particle(x.into(), 2.0 + h * change.masses[p]);
        }
        for (s, [i, j]) in EDGES.into_iter().enumerate() {
            let stiffness = 100.0 + 10.0 * s as f64 + h * change.stiffness[s];
            let damping = self.damping * (2.0 + h * change.damping[s]);
            builder.spring(i, j, Spring { stiffness, rest_length: 1.1 + h * change.rest_lengths[s], damping });
        }
        builder.hold(0);
        if self.has_moving {
            let motion = Motion::Velocity(Vector3::new(0.5, 0.2, 0.0));
            builder.constrain(Constraint { motion, ..Constraint::hold([6]) });
        }
        let (system, mut state) = builder.build().unwrap();
        for (p, v) in state.velocities.iter_mut().enumerate() {
            let start = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
            if !system.dofs().rows(p).is_empty() {
                *v = start + change.velocities[p] * h;
            }
        }
        let forces = change.loads.iter().map(|load| load * h).collect();
        let turned = |k: i32| gravity + Vector3::new(3.0, 4.0, -2.0) * f64::from(k);
        let path = Curve { times: vec![0.0, 0.04, 0.1], values: [0, 1, 3].map(turned).to_vec() };
        let gravity = (self.damping > 0.0).then_some(path);
        (system.with_loads(Loads { forces, gravity, ..Loads::default() }).unwrap(), state)
    }

    /// ∂/∂b of what is built from `damping · (2 + h δb)`.
    fn direction(&self) -> Parameters {
        let damping = self.change.damping.iter().map(|b| self.damping * b).collect();
        Parameters { damping, ..self.change.clone() }
    }
}

fn cotangents(run: &DifferentiableRun<'_>, seed: u64) -> Vec<Cotangent> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut vectors = || (0..7).map(|_| Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0))).collect();
    let steps = [run.steps(), run.steps() / 2, 0];
    steps.map(|step| Cotangent { step, positions: vectors(), velocities: vectors() }).to_vec()
}

/// Velocities of held particles are no result of a run.
fn cost(run: &DifferentiableRun<'_>, cotangents: &[Cotangent]) -> f64 {
    let states: Vec<&State> = run.states().collect();
    let value = |cotangent: &Cotangent| {
        let state = states[cotangent.step];
        let x: f64 = state.positions.iter().zip(&cotangent.positions).map(|(x, c)| x.dot(c)).sum();
        let free = |p: usize| !run.system.dofs().rows(p).is_empty();
        let v = state.velocities.iter().zip(&cotangent.velocities).enumerate();
        x + v.filter(|(p, _)| free(*p)).map(|(_, (v, c))| v.dot(c)).sum::<f64>()
    };
    cotangents.iter().map(value).sum()
}

fn few_states<'s>(
    system: &'s System,
    state: &State,
    method: Method,
    times: [f64; 2],
    room: usize,
) -> DifferentiableRun<'s> {
    DifferentiableRun::interruptible(system, state, method, times, Some(room), Interrupt::NEVER).unwrap()
}

/// How the last state changes.
fn last_change(run: &DifferentiableRun<'_>, change: &Parameters) -> StateChange {
    run.tangents(std::slice::from_ref(change), &[run.steps()]).unwrap().remove(0).remove(0)
}

/// Taylor's theorem for all parameters at once: what the gradient leaves is of second order, over four halvings.
#[test]
fn remainders_are_of_second_order() {
    for method in METHODS {
        for (seed, damping) in [(1, 0.0), (2, 1.0), (3, 10.0)] {
            let net = Net::new(seed, method != Method::Verlet, damping);
            let run = |h: f64| {
                let (system, state) = net.build(h);
                let run = DifferentiableRun::new(&system, &state, method, 0.013, 0.1).unwrap();
                let cotangents = cotangents(&run, 7);
                (cost(&run, &cotangents), run.gradient(&cotangents).unwrap())
            };
            let (value, gradient) = run(0.0);
            let slope = gradient.dot(&net.direction());
            let remainders = [0.02, 0.01, 0.005, 0.0025].map(|h| {
                let change = run(h).0 - value;
                [change.abs(), (change - h * slope).abs()]
            });
            for pair in remainders.windows(2) {
                let [first, second] = [0, 1].map(|k| (pair[0][k] / pair[1][k]).log2());
                assert!((0.8..1.2).contains(&first), "{} {damping}: {remainders:?}", method.name());
                assert!((1.85..2.15).contains(&second), "{} {damping}: {remainders:?}", method.name());
            }
        }
    }
}

/// ⟨cotangent, tangent⟩ = ⟨gradient, change⟩ to rounding, for every kind of parameter by itself.
#[test]
fn tangents_and_adjoints_agree() {
    let product = |a: &[Vector3<f64>], b: &[Vector3<f64>]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
    for method in METHODS {
        let net = Net::new(4, method != Method::Verlet, 3.0);
        let (system, state) = net.build(0.0);
        let run = DifferentiableRun::new(&system, &state, method, 0.02, 0.15).unwrap();
        let zero = || Parameters::zeros(&system);
        let all = &net.change;
        let kinds = [
            Parameters { stiffness: all.stiffness.clone(), ..zero() },
            Parameters { rest_lengths: all.rest_lengths.clone(), ..zero() },
            Parameters { damping: all.damping.clone(), ..zero() },
            Parameters { masses: all.masses.clone(), ..zero() },
            Parameters { gravity: all.gravity, ..zero() },
            Parameters { loads: all.loads.clone(), ..zero() },
            Parameters { positions: all.positions.clone(), ..zero() },
            Parameters { velocities: all.velocities.clone(), ..zero() },
        ];
        // All changes at once, after a step on the way too, and with few states kept.
        let [end, middle, _] = &cotangents(&run, 8)[..] else { panic!("cotangents of three states") };
        let steps = [middle.step, run.steps()];
        let found = run.tangents(&kinds, &steps).unwrap();
        let few = few_states(&system, &state, method, [0.02, 0.15], 3);
        assert_eq!(few.tangents(&kinds, &steps).unwrap(), found, "{}", method.name());
        let gradients = [middle, end].map(|state| run.gradient(std::slice::from_ref(state)).unwrap());
        for (kind, (change, states)) in kinds.iter().zip(&found).enumerate() {
            let alone = last_change(&run, change);
            for (cotangent, gradient, [x, v]) in [(middle, &gradients[0], &states[0]), (end, &gradients[1], &alone)] {
                let forward = product(&cotangent.positions, x) + product(&cotangent.velocities, v);
                let error = (forward - gradient.dot(change)).abs();
                assert!(error < 1e-12 * forward.abs().max(1e-3), "{} {kind}: {forward} {error}", method.name());
            }
            for (together, alone) in states[1].iter().flatten().zip(alone.iter().flatten()) {
                assert!((together - alone).norm() < 1e-11 * alone.norm().max(1e-2), "{}", method.name());
            }
        }
        for wrong in [[2, 1], [1, 1], [0, 99]] {
            assert!(run.tangents(&kinds, &wrong).is_err());
        }
    }
}

/// The same bits with all states, and with few checkpoints.
#[test]
fn checkpoints_change_no_bit() {
    for method in METHODS {
        let (system, state) = Net::new(5, method != Method::Verlet, 1.0).build(0.0);
        let run = DifferentiableRun::new(&system, &state, method, 0.01, 0.375).unwrap();
        assert_eq!((run.steps(), run.states().len()), (38, 39));
        let cotangents = cotangents(&run, 9);
        let gradient = run.gradient(&cotangents).unwrap();
        for room in [2, 3, 5, 12, 38] {
            let few = few_states(&system, &state, method, [0.01, 0.375], room);
            assert_eq!((few.states().len(), few.end()), (2, run.end()), "{}", method.name());
            assert_eq!(few.gradient(&cotangents).unwrap(), gradient, "{} {room}", method.name());
        }
    }
}

/// No checkpoints lead to fewer steps computed again than those that `split` sets: by dynamic programming over all places of the next one.
#[test]
fn checkpoints_are_set_where_the_fewest_steps_are_computed_again() {
    fn again(count: usize, room: usize) -> usize {
        let next = split(count, room);
        if next == count { count - 1 } else { next + again(count - next, room - 1) + again(next, room) }
    }
    let mut least = vec![vec![0, 0]];
    for room in 1..=6 {
        let mut of = vec![0; 101];
        for count in 2..of.len() {
            let with = |next: usize| {
                next + if room == 1 { count - next - 1 } else { least[room - 1][count - next] } + of[next]
            };
            let from = if room == 1 { count - 1 } else { 1 };
            of[count] = (from..count).map(with).min().unwrap();
            assert_eq!(again(count, room), of[count], "{count} {room}");
        }
        least.push(of);
    }
    // r l − C(s + r, r − 1) with l = 1000, s = 20 and r = 3 (Griewank and Walther), 999 of them in the run itself.
    assert_eq!(again(1000, 20), 3000 - 253);
}

/// A step so long and so damped that the symmetric factor does not lead to J: the same products by L U.
#[test]
fn strong_damping_is_solved_with_the_whole_jacobian() {
    let (system, state) = Net::new(6, true, 300.0).build(0.0);
    let run = DifferentiableRun::new(&system, &state, Method::BackwardEuler, 0.2, 0.2).unwrap();
    let mut jacobian = Jacobian::new(&system, &state).unwrap();
    jacobian.set(&run.core(0, None, &state, run.end()).solved, 0.2).unwrap();
    let b: Vec<f64> = (0..system.dofs().len()).map(|row| (row as f64).cos()).collect();
    for is_transposed in [false, true] {
        let x = jacobian.solve_unsymmetric(&b, is_transposed).unwrap();
        let scale = jacobian.size * norm(&x);
        assert!(norm(&jacobian.defect(&b, &x, is_transposed)) < 1e-14 * scale);
        let y = jacobian.solve(&b, is_transposed).unwrap();
        assert!(norm(&jacobian.defect(&b, &y, is_transposed)) < 1e-14 * scale);
        // Columns that are solved together, the others by their own.
        let many = [b.clone(), y.clone(), vec![0.0; b.len()]].concat().repeat(30);
        let together = jacobian.solve(&many, is_transposed).unwrap();
        for (b, x) in many.chunks_exact(b.len()).zip(together.chunks_exact(b.len())) {
            assert!(norm(&jacobian.defect(b, x, is_transposed)) <= 1e-14 * jacobian.size * norm(x));
        }
    }
}

#[test]
fn what_has_no_gradient_is_refused() {
    let (system, state) = Net::new(1, false, 1.0).build(0.0);
    let run = |method, dt, duration| DifferentiableRun::new(&system, &state, method, dt, duration);
    for method in Method::ALL.into_iter().filter(|method| !METHODS.contains(method)) {
        let message = run(method, 0.1, 0.1).unwrap_err().to_string();
        assert!(message.contains(method.name()) && message.contains("bdf2"), "{message}");
    }
    for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(run(Method::Verlet, wrong, 0.1).is_err() && (wrong == 0.0 || run(Method::Verlet, 0.1, wrong).is_err()));
    }
    let none = run(Method::Verlet, 0.1, 0.0).unwrap();
    assert_eq!((none.steps(), none.end()), (0, &state));
    let mut end = cotangents(&none, 1).swap_remove(2);
    assert_eq!(none.gradient(std::slice::from_ref(&end)).unwrap().positions, end.positions);
    end.step = 1;
    assert!(none.gradient(std::slice::from_ref(&end)).is_err());
    let short = Cotangent { step: 0, positions: vec![], velocities: vec![] };
    assert!(none.gradient(&[short]).is_err());
    let (moving, start) = Net::new(1, true, 1.0).build(0.0);
    assert!(DifferentiableRun::new(&moving, &start, Method::Verlet, 0.1, 1.0).is_err());
}

//! The formulas of one spring under random rounding: bounds of rounding hold whatever way each operation rounds.
//!
//! Every operation returns one of the two numbers next to its exact result, at random (Vignes, Numer. Algorithms 37, 2004; Parker, Monte
//! Carlo Arithmetic, 1997). Its error is below 2u, twice that of rounding to nearest, so that a bound of n u of the checks becomes one
//! of 2 n u, and a lucky cancellation of errors, on which a single run may rest, does not last a thousand draws.

use nalgebra::{Matrix3, Vector3};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{Rng, SeedableRng};
use serde::Deserialize;
use sprung::Scene;
use std::cell::RefCell;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Draws for each of the configurations.
pub const DRAWS: usize = 1000;

/// 2u: the largest relative error of an operation.
pub const UNIT: f64 = f64::EPSILON;

thread_local! {
    static COINS: RefCell<Xoshiro256PlusPlus> = RefCell::new(Xoshiro256PlusPlus::seed_from_u64(73));
}

/// A number whose operations round at random.
#[derive(Debug, Clone, Copy)]
pub struct Stochastic(pub f64);

impl Stochastic {
    /// One of the neighbours of an exact result: of that rounded to nearest, `near`, and the sign of what is left.
    fn of(near: f64, rest: f64) -> Self {
        let is_other = rest != 0.0 && rest.is_finite() && COINS.with_borrow_mut(|coins| coins.next_u64() & 1 == 1);
        match (is_other, rest > 0.0) {
            (false, _) => Self(near),
            (true, true) => Self(near.next_up()),
            (true, false) => Self(near.next_down()),
        }
    }

    pub fn sqrt(self) -> Self {
        let root = self.0.sqrt();
        Self::of(root, (-root).mul_add(root, self.0))
    }
}

impl Add for Stochastic {
    type Output = Self;

    /// With the exact error of a sum (Knuth).
    fn add(self, Self(b): Self) -> Self {
        let Self(a) = self;
        let sum = a + b;
        let part = sum - a;
        Self::of(sum, (a - (sum - part)) + (b - part))
    }
}

impl Mul for Stochastic {
    type Output = Self;

    fn mul(self, Self(b): Self) -> Self {
        Self::of(self.0 * b, self.0.mul_add(b, -(self.0 * b)))
    }
}

impl Div for Stochastic {
    type Output = Self;

    fn div(self, Self(b): Self) -> Self {
        let quotient = self.0 / b;
        Self::of(quotient, (-quotient).mul_add(b, self.0) * b.signum())
    }
}

impl Neg for Stochastic {
    type Output = Self;

    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Sub for Stochastic {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

#[derive(Deserialize)]
struct File {
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    name: String,
    scene: Scene,
    length: f64,
    strain: f64,
    force: Vec<f64>,
    energy: f64,
    stiffness_blocks: Blocks,
}

#[derive(Deserialize)]
struct Blocks {
    full: Vec<Vec<f64>>,
}

/// Length, strain, force, energy and block of a spring, by the formulas of `src/spring.rs`.
struct Formulas {
    length: f64,
    strain: f64,
    force: [f64; 3],
    energy: f64,
    block: Matrix3<f64>,
}

fn formulas(xi: &Vector3<f64>, xj: &Vector3<f64>, spring: &sprung::Spring) -> Formulas {
    let number = Stochastic;
    let [k, l0, half] = [spring.stiffness, spring.rest_length, 0.5].map(number);
    let d: [Stochastic; 3] = std::array::from_fn(|axis| number(xi[axis]) - number(xj[axis]));
    let l = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    let n = d.map(|component| component / l);
    let strain = (l - l0) / l0;
    let force = n.map(|n| (n * -(k * strain)).0);
    let energy = half * k * strain * strain * l0;
    let (transverse, axial) = (k * (l - l0) / (l0 * l), k / l0);
    let squares = n.map(|n| n * n);
    let excess = axial - transverse;
    let entry = |r: usize, c: usize| {
        let across = squares[(r + 1) % 3] + squares[(r + 2) % 3];
        let diagonal = || axial * squares[r] + transverse * across;
        if r == c { diagonal().0 } else { (excess * (n[r] * n[c])).0 }
    };
    Formulas { length: l.0, strain: strain.0, force, energy: energy.0, block: Matrix3::from_fn(entry) }
}

/// The bounds of `known/spring_blocks.rs` in units of rounding: none is exceeded in a thousand draws, and the worst of all draws uses more than
/// a tenth of each, so that they are no formality.
#[test]
fn bounds_of_a_spring_hold_however_it_is_rounded() {
    let file: File = serde_json::from_str(include_str!("../answers/spring_blocks.json")).unwrap();
    assert!(file.cases.len() > 40);
    const BOUNDS: [(&str, f64); 5] =
        [("length", 8.0), ("strain", 8.0), ("force", 10.0), ("energy", 20.0), ("block", 10.0)];
    let mut most = [0.0f64; 5];
    for case in &file.cases {
        let (system, state) = case.scene.build().unwrap();
        let spring = system.springs()[0];
        let [i, j] = system.pair(0);
        let [stiffness, reach] = [spring.stiffness / spring.rest_length, case.length.max(spring.rest_length)];
        let slack = stiffness * reach;
        let energy = slack * reach * (case.strain.abs() * spring.rest_length / reach).max(UNIT);
        let sizes =
            [case.length, reach / spring.rest_length, slack, energy, stiffness + spring.stiffness / case.length];
        for _ in 0..DRAWS {
            let found = formulas(&state.positions[i], &state.positions[j], &spring);
            let force = case.force.iter().zip(&found.force).map(|(known, found)| (found - known).abs());
            let known = &case.stiffness_blocks.full;
            let block = known.iter().enumerate().flat_map(|(r, row)| {
                let found = &found.block;
                row.iter().enumerate().map(move |(c, known)| (found[(r, c)] - known).abs())
            });
            let errors = [
                (found.length - case.length).abs(),
                (found.strain - case.strain).abs(),
                force.fold(0.0, f64::max),
                (found.energy - case.energy).abs(),
                block.fold(0.0, f64::max),
            ];
            for (k, (name, bound)) in BOUNDS.into_iter().enumerate() {
                let used = errors[k] / (UNIT * sizes[k]) / bound;
                assert!(used <= 1.0, "{}, {name}: {used} of its bound", case.name);
                most[k] = most[k].max(used);
            }
        }
    }
    println!("worst of the bounds used: {most:.3?}");
    assert!(most.iter().all(|used| *used > 0.1), "{most:?}");
}

/// Each operation gives both neighbours of an exact result, and an exact one itself.
#[test]
fn operations_round_both_ways() {
    let draws = |of: &dyn Fn() -> Stochastic| {
        let mut seen: Vec<u64> = (0..200).map(|_| of().0.to_bits()).collect();
        seen.sort_unstable();
        seen.dedup();
        seen.iter().map(|&bits| f64::from_bits(bits)).collect::<Vec<_>>()
    };
    let [one, third, three] = [1.0, 1.0 / 3.0, 3.0].map(Stochastic);
    let tenth = Stochastic(0.1);
    assert_eq!(draws(&|| one + Stochastic(2.0)), [3.0]);
    assert_eq!(draws(&|| three * Stochastic(0.5)), [1.5]);
    assert_eq!(draws(&|| Stochastic(9.0).sqrt()), [3.0]);
    // 1/3 is below its double's upper neighbour and above the double.
    assert_eq!(draws(&|| one / three), [1.0 / 3.0, (1.0f64 / 3.0).next_up()]);
    assert_eq!(draws(&|| -one / three).len(), 2);
    assert_eq!(draws(&|| one / -three), draws(&|| -(one / three)));
    for both in [draws(&|| tenth + third), draws(&|| tenth * third), draws(&|| Stochastic(2.0).sqrt())] {
        assert!(both.len() == 2 && both[0].next_up() == both[1], "{both:?}");
    }
}

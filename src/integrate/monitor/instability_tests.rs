//! The criterion of growth, by hand.

use super::energy_balance::{EnergyBalance, ParticleSums};
use super::instability::{Growth, Noise};
use super::springs::Sums;
use super::work::BodyEnergy;
use crate::integrate::StepFailure;
use crate::spring::Spring;
use crate::system::{State, System, SystemBuilder};

/// A particle at the origin, whose place holds no rounding.
fn particle() -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 1.0);
    builder.build().unwrap()
}

/// The energies of a scene at a state, in J.
#[derive(Clone, Copy, Default)]
struct Has {
    kinetic: f64,
    elastic: f64,
    /// Since the start.
    work: f64,
    dissipated: f64,
    certain: f64,
}

impl Has {
    fn start(&self) -> EnergyBalance {
        let springs = Sums { elastic: self.elastic, ..Sums::default() };
        EnergyBalance::new(&springs, &self.particles(), BodyEnergy::default())
    }

    fn particles(&self) -> ParticleSums {
        ParticleSums { kinetic: self.kinetic, ..ParticleSums::default() }
    }

    fn after(&self, start: &Self) -> EnergyBalance {
        let (mut balance, Self { elastic, work, dissipated, certain, .. }) = (start.start(), *self);
        balance.enter(&Sums { elastic, work, dissipated, certain }, &self.particles(), BodyEnergy::default());
        balance
    }
}

fn kinetic(kinetic: f64) -> Has {
    Has { kinetic, ..Has::default() }
}

/// The balance of two states by hand: what was released, what work swung between, and what came from nowhere since the lowest balance.
#[test]
fn growth_is_what_the_exchange_does_not_explain() {
    let (system, state) = particle();
    let start = Has { kinetic: 3.0, elastic: 5.0, ..Has::default() };
    let mut growth = Growth::new(&system, &start.start(), &state);
    assert_eq!((growth.exchanged(), growth.record.gained, growth.lost(&start.start())), (3.0, 0.0, 0.0));
    let figures = |growth: &Growth| {
        let record = growth.record;
        (record.lowest, record.gained, record.released, record.work)
    };
    let first = Has { kinetic: 4.0, elastic: 2.0, work: -1.5, dissipated: 0.5, certain: 0.25 }.after(&start);
    assert_eq!(growth.enter(&first, 1, &state, 0.5), Ok(()));
    // (4 − 3) + (2 − 5) + 1.5 + 0.25.
    assert_eq!(figures(&growth), (-0.25, 0.0, 3.0, [-1.5, 0.0]));
    assert_eq!(growth.exchanged(), 3.0 + 3.0 + 1.5);
    assert_eq!(growth.lost(&first), -1.5 + 2.0 - 0.5);
    let second = Has { kinetic: 6.0, elastic: 4.0, work: 1.0, dissipated: 0.75, certain: 0.5 }.after(&start);
    assert_eq!(growth.enter(&second, 2, &state, 0.5), Ok(()));
    // (6 − 3) + (4 − 5) − 1 + 0.5 = 1.5.
    assert_eq!(figures(&growth), (-0.25, 1.75, 3.0, [-1.5, 1.0]));
    assert_eq!(growth.exchanged(), 3.0 + 3.0 + 2.5);
    assert_eq!(growth.lost(&second), 1.0 - 2.0 - 0.75);
    // What was gained once is remembered.
    growth.enter(&first, 3, &state, 0.5).unwrap();
    assert_eq!((growth.record.gained, growth.exchanged()), (1.75, 8.5));
}

/// Energy that grows from 1 J, all that the motion exchanges; rounding is 1e-10 of it.
#[test]
fn four_times_what_was_exchanged_is_too_much() {
    let (system, state) = particle();
    let is_above = |gained: f64, doubts: &[f64]| {
        let mut growth = Growth::new(&system, &kinetic(1.0).start(), &state);
        doubts.iter().for_each(|&doubt| growth.doubt(doubt));
        growth.enter(&kinetic(1.0 + gained).after(&kinetic(1.0)), 1, &state, 0.5).unwrap();
        growth.is_above()
    };
    for (gained, expected) in [(0.0, false), (3.9, false), (4.0, false), (4.0 + 0.5e-10, false), (4.0 + 2e-10, true)] {
        assert_eq!(is_above(gained, &[]), expected, "{gained}");
    }
    // Doubts of steps add up.
    assert!(!is_above(6.9, &[1.0, 2.0]) && is_above(7.1, &[1.0, 2.0]) && is_above(6.9, &[1.0]));
    // Where nothing moves and nothing is gained nothing is too much; what is in doubt may be gained to the last bit.
    let mut growth = Growth::new(&system, &kinetic(0.0).start(), &state);
    growth.enter(&kinetic(0.0).after(&kinetic(0.0)), 1, &state, 0.5).unwrap();
    assert!(!growth.is_above());
    growth.doubt(2.0);
    growth.enter(&kinetic(2.0).after(&kinetic(0.0)), 2, &state, 0.5).unwrap();
    assert!(!growth.is_above());
}

/// Three steps in a row must find too much; a calm one between starts the count again.
#[test]
fn three_steps_in_a_row_make_a_run_unstable() {
    let (system, state) = particle();
    let start = kinetic(1.0);
    let mut growth = Growth::new(&system, &start.start(), &state);
    let mut enter = |steps: u64, kinetic: Has| growth.enter(&kinetic.after(&start), steps, &state, 0.5);
    for steps in [1, 2, 4, 5] {
        assert_eq!(enter(steps, kinetic(6.0)), Ok(()));
        if steps == 2 {
            assert_eq!(enter(3, kinetic(2.0)), Ok(()));
        }
    }
    assert_eq!(enter(6, kinetic(7.0)), Err(StepFailure::Unstable { gained: 6.0, exchanged: 1.0 }));
    assert_eq!((growth.record.above, growth.record.gained), (3, 6.0));
    let later = Growth::continued(growth.record, &kinetic(7.0).after(&start), 6, &state);
    assert!(later.is_above() && later.record == growth.record && later.saved.steps == 6);
}

/// Every calm state is saved at the start, then ever fewer, up to one in eight.
#[test]
fn calm_states_are_saved() {
    let (system, state) = particle();
    let start = kinetic(1.0);
    let mut growth = Growth::new(&system, &start.start(), &state);
    let mut saved = Vec::new();
    for steps in 1..=116 {
        let (balance, state) = (start.after(&start), State { time: steps as f64, ..state.clone() });
        growth.enter(&balance, steps, &state, 0.5).unwrap();
        if growth.saved.steps == steps {
            assert!(growth.saved.state == state && growth.saved.balance == balance);
            saved.push(steps);
        }
    }
    let [first, then] = [
        vec![1, 2, 3, 4, 5, 6, 7, 9, 11, 13, 15, 18, 21, 25, 29, 34, 39, 45, 52],
        vec![60, 68, 76, 84, 92, 100, 108, 116],
    ];
    assert_eq!(saved, [first, then].concat());
}

/// A state is calm as long as no more than three tenths of what the motion exchanged came from nowhere, but for rounding and doubt.
#[test]
fn states_that_have_grown_are_not_saved() {
    let (system, state) = particle();
    let is_saved = |gained: f64, doubt: f64| {
        let mut growth = Growth::new(&system, &kinetic(1.0).start(), &state);
        growth.doubt(doubt);
        growth.enter(&kinetic(1.0 + gained).after(&kinetic(1.0)), 1, &state, 0.5).unwrap();
        growth.saved.steps == 1
    };
    for (gained, doubt, expected) in [
        (0.29, 0.0, true),
        (0.3 + 0.5e-10, 0.0, true),
        (0.3 + 2e-10, 0.0, false),
        (0.7, 0.0, false),
        (0.49, 0.2, true),
        (0.51, 0.2, false),
    ] {
        assert_eq!(is_saved(gained, doubt), expected, "{gained} {doubt}");
    }
    // Of 4 J it is 1.2 J.
    for (gained, expected) in [(1.1, true), (1.3, false)] {
        let mut growth = Growth::new(&system, &kinetic(4.0).start(), &state);
        growth.enter(&kinetic(4.0 + gained).after(&kinetic(4.0)), 1, &state, 0.5).unwrap();
        assert_eq!(growth.saved.steps == 1, expected, "{gained}");
    }
    // Where nothing moves all is calm: what grows by nothing has not grown.
    let mut growth = Growth::new(&system, &kinetic(0.0).start(), &state);
    growth.enter(&kinetic(0.0).after(&kinetic(0.0)), 1, &state, 0.5).unwrap();
    assert_eq!(growth.saved.steps, 1);
}

/// Rounded places are 4e-12 m off where the largest coordinate is 4 m: on 12 N/m, and 5 kg that have got there in a step.
#[test]
fn rounded_positions_hold_energy() {
    let mut builder = SystemBuilder::new();
    builder.particle([0.0; 3], 2.0);
    builder.particle([0.0, 0.0, 4.0], 3.0);
    builder.spring(0, 1, Spring { stiffness: 6.0, rest_length: 0.5, damping: 0.0 });
    let (system, state) = builder.build().unwrap();
    let noise = Noise::new(&system, &state);
    for (dt, rates) in [(0.5, 4.0), (4.0, 0.0625)] {
        let expected = 0.5 * 16e-24 * (12.0 + 5.0 * rates);
        assert!((noise.energy(dt) / expected - 1.0).abs() < 1e-12, "{dt}: {}", noise.energy(dt));
    }
    // With short steps it is what grows: 5 kg · ½ (4e-12 m/1e-12 s)² = 40 J, beside the 4 J of the exchange.
    for (gained, expected) in [(43.9, false), (44.1, true)] {
        let mut growth = Growth::new(&system, &kinetic(1.0).start(), &state);
        growth.enter(&kinetic(1.0 + gained).after(&kinetic(1.0)), 1, &state, 1e-12).unwrap();
        assert_eq!(growth.is_above(), expected, "{gained}");
    }
}

/// Rounding is relative to the energies at the start, and to the present ones up to the energy exchanged.
#[test]
fn rounding_is_relative_to_what_is_added_up() {
    let (system, state) = particle();
    let is_above = |start: Has, now: Has| {
        let mut growth = Growth::new(&system, &start.start(), &state);
        let entered = growth.enter(&now.after(&start), 1, &state, 0.5);
        assert!(entered.is_ok() || growth.is_above());
        growth.is_above()
    };
    // 1e10 J of springs at the start make 1 J of rounding; energy that came later makes none beyond the exchange.
    let tense = Has { elastic: 1e10, ..Has::default() };
    for (gained, expected) in [(0.75, false), (1.25, true)] {
        assert_eq!(is_above(tense, Has { kinetic: gained, ..tense }), expected, "{gained}");
    }
    assert!(is_above(kinetic(0.0), kinetic(1e-3)));
}

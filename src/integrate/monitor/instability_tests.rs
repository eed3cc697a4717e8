//! The criterion of growth, by hand.

use super::energy_balance::{EnergyBalance, ParticleSums};
use super::instability::{GrowthRecord, SavedState};
use super::work::BodyEnergy;
use crate::force::SpringSums;
use crate::integrate::StepFailure;
use crate::integrate::fixtures::{particles, scene};
use crate::system::State;

/// The record of a particle at the origin, whose place holds no rounding.
fn record(start: &Has) -> GrowthRecord {
    let (system, state) = particles(&[0.0]);
    GrowthRecord::new(&system, &start.start(), &state)
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
        let springs = SpringSums { elastic: self.elastic, ..SpringSums::default() };
        EnergyBalance::new(&springs, &self.particles(), BodyEnergy::default())
    }

    fn particles(&self) -> ParticleSums {
        ParticleSums { energy: BodyEnergy { kinetic: self.kinetic, gravitational: 0.0 }, ..ParticleSums::default() }
    }

    fn after(&self, start: &Self) -> EnergyBalance {
        let (mut balance, Self { elastic, work, dissipated, certain, .. }) = (start.start(), *self);
        balance.enter(&SpringSums { elastic, work, dissipated, certain }, &self.particles(), BodyEnergy::default());
        balance
    }
}

fn kinetic(kinetic: f64) -> Has {
    Has { kinetic, ..Has::default() }
}

/// A record at a start, with energy in doubt, and one step of dt seconds from it: the record and whether the step was calm.
fn step([start, now]: [Has; 2], doubt: f64, dt: f64) -> (GrowthRecord, bool) {
    let mut growth = record(&start);
    growth.doubt(doubt);
    let (is_calm, entered) = growth.enter(&now.after(&start), dt);
    assert!(entered.is_ok() || growth.is_above());
    (growth, is_calm)
}

/// The balance of two states by hand: what was released, what work swung between, and what came from nowhere since the lowest balance.
#[test]
fn growth_is_what_the_exchange_does_not_explain() {
    let start = Has { kinetic: 3.0, elastic: 5.0, ..Has::default() };
    let mut growth = record(&start);
    assert_eq!((growth.exchanged(), growth.gained), (3.0, 0.0));
    let figures = |growth: &GrowthRecord| (growth.lowest, growth.gained, growth.released, growth.work);
    let first = Has { kinetic: 4.0, elastic: 2.0, work: -1.5, dissipated: 0.5, certain: 0.25 }.after(&start);
    assert_eq!(growth.enter(&first, 0.5).1, Ok(()));
    // (4 − 3) + (2 − 5) + 1.5 + 0.25.
    assert_eq!(figures(&growth), (-0.25, 0.0, 3.0, [-1.5, 0.0]));
    assert_eq!(growth.exchanged(), 3.0 + 3.0 + 1.5);
    let second = Has { kinetic: 6.0, elastic: 4.0, work: 1.0, dissipated: 0.75, certain: 0.5 }.after(&start);
    assert_eq!(growth.enter(&second, 0.5).1, Ok(()));
    // (6 − 3) + (4 − 5) − 1 + 0.5 = 1.5.
    assert_eq!(figures(&growth), (-0.25, 1.75, 3.0, [-1.5, 1.0]));
    assert_eq!(growth.exchanged(), 3.0 + 3.0 + 2.5);
    // What was gained once is remembered.
    growth.enter(&first, 0.5).1.unwrap();
    assert_eq!((growth.gained, growth.exchanged()), (1.75, 8.5));
}

/// Of the energy that the motion exchanges, the kinetic one at the start, three tenths from nowhere are calm and four times as much is too much, but
/// for what is in doubt and for rounding, which is 1e-10 of it.
#[test]
fn growth_is_judged_by_what_was_exchanged() {
    for (start, gained, doubt, calm, above) in [
        (1.0, 0.29, 0.0, true, false),
        (1.0, 0.3 + 0.5e-10, 0.0, true, false),
        (1.0, 0.3 + 2e-10, 0.0, false, false),
        (1.0, 0.49, 0.2, true, false),
        (1.0, 0.51, 0.2, false, false),
        (4.0, 1.1, 0.0, true, false),
        (4.0, 1.3, 0.0, false, false),
        (1.0, 4.0 + 0.5e-10, 0.0, false, false),
        (1.0, 4.0 + 2e-10, 0.0, false, true),
        (1.0, 6.9, 3.0, false, false),
        (1.0, 7.1, 3.0, false, true),
        // Where nothing moves and nothing is gained nothing is too much.
        (0.0, 0.0, 0.0, true, false),
        (0.0, 2.0, 2.0, true, false),
    ] {
        let (growth, is_calm) = step([kinetic(start), kinetic(start + gained)], doubt, 0.5);
        assert_eq!((is_calm, growth.is_above()), (calm, above), "{start} {gained} {doubt}");
    }
    // Doubts of steps add up.
    let (mut growth, _) = step([kinetic(1.0); 2], 1.0, 0.5);
    growth.doubt(2.0);
    growth.enter(&kinetic(7.9).after(&kinetic(1.0)), 0.5).1.unwrap();
    assert!(!growth.is_above());
}

/// Three steps in a row must find too much; a calm one between starts the count again.
#[test]
fn three_steps_in_a_row_make_a_run_unstable() {
    let start = kinetic(1.0);
    let mut growth = record(&start);
    let mut enter = |joules: f64| growth.enter(&kinetic(joules).after(&start), 0.5).1;
    for joules in [6.0, 6.0, 2.0, 6.0, 6.0] {
        assert_eq!(enter(joules), Ok(()));
    }
    assert_eq!(enter(7.0), Err(StepFailure::Unstable { gained: 6.0, exchanged: 1.0 }));
    assert_eq!((growth.above, growth.gained), (3, 6.0));
}

/// Every calm state is saved at the start, then ever fewer, up to one in eight.
#[test]
fn calm_states_are_saved() {
    let (_, state) = particles(&[0.0]);
    let (balance, later) = (kinetic(1.0).start(), kinetic(2.0).start());
    let mut saved = SavedState { steps: 0, state: state.clone(), balance };
    let mut steps_saved = Vec::new();
    for steps in 1..=116 {
        let state = State { time: steps as f64, ..state.clone() };
        saved.update(steps, &state, &later);
        if saved.steps == steps {
            assert!(saved.state == state && saved.balance == later);
            steps_saved.push(steps);
        }
    }
    let first = [1, 2, 3, 4, 5, 6, 7, 9, 11, 13, 15, 18, 21, 25, 29, 34, 39, 45, 52];
    assert!(steps_saved.into_iter().eq(first.into_iter().chain((60..=116).step_by(8))));
}

/// Rounded places are 4e-12 m off where the largest coordinate is 4 m: on 12 N/m, and 5 kg that have got there in a step.
#[test]
fn rounded_positions_hold_energy() {
    let particles = [([0.0; 3], 2.0), ([0.0, 0.0, 4.0], 3.0)];
    let (system, state) = scene(&particles, &[(0, 1, [6.0, 0.5, 0.0])]).build().unwrap();
    let record = GrowthRecord::new(&system, &kinetic(1.0).start(), &state);
    for (dt, rates) in [(0.5, 4.0), (4.0, 0.0625)] {
        let expected = 0.5 * 16e-24 * (12.0 + 5.0 * rates);
        let found = record.noise.energy(dt);
        assert!((found / expected - 1.0).abs() < 1e-12, "{dt}: {found}");
    }
    // With short steps it is what grows: 5 kg · ½ (4e-12 m/1e-12 s)² = 40 J, beside the 4 J of the exchange.
    for (gained, expected) in [(43.9, false), (44.1, true)] {
        let mut growth = record;
        growth.enter(&kinetic(1.0 + gained).after(&kinetic(1.0)), 1e-12).1.unwrap();
        assert_eq!(growth.is_above(), expected, "{gained}");
    }
}

/// Rounding is relative to the energies at the start, and to the present ones up to the energy exchanged.
#[test]
fn rounding_is_relative_to_what_is_added_up() {
    // 1e10 J of springs at the start make 1 J of rounding; energy that came later makes none beyond the exchange.
    let tense = Has { elastic: 1e10, ..Has::default() };
    for (gained, expected) in [(0.75, false), (1.25, true)] {
        assert_eq!(step([tense, Has { kinetic: gained, ..tense }], 0.0, 0.5).0.is_above(), expected, "{gained}");
    }
    assert!(step([kinetic(0.0), kinetic(1e-3)], 0.0, 0.5).0.is_above());
}

/// Three particles that fall freely exchange nothing, while their energies of some 10 J are rounded.
#[test]
fn a_scene_that_falls_as_a_whole_is_calm() {
    let particles = [0.0, 0.7, 1.9].map(|x| ([x, 0.3 * x * x, 0.0], 0.3 + 0.1 * x));
    let mut builder = scene(&particles, &[(0, 1, [1e-3, 1.0, 0.0]), (1, 2, [1e-3, 1.0, 0.0])]);
    let (system, state) = builder.gravity(0.0, -9.81, 0.0).clone().build().unwrap();
    let at = |energy: f64, surplus: f64| ParticleSums {
        energy: BodyEnergy { kinetic: energy + surplus, gravitational: -energy },
        centre_of_mass: BodyEnergy { kinetic: energy, gravitational: -energy },
    };
    let springs = SpringSums::default();
    let mut balance = EnergyBalance::new(&springs, &at(0.0, 0.0), BodyEnergy::default());
    let mut growth = GrowthRecord::new(&system, &balance, &state);
    for (surplus, expected) in [(10.0 * f64::EPSILON, false), (1e-3, true)] {
        balance.enter(&springs, &at(10.0, surplus), BodyEnergy::default());
        let _ = growth.enter(&balance, 1e-2);
        assert_eq!(growth.is_above(), expected, "{surplus:e}");
    }
}

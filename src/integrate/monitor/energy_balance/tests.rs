use super::super::constraint_work::{DrivenEnergy, Exchange};
use super::super::particles::{self, Carried};
use super::super::sums;
use super::{Balance, EnergyBalance, Free};
use crate::force::Energy;

fn springs(elastic: f64, dissipated: f64, certain: f64) -> sums::Sums {
    sums::Sums { elastic, dissipated, certain }
}

/// Kinetic energy and `Σ m gravity·x`, and what the centre of mass has of both.
fn particles([kinetic, weight]: [f64; 2], carried: [f64; 2]) -> particles::Sums {
    let mut sums = particles::Sums::default();
    (sums.kinetic, sums.weight) = (kinetic, weight);
    sums.carried = Carried { kinetic: carried[0], weight: carried[1] };
    sums
}

fn led(kinetic: f64, gravitational: f64) -> DrivenEnergy {
    DrivenEnergy { kinetic, gravitational }
}

/// A start and two steps, entered and added up by hand.
#[test]
fn energy_goes_where_the_steps_say() {
    let mut ledger = EnergyBalance::new(&springs(3.0, 0.0, 0.0), &particles([10.0, 6.0], [2.0, 1.5]), led(1.0, 0.5));
    let initial = Energy { kinetic: 10.0, elastic: 3.0, gravitational: -6.0 };
    assert_eq!((ledger.initial, ledger.energy, ledger.balance()), (initial, initial, Balance::default()));
    // Without what is led and what the centre of mass carries: 10 − 1 − 2, and 3 + (−6 − 0.5 + 1.5).
    let free = Free { kinetic: 7.0, potential: -2.0, work: 0.0, certain: 0.0, magnitude: 19.5 };
    assert_eq!(ledger.free(), free);

    let exchange = Exchange { work: 8.0, dissipated: 0.5, certain: 0.0625 };
    ledger.enter(&springs(5.0, 0.25, 0.125), &particles([20.0, 7.0], [3.0, 2.0]), led(4.0, 1.0), &exchange);
    assert_eq!((ledger.initial, ledger.energy.total()), (initial, 18.0));
    // What is led has got 3.5 J, by work that went through no spring.
    assert_eq!(ledger.balance(), Balance { work: 11.5, dissipated: 0.75, imbalance: 18.0 - 7.0 - 11.5 + 0.75 });
    let free = Free { kinetic: 13.0, potential: -1.0, work: 8.0, certain: 0.1875, magnitude: 33.0 };
    assert_eq!(ledger.free(), free);

    let exchange = Exchange { work: 2.0, dissipated: 0.25, certain: 0.5 };
    ledger.enter(&springs(5.0, 1.0, 0.75), &particles([20.0, 7.0], [3.0, 2.0]), led(4.0, 1.0), &exchange);
    assert_eq!(ledger.balance(), Balance { work: 13.5, dissipated: 2.0, imbalance: 18.0 - 7.0 - 13.5 + 2.0 });
    assert_eq!((ledger.free().work, ledger.free().certain), (10.0, 1.4375));

    // Of another state: its energy of 9 J, and what is said of work and damping.
    let energy = Energy { kinetic: 4.0, elastic: 6.0, gravitational: -1.0 };
    let balance = Balance { work: 0.25, dissipated: 4.0, imbalance: 9.0 - 7.0 - 0.25 + 4.0 };
    assert_eq!(ledger.balance_of(&energy, 0.25, 4.0), balance);
}

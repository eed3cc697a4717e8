use super::super::aside::Detour;
use super::super::particles::{self, Carried};
use super::super::sums;
use super::{Figures, Trail};

/// What the springs say of a step.
fn springs(lifted: f64, lifted_twice: f64, reach: f64) -> sums::Sums {
    sums::Sums { lifted, lifted_twice, reach, ..sums::Sums::default() }
}

/// Squares of change, bend, third, slip, defect, inertia and speed, and the kinetic energy with the part that the centre of mass has.
fn particles(squares: [f64; 7], [kinetic, carried]: [f64; 2]) -> particles::Sums {
    let mut sums = particles::Sums::default();
    [sums.change, sums.bend, sums.third, sums.slip, sums.defect, sums.inertia, sums.speed] = squares;
    (sums.kinetic, sums.carried) = (kinetic, Carried { kinetic: carried, weight: 0.0 });
    sums
}

fn detour(way: f64) -> Detour {
    Detour { way, energy: 0.0 }
}

/// Two steps of a half and a quarter of a second in a scene of 8 m, by hand.
#[test]
fn figures_are_sums_over_the_steps() {
    let mut trail = Trail::default();
    let first = particles([16.0, 9.0, 25.0, 36.0, 4.0, 100.0, 49.0], [10.0, 4.0]);
    let second = particles([144.0, 144.0, 1.0, 16.0, 81.0, 900.0, 121.0], [22.0, 2.0]);
    trail.enter(0.5, &springs(3.0, 5.0, 4.0), &first, &detour(0.5), Some(0.25));
    trail.enter(0.25, &springs(2.0, 7.0, 2.25), &second, &detour(0.75), Some(0.125));
    let expected = Figures {
        steps: 2,
        duration: 0.75,
        extent: 8.0,
        // ½·½·4 and ½·¼·12.
        change: (1.0 + 1.5) / 8.0,
        start: 2.0 * 1.0 / 8.0,
        bend: (0.5 * 3.0 + 0.25 * 12.0) / 8.0,
        third: (5.0 + 1.0) / 8.0,
        slip: (6.0 + 4.0) / 8.0,
        defect: (2.0 + 9.0) / (10.0 + 30.0),
        way: (0.5 * 7.0 + 0.25 * 11.0) / 8.0,
        // The kinetic energy of 6 J for half a second and 20 J for a quarter has a mean of 8/0.75 J.
        lifted: (3.0 + 2.0) * 0.75 / 8.0,
        lifted_twice: (5.0 + 7.0) * 0.75 / 8.0,
        reach: 2.0,
        embedded: (0.25 + 0.125) / 8.0,
        aside: (0.5 + 0.75) / 8.0,
        ..Figures::default()
    };
    assert_eq!(trail.figures(8.0), expected);
    // A method without an estimate adds nothing to the estimates.
    trail.enter(0.25, &springs(0.0, 0.0, 9.0), &second, &detour(0.0), None);
    let figures = trail.figures(8.0);
    assert_eq!((figures.steps, figures.reach, figures.embedded), (3, 3.0, expected.embedded));
}

/// Nothing out of nothing is nothing.
#[test]
fn figures_of_no_steps_are_zero() {
    assert_eq!(Trail::default().figures(2.0), Figures { extent: 2.0, ..Figures::default() });
}

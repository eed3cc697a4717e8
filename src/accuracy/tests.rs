//! What every way to an answer tries on small motions: which runs, what it believes of them, and when it leaves the motion to another way.
//!
//! `tests/tried_*.txt` hold it, block by block, as it was when it was looked at. Numbers are held to two percent. `SPRUNG_RENEW=tried` with this
//! test writes the list anew; the difference belongs into the change that makes it.

mod handed_on;
mod told;

use super::course::Course;
use super::price::Price;
use super::rates::Rates;
use super::search::{Search, Verdict};
use super::verlet::Extrapolated;
use super::{alone, dop853, equal, settled, stiff, verlet};
use crate::error::Result;
use crate::integrate::{Method, StiffnessPolicy};
use crate::linear::CostModel;
use crate::spring::{Spring, Stiffness};
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use nalgebra::Vector3;
use told::{Case, Told, Way, each, hold, priced};

fn spring(stiffness: f64, rest_length: f64, damping: f64) -> Spring {
    Spring { stiffness, rest_length, damping }
}

/// A chain that hangs from its first particle, pulled aside.
fn hanging(links: usize, stiffness: f64, damping: f64, aside: f64) -> (System, State) {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    builder.gravity(0.0, -9.81, 0.0);
    for p in 0..=links {
        builder.particle([aside * p as f64, -0.5 * p as f64, 0.0], 0.1 + 0.01 * p as f64);
    }
    for p in 0..links {
        builder.spring(p, p + 1, spring(stiffness * (1.0 + 0.1 * p as f64), 0.45, damping));
    }
    builder.hold(0);
    builder.build().unwrap()
}

/// A particle on a spring in a plane, so far from its anchor and so fast.
fn planet(at: [f64; 2], velocity: [f64; 2], rest_length: f64) -> (System, State) {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    builder.particle([0.0; 3], 1.0);
    let particle = builder.particle([at[0], at[1], 0.0], 1.0);
    builder.spring(0, 1, spring(10.0, rest_length, 0.0));
    builder.hold(0);
    builder.velocities[particle] = Vector3::new(velocity[0], velocity[1], 0.0);
    builder.build().unwrap()
}

/// Particles on a line, each on a spring of its own, that fly through their anchors: forces jump there.
fn through(particles: usize) -> (System, State) {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    for p in 0..particles {
        let [anchor, particle] = [0.0, 1.0 + 0.1 * p as f64].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
        builder.spring(anchor, particle, spring(4.0, 0.5, 0.0));
        builder.hold(anchor);
        builder.velocities[particle] = Vector3::new(-4.0, 0.0, 0.0);
    }
    builder.build().unwrap()
}

/// A stiff damped link whose anchor stands still until this time, and moves then.
fn led(kink: f64) -> (System, State) {
    led_by(kink, spring(1e6, 1.0, 1e3))
}

fn led_by(kink: f64, link: Spring) -> (System, State) {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    builder.gravity(0.0, -9.81, 0.0);
    builder.particle([0.0; 3], 1.0);
    builder.particle([0.0, -1.0, 0.0], 1.0);
    builder.spring(0, 1, link);
    let offsets = vec![Vector3::zeros(), Vector3::zeros(), Vector3::new(0.1, 0.0, 0.0)];
    let motion = Motion::Path { times: vec![-1.0, kink, kink + 1.0], offsets };
    builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
    builder.build().unwrap()
}

fn by_dop853(search: &mut Search<'_, Told>, price: Price) -> Result<String> {
    dop853::answer(search, price, None).map(|verdict| format!("{verdict:?}"))
}

fn elsewhere(led: std::result::Result<Verdict, Extrapolated>) -> String {
    match led {
        Ok(verdict) => format!("{verdict:?}"),
        Err(Extrapolated(other)) => format!("elsewhere, with a course: {}", other.is_some()),
    }
}

fn by_equal(search: &mut Search<'_, Told>, price: Price) -> Result<String> {
    equal::answer(search, price, None).map(elsewhere)
}

fn by_verlet(search: &mut Search<'_, Told>, price: Price) -> Result<String> {
    verlet::answer(search, price).map(elsewhere)
}

fn by_stiff(search: &mut Search<'_, Told>, price: Price) -> Result<String> {
    stiff::answer(search, price).map(|verdict| format!("{verdict:?}"))
}

fn by_settled(search: &mut Search<'_, Told>, price: Price) -> Result<String> {
    settled::answer(search, price).map(|verdict| format!("{verdict:?}"))
}

/// What Verlet's method extrapolates goes to the way.
fn handed_on(
    search: &mut Search<'_, Told>,
    price: Price,
    on: impl Fn(&mut Search<'_, Told>, Price, Option<Course>) -> Result<String>,
) -> Result<String> {
    match verlet::answer(search, price)? {
        Ok(verdict) => Ok(format!("{verdict:?}")),
        Err(Extrapolated(other)) => on(search, price, other),
    }
}

fn by_one(method: Method) -> impl Fn(&mut Search<'_, Told>, Price) -> Result<String> {
    move |search, _| {
        let rates = Rates { vibration: 30.0, damping: 0.5, cost: 0.0 };
        alone::answer(search, method, &rates).map(|verdict| format!("{verdict:?}"))
    }
}

fn swinging() -> Case {
    Case::new(hanging(3, 20.0, 0.0, 0.1), 1.0, 1e-4)
}

#[test]
fn steps_that_follow_an_estimate() {
    let swinging = swinging();
    let near = Case::new(planet([1.0, 0.0], [0.0, 0.05], 0.02), 2.0, 1e-4);
    let radial = Case::new(planet([1.0, 0.0], [-5.0, 0.0], 0.5), 1.0, 1e-3);
    let folding = Case::new(hanging(3, 200.0, 0.0, 0.9), 6.0, 1e-6);
    let digits = |accuracy: f64| move |case: &mut Case| case.accuracy = accuracy;
    let late = |case: &mut Case| case.start.time = 0.3;
    let cases = [
        ("swinging", swinging.clone()),
        ("swinging to a digit", swinging.with(digits(0.05))),
        ("swinging to nine digits", swinging.with(digits(1e-9))),
        ("swinging to rounding", swinging.with(digits(1e-15))),
        ("swinging slowly", swinging.with(priced(100.0, 10.0, 0.1))),
        ("swinging fast", swinging.with(priced(100.0, 10.0, 1e3))),
        ("near the anchor", near.clone()),
        ("near the anchor to a digit", near.with(digits(0.05))),
        ("near the anchor to seven digits", near.with(digits(1e-7))),
        ("through the anchor", radial.clone()),
        ("through the anchor to seven digits", radial.with(digits(1e-7))),
        ("on a line", Case::new(through(1), 2.0, 1e-3)),
        ("on a line to six digits", Case::new(through(1), 2.0, 1e-6)),
        ("several on a line", Case::new(through(6), 2.0, 1e-2)),
        (
            "several on a line, not confirmed",
            Case::new(through(6), 2.0, 1e-2).with(|c| c.verdict = Verdict::Interrupted),
        ),
        ("four on a line", Case::new(through(4), 2.0, 1e-2)),
        ("folding", folding.clone()),
        ("folding later", folding.with(late)),
        ("ended", swinging.with(|case| case.looks = 300)),
        ("dear", swinging.with(|case| case.spent = 3e7 - 3e3)),
        ("dearer", swinging.with(|case| case.spent = 3e7 - 300.0)),
    ];
    let mut all = each(&by_dop853, &cases);
    let compared: Way<'_> = &|search, price| {
        handed_on(search, price, |search, price, other| {
            dop853::answer(search, price, other).map(|verdict| format!("{verdict:?}"))
        })
    };
    for (name, accuracy) in [("compared", 1e-4), ("compared to six digits", 1e-6), ("compared to one digit", 0.1)] {
        all.push((name.into(), near.with(digits(accuracy)).tried(compared)));
    }
    hold("tried_dop853", all);
}

#[test]
fn steps_of_one_length() {
    let swinging = swinging();
    let digits = |accuracy: f64| move |case: &mut Case| case.accuracy = accuracy;
    let cases = [
        ("swinging", swinging.clone()),
        ("swinging to a digit", swinging.with(digits(0.05))),
        ("swinging to nine digits", swinging.with(digits(1e-9))),
        ("stiff", Case::new(hanging(3, 2e4, 0.0, 0.01), 0.5, 1e-4)),
        ("near the anchor", Case::new(planet([1.0, 0.0], [0.0, 0.05], 0.02), 2.0, 1e-4)),
        ("through the anchor", Case::new(planet([1.0, 0.0], [-5.0, 0.0], 0.5), 1.0, 1e-3)),
        ("on a line", Case::new(through(1), 2.0, 1e-3)),
        ("folding", Case::new(hanging(3, 200.0, 0.0, 0.9), 6.0, 1e-6)),
        ("breaking down", Case::new(hanging(3, 2e9, 0.0, 0.3), 5.0, 1e-3).with(priced(100.0, 40.0, 50.0))),
        ("swinging to ten digits", swinging.with(digits(1e-10))),
        ("ended", swinging.with(|case| case.looks = 100)),
        ("dear", swinging.with(|case| case.spent = 3e7 - 400.0)),
        ("dearer", swinging.with(|case| case.spent = 3e7 - 20.0)),
    ];
    let mut all = each(&by_equal, &cases);
    let compared: Way<'_> = &|search, price| {
        handed_on(search, price, |search, price, other| equal::answer(search, price, other).map(elsewhere))
    };
    for (name, accuracy) in [("compared", 1e-4), ("compared to six digits", 1e-6), ("compared to three digits", 1e-3)] {
        all.push((name.into(), swinging.with(digits(accuracy)).tried(compared)));
    }
    hold("tried_equal", all);
}

#[test]
fn runs_of_verlet() {
    let swinging = swinging();
    let digits = |accuracy: f64| move |case: &mut Case| case.accuracy = accuracy;
    let cases = [
        ("swinging", swinging.clone()),
        ("swinging to a digit", swinging.with(digits(0.1))),
        ("swinging to two digits", swinging.with(digits(1e-2))),
        ("swinging to three digits", swinging.with(digits(1e-3))),
        // The first pair's estimate is 0.89 and 0.91 of these.
        ("swinging to what is just shown", swinging.with(digits(0.0497))),
        ("swinging to what is just not shown", swinging.with(digits(0.0486))),
        ("swinging cheaply", swinging.with(priced(30.0, 3e3, 30.0))),
        ("stiff", Case::new(hanging(3, 2e4, 0.0, 0.01), 0.5, 1e-2)),
        ("folding", Case::new(hanging(3, 200.0, 0.0, 0.9), 6.0, 1e-3)),
        ("folding cheaply", Case::new(hanging(3, 200.0, 0.0, 0.9), 6.0, 1e-3).with(priced(300.0, 3e4, 30.0))),
        ("out of phase", Case::new(hanging(3, 2e4, 0.0, 0.01), 0.5, 2e-4).with(priced(200.0, 3e4, 30.0))),
        ("led from within", Case::new(led_by(0.5, spring(60.0, 0.9, 0.0)), 1.0, 1e-4).with(priced(10.0, 3e3, 30.0))),
        ("led from the end", Case::new(led_by(1.0, spring(60.0, 0.9, 0.0)), 1.0, 1e-4).with(priced(10.0, 3e3, 30.0))),
        ("on a line", Case::new(through(1), 2.0, 1e-3).with(priced(30.0, 3e3, 30.0))),
        ("near the anchor", Case::new(planet([1.0, 0.0], [0.0, 0.05], 0.02), 2.0, 1e-3).with(priced(30.0, 3e3, 30.0))),
        ("swinging in many steps", swinging.with(digits(0.1)).with(priced(1e3, 3.0, 30.0))),
        // Neglects little, but may buckle.
        ("pressed in many steps", Case::new(planet([0.5, 0.0], [0.0; 2], 1.0), 20.0, 0.1).with(priced(1e4, 1e5, 30.0))),
        ("blown up", Case::new(hanging(3, 2e3, 0.0, 0.3), 2.0, 1e-2).with(priced(30.0, 3e3, 100.0))),
        ("broken down", Case::new(hanging(3, 2e9, 0.0, 0.3), 2.0, 1e-2).with(priced(30.0, 3e3, 100.0))),
        ("ended", swinging.with(|case| case.looks = 60)),
        ("dear", swinging.with(|case| case.spent = 3e7 - 30.0)),
        ("dearer", swinging.with(|case| case.spent = 3e7 - 5.0)),
    ];
    hold("tried_verlet", each(&by_verlet, &cases));
}

#[test]
fn implicit_runs() {
    let settling = Case::new(hanging(2, 300.0, 6.0, 0.02), 20.0, 1e-2);
    let stiff = Case::new(hanging(3, 2e5, 400.0, 0.05), 0.5, 1e-2);
    let resting = Case::new(hanging(2, 2e6, 2e3, 0.0), 1.0, 1e-3);
    let digits = |accuracy: f64| move |case: &mut Case| case.accuracy = accuracy;
    let pressed = Case::new(planet([0.5, 0.0], [0.0, 0.0], 1.0), 20.0, 1e-2).with(priced(1e5, 1e4, 30.0));
    let cases = [
        ("settling", settling.clone()),
        ("settling to a digit", settling.with(digits(0.1))),
        ("settling to four digits", settling.with(digits(1e-4))),
        ("stiff", stiff.clone()),
        ("stiff to a digit", stiff.with(digits(0.2))),
        ("stiff to four digits", stiff.with(digits(1e-4))),
        ("stiff and almost too cheap", stiff.with(priced(25e2, 1e3, 1e3))),
        ("stiff and cheap", stiff.with(priced(1e3, 1e3, 1e3))),
        ("resting", resting.clone()),
        ("resting to five digits", resting.with(digits(1e-5))),
        ("creeping", Case::new(hanging(2, 20.0, 500.0, 0.05), 2.0, 1e-2)),
        ("creeping to three digits", Case::new(hanging(2, 20.0, 500.0, 0.05), 2.0, 1e-3)),
        ("creeping fast", Case::new(hanging(2, 20.0, 50.0, 0.05), 2.0, 1e-2)),
        ("swinging", Case::new(hanging(3, 20.0, 0.0, 0.1), 1.0, 1e-3).with(priced(1e5, 1e5, 1e3))),
        ("pressed", pressed),
        ("led from within", Case::new(led(0.5), 1.0, 1e-2)),
        ("led from the end", Case::new(led(1.0), 1.0, 1e-2)),
        ("led afterwards", Case::new(led(3.0), 1.0, 1e-2)),
        ("led later", Case::new(led(3.0), 1.0, 1e-2).with(|case| case.start.time = 2.5)),
        ("ended", stiff.with(|case| case.looks = 20)),
        ("dear", stiff.with(|case| case.spent = 3e7 - 500.0)),
        ("tension alone", stiff.with(|case| case.stiffness = Some(StiffnessPolicy::Always(Stiffness::Tension)))),
    ];
    let of_stiff = cases.each_ref().map(|(name, case)| {
        (*name, if name.contains("cheap") { case.clone() } else { case.with(priced(1e4, 1e4, 1e3)) })
    });
    hold("tried_stiff", each(&by_stiff, &of_stiff));
    let mut all = each(&by_settled, &cases);
    // Further and further runs, down to where they are not believed any more.
    for accuracy in [1e-3, 4e-4, 2e-4, 1e-4, 5e-5, 2e-5] {
        let case = Case::new(led(3.0), 1.0, accuracy).with(priced(1e5, 1e5, 1e3));
        all.push((format!("led afterwards to {accuracy:e}"), case.tried(&by_settled)));
    }
    let barely = Case::new(led(3.0), 1.0, 1e-2).with(priced(350.0, 1e3, 1e3));
    all.push(("led afterwards, explicit answers being hardly dear enough".into(), barely.tried(&by_settled)));
    // Definite for a twelfth of the time, and not for all of it.
    let pressed = Case::new(planet([0.5, 0.0], [0.0, 0.0], 1.0), 2.4, 0.2).with(priced(1e5, 1e4, 30.0));
    all.push(("pressed for a while".into(), pressed.tried(&by_settled)));
    for (name, case) in &cases[..15] {
        all.push((format!("{name}, explicit answers being dear"), case.with(priced(1e5, 1e5, 1e3)).tried(&by_settled)));
    }
    hold("tried_settled", all);
}

/// At what price of explicit answers implicit ones are tried.
#[test]
fn prices_at_which_implicit_runs_are_tried() {
    for accuracy in [1e-2, 1e-3] {
        let case = Case::new(led(3.0), 1.0, accuracy);
        let costs = CostModel::of(&case.system);
        let solve = costs.least_direct_solve();
        let settled =
            36.0 * (0.1 / accuracy).powf(0.12) * (2.0 + costs.assembly() + costs.least_factorization() + solve);
        let step = 7.0 + costs.assembly() + costs.least_factorization() + 12.0 * solve;
        let stiff = 60.0 * (0.1 / accuracy).powf(0.3) * step;
        for (way, border) in [(&by_settled as Way<'_>, settled), (&by_stiff as Way<'_>, stiff)] {
            for (part, is_tried) in [(0.99, false), (1.01, true)] {
                // An explicit answer is two runs of Verlet's method.
                let told = case.with(priced(part * border / 2.25, 1e3, 1e3)).tried(way);
                assert_eq!(told.contains("dt =") || told.contains("rtol ="), is_tried, "{part} {border}: {told}");
            }
        }
    }
}

#[test]
fn methods_alone() {
    let swinging = swinging().with(|case| case.accuracy = 1e-3);
    let stiff = Case::new(hanging(3, 2e5, 400.0, 0.05), 0.05, 1e-3);
    let blown = Case::new(hanging(3, 2e7, 0.0, 0.3), 0.2, 1e-2).with(|case| case.spent = 3e7 - 3e4);
    let digits = |accuracy: f64| move |case: &mut Case| case.accuracy = accuracy;
    let cases = [
        ("swinging", swinging.clone()),
        ("swinging to a digit", swinging.with(digits(0.1))),
        ("swinging to five digits", swinging.with(digits(1e-5))),
        ("stiff", stiff.clone()),
        ("resting", Case::new(hanging(1, 2e6, 2e3, 0.0), 1.0, 1e-3)),
        ("free", Case::new(planet([1.0, 0.0], [0.0, 0.0], 1.0), 1.0, 1e-3)),
        ("near the anchor", Case::new(planet([1.0, 0.0], [0.0, 0.05], 0.02), 2.0, 1e-2)),
        ("ended", swinging.with(|case| case.looks = 80)),
        ("dear", swinging.with(|case| case.spent = 3e7 - 200.0)),
        ("to rounding", swinging.with(digits(1e-16)).with(|case| case.duration = 0.05)),
        ("broken down", blown),
    ];
    let mut all = Vec::new();
    for method in Method::ALL {
        for (name, case) in &cases {
            // Low orders never get there.
            let is_low = method.order() < 2 && case.accuracy < 1e-3;
            if !(is_low || (case.accuracy < 1e-12 && !method.estimates_errors())) {
                // What is left is little: what does not get there soon is ended.
                let case = case.with(|case| case.spent = case.spent.max(3e7 - 3e4));
                all.push((format!("{name} by {}", method.name()), case.tried(&by_one(method))));
            }
        }
    }
    hold("tried_alone", all);
}

/// Matrices that would take long to factor are not looked at.
#[test]
fn what_is_too_large_is_not_settled() {
    for (particles, is_tried) in [(30_000, true), (30_001, false)] {
        let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
        (0..particles).for_each(|p| _ = builder.particle([f64::from(p), 0.0, 0.0], 1.0));
        let case = Case::new(builder.build().unwrap(), 1.0, 1e-2).with(priced(1e5, 1e5, 1e3));
        let tried = case.tried(&by_settled);
        assert_eq!(tried.contains("bdf2"), is_tried, "{particles}: {tried}");
    }
}

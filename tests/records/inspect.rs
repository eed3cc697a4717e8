//! Every figure of inspections of small systems is the one that was measured when it was looked at: definite and indefinite ones,
//! planar, held, led and turning, diagonalised whole and searched.

use crate::record::{Row, beside, hold};
use faer::Par;
use sprung::inspect::{Follower, Inspection, Pictures, Turning, smallest_eigenvalue};
use sprung::integrate::{ImplicitOptions, Method, StepMatrices, StiffnessPolicy};
use sprung::linear::{SolverChoice, SolverOptions};
use sprung::scene::{Kind, builtin};
use sprung::verify::{Subject, built_in};
use sprung::work::Work;
use sprung::{Spring, Stiffness, SystemBuilder};

fn small() -> Vec<Subject> {
    built_in().unwrap()
}

/// A crooked chain between walls, pressed where `rest_length` is above 1, with more degrees of freedom than are diagonalised whole.
fn chain(free: usize, rest_length: f64, damping: f64) -> Subject {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    for p in 0..free + 2 {
        let [x, y] = [p as f64 + 0.01 * ((7 * p) % 5) as f64, 0.05 * ((3 * p) % 7) as f64];
        builder.particle([x, y, 0.0], 2.0 + 0.1 * (p % 3) as f64);
    }
    for p in 0..=free {
        let stiffness = 50.0 + (p % 4) as f64;
        builder.spring(p, p + 1, Spring { stiffness, rest_length: rest_length + 0.01 * (p % 5) as f64, damping });
    }
    builder.hold(0);
    builder.hold(free + 1);
    let (system, state) = builder.build().unwrap();
    Subject { name: format!("chain {free} {rest_length}"), system, state, dt: 0.1 }
}

fn cloth() -> Subject {
    let cloth = Subject::of_scene(&builtin(Kind::Cloth, 9).unwrap()).unwrap();
    Subject { dt: 0.05, ..cloth }
}

/// Shows a text as it is.
struct Shown(String);

impl std::fmt::Debug for Shown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

fn inspections(name: &str, subjects: &[Subject], factors: &[f64], options: &[Stiffness], most: f64) {
    hold(name, |seed| {
        let mut rows = Vec::new();
        for subject in subjects.iter().map(|subject| beside(subject, seed)) {
            for (factor, option) in
                factors.iter().flat_map(|&factor| options.iter().map(move |&option| (factor, option)))
            {
                let (system, state, dt) = (&subject.system, &subject.state, factor * subject.dt);
                let mut shares = Vec::new();
                let mut look = |share: f64, _: &Inspection| shares.push(share);
                let found = Inspection::within(system, state, dt, option, Par::Seq, most, &mut look);
                let key = format!("{} {factor} {}", subject.name, option.name());
                let Ok(found) = found else {
                    rows.push(Row::shown(key, &found.map_err(|error| error.to_string())));
                    continue;
                };
                let said = (found.multiplicity(), found.fold(), found.examined().inertia.is_definite());
                // That it keeps an analysis for its pictures is nothing that was found.
                let shown = format!("{:?}", (&found, said, shares)).replace(", analysed: Some(Analysed)", "");
                rows.push(Row::shown(&key, &Shown(shown.replace(", analysed: None", ""))));
                rows.push(Row::shown(
                    format!("{key} pictures"),
                    &Pictures::of(system, state, &found).map(|p| p.named("x")),
                ));
            }
        }
        rows
    });
}

/// Every so many of the small scenes, under the full stiffness and the axial one, at its step and at one twenty times as long.
fn some(part: usize) {
    let subjects: Vec<Subject> = small().into_iter().skip(part).step_by(6).collect();
    let options = [Stiffness::Full, Stiffness::Axial];
    inspections(&format!("inspect_small_{part}"), &subjects, &[1.0, 20.0], &options, f64::INFINITY);
}

macro_rules! parts {
    ($($name:ident $part:literal)*) => { $(#[test] fn $name() { some($part); })* };
}

parts!(first_scenes 0 second_scenes 1 third_scenes 2 fourth_scenes 3 fifth_scenes 4 sixth_scenes 5);

#[test]
fn a_pressed_chain() {
    inspections("inspect_pressed", &[chain(130, 1.25, 0.3)], &[8.0], &[Stiffness::Full], f64::INFINITY);
}

#[test]
fn a_stretched_chain() {
    inspections("inspect_stretched", &[chain(130, 0.7, 0.0)], &[1.0], &[Stiffness::Tension], f64::INFINITY);
}

#[test]
fn a_cloth() {
    inspections("inspect_cloth", &[cloth()], &[1.0], &[Stiffness::Full], f64::INFINITY);
}

#[test]
fn inspections_that_leave_parts_out() {
    for (name, most) in [("inspect_little", 2e4), ("inspect_less", 3e5)] {
        inspections(name, &small()[..6], &[4.0], &[Stiffness::Tension], most);
    }
}

#[test]
fn runs_are_followed() {
    hold("inspect_followed", |seed| {
        let mut rows = Vec::new();
        for subject in small().iter().map(|subject| beside(subject, seed)) {
            for (factor, option) in [(1.0, Stiffness::Full), (6.0, Stiffness::Full), (6.0, Stiffness::Axial)] {
                let (system, dt) = (&subject.system, factor * subject.dt);
                let mut state = subject.state.clone();
                let linear = SolverOptions { solver: SolverChoice::Llt, ..SolverOptions::default() };
                let options = ImplicitOptions { stiffness: StiffnessPolicy::Always(Stiffness::Axial), linear };
                let mut stepper = Method::LinearBackwardEuler.stepper(system, &state, &options).unwrap();
                let key = format!("{} {factor} {}", subject.name, option.name());
                let mut follower = Follower::new(system, &state, option, dt, Par::Seq).unwrap();
                for step in 1..=12 {
                    if stepper.step(&mut state, dt).is_err() || follower.look(step, &state).is_err() {
                        break;
                    }
                }
                let losses = follower.first_losses();
                rows.push(Row::shown(key, &(losses.first(), losses)));
            }
        }
        rows
    });
}

#[test]
fn turning_and_the_smallest_eigenvalue() {
    hold("inspect_turning", |seed| {
        let mut rows = Vec::new();
        for subject in small().iter().chain(&[chain(130, 1.25, 0.3), cloth()]).map(|subject| beside(subject, seed)) {
            let (system, state, dt) = (&subject.system, &subject.state, subject.dt);
            let mut turning = Turning::new(system, state, Par::Seq).unwrap();
            for option in Stiffness::ALL {
                let found = (
                    turning.worst(option, 3.0 * dt),
                    turning.largest_step(option, dt),
                    turning.largest_step(option, 200.0 * dt),
                );
                let braked = found.0.map(|turn| (turn.braked(), turn.excess()));
                rows.push(Row::shown(format!("{} {}", subject.name, option.name()), &(found, braked)));
            }
            let mut work = Work::default();
            let a = StepMatrices::assemble(system, state, Stiffness::Full, 5.0 * dt).unwrap().a;
            let smallest = smallest_eigenvalue(&a, Par::Seq, &mut work).map_err(|error| error.to_string());
            rows.push(Row::shown(format!("{} smallest", subject.name), &(smallest, work)));
        }
        rows
    });
}

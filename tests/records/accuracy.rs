//! Every figure of the search for an accuracy on small systems is the one that was measured when it was looked at: what is chosen, what
//! it costs, what is said on the way, and what need not be modelled.

use crate::record::{Row, beside, hold};
use faer::Par;
use sprung::accuracy::{Audience, Requirement, SearchProgress, answer, preset, reduce};
use sprung::integrate::{Method, Monitor, StiffnessPolicy};
use sprung::linear::{SolverChoice, SolverOptions};
use sprung::verify::{Subject, built_in};
use sprung::{Error, Spring, State, Stiffness, SystemBuilder};
use std::cell::Cell;

/// Keeps what it is told.
#[derive(Default)]
struct Listener(Vec<(String, [f64; 3])>);

impl Audience for Listener {
    type Records = Vec<(u64, f64, f64)>;

    fn begin(&mut self, monitor: &Monitor) -> Result<Self::Records, Error> {
        Ok(vec![(0, monitor.time(), monitor.energy().total())])
    }

    fn record(
        &mut self,
        records: &mut Self::Records,
        number: u64,
        state: &State,
        monitor: &Monitor,
    ) -> Result<(), Error> {
        records.push((number, state.time, monitor.energy().total()));
        Ok(())
    }

    fn progress(&mut self, progress: &SearchProgress<'_>) {
        let SearchProgress { doing, part, spent, left } = *progress;
        if self.0.last().is_none_or(|last| last.0 != doing || part >= 1.0) {
            self.0.push((doing.to_owned(), [part, spent, left]));
        }
    }
}

/// A chain that hangs from its first particle, of so many links, pulled aside.
fn hanging(name: &str, links: usize, stiffness: f64, damping: f64, aside: f64) -> Subject {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    builder.gravity(0.0, -9.81, 0.0);
    for p in 0..=links {
        builder.particle([aside * p as f64, -0.5 * p as f64, 0.0], 0.1 + 0.01 * p as f64);
    }
    for p in 0..links {
        builder.spring(p, p + 1, Spring { stiffness: stiffness * (1.0 + 0.1 * p as f64), rest_length: 0.45, damping });
    }
    builder.hold(0);
    let (system, state) = builder.build().unwrap();
    Subject { name: name.into(), system, state, dt: 0.01 }
}

fn soft() -> Subject {
    hanging("soft", 3, 20.0, 0.0, 0.1)
}

fn stiff() -> Subject {
    hanging("stiff", 3, 2e5, 400.0, 0.05)
}

/// Comes to rest long before the end.
fn settling() -> Subject {
    hanging("settling", 2, 300.0, 6.0, 0.02)
}

fn wanted(accuracy: f64, duration: f64) -> Requirement {
    let interval = duration / 8.0;
    Requirement { accuracy, duration, interval, par: Par::Seq, method: None, stiffness: None, solver: None }
}

fn searched(name: &str, subject: &Subject, requirements: &[Requirement], looks: u64) {
    hold(name, |seed| {
        let subject = beside(subject, seed);
        let row = |(number, requirement): (usize, &Requirement)| {
            let (looked, mut listener) = (Cell::new(0), Listener::default());
            let go_on = || looked.replace(looked.get() + 1) < looks;
            let found = answer(&subject.system, &subject.state, requirement, &mut listener, &go_on);
            Row::shown(format!("{} {number}", subject.name), &(found.map_err(|error| error.to_string()), listener.0))
        };
        requirements.iter().enumerate().map(row).collect()
    });
}

#[test]
fn soft_systems() {
    searched("accuracy_soft", &soft(), &[wanted(1e-2, 1.0), wanted(1e-5, 1.0), wanted(1e-9, 0.4)], u64::MAX);
}

#[test]
fn stiff_systems() {
    searched("accuracy_stiff", &stiff(), &[wanted(1e-1, 0.5), wanted(1e-3, 0.5)], u64::MAX);
}

#[test]
fn systems_that_settle() {
    searched("accuracy_settling", &settling(), &[wanted(1e-2, 20.0), wanted(1e-4, 20.0)], u64::MAX);
}

#[test]
fn systems_at_rest_and_led() {
    let scenes = built_in().unwrap();
    for (name, scene) in [
        ("accuracy_tetrahedron", "tetrahedron"),
        ("accuracy_led", "moving anchor"),
        ("accuracy_line", "one-dimensional"),
    ] {
        let subject = scenes.iter().find(|subject| subject.name == scene).unwrap();
        searched(name, subject, &[wanted(1e-2, 40.0 * subject.dt), wanted(1e-4, 20.0 * subject.dt)], u64::MAX);
    }
}

fn each(methods: &[Method], name: &str, subject: &Subject, duration: f64) {
    let of = |&method: &Method| Requirement { method: Some(method), ..wanted(1e-3, duration) };
    searched(name, subject, &methods.iter().map(of).collect::<Vec<_>>(), u64::MAX);
}

#[test]
fn methods_that_are_given_on_soft_systems() {
    each(&Method::ALL, "accuracy_given_soft", &soft(), 0.3);
}

#[test]
fn methods_that_are_given_on_stiff_systems() {
    let implicit: Vec<Method> = Method::ALL.into_iter().filter(|method| method.is_implicit()).collect();
    each(&implicit, "accuracy_given_stiff", &stiff(), 0.05);
}

#[test]
fn options_that_are_given() {
    let policies = [StiffnessPolicy::Always(Stiffness::Tension), StiffnessPolicy::Always(Stiffness::Axial)];
    let stiffness = policies.map(|policy| Requirement { stiffness: Some(policy), ..wanted(1e-2, 0.2) });
    let solvers = [SolverChoice::Cg, SolverChoice::Llt];
    let solver = solvers.map(|solver| Requirement { solver: Some(solver), ..wanted(1e-2, 0.2) });
    searched("accuracy_options", &stiff(), &[stiffness, solver].concat(), u64::MAX);
}

#[test]
fn searches_that_are_ended() {
    for looks in [5, 60, 400] {
        searched(&format!("accuracy_ended_{looks}"), &soft(), &[wanted(1e-6, 1.0)], looks);
    }
}

#[test]
fn what_need_not_be_modelled() {
    hold("accuracy_reduced", |seed| {
        let mut rows = Vec::new();
        for subject in built_in().unwrap().iter().chain(&[soft(), stiff()]) {
            for twin in [subject.clone(), subject.relaxed().unwrap(), subject.in_space().unwrap()] {
                let twin = beside(&twin, seed);
                let reduced = reduce(&twin.system, &twin.state);
                let words: Vec<String> = reduced.reductions.iter().map(ToString::to_string).collect();
                let dofs: Vec<_> = reduced.system.dofs().iter().collect();
                rows.push(Row::shown(twin.name.clone(), &(&reduced.reductions, words, dofs)));
                let preset = preset(&twin.system, &twin.state, 5.0 * twin.dt, SolverOptions::default());
                rows.push(Row::shown(format!("{} preset", twin.name), &preset.map_err(|error| error.to_string())));
            }
        }
        rows
    });
}

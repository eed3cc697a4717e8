//! Every figure of short runs with each method is the one that was measured when it was looked at: states, work, what monitors say, steps
//! under error control.

use crate::record::{Row, beside, hold};
use sprung::integrate::{
    Adaptivity, Equations, ImplicitOptions, Method, Monitor, MonitorOptions, Sampling, Schedule, StiffnessPolicy,
    run_adaptive, run_adaptive_monitored, run_monitored,
};
use sprung::linear::{SolverChoice, SolverOptions};
use sprung::verify::{Subject, built_in};
use sprung::{Spring, Stiffness, SystemBuilder};
use std::ops::ControlFlow;

/// Small scenes, and one of a free body that spins, is damped and falls.
fn subjects() -> Vec<Subject> {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.2, -1.0, 0.1);
    for p in 0..5 {
        let angle = p as f64;
        let at = builder.particle([angle.cos(), (2.0 * angle).sin(), 0.3 * angle], 0.5 + 0.1 * angle);
        builder.velocities[at] = [-0.4 * angle.sin(), 0.5, 0.2 * angle.cos()].into();
        for q in 0..at {
            builder.spring(q, at, Spring { stiffness: 30.0 + 4.0 * q as f64, rest_length: 1.1, damping: 0.3 });
        }
    }
    let (system, state) = builder.build().unwrap();
    let chosen = ["compressed chain", "moving anchor", "one-dimensional", "planar truss", "taut string", "tetrahedron"];
    let mut all = built_in().unwrap();
    all.retain(|subject| chosen.contains(&&*subject.name));
    all.push(Subject { name: "spinning".into(), system, state, dt: 0.03 });
    all
}

fn policies(method: Method) -> Vec<StiffnessPolicy> {
    let all = Stiffness::ALL.map(StiffnessPolicy::Always);
    match method.equations() {
        Equations::Linear => [&all[..], &[StiffnessPolicy::OnDemand]].concat(),
        _ => vec![StiffnessPolicy::OnDemand],
    }
}

/// What a monitor of a method does, and all figures that need no forces.
fn all_figures(method: Method, policy: StiffnessPolicy) -> MonitorOptions {
    MonitorOptions { forces: MonitorOptions::of(method, policy).forces, ..MonitorOptions::default() }
}

/// Eight steps with a monitor.
fn steps(method: Method, factors: &[f64]) {
    hold(&format!("integrate_{}", method.name()), |seed| {
        let mut rows = Vec::new();
        for subject in subjects().iter().map(|subject| beside(subject, seed)) {
            for (factor, policy) in
                factors.iter().flat_map(|&f| policies(method).into_iter().map(move |policy| (f, policy)))
            {
                let solver = if policy == StiffnessPolicy::OnDemand { SolverChoice::Auto } else { SolverChoice::Ldlt };
                let linear = SolverOptions { solver, ..SolverOptions::default() };
                let options = ImplicitOptions { stiffness: policy, linear };
                let mut state = subject.state.clone();
                let key = format!("{} {factor} {}", subject.name, policy.name());
                let Ok(mut stepper) = method.stepper(&subject.system, &state, &options) else { continue };
                let mut monitor = Monitor::new(&subject.system, &state, all_figures(method, policy)).unwrap();
                let schedule = Schedule::steps(factor * subject.dt, 8);
                let mut seen = Vec::new();
                let outcome = run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, |_, state, monitor| {
                    seen.push((monitor.energy_at(state), monitor.figures(state), monitor.time()));
                    ControlFlow::Continue(())
                });
                let figures = monitor.figures(&state);
                let said =
                    (figures.estimate(method), figures.warnings(method, None), monitor.balance(), monitor.account());
                rows.push(Row::shown(&key, &(&state, stepper.statistics(), outcome)));
                rows.push(Row::shown(format!("{key} monitor"), &(seen, said)));
            }
        }
        rows
    });
}

/// With error control, records on the way, and with a monitor too.
fn controlled(method: Method) {
    hold(&format!("integrate_{}_controlled", method.name()), |seed| {
        let mut rows = Vec::new();
        for subject in subjects().iter().map(|subject| beside(subject, seed)) {
            for (rtol, solver) in [(1e-2, SolverChoice::Auto), (1e-4, SolverChoice::Llt)] {
                let linear = SolverOptions { solver, ..SolverOptions::default() };
                let options = ImplicitOptions { stiffness: StiffnessPolicy::OnDemand, linear };
                let (mut state, duration) = (subject.state.clone(), 12.0 * subject.dt);
                let how = Adaptivity {
                    duration,
                    rtol,
                    first_step: None,
                    sampling: Sampling::Every(duration / 5.0),
                    part_of: None,
                };
                let key = format!("{} {rtol:e}", subject.name);
                let mut stepper = method.adaptive_stepper(&subject.system, &state, &options).unwrap().unwrap();
                let mut seen = Vec::new();
                let outcome = run_adaptive(&mut *stepper, &subject.system, &mut state, &how, |step, state| {
                    seen.push((step, state.clone()));
                    if step < 200 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
                });
                rows.push(Row::shown(&key, &(&state, stepper.statistics(), outcome, &seen)));
                let mut state = subject.state.clone();
                let mut stepper = method.adaptive_stepper(&subject.system, &state, &options).unwrap().unwrap();
                let how = Adaptivity { sampling: Sampling::Steps, first_step: Some(subject.dt), ..how };
                let chosen = all_figures(method, StiffnessPolicy::OnDemand);
                let mut monitor = Monitor::new(&subject.system, &state, chosen).unwrap();
                let mut seen = Vec::new();
                let outcome = run_adaptive_monitored(
                    &mut *stepper,
                    &subject.system,
                    &mut state,
                    &how,
                    &mut monitor,
                    |step, state, monitor| {
                        seen.push((step, state.time, monitor.figures(state)));
                        if step < 40 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
                    },
                );
                let warnings = monitor.figures(&state).warnings(method, Some(rtol));
                rows.push(Row::shown(format!("{key} monitor"), &(seen, outcome, warnings, monitor.account())));
            }
        }
        rows
    });
}

macro_rules! methods {
    ($($name:ident $controlled:ident $method:ident)*) => { $(
        #[test]
        fn $name() {
            steps(Method::$method, &[1.0, 6.0]);
        }
        #[test]
        fn $controlled() {
            controlled(Method::$method);
        }
    )* };
}

methods!(
    w2 w2_controlled W2
    rodas4 rodas4_controlled Rodas4
    bdf2 bdf2_controlled Bdf2
    dop853 dop853_controlled Dop853
);

#[test]
fn linear_backward_euler() {
    steps(Method::LinearBackwardEuler, &[1.0, 6.0]);
}

#[test]
fn backward_euler() {
    steps(Method::BackwardEuler, &[1.0, 6.0]);
}

#[test]
fn implicit_midpoint() {
    steps(Method::ImplicitMidpoint, &[1.0, 6.0]);
}

#[test]
fn explicit_steps() {
    for method in [Method::Verlet, Method::ForwardEuler, Method::SymplecticEuler] {
        steps(method, &[0.3, 3.0]);
    }
}

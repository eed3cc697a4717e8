//! Where forces are linearised decides whether a cloth hangs on the right side.
//!
//! `cargo xtask motion [SIZE ...]` lets cloths swing down for half a second, by
//! default those of 10 × 10, 20 × 20 and 32 × 32 particles, and prints for several steps how far each method ends from the truth: the
//! distance of all positions from those of an explicit method of eighth order with local errors of 1e-9, over their distance
//! from their centroid. The work of `bdf2` stands beside that of `linear-backward-euler`, and the ratio of their times, each the
//! shortest of several runs that take turns.

use nalgebra::Vector3;
use sprung::chart::dop853;
use sprung::integrate::{ImplicitOptions, Method, Schedule, Statistics, Status, StiffnessPolicy, run};
use sprung::scene::{Kind, builtin};
use sprung::{State, Stiffness, System};
use std::error::Error;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

/// In s.
const DURATION: f64 = 0.5;

/// In s.
const STEPS: [f64; 5] = [1.0 / 60.0, 0.01, 0.005, 0.0025, 0.00125];

/// Times are measured with steps from here on; of shorter ones enough is known then.
const TIMED: f64 = 0.005;

/// Runs of each of two methods that are timed.
const TURNS: usize = 9;

fn main() -> Result<(), Box<dyn Error>> {
    let sizes = std::env::args().skip(1).map(|size| size.parse()).collect::<Result<Vec<usize>, _>>()?;
    let sizes = if sizes.is_empty() { vec![10, 20, 32] } else { sizes };
    println!(
        "| cloth | dt, s | `linear-backward-euler`: default / `tension` / `axial` | `backward-euler` | `bdf2`: default / `tension` / `axial` | \
         factorizations a step: the same / `bdf2` | time, `bdf2` over that |"
    );
    println!("|---|---|---|---|---|---|---|");
    for size in sizes {
        let (system, start) = builtin(Kind::Cloth, size)?.build()?;
        let deadline = Instant::now() + Duration::from_secs(3600);
        let truth = dop853(&system, &start, DURATION, 1e-9, deadline).ok_or("no reference within an hour")?;
        let cloth = Cloth { size, system, start, truth };
        for dt in STEPS {
            cloth.row(dt)?;
        }
    }
    Ok(())
}

struct Cloth {
    size: usize,
    system: System,
    start: State,
    truth: State,
}

impl Cloth {
    fn row(&self, dt: f64) -> Result<(), Box<dyn Error>> {
        let policies = [StiffnessPolicy::OnDemand, Stiffness::Tension.into(), Stiffness::Axial.into()];
        let errors = |method: Method, policies: &[StiffnessPolicy]| -> Result<String, Box<dyn Error>> {
            let errors = policies.iter().map(|&policy| Ok(self.run(method, policy, dt)?.error));
            Ok(errors.collect::<Result<Vec<_>, Box<dyn Error>>>()?.join(" / "))
        };
        let (notes, bdf2) = (Method::LinearBackwardEuler, Method::Bdf2);
        let work = [notes, bdf2].map(|method| self.run(method, StiffnessPolicy::OnDemand, dt));
        let [notes_work, bdf2_work] = work;
        let a_step = |run: &Run| run.statistics.work.factorizations as f64 / run.steps as f64;
        println!(
            "| {size} × {size} | {dt:.5} | {} | {} | {} | {:.2} / {:.2} | {} |",
            errors(notes, &policies)?,
            errors(Method::BackwardEuler, &policies[..1])?,
            errors(bdf2, &policies)?,
            a_step(&notes_work?),
            a_step(&bdf2_work?),
            if dt >= TIMED { format!("{:.2}", self.time_ratio(dt)?) } else { "–".into() },
            size = self.size,
        );
        Ok(())
    }

    /// The shortest time of bdf2 over that of `linear-backward-euler`, which take turns.
    fn time_ratio(&self, dt: f64) -> Result<f64, Box<dyn Error>> {
        let mut shortest = [Duration::MAX; 2];
        for _ in 0..TURNS {
            for (shortest, method) in shortest.iter_mut().zip([Method::Bdf2, Method::LinearBackwardEuler]) {
                *shortest = self.run(method, StiffnessPolicy::OnDemand, dt)?.time.min(*shortest);
            }
        }
        Ok(shortest[0].as_secs_f64() / shortest[1].as_secs_f64())
    }

    fn run(&self, method: Method, stiffness: StiffnessPolicy, dt: f64) -> Result<Run, Box<dyn Error>> {
        let options = ImplicitOptions { stiffness, ..ImplicitOptions::default() };
        let mut stepper = method.stepper(&self.system, &self.start, &options)?;
        let mut state = self.start.clone();
        let begin = Instant::now();
        let schedule = Schedule::duration(dt, DURATION);
        let outcome = run(&mut *stepper, &mut state, &schedule, |_, _| ControlFlow::Continue(()));
        let time = begin.elapsed();
        let error = match outcome.status() {
            Status::Completed => format!("{:.3}", self.error(&state)),
            status => status.name().into(),
        };
        Ok(Run { error, steps: outcome.steps, statistics: *stepper.statistics(), time })
    }

    fn error(&self, state: &State) -> f64 {
        let truth = &self.truth.positions;
        let centroid = truth.iter().sum::<Vector3<f64>>() / truth.len() as f64;
        let spread: f64 = truth.iter().map(|x| (x - centroid).norm_squared()).sum();
        let apart: f64 = truth.iter().zip(&state.positions).map(|(x, y)| (x - y).norm_squared()).sum();
        (apart / spread).sqrt()
    }
}

struct Run {
    /// The error at the end; the status of a run that failed.
    error: String,
    steps: u64,
    statistics: Statistics,
    time: Duration,
}

//! No scale of its own: a scene in other units of length, time and mass moves in the same way, and its files are of the same size.

use crate::sandbox::Sandbox;
use nalgebra::Vector3;
use sprung::integrate::{Method, Monitor, Schedule};
use sprung::plan::{MethodChoice, RECORDS, RunOptions, records_every};
use sprung::system::{Axes, Constraint, Motion};
use sprung::{Spring, State, System, SystemBuilder};
use std::ops::ControlFlow;

/// How many of a system's units make one of SI.
#[derive(Debug, Clone, Copy)]
struct Units {
    length: f64,
    time: f64,
    mass: f64,
}

const SI: Units = Units { length: 1.0, time: 1.0, mass: 1.0 };

/// Very nearly millimetres, milliseconds and grams; nanometres, nanoseconds and femtograms; astronomical units, years and solar
/// masses. Powers of two scale every intermediate result without rounding.
const POWERS_OF_TWO: [Units; 3] = [
    Units { length: 1024.0, time: 1024.0, mass: 1024.0 },
    Units { length: 1_073_741_824.0, time: 1_073_741_824.0, mass: 1_125_899_906_842_624.0 },
    Units {
        length: 1.0 / 137_438_953_472.0,
        time: 1.0 / 33_554_432.0,
        mass: 1.0 / 1_267_650_600_228_229_401_496_703_205_376.0,
    },
];

/// The same as people have them.
const CUSTOMARY: [Units; 3] = [
    Units { length: 1e3, time: 1e3, mass: 1e3 },
    Units { length: 1e9, time: 1e9, mass: 1e18 },
    Units { length: 6.684587e-12, time: 3.168809e-8, mass: 5.029e-31 },
];

const SIDE: usize = 4;
const DURATION: f64 = 0.5;
const PULL: [f64; 3] = [-0.05, 0.02, 0.1];

impl Units {
    fn speed(&self) -> f64 {
        self.length / self.time
    }

    fn acceleration(&self) -> f64 {
        self.speed() / self.time
    }

    fn force(&self) -> f64 {
        self.mass * self.acceleration()
    }

    fn damping(&self) -> f64 {
        self.mass / self.time
    }
}

/// A cloth of 0.3 m that hangs at one corner and is pulled at another.
fn positions() -> Vec<[f64; 3]> {
    let place = |i: usize, j: usize| [0.1 * i as f64, 0.02 * ((3 * i + 5 * j) % 7) as f64, 0.1 * j as f64];
    (0..SIDE * SIDE).map(|p| place(p / SIDE, p % SIDE)).collect()
}

fn pairs() -> Vec<[usize; 2]> {
    let n = SIDE;
    let along = (0..n * n).filter(move |p| p % n + 1 < n).map(|p| [p, p + 1]);
    let across = (0..n * (n - 1)).map(move |p| [p, p + n]);
    let bias = (0..n * (n - 1)).filter(move |p| p % n + 1 < n).map(move |p| [p, p + n + 1]);
    along.chain(across).chain(bias).collect()
}

fn cloth(units: &Units) -> (System, State) {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -9.75 * units.acceleration(), 0.0);
    for position in positions() {
        builder.particle(position.map(|x| x * units.length), 0.0125 * units.mass);
    }
    for [i, j] in pairs() {
        let rest_length = if j == i + SIDE + 1 { 0.1375 } else { 0.1 } * units.length;
        builder.spring(i, j, Spring { stiffness: 12.5 * units.force(), rest_length, damping: 0.01 * units.damping() });
    }
    builder.hold(0);
    let pull = PULL.map(|x| x * units.length);
    let motion = Motion::Path { times: vec![0.0, 0.25 * units.time], offsets: vec![Vector3::zeros(), pull.into()] };
    builder.constrain(Constraint { particles: vec![SIDE - 1], axes: Axes::ALL, motion });
    builder.build().unwrap()
}

/// How a run ends that is made as the command makes it, positions at its end in m, and the number of records.
fn end(
    units: &Units,
    run_options: &RunOptions,
    dt: Option<f64>,
    rtol: Option<f64>,
) -> (&'static str, Vec<Vector3<f64>>, usize) {
    let (system, mut state) = cloth(units);
    let duration = DURATION * units.time;
    let interval = dt.map_or(records_every(duration), |dt| dt * units.time);
    let plan = run_options.plan(&system, &state, [interval, duration], rtol).unwrap();
    let mut monitor = Monitor::new(&system, &state, plan.monitor(true, true)).unwrap();
    let mut stepper = plan.stepper(&system, &state).unwrap();
    let mut records = 0;
    let schedule = Schedule::duration(interval, duration);
    let outcome = stepper.run(&system, &mut state, &schedule, &mut monitor, |_, _, _| {
        records += 1;
        ControlFlow::Continue(())
    });
    (outcome.status().name(), state.positions.iter().map(|x| x / units.length).collect(), records)
}

/// Every way to run: each method with equal steps, those that can with adaptive ones, and the choice of the program.
fn ways() -> Vec<(RunOptions, Option<f64>, Option<f64>)> {
    let asked = |method| RunOptions { method: Some(method), ..RunOptions::default() };
    let equal = MethodChoice::ALL.into_iter().map(|method| (asked(method), Some(1.0 / 1024.0), None));
    let estimating = Method::ALL.into_iter().filter(|method| method.estimates_errors());
    let adaptive = estimating.map(|method| (asked(MethodChoice::Named(method)), None, Some(1e-3)));
    equal.chain(adaptive).chain([(RunOptions::default(), None, Some(1e-2))]).collect()
}

/// Powers of two change no digit: where one changes, a number is compared with one that has another unit.
#[test]
fn units_that_round_nothing_change_no_bit() {
    for (run_options, dt, rtol) in ways() {
        let expected = end(&SI, &run_options, dt, rtol);
        for units in &POWERS_OF_TWO {
            let found = end(units, &run_options, dt, rtol);
            assert_eq!(found, expected, "{units:?} {run_options:?} {rtol:?}");
            assert!(dt.is_some() || found.2 == RECORDS as usize, "{}", found.2);
        }
    }
}

/// With units that round, by as little as rounding and the tolerance of linear solves leave in half a second of a cloth.
#[test]
fn customary_units_give_the_same_motion() {
    for (run_options, dt, rtol) in ways() {
        let (status, expected, _) = end(&SI, &run_options, dt, rtol);
        for units in &CUSTOMARY {
            let (ended, found, _) = end(units, &run_options, dt, rtol);
            assert_eq!(ended, status, "{units:?} {run_options:?} {rtol:?}");
            // Forward Euler makes energy from nowhere, and with it of every rounding what it likes.
            if status != "completed" {
                continue;
            }
            let farthest = found.iter().zip(&expected).map(|(x, y)| (x - y).norm()).fold(0.0, f64::max);
            assert!(farthest < 1e-8, "{farthest:e}: {units:?} {run_options:?} {rtol:?}");
        }
    }
}

fn scene(units: &Units) -> String {
    let rows = |rows: &[[f64; 3]], unit: f64| {
        format!("{:?}", rows.iter().map(|row| row.map(|x| x * unit)).collect::<Vec<_>>())
    };
    let rest_lengths: Vec<f64> =
        pairs().iter().map(|[i, j]| if *j == i + SIDE + 1 { 0.1375 } else { 0.1 } * units.length).collect();
    format!(
        "gravity = [0.0, {:?}, 0.0]\n[particles]\npositions = {}\nmasses = {:?}\n[springs]\npairs = {:?}\nstiffness = {:?}\n\
         rest_lengths = {rest_lengths:?}\ndamping = {:?}\n[[constraints]]\nparticles = [0]\n[[constraints]]\nparticles = [{}]\n\
         path = {{ times = [0.0, {:?}], offsets = {} }}\n[time]\nduration = {:?}\n",
        -9.75 * units.acceleration(),
        rows(&positions(), units.length),
        0.0125 * units.mass,
        pairs(),
        12.5 * units.force(),
        0.01 * units.damping(),
        SIDE - 1,
        0.25 * units.time,
        rows(&[[0.0; 3], PULL], units.length),
        DURATION * units.time,
    )
}

/// The files of a run by default: as many records, and as large up to the digits of numbers; the page plays for as long.
#[test]
fn files_are_of_the_same_size_in_all_units() {
    let sandbox = Sandbox::new();
    let mut pages = Vec::new();
    let sizes = [SI].iter().chain(&CUSTOMARY).enumerate().map(|(k, units)| {
        sandbox.put(&format!("{k}.toml"), &scene(units));
        sandbox.sprung(&["run", &format!("{k}.toml"), "--view", "--out", &format!("{k}")]).ends_with(0);
        let rows = sandbox.csv(&format!("{k}/energy.csv"));
        assert_eq!(rows.len(), RECORDS as usize + 1);
        let page = sandbox.read(&format!("{k}/view.html"));
        let about = page.split("id=\"about\">").nth(1).unwrap().split("</script>").next().unwrap();
        let about: serde_json::Value = serde_json::from_str(about).unwrap();
        let length = about["times"].as_array().unwrap().last().unwrap().as_f64().unwrap();
        pages.push(length / about["speed"].as_f64().unwrap());
        sandbox
            .names(&k.to_string())
            .iter()
            .map(|name| std::fs::metadata(sandbox.path(&format!("{k}/{name}"))).unwrap().len())
            .sum()
    });
    let sizes: Vec<u64> = sizes.collect();
    // Powers of ten take four letters of some twenty.
    assert!(sizes.iter().all(|&size| (size as f64 / sizes[0] as f64 - 1.0).abs() < 0.3), "{sizes:?}");
    assert!(pages.iter().all(|seconds| (3.0..=10.0).contains(seconds)), "{pages:?}");
}

//! Makes `verification/ready.md`: what `--accuracy` answers on ready scenes of all kinds and sizes, at their own duration, at half and at twice of it,
//! against references by two methods.
//!
//! ```sh
//! cargo xtask ready --write            # ten sizes of each kind
//! cargo xtask ready --largest 8        # those of at most this size
//! ```
//!
//! Every scene is recorded when it is done; `--resume` goes on from there, and the page is about all that are recorded.

use clap::Parser;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sprung::accuracy::{AccuracyOptions, Configuration, SpectralRadius, StepControl, Verdict, relative_position_error};
use sprung::accuracy::{run_to_accuracy, trial};
use sprung::integrate::{ImplicitOptions, Method, Status};
use sprung::scene::{Kind, builtin};
use sprung::{State, System};
use std::error::Error;
use std::fmt::Write;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Answers on ready scenes against references by two methods.
#[derive(Parser)]
struct Arguments {
    /// No scene of a larger size
    #[arg(long, default_value_t = usize::MAX)]
    largest: usize,

    /// No scene of a smaller size
    #[arg(long, default_value_t = 0)]
    smallest: usize,

    /// Only this kind
    #[arg(long)]
    kind: Option<String>,

    /// Durations, in those of the scenes
    #[arg(long, value_delimiter = ',', default_value = "0.5,1,2")]
    durations: Vec<f64>,

    /// Goes on with the last table instead of beginning anew
    #[arg(long)]
    resume: bool,

    /// Writes the page
    #[arg(long)]
    write: bool,

    /// Where scenes are recorded
    #[arg(long, default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/../target/ready"))]
    folder: PathBuf,
}

const ACCURACIES: [f64; 4] = [1e-1, 1e-2, 1e-3, 1e-4];

/// Kinds with ten sizes each.
const SCENES: [(Kind, [usize; 10]); 7] = [
    (Kind::Chain, [3, 4, 5, 6, 8, 10, 12, 15, 20, 30]),
    (Kind::Cloth, [3, 4, 6, 8, 10, 12, 14, 16, 20, 28]),
    (Kind::Lattice, [2, 3, 4, 5, 6, 7, 8, 9, 10, 12]),
    (Kind::Column, [3, 4, 5, 6, 7, 8, 9, 10, 12, 15]),
    (Kind::Pendulum, [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]),
    (Kind::String, [3, 5, 7, 10, 15, 20, 31, 40, 60, 80]),
    (Kind::Network, [10, 15, 20, 30, 40, 50, 70, 100, 150, 200]),
];

/// A scene, its duration over its own, and the answers.
#[derive(Serialize, Deserialize)]
struct Record {
    kind: String,
    size: usize,
    times: f64,
    answers: Vec<Answered>,
}

impl Record {
    fn is_of(&self, kind: Kind, size: usize, times: f64) -> bool {
        self.kind == kind.name() && (self.size, self.times) == (size, times)
    }

    /// The place of its kind in the table, its size and its duration.
    fn place(&self) -> (usize, usize, f64) {
        let place = SCENES.iter().position(|(kind, _)| kind.name() == self.kind).unwrap_or(SCENES.len());
        (place, self.size, self.times)
    }
}

/// An answer beside the references.
#[derive(Serialize, Deserialize)]
struct Answered {
    scene: String,
    duration: f64,
    accuracy: f64,
    /// The difference of the references.
    apart: f64,
    is_confirmed: bool,
    estimate: Option<f64>,
    error: f64,
    method: String,
    until: Option<f64>,
}

impl Answered {
    /// Confirmed, and off by more than R and what the references differ by; or confirmed where they differ by more than R.
    fn is_broken(&self) -> bool {
        self.is_confirmed && (self.error > self.accuracy + self.apart || self.apart > self.accuracy)
    }

    /// Unconfirmed though the references agree far better.
    fn is_needless(&self) -> bool {
        !self.is_confirmed && self.apart < 0.1 * self.accuracy
    }
}

fn reference(
    system: &System,
    start: &State,
    method: Method,
    rtol: f64,
    duration: f64,
) -> sprung::Result<Option<State>> {
    let configuration = Configuration { method, options: ImplicitOptions::default() };
    let control = StepControl::Adaptive { rtol, first_step: None };
    let run = trial(system, start, &configuration, control, duration, &|| true)?;
    Ok((run.status == Status::Completed).then_some(run.state))
}

/// The end of Verlet's method with steps of a 64th and of a 128th of their limit, extrapolated to no step: `(4 x(h/2) − x(h))/3`.
fn extrapolated(system: &System, start: &State, duration: f64) -> sprung::Result<Option<State>> {
    let step = SpectralRadius::at(system, start)?.verlet_limit().min(duration) / 64.0;
    let configuration = Configuration { method: Method::Verlet, options: ImplicitOptions::default() };
    let end = |dt: f64| trial(system, start, &configuration, StepControl::Step(dt), duration, &|| true);
    let (coarse, mut fine) = (end(step)?, end(0.5 * step)?);
    if [coarse.status, fine.status] != [Status::Completed; 2] {
        return Ok(None);
    }
    fine.state.positions.iter_mut().zip(&coarse.state.positions).for_each(|(x, coarse)| *x += (*x - coarse) / 3.0);
    Ok(Some(fine.state))
}

/// Degrees of freedom from which RODAS4 to so many digits takes minutes, and Verlet's method stands for it.
const MANY: usize = 150;

fn answers(kind: Kind, size: usize, times: f64) -> Result<Vec<Answered>, String> {
    let of = |error: sprung::Error| format!("{} {size}: {error}", kind.name());
    let scene = builtin(kind, size).map_err(of)?;
    let (system, start) = scene.build().map_err(of)?;
    let duration = times * scene.time.duration.unwrap_or(1.0);
    let explicit = reference(&system, &start, Method::Dop853, 1e-12, duration).map_err(of)?;
    let Some(explicit) = explicit else { return Ok(Vec::new()) };
    let mut apart = f64::INFINITY;
    // Verlet's method where that of many digits takes long, and the other where they differ.
    let is_large = system.dofs().len() > MANY;
    let rtols = if is_large { [None, Some(1e-9)] } else { [Some(1e-9), Some(1e-11)] };
    for rtol in rtols {
        let found = match rtol {
            None => extrapolated(&system, &start, duration),
            Some(rtol) => reference(&system, &start, Method::Rodas4, rtol, duration),
        };
        let Some(other) = found.map_err(of)? else { return Ok(Vec::new()) };
        apart = apart.min(relative_position_error(&other.positions, &explicit.positions, &start.positions));
        // The smallest R by ten.
        if apart < 1e-5 {
            break;
        }
    }
    let mut all = Vec::new();
    for accuracy in ACCURACIES {
        let (method, stiffness, solver) = (None, None, None);
        let interval = duration / 300.0;
        let options = AccuracyOptions { accuracy, duration, interval, par: faer::Par::Seq, method, stiffness, solver };
        let Some(found) = run_to_accuracy(&system, &start, &options, &mut (), &|| true).map_err(of)? else { continue };
        all.push(Answered {
            scene: format!("{} {size}", kind.name()),
            duration,
            accuracy,
            apart,
            is_confirmed: found.verdict == Verdict::Confirmed,
            estimate: found.estimated_error,
            error: relative_position_error(&found.state.positions, &explicit.positions, &start.positions),
            method: found.configuration.method.name().into(),
            until: found.predictable_until,
        });
    }
    Ok(all)
}

fn row(answer: &Answered) -> String {
    let Answered { scene, duration, accuracy, apart, is_confirmed, estimate, error, method, until } = answer;
    let verdict = if *is_confirmed { "confirmed" } else { "unconfirmed" };
    let estimate = estimate.map_or("–".into(), |estimate| format!("{estimate:.1e}"));
    let until = until.map_or("–".into(), |until| format!("{until:.3}"));
    format!(
        "| {scene} | {duration} | {accuracy:e} | {apart:.1e} | {method} | {verdict} | {estimate} | {error:.1e} | {until} |\n"
    )
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let jobs: Vec<(Kind, usize, f64)> = SCENES
        .iter()
        .flat_map(|(kind, sizes)| sizes.iter().map(move |size| (*kind, *size)))
        .filter(|(kind, size)| {
            (arguments.smallest..=arguments.largest).contains(size)
                && arguments.kind.as_ref().is_none_or(|name| name == kind.name())
        })
        .flat_map(|(kind, size)| arguments.durations.iter().map(move |times| (kind, size, *times)))
        .collect();
    std::fs::create_dir_all(&arguments.folder)?;
    let file = arguments.folder.join("records.jsonl");
    let mut records: Vec<Record> = match std::fs::read_to_string(&file) {
        Ok(text) if arguments.resume => text.lines().map(serde_json::from_str).collect::<Result<_, _>>()?,
        _ => Vec::new(),
    };
    let mut options = OpenOptions::new();
    let options = if arguments.resume { options.append(true) } else { options.write(true).truncate(true) };
    let file = std::sync::Mutex::new(options.create(true).open(file)?);
    let left = jobs.par_iter().filter(|&&(kind, size, times)| !records.iter().any(|r| r.is_of(kind, size, times)));
    let made = left.map(|&(kind, size, times)| {
        let answers = answers(kind, size, times)?;
        answers.iter().for_each(|answer| eprint!("{}", row(answer)));
        let record = Record { kind: kind.name().into(), size, times, answers };
        let line = serde_json::to_string(&record).map_err(|error| error.to_string())?;
        let mut file = file.lock().map_err(|error| error.to_string())?;
        writeln!(file, "{line}").map_err(|error| error.to_string())?;
        Ok(record)
    });
    let made = made.collect::<Result<Vec<_>, String>>()?;
    records.extend(made);
    records.sort_by(|a, b| a.place().partial_cmp(&b.place()).unwrap_or(std::cmp::Ordering::Equal));
    let contents: Vec<String> = SCENES
        .iter()
        .map(|(kind, sizes)| {
            let times = |size| records.iter().filter(|r| r.kind == kind.name() && r.size == size).count();
            let (done, open): (Vec<_>, Vec<_>) =
                sizes.iter().partition(|&&size| times(size) >= arguments.durations.len());
            let of = |sizes: Vec<&usize>| sizes.iter().map(|size| size.to_string()).collect::<Vec<_>>().join(", ");
            let missing = if open.is_empty() { String::new() } else { format!("(not all durations of {})", of(open)) };
            let words = [kind.name().to_string(), of(done), missing];
            words.into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ")
        })
        .collect();
    let scenes = records.len();
    let all: Vec<Answered> = records.into_iter().flat_map(|record| record.answers).collect();
    const HEADER: &str = "| scene | duration, s | R | references differ by | method | verdict | estimate | error | predictable until, s |\n|---|---|---|---|---|---|---|---|---|\n";
    let table = |title: &str, of: &dyn Fn(&&Answered) -> bool| {
        let rows: String = all.iter().filter(of).map(row).collect();
        if rows.is_empty() { format!("## {title}\n\nNone.\n\n") } else { format!("## {title}\n\n{HEADER}{rows}\n") }
    };
    let mut page = format!(
        "# Ready scenes\n\nMade by `cargo xtask ready --write`: answers of `--accuracy` on {scenes} ready scenes and durations (the scenes' own, times {}). References are runs of \
         DOP853 with `rtol = 1e-12` and of RODAS4 with `rtol = 1e-9`, or 1e-11 where these differ by more than 1e-5, beyond {MANY} degrees of freedom of Verlet's method, extrapolated; errors are relative position errors against the first. Sizes: {}.\n\n\
         | R | answers | confirmed | broken promises | unconfirmed | of these needlessly |\n|---|---|---|---|---|---|\n",
        arguments.durations.iter().map(f64::to_string).collect::<Vec<_>>().join(", "),
        contents.join("; "),
    );
    for accuracy in ACCURACIES {
        let of = |what: &dyn Fn(&&Answered) -> bool| all.iter().filter(|a| a.accuracy == accuracy).filter(what).count();
        let (every, confirmed) = (of(&|_| true), of(&|a| a.is_confirmed));
        let (broken, needless) = (of(&|a| a.is_broken()), of(&|a| a.is_needless()));
        writeln!(page, "| {accuracy:e} | {every} | {confirmed} | {broken} | {} | {needless} |", every - confirmed)?;
    }
    page.push_str(&format!(
        "\nA promise is broken where a confirmed answer is off by more than R and what the references differ by, or where these differ by more than R. An answer is \
         unconfirmed needlessly where the references differ by less than a tenth of R.\n\n{}{}",
        table("Broken promises", &|answer| answer.is_broken()),
        table("Unconfirmed answers", &|answer| !answer.is_confirmed)
    ));
    println!("{page}");
    if arguments.write {
        std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("ready.md"), page)?;
    }
    Ok(())
}

//! Arguments that several commands share: the scene, its initial state, and values of options.

use super::Stop;
use super::console::Console;
use super::threads::{Threads, interrupt, is_interrupted};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use sprung::error::Invalid;
use sprung::integrate::{Outcome, Schedule, run};
use sprung::output::{AtomicFile, OutputFolder, read_final_state};
use sprung::plan::{DEFAULT_STEP, Plan, RunOptions, records_every};
use sprung::report::number::compact;
use sprung::scene::{Built, Scene, TimeSettings};
use sprung::{Error, Result, State, System};
use std::io::{self, Read};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The scene that a command works on.
#[derive(Debug, clap::Args)]
pub struct SceneFile {
    /// The scene: a TOML, JSON or NumPy (.npz) file, or - for standard input
    #[arg(value_name = "SCENE")]
    pub path: PathBuf,
}

pub struct LoadedScene {
    pub file: PathBuf,
    pub name: String,
    pub time: TimeSettings,
    pub system: System,
    pub state: State,
    /// The file of the state, where it is not the scene's start.
    pub at: Option<PathBuf>,
    pub triangles: Vec<[u32; 3]>,
}

impl SceneFile {
    pub fn load(&self, console: &Console) -> Result<LoadedScene> {
        let (scene, file) = read_scene(&self.path)?;
        let built = scene.build_with_notes().map_err(|error| error.in_file(&file))?;
        let Built { system, state, triangles, notes } = built;
        notes.iter().for_each(|line| console.note(line));
        Ok(LoadedScene { file, name: scene.name, time: scene.time, system, state, at: None, triangles })
    }
}

/// Reads a scene from a file, or from standard input for `-`, as JSON where that begins with a brace; returns it with its source.
pub fn read_scene(path: &Path) -> Result<(Scene, PathBuf)> {
    if path != "-" {
        return Ok((Scene::load(path)?, path.into()));
    }
    let mut text = String::new();
    let source = PathBuf::from("standard input");
    io::stdin().read_to_string(&mut text).map_err(|error| Error::reading_text(&source, error))?;
    let is_json = text.trim_start_matches('\u{feff}').trim_start().starts_with('{');
    let scene = if is_json { Scene::from_json(&text) } else { Scene::from_toml(&text) };
    let scene = scene.map_err(|error| match error.in_file(&source) {
        Error::Format { message, .. } => Error::Format { file: source.clone(), message },
        other => other,
    })?;
    Ok((scene, source))
}

/// The folder of a name below `out`, with hyphens for spaces, which separate words in a shell.
pub fn folder_of(name: &str) -> PathBuf {
    PathBuf::from("out").join(name.split_whitespace().collect::<Vec<_>>().join("-"))
}

impl LoadedScene {
    pub fn duration(&self, given: Option<f64>) -> Result<f64> {
        given.or(self.time.duration).ok_or_else(|| {
            let file = self.file.display();
            Error::Usage(format!("{file}: no duration: give the option --duration or the key time.duration"))
        })
    }

    /// The given step, the scene's own, or [`DEFAULT_STEP`] with a note.
    pub fn step_or_default(&self, console: &Console, given: Option<f64>) -> f64 {
        given.or(self.time.dt).unwrap_or_else(|| {
            console.note(format_args!("no dt was given: {DEFAULT_STEP} s is taken (--dt, or the key time.dt)"));
            DEFAULT_STEP
        })
    }

    pub fn motion_length(&self, given: Option<f64>, what: &str) -> Result<f64> {
        let duration = self.duration(given)?;
        if duration > 0.0 {
            return Ok(duration);
        }
        let invalid = Invalid::new("time.duration", duration, format!("must be positive: {what} needs a motion"));
        Err(Error::from(invalid).in_file(&self.file))
    }

    /// Steps of dt seconds to the end of a run; an error where they cannot be counted, or vanish in the rounding of the initial time.
    pub fn schedule(&self, dt: f64, duration: f64) -> Result<Schedule> {
        Schedule::check(dt, duration).map_err(|invalid| match invalid.key.as_str() {
            "dt" => self.blame((self.time.dt, dt), invalid),
            _ => self.blame((self.time.duration, duration), invalid),
        })?;
        let (time, resolution) = (self.state.time, f64::EPSILON * self.state.time.abs());
        // Times may be rounded by a ten-thousandth of a step.
        if let Some(file) = self.at.as_ref().filter(|_| resolution > 1e-4 * dt) {
            let dt = compact(dt);
            let rule = format!("is too late for steps of {dt} s: numbers of this size are {resolution:.0e} s apart");
            return Err(Error::from(Invalid::new("time", time, rule)).in_file(file));
        }
        Ok(Schedule::duration(dt, duration))
    }

    /// The interval of the records of a motion where no step is given.
    pub fn record_interval(&self, duration: f64) -> Result<f64> {
        let interval = records_every(duration);
        if interval > 0.0 {
            return Ok(interval);
        }
        let invalid = Invalid::new("duration", format!("{duration:e}"), "is too short to be divided into steps");
        Err(self.blame((self.time.duration, duration), invalid))
    }

    /// The error of a value of `[time]`: what is not the scene's was given as an option.
    fn blame(&self, (of_scene, value): (Option<f64>, f64), invalid: Invalid) -> Error {
        if of_scene != Some(value) {
            return Error::from(Invalid { key: format!("--{}", invalid.key), ..invalid });
        }
        Error::from(Invalid { key: format!("time.{}", invalid.key), ..invalid }).in_file(&self.file)
    }
}

/// The threads and the output folder of a command on a scene.
#[derive(Debug, clap::Args)]
pub struct Process {
    #[command(flatten)]
    pub threads: Threads,

    /// Folder for the files, made where it does not exist [default: out/<scene name>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Process {
    pub fn folder(&self, scene: &LoadedScene) -> PathBuf {
        self.out.clone().unwrap_or_else(|| folder_of(&scene.name))
    }

    /// Computes something of a scene in the background; an interruption ends the command.
    pub fn compute<T: Send + 'static>(
        &self,
        mut scene: LoadedScene,
        compute: impl FnOnce(&mut LoadedScene) -> Result<T, Stop> + Send + 'static,
    ) -> Result<(LoadedScene, T), Stop> {
        let compute = move |_: &mut dyn FnMut(())| match compute(&mut scene) {
            Ok(computed) => Ok((scene, computed)),
            Err(Stop::Unusable(error)) => Err(error.in_file(&scene.file).into()),
            Err(other) => Err(other),
        };
        let computed = self.threads.attend(compute, |()| {})?;
        computed.unwrap_or_else(|| Err(Stop::Computation("interrupted: nothing was written".into())))
    }
}

/// Creates and locks a folder, and checks that files of these names can be written there. `goes_on` keeps unfinished files of a killed run.
pub fn claim(folder: &Path, names: &[&str], goes_on: bool) -> Result<OutputFolder> {
    let claimed = OutputFolder::claim(folder, goes_on)?;
    names.iter().try_for_each(|name| AtomicFile::create(folder.join(name)).map(drop))?;
    Ok(claimed)
}

/// A state from a file.
#[derive(Debug, clap::Args)]
pub struct At {
    /// Start at the state of a final.json, as a run writes it, its time included: paths, gravity and rest lengths in time go on from there.
    /// Everything else is the scene's, which may have been changed since; rest lengths that it does not give are still the distances of its own
    /// positions. A prescribed coordinate that is not where its motion has it at that time moves on from where it is
    #[arg(long, value_name = "FILE")]
    pub at: Option<PathBuf>,
}

impl At {
    pub fn place(&self, scene: LoadedScene) -> Result<LoadedScene> {
        let Some(file) = &self.at else { return Ok(scene) };
        let mut state = read_final_state(file, &scene.system)?;
        let system = scene.system.continued_from(&state);
        system.prescribed().set_velocities(state.time, &mut state.velocities);
        Ok(LoadedScene { system, state, at: Some(file.clone()), ..scene })
    }
}

/// Advances a state as `sprung run --steps N --dt S` does: by linearised backward Euler with on-demand stiffness. `observe` gets the
/// number of every step and the state after it, and may end the run, as an interruption does.
pub fn advance(
    console: &Console,
    (system, state): (&System, &mut State),
    (dt, steps): (f64, u64),
    message: &'static str,
    mut observe: impl FnMut(u64, &State) -> ControlFlow<()>,
) -> Result<Outcome> {
    let run_options = RunOptions { interrupt: interrupt(), ..RunOptions::default() };
    let Plan { configuration, .. } = run_options.plan(system, state, [dt, dt * steps as f64], None)?;
    let mut stepper = configuration.method.stepper(system, state, &configuration.options)?;
    let bar = console.step_bar(steps).with_message(message);
    let outcome = run(stepper.as_mut(), state, &Schedule::steps(dt, steps), |step, state: &State| {
        bar.set_position(step);
        match observe(step, state) {
            ControlFlow::Continue(()) if !is_interrupted() => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        }
    });
    bar.finish_and_clear();
    Ok(outcome)
}

pub fn positive(text: &str) -> Result<f64, String> {
    number(text, "must be finite and positive", |value| value > 0.0)
}

pub fn fraction(text: &str) -> Result<f64, String> {
    number(text, "must lie between 0 and 1", |value| value > 0.0 && value < 1.0)
}

fn number(text: &str, rule: &str, allowed: impl Fn(f64) -> bool) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "is not a number".to_owned())?;
    if value.is_finite() && allowed(value) { Ok(value) } else { Err(rule.to_owned()) }
}

pub fn whole(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| if is_whole(text) { TOO_LARGE } else { "must be a whole number, not negative" }.to_owned())
}

/// A whole number above zero. The library checks that of sizes.
pub fn positive_count<T: FromStr>(text: &str) -> Result<T, String> {
    let is_zero = text.parse() == Ok(0u8);
    let rule = if is_whole(text) && !is_zero { TOO_LARGE } else { "must be a whole number above zero" };
    text.parse().map_err(|_| rule.to_owned())
}

const TOO_LARGE: &str = "is too large";

fn is_whole(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit())
}

pub fn choice<T: Copy + Send + Sync + 'static>(
    choices: &'static [(T, &'static str)],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    let names = choices.iter().map(move |&(choice, help)| PossibleValue::new(name(choice)).help(help));
    PossibleValuesParser::new(names).try_map(move |text| {
        let named = choices.iter().find(|(choice, _)| name(*choice) == text);
        named.map(|(choice, _)| *choice).ok_or("is not one of the choices")
    })
}

//! Arguments that several commands share.

use super::console::Console;
use super::{Stop, interrupt};
use sprung::error::Invalid;
use sprung::integrate::Schedule;
use sprung::output::{AtomicFile, OutputFolder};
use sprung::plan::DEFAULT_STEP;
use sprung::scene::{Built, Scene, TimeSettings};
use sprung::{Error, Result, State, System};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::Duration;

/// Bytes that must be there when a computation begins: enough for the system to be asked.
const BEGINNING: u64 = 2 << 20;

/// The stack of a thread, in bytes.
const STACK: u64 = 2 << 20;

/// The part of a step, at most, by which times may be rounded.
const RESOLVED: f64 = 1e-4;

/// The scene that a command works on.
#[derive(Debug, clap::Args)]
pub struct SceneFile {
    /// The scene: a TOML, JSON or NumPy (.npz) file, or - for standard input
    #[arg(value_name = "SCENE")]
    path: PathBuf,
}

/// A scene that has been read and checked.
pub struct LoadedScene {
    pub file: PathBuf,
    pub name: String,
    pub time: TimeSettings,
    pub system: System,
    pub state: State,
    /// The file that the state is from, where it is not the scene's start.
    pub at: Option<PathBuf>,
    /// Of its mesh, to be shown.
    pub triangles: Vec<[u32; 3]>,
}

impl SceneFile {
    pub fn at(path: &Path) -> Self {
        Self { path: path.into() }
    }

    /// Reads and builds the scene; says what may surprise in its mesh.
    pub fn load(&self, console: &Console) -> Result<LoadedScene> {
        let (scene, file) = read_scene(&self.path)?;
        let built = scene.build_with_notes().map_err(|error| error.in_file(&file))?;
        let Built { system, state, triangles, notes } = built;
        notes.iter().for_each(|line| console.note(line));
        Ok(LoadedScene { file, name: scene.name, time: scene.time, system, state, at: None, triangles })
    }
}

/// Reads a scene and says where from: a file, or standard input for `-`, as JSON where that begins with a brace.
///
/// # Errors
/// As for [`Scene::load`].
pub fn read_scene(path: &Path) -> Result<(Scene, PathBuf)> {
    if path != "-" {
        return Ok((Scene::load(path)?, path.into()));
    }
    let mut text = String::new();
    let source = PathBuf::from("standard input");
    io::stdin().read_to_string(&mut text).map_err(|error| Error::io(&source, error))?;
    let is_json = text.trim_start_matches('\u{feff}').trim_start().starts_with('{');
    let scene = if is_json { Scene::from_json(&text) } else { Scene::from_toml(&text) };
    let scene = scene.map_err(|error| match error.in_file(&source) {
        Error::Format { message, .. } => Error::Format { file: source.clone(), message },
        other => other,
    })?;
    Ok((scene, source))
}

/// The folder of a name below `out`: spaces, which shells part words at, become hyphens.
pub fn folder_of(name: &str) -> PathBuf {
    PathBuf::from("out").join(name.split_whitespace().collect::<Vec<_>>().join("-"))
}

impl LoadedScene {
    /// The value of an option, or the scene's own.
    ///
    /// # Errors
    /// When neither is given: says which option or key to give.
    pub fn or_given<T>(&self, option: Option<T>, key: Option<T>, name: &str) -> Result<T> {
        option.or(key).ok_or_else(|| {
            Error::Usage(format!("{}: no {name}: give the option --{name} or the key time.{name}", self.file.display()))
        })
    }

    /// The step asked for, the scene's own, or [`DEFAULT_STEP`]; says so where it was not given.
    pub fn step_or_default(&self, console: &Console, asked: Option<f64>) -> f64 {
        asked.or(self.time.dt).unwrap_or_else(|| {
            console.note(format_args!("no dt was given: {DEFAULT_STEP} s is taken (--dt, or the key time.dt)"));
            DEFAULT_STEP
        })
    }

    /// The length of a motion that is to be compared with itself: there must be one.
    ///
    /// # Errors
    /// A duration that is neither given nor in the scene, or is zero.
    pub fn motion_length(&self, option: Option<f64>, what: &str) -> Result<f64> {
        let duration = self.or_given(option, self.time.duration, "duration")?;
        if duration > 0.0 {
            return Ok(duration);
        }
        let invalid = Invalid::new("time.duration", duration, format!("must be positive: {what} needs a motion"));
        Err(Error::from(invalid).in_file(&self.file))
    }

    /// Steps of dt seconds to the end of a run.
    ///
    /// # Errors
    /// Those that cannot be counted, or are lost beside the time at which they start.
    pub fn schedule(&self, dt: f64, duration: f64) -> Result<Schedule> {
        Schedule::check(dt, duration).map_err(|error| self.not_countable(error))?;
        let (time, resolution) = (self.state.time, f64::EPSILON * self.state.time.abs());
        if let Some(file) = self.at.as_ref().filter(|_| resolution > RESOLVED * dt) {
            let rule = format!("is too late for steps of {dt:e} s: numbers of this size are {resolution:.0e} s apart");
            return Err(Error::from(Invalid::new("time", time, rule)).in_file(file));
        }
        Ok(Schedule::duration(dt, duration))
    }

    /// A step or length of time that makes no schedule, with the file that it may come from.
    pub fn not_countable(&self, invalid: Invalid) -> Error {
        let key = format!("time.{}", invalid.key);
        Error::from(Invalid { key, ..invalid }).in_file(&self.file)
    }

    /// The folder for results: the one asked for, or `out/<scene name>`, with hyphens for spaces.
    pub fn folder(&self, asked: &Option<PathBuf>) -> PathBuf {
        asked.clone().unwrap_or_else(|| folder_of(&self.name))
    }
}

/// Makes sure, before results are written, that files of these names can be written in a folder, and that nobody else is at work
/// there as long as the value is kept; makes the folder.
///
/// # Errors
/// The first name that cannot be written; a folder that is in use.
pub fn check_writable(folder: &Path, names: &[&str]) -> Result<OutputFolder> {
    claim(folder, names, false)
}

/// As [`check_writable`]; what a killed run has left unfinished stays where it is to be gone on with.
///
/// # Errors
/// As for [`check_writable`].
pub fn claim(folder: &Path, names: &[&str], goes_on: bool) -> Result<OutputFolder> {
    let claimed = OutputFolder::claim(folder, goes_on)?;
    names.iter().try_for_each(|name| AtomicFile::create(folder.join(name)).map(drop))?;
    Ok(claimed)
}

/// What comes from a computation that is attended.
enum Message<T, R> {
    Told(T),
    Done(R),
}

/// How soon an interruption is noticed.
const PATIENCE: Duration = Duration::from_millis(20);

/// How many threads compute.
#[derive(Debug, clap::Args)]
pub struct Threads {
    /// Threads to compute with; results do not depend on it [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

impl Threads {
    /// Runs a computation on as many threads as asked for.
    pub fn install<T: Send>(&self, compute: impl FnOnce() -> Result<T, Stop> + Send) -> Result<T, Stop> {
        self.pool()?.install(compute)
    }

    /// Runs a computation as [`install`](Self::install) does, until it ends or the user interrupts it; `heard` gets what it tells on
    /// the way. `None` where it was interrupted: it may be at work still, but nobody waits for it, and it ends with the process.
    ///
    /// # Errors
    /// Threads that cannot be had.
    pub fn attend<T: Send + 'static, R: Send + 'static>(
        &self,
        compute: impl FnOnce(&mut dyn FnMut(T)) -> R + Send + 'static,
        mut heard: impl FnMut(T),
    ) -> Result<Option<R>, Stop> {
        interrupt::keep();
        let (sender, receiver) = mpsc::channel();
        self.pool()?.spawn(move || {
            // Where nobody listens any more there is nobody to tell that.
            let result = compute(&mut |told| _ = sender.send(Message::Told(told)));
            let _ = sender.send(Message::Done(result));
        });
        while !interrupt::is_requested() {
            match receiver.recv_timeout(PATIENCE) {
                Ok(Message::Told(told)) => heard(told),
                Ok(Message::Done(result)) => return Ok(Some(result)),
                Err(mpsc::RecvTimeoutError::Timeout) => {}
                Err(mpsc::RecvTimeoutError::Disconnected) => break,
            }
        }
        Ok(None)
    }

    fn pool(&self) -> Result<rayon::ThreadPool, Stop> {
        let threads = self.threads.map_or(0, usize::from);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).spawn_handler(begin).build();
        let pool = pool.map_err(|error| Error::Usage(format!("--threads: {error}")))?;
        // Where threads have taken nearly all, what is too small to be asked for would not be there either.
        sprung::memory::ensure(BEGINNING, "what a computation begins with")?;
        Ok(pool)
    }
}

/// Begins a thread of the pool, and returns when it has what it begins with. An allocator gives every thread memory of its own, some 10⁸ addresses and for
/// a moment twice that, when it first asks: all do so now, as what is asked for later would not be there any more where addresses are limited, and
/// one after the other, as a thread that begins in another's moment would find nothing and end the process.
fn begin(thread: rayon::ThreadBuilder) -> io::Result<()> {
    sprung::memory::ensure(STACK + BEGINNING, "what a thread begins with").map_err(io::Error::other)?;
    let (sender, receiver) = mpsc::channel();
    std::thread::Builder::new().stack_size(STACK as usize).spawn(move || {
        drop(std::hint::black_box(Box::new(0u64)));
        let _ = sender.send(());
        thread.run();
    })?;
    receiver.recv().map_err(io::Error::other)
}

//! `--resume`: what an earlier run left in an output folder, and whether a run can go on from it.

use super::console::Console;
use super::number::number;
use super::parts::Parts;
use sprung::output::Checkpoint;
use sprung::{Error, Result};
use std::fmt::{self, Display};
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

/// What is in an output folder before a run.
pub struct Earlier {
    folder: PathBuf,
    before: Option<Before>,
    /// A checkpoint, where the run is to be resumed.
    checkpoint: Option<Checkpoint>,
    /// Whether the run of the checkpoint came to its end.
    is_finished: bool,
}

impl Earlier {
    /// Looks into a folder.
    ///
    /// # Errors
    /// A checkpoint that cannot be read.
    pub fn of(folder: &Path, resume: bool) -> Result<Self> {
        let unfinished = if resume { Checkpoint::read(folder)? } else { None };
        let is_finished = resume && unfinished.is_none();
        let checkpoint = if is_finished { Checkpoint::read_finished(folder)? } else { unfinished };
        Ok(Self { folder: folder.into(), before: Before::of(folder), checkpoint, is_finished })
    }

    /// Steps from one checkpoint to the next.
    pub fn every(&self) -> Option<NonZeroU64> {
        NonZeroU64::new(self.checkpoint.as_ref()?.every)
    }

    /// The checkpoint to go on from, if that is asked for and there is one; says what becomes of the earlier run.
    ///
    /// # Errors
    /// The checkpoint of another run that has not ended; none at all, and none that this run would write.
    pub fn checkpoint(self, console: &Console, resume: bool, parts: &Parts) -> Result<Option<Checkpoint>> {
        let Self { folder, before, checkpoint, is_finished } = self;
        let Some(found) = checkpoint else {
            match before {
                Some(before) if resume => console.note(format_args!(
                    "{before} and left nothing to go on from, as it wrote no checkpoint: this run starts again"
                )),
                Some(before) => console.note(format_args!("{before}: this run replaces its files")),
                None if resume && parts.checkpoints.is_none() => {
                    let folder = folder.display();
                    return Err(Error::Usage(format!("{folder}: no checkpoint to resume from: give --checkpoint N")));
                }
                None => {}
            }
            return Ok(None);
        };
        let before = || before.map_or_else(|| format!("{}: a run ended here", folder.display()), |run| run.to_string());
        let (step, time) = (found.reached, number(found.time));
        match parts.obstacle(&found) {
            None if is_finished => {
                console.note(format_args!(
                    "{}: this run goes on from its checkpoint at step {step}, t = {time} s",
                    before()
                ));
                Ok(Some(found))
            }
            None => Ok(Some(found)),
            Some(why) if is_finished => {
                console.note(format_args!("{}; {why}: this run starts again", before()));
                Ok(None)
            }
            Some(why) => Err(Error::Usage(format!(
                "{}: {why}: give the scene and the arguments of the run that wrote it, or leave out --resume",
                folder.display()
            ))),
        }
    }
}

/// The run whose results are in a folder.
struct Before {
    folder: PathBuf,
    method: String,
    status: String,
    time: f64,
}

impl Before {
    /// As its summary says; `None` where there is none that can be read.
    fn of(folder: &Path) -> Option<Self> {
        let text = std::fs::read_to_string(folder.join("summary.json")).ok()?;
        let summary: serde_json::Value = serde_json::from_str(&text).ok()?;
        let text = |key: &str| summary.get(key)?.as_str().map(str::to_owned);
        let time = summary.get("time")?.as_f64()?;
        Some(Self { folder: folder.into(), method: text("method")?, status: text("status")?, time })
    }
}

impl Display for Before {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { folder, method, status, time } = self;
        let (folder, time) = (folder.display(), number(*time));
        write!(f, "{folder}: a run by {method} ended here, {status} at t = {time} s")
    }
}

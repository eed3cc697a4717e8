//! `sprung new`: print a ready scene.

use super::console::{Console, print};
use super::values::size;
use super::{Outcome, Stop};
use sprung::scene::{Kind, builtin};

/// Print a ready scene as TOML (with --json: as JSON)
///
/// Save it to a file, change what you like, and run it: `sprung new cloth --size 30 > cloth.toml`.
#[derive(Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct New {
    /// What to make
    #[arg(value_name = "KIND")]
    kind: Kind,

    /// How large: the number of particles or links along the scene [default: one that shows what the kind is about]
    #[arg(long, value_name = "N", value_parser = size)]
    size: Option<usize>,
}

impl New {
    pub fn execute(&self, console: &Console) -> Result<Outcome, Stop> {
        let scene = builtin(self.kind, self.size.unwrap_or(self.kind.default_size()))?;
        let text = if console.json { scene.to_json() } else { scene.to_toml() };
        print(text.trim_end())?;
        Ok(Outcome::Done)
    }
}

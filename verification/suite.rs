//! The verification suite: one named test for every check on every scene.
//!
//! `cargo test --test verification` runs it, and arguments after `--` choose: part of a name, `--list`, `--exact`,
//! `--skip`. After a run of all tests in one process `report.html`, `report.json` and `junit.xml` are in the folder
//! `verification` of the target folder. A run of some tests writes nothing: a report that leaves out most of the suite
//! would look like one of all of it. Runners that start a process for every test, such as cargo-nextest, therefore get
//! the verdicts and write their own report.

mod collect;
mod failures;
mod known;
#[allow(dead_code, reason = "the suite uses a part of it")]
mod manufactured;
mod scenes;

use collect::Collector;
use libtest_mimic::Arguments;

fn main() {
    let arguments = Arguments::from_args();
    let mut collector = Collector::default();
    let mut trials = Vec::new();
    trials.extend(scenes::trials(&mut collector));
    trials.extend(known::trials(&mut collector));
    trials.extend(failures::trials(&mut collector));
    let conclusion = libtest_mimic::run(&arguments, trials);
    if !arguments.list && conclusion.num_filtered_out == 0 {
        collector.report();
    }
    conclusion.exit();
}

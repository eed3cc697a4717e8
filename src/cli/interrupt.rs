//! Ctrl-C: the first one asks for an orderly end, the second one does not wait for it.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag::{register, register_conditional_shutdown};
use sprung::interrupt::Interrupt;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

/// A flag that becomes true when the user interrupts, the terminal goes away or the system asks the process to end. A hangup that
/// is ignored is left alone, so that `nohup` works.
pub fn flag() -> &'static AtomicBool {
    static FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    FLAG.get_or_init(register_all)
}

/// The flag as the library takes it.
pub fn request() -> Interrupt {
    Interrupt::on(flag())
}

fn register_all() -> Arc<AtomicBool> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM].into_iter().chain(hangup()) {
        // In this order: the first signal finds the flag down and raises it, the second finds it up and ends the
        // process with the status that shells give to one killed by the signal. Where nothing can be registered, the
        // first one ends the process, as it does without us.
        let _ = register_conditional_shutdown(signal, 128 + signal, flag.clone());
        let _ = register(signal, flag.clone());
    }
    flag
}

/// The signal of a terminal that goes away, unless it is ignored.
#[cfg(unix)]
fn hangup() -> Option<i32> {
    use signal_hook::consts::SIGHUP;
    (!is_ignored(SIGHUP)).then_some(SIGHUP)
}

#[cfg(not(unix))]
fn hangup() -> Option<i32> {
    None
}

/// Whether the process was started with a signal ignored; where that cannot be known it may have been.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_none_or(|mask| mask >> (signal - 1) & 1 == 1)
}

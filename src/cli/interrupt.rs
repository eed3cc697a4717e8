//! Ctrl-C: while there is something to keep the first one asks for an orderly end, and the second one does not wait for it. Before
//! that, while scenes are read and matrices analysed, it ends the process as it does without us.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag::{register, register_conditional_shutdown};
use sprung::interrupt::Interrupt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Once, OnceLock};

/// A flag that becomes true when the user interrupts, the terminal goes away or the system asks the process to end, once
/// [`keep`] has been called.
pub fn flag() -> &'static AtomicBool {
    shared()
}

/// Whether an end was asked for.
pub fn is_requested() -> bool {
    flag().load(Ordering::Relaxed)
}

/// From now on there is something to keep. A hangup that is ignored is left alone, so that `nohup` works.
pub fn keep() {
    static KEPT: Once = Once::new();
    KEPT.call_once(|| register_all(shared()));
}

fn shared() -> &'static Arc<AtomicBool> {
    static FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    FLAG.get_or_init(Arc::default)
}

/// The flag as the library takes it.
pub fn request() -> Interrupt {
    Interrupt::on(flag())
}

fn register_all(flag: &Arc<AtomicBool>) {
    for signal in [SIGINT, SIGTERM].into_iter().chain(hangup()) {
        // In this order: the first signal finds the flag down and raises it, the second finds it up and ends the
        // process with the status that shells give to one killed by the signal. Where nothing can be registered, the
        // first one ends the process, as it does without us.
        let _ = register_conditional_shutdown(signal, 128 + signal, flag.clone());
        let _ = register(signal, flag.clone());
    }
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

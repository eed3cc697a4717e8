//! Ctrl-C: the first one asks for an orderly end, the second one does not wait for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The exit status of shells for a process that SIGINT has ended.
const KILLED_BY_INTERRUPT: i32 = 130;

/// A flag that becomes true when the user interrupts (SIGINT) or the system asks the process to end (SIGTERM, SIGHUP).
pub fn flag() -> Arc<AtomicBool> {
    let flag = Arc::new(AtomicBool::new(false));
    let raised = flag.clone();
    // Where no handler can be installed an interrupt ends the process at once, as it does without one.
    let _ = ctrlc::set_handler(move || {
        if raised.swap(true, Ordering::Relaxed) {
            std::process::exit(KILLED_BY_INTERRUPT);
        }
    });
    flag
}

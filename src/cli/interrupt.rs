//! Ctrl-C: the first one asks for an orderly end, the second one does not wait for it.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag::{register, register_conditional_shutdown};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A flag that becomes true when the user interrupts or the system asks the process to end. A hangup is left alone, so
/// that `nohup` works.
pub fn flag() -> Arc<AtomicBool> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // In this order: the first signal finds the flag down and raises it, the second finds it up and ends the
        // process with the status that shells give to one killed by the signal. Where nothing can be registered, the
        // first one ends the process, as it does without us.
        let _ = register_conditional_shutdown(signal, 128 + signal, flag.clone());
        let _ = register(signal, flag.clone());
    }
    flag
}

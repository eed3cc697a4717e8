//! `--threads` and interruption.
//!
//! Once there is something to keep, the first Ctrl-C asks for an orderly end, and the second one ends the process. Before that, while
//! scenes are read and matrices analysed, the first one ends it.

use super::Stop;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag::{register, register_conditional_shutdown};
use sprung::Error;
use sprung::interrupt::Interrupt;
use std::io;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Once, OnceLock, mpsc};
use std::time::Duration;

fn shared_flag() -> &'static Arc<AtomicBool> {
    static FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    FLAG.get_or_init(Arc::default)
}

pub fn interrupt() -> Interrupt {
    Interrupt::on(shared_flag())
}

pub fn is_interrupted() -> bool {
    shared_flag().load(Ordering::Relaxed)
}

/// From now on an interruption, the end of the terminal or a request of the system to end is orderly. An ignored hangup stays ignored, so
/// that `nohup` works.
pub fn end_in_order() {
    static REGISTERED: Once = Once::new();
    REGISTERED.call_once(|| {
        let flag = shared_flag();
        for signal in [SIGINT, SIGTERM].into_iter().chain(hangup()) {
            // In this order: the first signal finds the flag down and raises it, the second finds it up and ends the process with the
            // status that shells give to one killed by the signal. Where this fails, the first one ends the process.
            let _ = register_conditional_shutdown(signal, 128 + signal, flag.clone());
            let _ = register(signal, flag.clone());
        }
    });
}

/// The signal of a terminal that goes away, unless the process ignores it or that cannot be known.
#[cfg(unix)]
fn hangup() -> Option<i32> {
    use signal_hook::consts::SIGHUP;
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"))?;
    let ignored = u64::from_str_radix(ignored.trim(), 16).ok()?;
    (ignored >> (SIGHUP - 1) & 1 == 0).then_some(SIGHUP)
}

#[cfg(not(unix))]
fn hangup() -> Option<i32> {
    None
}

/// Bytes of a thread's stack, and those that must be free when a computation begins.
const STACK: u64 = 2 << 20;

/// The number of threads that compute.
#[derive(Debug, clap::Args)]
pub struct Threads {
    /// Threads to compute with; results do not depend on it [default: all cores]
    #[arg(long, value_name = "N", value_parser = thread_count)]
    threads: Option<u16>,
}

fn thread_count(text: &str) -> Result<u16, String> {
    let count = text.parse().ok().filter(|count| (1..=1024).contains(count));
    count.ok_or_else(|| "must be a whole number from 1 to 1024".to_owned())
}

impl Threads {
    pub fn install<T: Send>(&self, compute: impl FnOnce() -> Result<T, Stop> + Send) -> Result<T, Stop> {
        self.pool()?.install(compute)
    }

    /// As [`install`](Self::install), in the background, until the computation ends or the user interrupts it; `observe` gets its
    /// progress. Returns `None` after an interruption: the computation then ends with the process.
    pub fn attend<T: Send + 'static, R: Send + 'static>(
        &self,
        compute: impl FnOnce(&mut dyn FnMut(T)) -> R + Send + 'static,
        mut observe: impl FnMut(T),
    ) -> Result<Option<R>, Stop> {
        end_in_order();
        let (sender, receiver) = mpsc::channel();
        self.pool()?.spawn(move || {
            // After an interruption nobody receives.
            let result = compute(&mut |progress| _ = sender.send(ControlFlow::Continue(progress)));
            let _ = sender.send(ControlFlow::Break(result));
        });
        while !is_interrupted() {
            match receiver.recv_timeout(Duration::from_millis(20)) {
                Ok(ControlFlow::Continue(progress)) => observe(progress),
                Ok(ControlFlow::Break(result)) => return Ok(Some(result)),
                Err(mpsc::RecvTimeoutError::Timeout) => {}
                Err(mpsc::RecvTimeoutError::Disconnected) => break,
            }
        }
        Ok(None)
    }

    fn pool(&self) -> Result<rayon::ThreadPool, Stop> {
        let threads = self.threads.map_or(0, usize::from);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).spawn_handler(start_thread).build();
        let pool = pool.map_err(|error| Error::Usage(format!("--threads: {error}")))?;
        // Small allocations are not checked: the threads must leave some memory for them.
        sprung::memory::ensure(STACK, "what a computation begins with")?;
        Ok(pool)
    }
}

/// Starts a thread of the pool, and returns when its allocator has reserved its arena. With limited address space threads that do so at
/// the same time, or later, end the process.
fn start_thread(thread: rayon::ThreadBuilder) -> io::Result<()> {
    sprung::memory::ensure(2 * STACK, "what a thread begins with").map_err(io::Error::other)?;
    let (sender, receiver) = mpsc::channel();
    std::thread::Builder::new().stack_size(STACK as usize).spawn(move || {
        drop(std::hint::black_box(Box::new(0u64)));
        let _ = sender.send(());
        thread.run();
    })?;
    receiver.recv().map_err(io::Error::other)
}

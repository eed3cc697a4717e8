//! Computing without the lock of the interpreter, so that other threads of Python go on, and so that Ctrl-C works.
//!
//! Python answers signals in its main thread, between two of its own instructions; while that thread computes there is none. So the
//! work goes to a pool of threads, and the thread that called waits for it: every twentieth of a second it lets Python look for signals,
//! and raises a flag that the library looks at between pieces of work when one of them raised an exception. The work may ask the
//! caller something in between, such as to call a function of the user's: that runs in the thread that called, where users expect it.
//!
//! Forces and spring laws of the user's own are called where they are needed, by the thread that computes, which takes the lock for as long
//! ([`functions`](crate::functions)). Whoever calls [`compute`] must not hold the lock while it waits for other threads, and does not: `detach`
//! gives it back. What such a function raises is kept in the flag and ends the computation.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use sprung::interrupt::Interrupt;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How often signals are looked for.
const LOOK: Duration = Duration::from_millis(50);

/// A request to stop, of one computation, and the first exception of a function that it called. The library holds the bits for ever, so they
/// are used again.
pub struct Flag {
    stop: &'static AtomicBool,
    exception: Mutex<Option<PyErr>>,
}

static UNUSED: Mutex<Vec<&'static AtomicBool>> = Mutex::new(Vec::new());

impl Flag {
    /// One that nobody uses.
    pub fn new() -> Arc<Self> {
        let unused = UNUSED.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let stop = unused.unwrap_or_else(|| Box::leak(Box::new(AtomicBool::new(false))));
        Arc::new(Self { stop, exception: Mutex::new(None) })
    }

    /// As the library takes it.
    pub fn interrupt(&self) -> Interrupt {
        Interrupt::on(self.stop)
    }

    /// Whether to stop.
    pub fn is_raised(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Stops, and keeps the first exception that says why.
    pub fn fail(&self, exception: PyErr) {
        self.exception.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(exception);
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Whether a function has raised an exception.
    pub fn has_failed(&self) -> bool {
        self.exception.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    /// Is as new; the exception that there was.
    fn reset(&self) -> Option<PyErr> {
        self.stop.store(false, Ordering::Relaxed);
        self.exception.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

impl Drop for Flag {
    fn drop(&mut self) {
        self.stop.store(false, Ordering::Relaxed);
        UNUSED.lock().unwrap_or_else(PoisonError::into_inner).push(self.stop);
    }
}

/// What the work says to the thread that waits for it.
enum Message<M> {
    Asks(M),
    Done,
}

/// The way from the work to the thread that waits for it.
pub struct Line<M> {
    messages: Sender<Message<M>>,
    answers: Receiver<ControlFlow<()>>,
}

impl<M> Line<M> {
    /// Asks the caller something, and waits for the answer: whether to go on.
    pub fn ask(&self, message: M) -> ControlFlow<()> {
        match self.messages.send(Message::Asks(message)) {
            Ok(()) => self.answers.recv().unwrap_or(ControlFlow::Break(())),
            Err(_) => ControlFlow::Break(()),
        }
    }
}

/// Computes, see the module.
///
/// # Errors
/// What a handler of a signal or a function of the user's raised; the work has ended then, early where it looks at the flag.
pub fn compute<T: Send>(py: Python<'_>, flag: &Flag, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    converse(py, flag, |_: &Line<()>| work(), |_, ()| Ok(ControlFlow::Continue(())))
}

/// As [`compute`], with questions that the caller answers.
///
/// # Errors
/// As for [`compute`]; what an answer raised.
pub fn converse<T: Send, M: Send>(
    py: Python<'_>,
    flag: &Flag,
    work: impl FnOnce(&Line<M>) -> T + Send,
    mut answer: impl FnMut(Python<'_>, M) -> PyResult<ControlFlow<()>> + Send,
) -> PyResult<T> {
    // A function of the user's that computes in turn runs on a thread of the pool. If it waited there for others of the pool, all of them
    // could come to wait.
    let pool = if rayon::current_thread_index().is_some() { made(1)? } else { pool()? };
    flag.reset();
    let mut result = None;
    let mut raised = None;
    py.detach(|| {
        let (messages, inbox) = channel();
        let (replies, answers) = channel();
        let line = Line { messages, answers };
        let (result, raised) = (&mut result, &mut raised);
        pool.in_place_scope(move |scope| {
            scope.spawn(move |_| {
                *result = Some(work(&line));
                let _ = line.messages.send(Message::Done);
            });
            loop {
                let (outcome, asked) = match inbox.recv_timeout(LOOK) {
                    Ok(Message::Done) | Err(RecvTimeoutError::Disconnected) => break,
                    Ok(Message::Asks(_)) if raised.is_some() => (Ok(ControlFlow::Break(())), true),
                    Ok(Message::Asks(message)) => (Python::attach(|py| answer(py, message)), true),
                    Err(RecvTimeoutError::Timeout) if raised.is_some() => continue,
                    Err(RecvTimeoutError::Timeout) => {
                        (Python::attach(|py| py.check_signals().map(|()| ControlFlow::Continue(()))), false)
                    }
                };
                let reply = outcome.unwrap_or_else(|error| {
                    flag.stop.store(true, Ordering::Relaxed);
                    *raised = Some(error);
                    ControlFlow::Break(())
                });
                if asked {
                    let _ = replies.send(reply);
                }
            }
        });
    });
    let failed = flag.reset();
    match (raised.or(failed), result) {
        (Some(error), _) => Err(error),
        (None, Some(result)) => Ok(result),
        (None, None) => Err(PyRuntimeError::new_err("the computation ended without a result")),
    }
}

/// The pool of threads of this process, as many as there are cores or as `RAYON_NUM_THREADS` says. A process that was forked has
/// none of its parent's threads, so it gets a pool of its own.
fn pool() -> PyResult<Arc<ThreadPool>> {
    static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if let Some((owner, pool)) = &*pool
        && *owner == process
    {
        return Ok(pool.clone());
    }
    // As many threads as rayon makes by itself.
    let made = made(0)?;
    // The parent's cannot be ended from here.
    std::mem::forget(pool.replace((process, made.clone())));
    Ok(made)
}

fn made(threads: usize) -> PyResult<Arc<ThreadPool>> {
    let made = ThreadPoolBuilder::new().num_threads(threads).build();
    made.map(Arc::new).map_err(|error| PyRuntimeError::new_err(error.to_string()))
}

//! How ranks wait for each other where they share cores.
//!
//! Open MPI looks for messages again and again while it waits, and where there are more ranks than cores it calls `sched_yield`
//! between two looks. Linux charges a process for that as for work: a rank that has waited so has used up its share when its
//! message comes, and stands behind every other busy process. On two cores with two such processes beside them, three ranks took
//! 36 to 51 s for what they do in 1.6 s alone, and looked as if they waited for ever.
//!
//! This program therefore has a `sched_yield` of its own, which Open MPI finds before that of the C library: after a short while of
//! waiting it sleeps between two looks. Who sleeps is charged nothing and gets a core at once when it wakes. Where every rank has a
//! core Open MPI does not call it.

#![allow(unsafe_code)]

use std::cell::Cell;
use std::ffi::c_int;
use std::time::{Duration, Instant};

/// Looks that are further apart belong to two waits: one look takes about a microsecond.
const APART: Duration = Duration::from_micros(20);

/// What a rank waits without sleeping: about as long as the shortest sleep and waking up take, so that no wait becomes more than
/// twice as long by the wrong choice.
const AWAKE: Duration = Duration::from_micros(100);

/// Linux adds 50 µs to it.
const SLEEP: Duration = Duration::from_micros(20);

thread_local! {
    /// When the wait began, and when it looked last.
    static WAIT: Cell<Option<[Instant; 2]>> = const { Cell::new(None) };
}

/// In place of the C library's.
// SAFETY: it has that function's type and, as that promises no more than that others may run, does what it does.
#[cfg(target_os = "linux")]
#[unsafe(no_mangle)]
extern "C" fn sched_yield() -> c_int {
    // A thread that ends has no such place any more, and need not sleep.
    let _ = WAIT.try_with(wait);
    0
}

fn wait(place: &Cell<Option<[Instant; 2]>>) {
    let now = Instant::now();
    let begin = place.get().filter(|[_, last]| now - *last <= APART).map_or(now, |[begin, _]| begin);
    if now - begin > AWAKE {
        std::thread::sleep(SLEEP);
    }
    place.set(Some([begin, Instant::now()]));
}

//! The workspace of faer's products of dense blocks.
//!
//! The first such product of a thread takes twice the size of the machine's last-level caches, whatever the size of the blocks, keeps
//! it as long as the thread lives, and ends the process where it cannot have it. Hardly any of it is ever touched, so it counts
//! against a limit on the address space alone. Where there is one, every thread of the pool is made to take its workspace when
//! something is set up that will multiply, after the room has been asked for: then what cannot be had is an error like any other.

use faer::{Accum, Mat, Par};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fs::{read_dir, read_to_string};
use std::path::Path;
use std::sync::OnceLock;

thread_local! {
    /// Whether this thread has its workspace.
    static TAKEN: Cell<bool> = const { Cell::new(false) };
}

/// Bytes that the threads of the pool, and this one, have yet to take.
pub(super) fn missing() -> u64 {
    let missing = || u64::from(!TAKEN.get());
    let threads: u64 = rayon::broadcast(|_| missing()).into_iter().sum();
    (threads + outside().map_or(0, |()| missing())) * bytes()
}

/// Makes them take it; whether all of them have it now.
pub(super) fn take() -> bool {
    let taken = rayon::broadcast(|_| take_here());
    taken.into_iter().all(|taken| taken) && outside().is_none_or(|()| take_here())
}

/// This thread, where it is none of the pool's.
fn outside() -> Option<()> {
    rayon::current_thread_index().is_none().then_some(())
}

fn take_here() -> bool {
    if !TAKEN.get() {
        // Asked for and given back first: unlike the product this may fail.
        if Vec::<u8>::new().try_reserve_exact(bytes() as usize).is_err() {
            return false;
        }
        let block = Mat::<f64>::identity(ORDER, ORDER);
        let mut product = Mat::<f64>::zeros(ORDER, ORDER);
        faer::linalg::matmul::matmul(&mut product, Accum::Replace, &block, &block, 1.0, Par::Seq);
        TAKEN.set(true);
    }
    true
}

/// Products of smaller blocks than of order 16 are made without a workspace.
const ORDER: usize = 32;

/// Bytes that a thread takes.
pub(super) fn bytes() -> u64 {
    static BYTES: OnceLock<u64> = OnceLock::new();
    *BYTES.get_or_init(|| twice_the_last_level(caches(Path::new("/sys/devices/system/cpu"))))
}

/// Where there is no third level four times the second counts, for the processors that share what is behind it.
fn twice_the_last_level([second, third]: [u64; 2]) -> u64 {
    2 * third.max(4 * second).max(LEAST)
}

/// What is taken for the last level where its size is not known, or less.
const LEAST: u64 = 4_194_304;

/// The largest cache of the second level, and all of the third together, in bytes.
fn caches(cpus: &Path) -> [u64; 2] {
    let text = |file: &Path| read_to_string(file).unwrap_or_default().trim().to_owned();
    let mut second = 0;
    let mut third = BTreeMap::new();
    for cpu in read_dir(cpus).into_iter().flatten().flatten() {
        for cache in read_dir(cpu.path().join("cache")).into_iter().flatten().flatten() {
            let cache = cache.path();
            let size = size(&text(&cache.join("size")));
            match text(&cache.join("level")).as_str() {
                "2" => second = size.max(second),
                // One that several processors share is listed with each of them.
                "3" => _ = third.insert(text(&cache.join("shared_cpu_list")), size),
                _ => {}
            }
        }
    }
    [second, third.values().sum()]
}

/// `32768K` in bytes.
fn size(text: &str) -> u64 {
    let digits = text.trim_end_matches(char::is_alphabetic);
    let unit = match text.chars().next_back() {
        Some('K') => 1 << 10,
        Some('M') => 1 << 20,
        Some('G') => 1 << 30,
        _ => 1,
    };
    digits.parse::<u64>().map_or(0, |number| number.saturating_mul(unit))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::held;

    #[test]
    fn sizes_are_read_with_their_units() {
        let read = ["32768K", "32M", "1G", "512", "", "K", "many"].map(size);
        assert_eq!(read, [32 << 20, 32 << 20, 1 << 30, 512, 0, 0, 0]);
    }

    /// Two processors with a second level each share a third one, another has one of its own; first levels do not count.
    #[test]
    fn caches_count_once() {
        let folder = std::env::temp_dir().join(format!("sprung-caches-{}", std::process::id()));
        for (cpu, index, level, size, shared) in [
            (0, 0, "1", "9M", "0"),
            (0, 2, "2", "512K", "0"),
            (0, 3, "3", "8M", "0-1"),
            (1, 2, "2", "1M", "1"),
            (1, 3, "3", "8M", "0-1"),
            (2, 2, "2", "256K", "2"),
            (2, 3, "3", "4M", "2"),
        ] {
            let cache = folder.join(format!("cpu{cpu}/cache/index{index}"));
            std::fs::create_dir_all(&cache).unwrap();
            for (file, text) in [("level", level), ("size", size), ("shared_cpu_list", shared)] {
                std::fs::write(cache.join(file), format!("{text}\n")).unwrap();
            }
        }
        assert_eq!(caches(&folder), [1 << 20, 12 << 20]);
        assert_eq!(caches(&folder.join("absent")), [0, 0]);
        std::fs::remove_dir_all(&folder).unwrap();
        let taken = [[1 << 20, 12 << 20], [3 << 20, 10 << 20], [1 << 20, 1 << 20], [0, 0]].map(twice_the_last_level);
        assert_eq!(taken, [24 << 20, 24 << 20, 8 << 20, 8 << 20]);
    }

    /// Beside the threads of the pool the one that asks counts, once.
    #[test]
    fn threads_outside_the_pool_take_their_own() {
        let alone = |work: fn()| std::thread::spawn(work).join().unwrap();
        alone(|| assert!(take() && missing() == 0));
        alone(|| {
            assert_eq!(missing(), bytes());
            assert!(take() && missing() == 0);
        });
    }

    /// The workspace is what it is thought to be, on the machine at hand, and products take nothing more once it is there. Other
    /// tests take memory meanwhile: one of several threads is alone with its look.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_product_takes_what_was_asked_for_and_only_once() {
        let look = || {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            pool.install(|| {
                assert_eq!(missing(), bytes());
                let before = held()[0];
                assert!(take());
                let taken = held()[0].saturating_sub(before);
                assert_eq!(missing(), 0);
                taken
            })
        };
        let looks: Vec<u64> = (0..20).map(|_| look()).collect();
        assert!(looks.iter().any(|&taken| taken <= bytes() + (1 << 20)), "{looks:?} of {}", bytes());
    }
}

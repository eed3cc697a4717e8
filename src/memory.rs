//! The memory that this process may take, limits included.
//!
//! A failed allocation ends the process, and one beyond the limit of a container gets it killed later. So what grows with a scene is checked before
//! it is allocated. The room is the memory of the machine, the limit of the process's control groups or that on its address space (`ulimit -v`), less
//! what the process holds. Other processes do not count, so that runs are repeatable. Where `/proc` says nothing there is no limit.
//!
//! The first product of dense blocks by faer on a thread takes a workspace of twice the machine's last-level caches for good, and ends the process
//! where it cannot have it. Hardly any of it is touched, so it counts against a limit on the address space alone. Where there is one, every thread of
//! the pool takes its workspace when a factorization is set up, after a check.

use crate::error::{Error, Result};
use faer::{Accum, Mat, Par};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fs::{read_dir, read_to_string};
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes that this process may ever hold.
pub fn limit() -> Option<u64> {
    [physical(), address_space()].into_iter().flatten().min()
}

/// Bytes that this process may hold in addition to what it does.
pub fn room() -> u64 {
    let [size, resident] = held();
    let beyond = |limit: Option<u64>, held: u64| limit.map_or(u64::MAX, |limit| limit.saturating_sub(held));
    beyond(physical(), resident).min(beyond(address_space(), size))
}

/// Checks that there is room for so many bytes. Small requests add up until they are checked together, as a check reads a file.
///
/// # Errors
/// [`Error::TooLarge`] with the bytes needed and the room there is.
pub fn ensure(bytes: u64, what: &'static str) -> Result<()> {
    #[cfg(test)]
    watch::note(bytes, what);
    /// Bytes that were granted since the last check.
    static UNCHECKED: AtomicU64 = AtomicU64::new(0);
    let unchecked = UNCHECKED.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
    if unchecked <= 1 << 20 {
        return Ok(());
    }
    UNCHECKED.store(0, Ordering::Relaxed);
    let room = room().saturating_sub(RESERVE);
    if bytes <= room { Ok(()) } else { Err(Error::TooLarge { what, bytes, room }) }
}

/// As [`ensure`], for something that multiplies dense blocks: the threads of the pool have their workspace when this returns.
pub(crate) fn ensure_with_dense_products(bytes: u64, what: &'static str) -> Result<()> {
    ensure(bytes, what)?;
    let Some(limit) = address_space() else { return Ok(()) };
    let room = || limit.saturating_sub(held()[0]).saturating_sub(RESERVE);
    let bytes = bytes.saturating_add(missing_workspaces());
    let fits = bytes <= room() && take_workspaces();
    if fits { Ok(()) } else { Err(Error::TooLarge { what, bytes, room: room() }) }
}

pub(crate) fn filled<T: Clone>(value: T, length: usize, what: &'static str) -> Result<Vec<T>> {
    let bytes = (length as u64).saturating_mul(size_of::<T>() as u64);
    ensure(bytes, what)?;
    let mut list = Vec::new();
    list.try_reserve_exact(length).map_err(|_| Error::TooLarge { what, bytes, room: room() })?;
    list.resize(length, value);
    Ok(list)
}

/// Bytes left for what is not checked: messages, buffers of files, and the overhead of the allocator.
const RESERVE: u64 = 8 << 20;

/// The memory of the machine, or of the control groups.
fn physical() -> Option<u64> {
    static PHYSICAL: OnceLock<Option<u64>> = OnceLock::new();
    *PHYSICAL.get_or_init(|| {
        let groups = read_to_string("/proc/self/cgroup").unwrap_or_default();
        let of_groups = group_limits(&groups, |path| read_to_string(path).ok());
        [machine(&read_to_string("/proc/meminfo").unwrap_or_default()), of_groups].into_iter().flatten().min()
    })
}

/// `MemTotal` of `/proc/meminfo`.
fn machine(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}

/// The lowest limit of the control groups of the process, of both versions, and of those above them.
fn group_limits(groups: &str, read: impl Fn(&Path) -> Option<String>) -> Option<u64> {
    let mut lowest = None;
    for line in groups.lines() {
        let mut parts = line.splitn(3, ':');
        let (Some(_), Some(controllers), Some(group)) = (parts.next(), parts.next(), parts.next()) else { continue };
        let (root, name) = match controllers {
            "" => ("/sys/fs/cgroup", "memory.max"),
            list if list.split(',').any(|controller| controller == "memory") => {
                ("/sys/fs/cgroup/memory", "memory.limit_in_bytes")
            }
            _ => continue,
        };
        // Inside a container only the root may be visible.
        for group in Path::new(group).ancestors() {
            let folder = Path::new(root).join(group.strip_prefix("/").unwrap_or(group));
            let limit = read(&folder.join(name)).and_then(|text| text.trim().parse::<u64>().ok());
            lowest = [lowest, limit].into_iter().flatten().min();
        }
    }
    // Version 1 has a number near 2⁶³ instead of no limit.
    lowest.filter(|&limit| limit < 1 << 60)
}

fn address_space() -> Option<u64> {
    static ADDRESS_SPACE: OnceLock<Option<u64>> = OnceLock::new();
    *ADDRESS_SPACE.get_or_init(|| {
        let limits = read_to_string("/proc/self/limits").unwrap_or_default();
        let line = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
        line.split_whitespace().next()?.parse().ok()
    })
}

fn held() -> [u64; 2] {
    let status = read_to_string("/proc/self/status").unwrap_or_default();
    ["VmSize:", "VmRSS:"].map(|key| {
        let value = status.lines().find_map(|line| line.strip_prefix(key)?.split_whitespace().next());
        value.and_then(|text| text.parse::<u64>().ok()).unwrap_or(0) * 1024
    })
}

thread_local! {
    /// Whether this thread has its workspace.
    static HAS_WORKSPACE: Cell<bool> = const { Cell::new(false) };
}

/// Bytes of the workspaces that the threads of the pool, and this one, do not have yet.
fn missing_workspaces() -> u64 {
    let missing = on_every_thread(|| !HAS_WORKSPACE.get()).into_iter().filter(|&is_missing| is_missing);
    missing.count() as u64 * workspace_bytes()
}

/// Allocates them; true if all threads have theirs now.
fn take_workspaces() -> bool {
    on_every_thread(take_workspace).into_iter().all(|taken| taken)
}

/// The results of the threads of the pool, and of this one where it is none of them.
fn on_every_thread<R: Send>(work: fn() -> R) -> Vec<R> {
    let mut results = rayon::broadcast(|_| work());
    if rayon::current_thread_index().is_none() {
        results.push(work());
    }
    results
}

fn take_workspace() -> bool {
    if !HAS_WORKSPACE.get() {
        // Allocated and freed first: unlike the product this may fail.
        if Vec::<u8>::new().try_reserve_exact(workspace_bytes() as usize).is_err() {
            return false;
        }
        // Blocks of order below 16 are multiplied without a workspace.
        let block = Mat::<f64>::identity(32, 32);
        let mut product = Mat::<f64>::zeros(32, 32);
        faer::linalg::matmul::matmul(&mut product, Accum::Replace, &block, &block, 1.0, Par::Seq);
        HAS_WORKSPACE.set(true);
    }
    true
}

fn workspace_bytes() -> u64 {
    static BYTES: OnceLock<u64> = OnceLock::new();
    *BYTES.get_or_init(|| twice_the_last_level(caches(Path::new("/sys/devices/system/cpu"))))
}

/// As faer does: without a third level four times the second counts, and at least 4 MiB.
fn twice_the_last_level([second, third]: [u64; 2]) -> u64 {
    2 * third.max(4 * second).max(4 << 20)
}

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
                // A shared one is listed with each of its processors.
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

/// Records the bytes that are checked, for tests that compare them with those held.
#[cfg(test)]
pub(crate) mod watch {
    use std::cell::RefCell;

    thread_local! {
        static ASKED: RefCell<Vec<(u64, &'static str)>> = const { RefCell::new(Vec::new()) };
    }

    pub(super) fn note(bytes: u64, what: &'static str) {
        ASKED.with_borrow_mut(|asked| asked.push((bytes, what)));
    }

    /// The result of some work, and the bytes that it checks under a name on this thread.
    pub(crate) fn asked<T>(name: &str, work: impl FnOnce() -> T) -> (T, u64) {
        ASKED.take();
        let result = work();
        let asked = ASKED.take();
        (result, asked.iter().filter(|(_, what)| *what == name).map(|(bytes, _)| bytes).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_machine_and_every_group_count() {
        assert_eq!(machine("MemFree: 1 kB\nMemTotal:       2048 kB\n"), Some(2 << 20));
        assert_eq!(machine(""), None);
        let read = |path: &Path| match path.to_str()? {
            "/sys/fs/cgroup/a/b/memory.max" => Some("max\n".to_owned()),
            "/sys/fs/cgroup/a/memory.max" => Some("3000\n".to_owned()),
            "/sys/fs/cgroup/memory/c/memory.limit_in_bytes" => Some("9223372036854771712\n".to_owned()),
            "/sys/fs/cgroup/memory/memory.limit_in_bytes" => Some("2000\n".to_owned()),
            _ => None,
        };
        assert_eq!(group_limits("0::/a/b\n", read), Some(3000));
        assert_eq!(group_limits("4:cpu,memory:/c/d\n0::/a\n", read), Some(2000));
        assert_eq!(group_limits("4:cpu:/c\n", read), None);
        assert_eq!(
            group_limits("4:memory:/c\n", |path| path.ends_with("c/memory.limit_in_bytes").then(|| read(path))?),
            None
        );
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn what_is_held_counts() {
        let list = filled(1_u8, 32 << 20, "a list").unwrap();
        let [size, resident] = held();
        // Every page of the list was written to, and is in memory that this process may hold.
        assert!(list.len() as u64 <= resident && resident <= size, "{resident} of {size}");
        assert!(limit().is_some_and(|limit| resident < limit) && physical().is_some());
        assert!(ensure(1000, "little").is_ok() && ensure(u64::MAX, "much").is_err());
        assert!(ensure_with_dense_products(u64::MAX, "much").is_err());
    }

    /// In a process of its own, with two gibibytes of addresses beside the workspaces of all threads.
    #[test]
    #[cfg(target_os = "linux")]
    fn an_address_space_may_be_limited() {
        const TEST: &str = "memory::tests::an_address_space_may_be_limited";
        const ALONE: &str = "SPRUNG_TEST_ALONE";
        let limit = (2 << 30) + (rayon::current_num_threads() as u64 + 1) * workspace_bytes();
        if std::env::var_os(ALONE).is_some() {
            assert_eq!(address_space(), Some(limit));
            assert!(ensure_with_dense_products(room() - RESERVE - (1 << 20), "nearly all").is_err());
            assert!(ensure_with_dense_products(1 << 20, "little").is_ok());
            return;
        }
        let command = format!("ulimit -v {} && exec \"$0\" --exact {TEST}", limit / 1024);
        let program = std::env::current_exe().unwrap();
        let output =
            std::process::Command::new("sh").args(["-c", &command]).arg(program).env(ALONE, "").output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    }

    #[test]
    fn what_fits_is_filled_and_what_does_not_is_an_error() {
        assert_eq!(filled(1.5, 3, "a list").unwrap(), [1.5; 3]);
        for length in [usize::MAX, usize::MAX / 16, 1 << 55] {
            let error = filled(0.0, length, "a list").unwrap_err();
            assert!(matches!(error, Error::TooLarge { what: "a list", .. }), "{error}");
            assert!(error.to_string().starts_with("a list takes "), "{error}");
        }
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
        let read = ["32768K", "32M", "1G", "512", "", "K", "many"].map(size);
        assert_eq!(read, [32 << 20, 32 << 20, 1 << 30, 512, 0, 0, 0]);
        let taken = [[1 << 20, 12 << 20], [3 << 20, 10 << 20], [1 << 20, 1 << 20], [0, 0]].map(twice_the_last_level);
        assert_eq!(taken, [24 << 20, 24 << 20, 8 << 20, 8 << 20]);
    }

    #[test]
    fn threads_outside_the_pool_take_their_own() {
        let alone = |work: fn()| std::thread::spawn(work).join().unwrap();
        alone(|| assert!(take_workspaces() && missing_workspaces() == 0));
        alone(|| {
            assert_eq!(missing_workspaces(), workspace_bytes());
            assert!(take_workspaces() && missing_workspaces() == 0);
        });
    }

    /// Other tests take memory meanwhile, but not during every one of several attempts.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_product_takes_what_was_asked_for_and_only_once() {
        let look = || {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            pool.install(|| {
                assert_eq!(missing_workspaces(), workspace_bytes());
                let before = held()[0];
                assert!(take_workspaces());
                let taken = held()[0].saturating_sub(before);
                assert_eq!(missing_workspaces(), 0);
                taken
            })
        };
        let looks: Vec<u64> = (0..20).map(|_| look()).collect();
        let bytes = workspace_bytes();
        assert!(looks.iter().any(|&taken| taken <= bytes + (1 << 20)), "{looks:?} of {bytes}");
    }
}

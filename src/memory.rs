//! How much memory there is, limits included, and whether something fits.
//!
//! An allocation that fails ends the process, and one that succeeds beyond what a container may have ends it later, without a
//! word. So what grows with a scene is held to the room there is before it is allocated. The room is what the machine has, or the
//! control groups of the process allow, or the limit on its address space (`ulimit -v`), less what the process holds. What other
//! processes hold is not looked at: the same run on the same machine shall do the same. Where the system says nothing (it is asked
//! through `/proc`) there is no limit.

mod workspace;

use crate::error::{Error, Result};
use std::fs::read_to_string;
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

/// Makes sure that there is room for so many bytes, and a little for everything that is small. The system is asked once for every
/// mebibyte: the first of a process is taken to be there.
///
/// # Errors
/// [`Error::TooLarge`] with the bytes needed and the room there is.
///
/// # Examples
/// ```
/// use sprung::memory::ensure;
///
/// assert!(ensure(1000, "a kilobyte").is_ok());
/// assert!(ensure(u64::MAX, "more than there is").is_err());
/// ```
pub fn ensure(bytes: u64, what: &'static str) -> Result<()> {
    #[cfg(test)]
    watch::note(bytes, what);
    // The question costs the reading of a file, which takes longer than many a run of a small scene. What is small adds up, though:
    // it counts until the next question.
    let unasked = UNASKED.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
    if unasked <= SMALL {
        return Ok(());
    }
    UNASKED.store(0, Ordering::Relaxed);
    let room = room().saturating_sub(SMALL_THINGS);
    if bytes <= room { Ok(()) } else { Err(Error::TooLarge { what, bytes, room }) }
}

/// As [`ensure`], for something that products of dense blocks are made with: the threads of the pool have their workspace
/// when this returns.
///
/// # Errors
/// [`Error::TooLarge`].
pub(crate) fn ensure_with_dense_products(bytes: u64, what: &'static str) -> Result<()> {
    ensure(bytes, what)?;
    let Some(limit) = address_space() else { return Ok(()) };
    let room = || limit.saturating_sub(held()[0]).saturating_sub(SMALL_THINGS);
    let bytes = bytes.saturating_add(workspace::missing());
    let fits = bytes <= room() && workspace::take();
    if fits { Ok(()) } else { Err(Error::TooLarge { what, bytes, room: room() }) }
}

/// A list of zeros, or of whatever `value` is, if there is room for it.
///
/// # Errors
/// [`Error::TooLarge`].
pub(crate) fn filled<T: Clone>(value: T, length: usize, what: &'static str) -> Result<Vec<T>> {
    let bytes = (length as u64).saturating_mul(size_of::<T>() as u64);
    ensure(bytes, what)?;
    let mut list = Vec::new();
    list.try_reserve_exact(length).map_err(|_| Error::TooLarge { what, bytes, room: room() })?;
    list.resize(length, value);
    Ok(list)
}

/// What nobody asks for: messages, buffers of files, lists of a few numbers, and what an allocator rounds up.
const SMALL_THINGS: u64 = 8_388_608;

/// Bytes that are not worth a question.
const SMALL: u64 = 1_048_576;

/// Bytes that were granted since the last question.
static UNASKED: AtomicU64 = AtomicU64::new(0);

/// The memory of the machine, or of the control groups.
fn physical() -> Option<u64> {
    // Read once: it stays what it is while a process runs.
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

/// The lowest limit of the control groups in which `/proc/self/cgroup` puts the process, and of those above them; of both versions.
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
        // Inside a container the group's own path may not be there: its root is then what the process sees.
        for group in Path::new(group).ancestors() {
            let folder = Path::new(root).join(group.strip_prefix("/").unwrap_or(group));
            let limit = read(&folder.join(name)).and_then(|text| text.trim().parse::<u64>().ok());
            lowest = [lowest, limit].into_iter().flatten().min();
        }
    }
    // Without a limit version 1 says a number near 2⁶³.
    lowest.filter(|&limit| limit < 1 << 60)
}

/// The limit on the address space.
fn address_space() -> Option<u64> {
    static ADDRESS_SPACE: OnceLock<Option<u64>> = OnceLock::new();
    *ADDRESS_SPACE.get_or_init(|| {
        let limits = read_to_string("/proc/self/limits").unwrap_or_default();
        let line = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
        line.split_whitespace().next()?.parse().ok()
    })
}

/// Bytes of address space and of memory held.
fn held() -> [u64; 2] {
    let status = read_to_string("/proc/self/status").unwrap_or_default();
    ["VmSize:", "VmRSS:"].map(|key| {
        let value = status.lines().find_map(|line| line.strip_prefix(key)?.split_whitespace().next());
        value.and_then(|text| text.parse::<u64>().ok()).unwrap_or(0) * 1024
    })
}

/// What is asked for, for tests that hold it to what is then held.
#[cfg(test)]
pub(crate) mod watch {
    use std::cell::RefCell;

    thread_local! {
        static ASKED: RefCell<Vec<(u64, &'static str)>> = const { RefCell::new(Vec::new()) };
    }

    pub(super) fn note(bytes: u64, what: &'static str) {
        ASKED.with_borrow_mut(|asked| asked.push((bytes, what)));
    }

    /// What some work returns, and the bytes that it asks for under a name on this thread.
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

    /// In a process of its own, with two gibibytes of addresses beside the workspaces of all threads, which a large cache makes large: they are the limit, and
    /// where nearly all of them are asked for there is no room for the workspaces.
    #[test]
    #[cfg(target_os = "linux")]
    fn an_address_space_may_be_limited() {
        const TEST: &str = "memory::tests::an_address_space_may_be_limited";
        const ALONE: &str = "SPRUNG_TEST_ALONE";
        let limit = (2 << 30) + (rayon::current_num_threads() as u64 + 1) * workspace::bytes();
        if std::env::var_os(ALONE).is_some() {
            assert_eq!(address_space(), Some(limit));
            assert!(ensure_with_dense_products(room() - SMALL_THINGS - (1 << 20), "nearly all").is_err());
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
}

//! How much memory there is to take.

/// Bytes that new data may take without pushing other data out, where the system tells (Linux does).
pub(super) fn available() -> Option<usize> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let kibibytes: usize =
        text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?.split_whitespace().next()?.parse().ok()?;
    Some(kibibytes.saturating_mul(1024))
}

/// Whether so many bytes fit the memory with as much left over; `true` where nothing is known.
pub(super) fn fits(bytes: usize) -> bool {
    available().is_none_or(|available| bytes <= available / 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_larger_than_any_memory_does_not_fit() {
        assert!(fits(1 << 10));
        assert_eq!(fits(usize::MAX), available().is_none());
    }
}

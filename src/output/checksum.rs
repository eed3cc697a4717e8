//! A checksum of what is written, to tell a file that is whole from one that is not.

use std::io::{self, Write};

/// FNV-1a of 64 bits: enough against accidents, which is all that it is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Checksum(u64);

impl Default for Checksum {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Checksum {
    /// Of some bytes.
    pub fn of(bytes: &[u8]) -> Self {
        let mut checksum = Self::default();
        checksum.add(bytes);
        checksum
    }

    /// Takes in more bytes.
    pub fn add(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    /// As sixteen hexadecimal digits.
    pub fn text(self) -> String {
        format!("{:016x}", self.0)
    }
}

/// A writer that counts and sums up what goes through it.
#[derive(Debug)]
pub struct Tally<W> {
    inner: W,
    bytes: u64,
    checksum: Checksum,
}

impl<W> Tally<W> {
    /// Behind what has been written already: so many bytes with this checksum.
    pub fn after(inner: W, bytes: u64, checksum: Checksum) -> Self {
        Self { inner, bytes, checksum }
    }

    /// Nothing written yet.
    pub fn new(inner: W) -> Self {
        Self::after(inner, 0, Checksum::default())
    }

    /// Bytes so far, and their checksum.
    pub fn so_far(&self) -> (u64, Checksum) {
        (self.bytes, self.checksum)
    }

    /// The writer.
    pub fn into_inner(self) -> W {
        self.inner
    }
}

impl<W: Write> Write for Tally<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(bytes)?;
        self.bytes += written as u64;
        self.checksum.add(bytes.get(..written).unwrap_or(bytes));
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::{Checksum, Tally};
    use std::io::Write;

    /// The published values of FNV-1a.
    #[test]
    fn checksums_are_the_published_ones() {
        for (text, sum) in [("", "cbf29ce484222325"), ("a", "af63dc4c8601ec8c"), ("foobar", "85944171f73967e8")] {
            assert_eq!(Checksum::of(text.as_bytes()).text(), sum);
        }
    }

    #[test]
    fn tallies_go_on_where_others_ended() {
        let mut whole = Tally::new(Vec::new());
        whole.write_all(b"foobar").unwrap();
        let mut second = Tally::after(Vec::new(), 3, Checksum::of(b"foo"));
        second.write_all(b"bar").unwrap();
        assert_eq!(whole.so_far(), second.so_far());
        assert_eq!((whole.into_inner(), second.into_inner()), (b"foobar".to_vec(), b"bar".to_vec()));
    }
}

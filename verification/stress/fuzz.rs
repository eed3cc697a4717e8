//! The bodies of the fuzz targets on random bytes and mutated corpora, without coverage: for machines without `cargo fuzz`, and for
//! counting.

use crate::bodies;
use std::panic::catch_unwind;
use std::path::Path;
use std::time::Instant;

/// Runs a target so often; returns whether nothing fell.
pub fn search(target: &str, count: u64, seed: u64) -> bool {
    let Some(body) = bodies::body(target) else {
        eprintln!("no such target: {target}");
        return false;
    };
    let corpus = corpus(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(target));
    let mut random = Random(seed ^ 0x9e37_79b9_7f4a_7c15);
    let (mut fell, start) = (0u64, Instant::now());
    for index in 0..count {
        let input = random.input(&corpus);
        if catch_unwind(|| body(&input)).is_err() {
            fell += 1;
            let file = std::env::temp_dir().join(format!("sprung-{target}-{seed}-{index}"));
            let _ = std::fs::write(&file, &input);
            println!("fell: {}", file.display());
            if fell >= 20 {
                break;
            }
        }
    }
    println!("{target}: {count} executions in {:.0} s, {fell} fell", start.elapsed().as_secs_f64());
    fell == 0
}

fn corpus(folder: &Path) -> Vec<Vec<u8>> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<_> = entries.map(|entry| entry.path()).collect();
    files.sort();
    files.iter().filter_map(|file| std::fs::read(file).ok()).collect()
}

/// Texts that matter to some format, to be put in anywhere.
const WORDS: [&[u8]; 20] = [
    b"1e999",
    b"-1",
    b"0",
    b"nan",
    b"inf",
    b"1e-320",
    b"[]",
    b"{}",
    b"[[",
    b"]]",
    b"\n",
    b"\"",
    b"4294967295",
    b"null",
    b"1.7976931348623157e308",
    b"v 0 0 0\n",
    b"f 1 2 3\n",
    b"=",
    b",",
    b"\xff\xfe",
];

struct Random(u64);

impl Random {
    fn next(&mut self) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize
    }

    fn below(&mut self, end: usize) -> usize {
        self.next() % end.max(1)
    }

    /// Random bytes, or something of the corpus with a few changes.
    fn input(&mut self, corpus: &[Vec<u8>]) -> Vec<u8> {
        if corpus.is_empty() || self.below(4) == 0 {
            let length = self.below(300);
            return (0..length).map(|_| self.next() as u8).collect();
        }
        let mut bytes = corpus[self.below(corpus.len())].clone();
        for _ in 0..self.below(6) {
            let at = self.below(bytes.len() + 1);
            match self.below(6) {
                0 if at < bytes.len() => bytes[at] ^= 1 << self.below(8),
                1 if at < bytes.len() => bytes[at] = self.next() as u8,
                2 => {
                    let end = bytes.len().min(at + self.below(20));
                    bytes.drain(at..end);
                }
                3 => {
                    let end = bytes.len().min(at + self.below(40));
                    let piece = bytes[at..end].to_vec();
                    let to = self.below(bytes.len() + 1);
                    bytes.splice(to..to, piece);
                }
                4 => {
                    let other = &corpus[self.below(corpus.len())];
                    let from = self.below(other.len());
                    let end = other.len().min(from + self.below(60));
                    bytes.splice(at..at, other[from..end].to_vec());
                }
                _ => {
                    let word = WORDS[self.below(WORDS.len())];
                    let end = bytes.len().min(at + self.below(6));
                    bytes.splice(at..end, word.iter().copied());
                }
            }
        }
        bytes
    }
}

//! Split scenes, of which every rank reads its own part: a folder with `scene.json`, `particles.bin`, `springs.bin`, `leads.bin`.
//!
//! | file | contents |
//! |---|---|
//! | `scene.json` | format, name, dimension, gravity, counts, times, the motions of constraints |
//! | `particles.bin` | seven numbers for each particle: x (m), v (m/s), m (kg); prescribed coordinates at the start of their motion |
//! | `springs.bin` | five for each spring: i, j, k (N), l0 (m), b (N·s/m) |
//! | `leads.bin` | three for each prescribed coordinate, by particle and axis: particle, axis, index of its motion |
//!
//! All numbers are little-endian doubles; integers are exact. The files do not depend on the number of ranks.

use crate::agreed::{agreed, one_of_all};
use crate::slab::{self, Header, LEAD, PARTICLE, SPRING, Slab};
use crate::{Stop, or_end, ranks};
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

const FORMAT: &str = "sprung-mpi scene 1";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Content {
    format: String,
    leads: u64,
    scene: Header,
}

/// Writes the scene that lies on the ranks, every rank its share.
///
/// # Errors
/// Why not, on all ranks, before anything is written. One while numbers are written ends all ranks.
pub fn write(folder: &Path, header: Header, slab: &Slab) -> Result<(), Stop> {
    agreed(|| {
        std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        // Without this file the folder is no scene; it comes last.
        match std::fs::remove_file(folder.join("scene.json")) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(format!("{}: {error}", folder.display())),
            _ => Ok(true),
        }
    })?;
    let leads = ranks::all((slab.leads.len() / LEAD) as u64);
    write_numbers(&folder.join("particles.bin"), &slab.particles);
    write_numbers(&folder.join("springs.bin"), &slab.springs);
    write_numbers(&folder.join("leads.bin"), &slab.leads);
    if ranks::rank() == 0 {
        let content = Content { format: FORMAT.into(), leads: leads.iter().sum(), scene: header };
        let text = or_end(serde_json::to_string_pretty(&content));
        or_end(crate::results::write_text(&folder.join("scene.json"), &(text + "\n")));
    }
    Ok(())
}

/// Every rank's numbers one behind the other. An error ends all ranks.
fn write_numbers(path: &Path, numbers: &[f64]) {
    if ranks::rank() == 0 {
        or_end(File::create(path).map_err(|error| format!("{}: {error}", path.display())));
    }
    let counts = ranks::all(numbers.len() as u64);
    let before: u64 = counts[..ranks::rank()].iter().sum();
    let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    let written = OpenOptions::new().write(true).open(path).and_then(|file| {
        file.write_all_at(&bytes, 8 * before)?;
        file.sync_all()
    });
    or_end(written.map_err(|error| format!("{}: {error}", path.display())));
    // All of it is there before anything says so.
    ranks::total(0);
}

/// This rank's share of a scene in files.
///
/// # Errors
/// What is wrong with it, on all ranks.
pub fn read(folder: &Path, most: u64) -> Result<(Header, Slab), Stop> {
    let file = folder.join("scene.json");
    let mut text = String::new();
    agreed(|| {
        text = std::fs::read_to_string(&file).map_err(|error| format!("{}: {error}", file.display()))?;
        Ok(true)
    })?;
    let wrong = |what: String| Stop::Unusable(format!("{}: {what}", file.display()));
    let content: Content = serde_json::from_str(&ranks::share_text(&text)).map_err(|error| wrong(error.to_string()))?;
    if content.format != FORMAT {
        return Err(wrong(format!("format = {:?}: must be {FORMAT:?}", content.format)));
    }
    let header = content.scene;
    slab::check_rows(header.particles, header.dimension, most).map_err(&wrong)?;
    let particles = range(folder, "particles.bin", header.particles, PARTICLE)?;
    let springs = range(folder, "springs.bin", header.springs, SPRING)?;
    let leads = range(folder, "leads.bin", content.leads, LEAD)?;
    check(folder, &header, [&particles, &springs, &leads])?;
    // Prescribed coordinates go to those who have their particles.
    let ranges = ranks::ranges(header.particles);
    let mut parcels = vec![Vec::new(); ranks::ranks()];
    for lead in leads.chunks_exact(LEAD) {
        parcels[ranks::owner(&ranges, lead[0] as u64)].extend_from_slice(lead);
    }
    let leads = ranks::exchange(&parcels).concat();
    Ok((header, Slab { particles, springs, leads }))
}

/// This rank's records of a file.
fn range(folder: &Path, name: &str, records: u64, size: usize) -> Result<Vec<f64>, Stop> {
    let path = folder.join(name);
    let ranges = ranks::ranges(records);
    let (first, end) = (ranges[ranks::rank()], ranges[ranks::rank() + 1]);
    let record = 8 * size as u64;
    let mut bytes = vec![0; (record * (end - first)) as usize];
    let read = File::open(&path).and_then(|file| {
        if file.metadata()?.len() != record * records {
            return Err(io::Error::new(io::ErrorKind::InvalidData, format!("must have {} bytes", record * records)));
        }
        file.read_exact_at(&mut bytes, record * first)
    });
    one_of_all(read.err().map(|error| format!("{}: {error}", path.display())))?;
    Ok(bytes.chunks_exact(8).map(|bytes| f64::from_le_bytes(bytes.try_into().unwrap_or_default())).collect())
}

/// The values that a scene may have; the rest is checked where a part is built.
fn check(folder: &Path, header: &Header, [particles, springs, leads]: [&[f64]; 3]) -> Result<(), Stop> {
    let is_number = |value: f64, below: u64| value.fract() == 0.0 && (0.0..below as f64).contains(&value);
    let particle = |value: f64| is_number(value, header.particles);
    let mine = ranks::rank();
    let first = |records: u64| ranks::ranges(records)[mine];
    let mut wrong = None;
    for (at, record) in particles.chunks_exact(PARTICLE).enumerate() {
        if record.iter().any(|value| !value.is_finite()) || record[6] <= 0.0 {
            wrong = wrong.or(Some(("particles.bin", first(header.particles) + at as u64, record.to_vec())));
        }
    }
    for (at, record) in springs.chunks_exact(SPRING).enumerate() {
        let ends = particle(record[0]) && particle(record[1]) && record[0] != record[1];
        let is_positive = |value: f64| value.is_finite() && value > 0.0;
        let damping = record[4].is_finite() && record[4] >= 0.0;
        if !(ends && is_positive(record[2]) && is_positive(record[3]) && damping) {
            wrong = wrong.or(Some(("springs.bin", first(header.springs) + at as u64, record.to_vec())));
        }
    }
    for (at, record) in leads.chunks_exact(LEAD).enumerate() {
        let lead = particle(record[0]) && is_number(record[1], 3) && is_number(record[2], header.motions.len() as u64);
        if !lead {
            wrong = wrong.or(Some(("leads.bin", at as u64, record.to_vec())));
        }
    }
    let message = wrong.map(|(name, at, record)| {
        format!("{}: record {at} = {record:?}: is not what a scene can have", folder.join(name).display())
    });
    one_of_all(message)
}

//! Files of a run: the same as those of `sprung run`, and frames in pieces.
//!
//! No rank ever has all particles: what is written by number passes rank 0 range by range.

use crate::part::{Halo, Part};
use crate::{or_end, ranks};
use sprung::nalgebra::Vector3;
use sprung::output::{AtomicFile, write_frame};
use sprung::{State, System, SystemBuilder};
use std::io::{self, Write};
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

/// Vectors of own particles, as every rank has them by the numbers of [`ranks::ranges`].
pub fn by_number(halo: &Halo, total: u64, vectors: &[Vector3<f64>]) -> Vec<[f64; 3]> {
    let ranges = ranks::ranges(total);
    let mut parcels = vec![Vec::new(); ranks::ranks()];
    for (&number, v) in halo.particles.iter().zip(vectors).take(halo.own) {
        parcels[ranks::owner(&ranges, number)].extend([number as f64, v.x, v.y, v.z]);
    }
    let (first, end) = (ranges[ranks::rank()], ranges[ranks::rank() + 1]);
    let mut found = vec![[0.0; 3]; (end - first) as usize];
    for list in ranks::exchange(&parcels) {
        for record in list.chunks_exact(4) {
            found[(record[0] as u64 - first) as usize] = [record[1], record[2], record[3]];
        }
    }
    found
}

/// The reverse: vectors that lie on the ranks by number, for own particles and ghosts.
pub fn by_part(halo: &Halo, total: u64, vectors: &[[f64; 3]]) -> Vec<Vector3<f64>> {
    let ranges = ranks::ranges(total);
    let mut questions = vec![Vec::new(); ranks::ranks()];
    let mut places = vec![Vec::new(); ranks::ranks()];
    for (p, &number) in halo.particles.iter().enumerate() {
        let owner = ranks::owner(&ranges, number);
        questions[owner].push(number);
        places[owner].push(p);
    }
    let first = ranges[ranks::rank()];
    let answer = |asked: &Vec<u64>| asked.iter().flat_map(|&number| vectors[(number - first) as usize]).collect();
    let answers: Vec<Vec<f64>> = ranks::exchange(&questions).iter().map(answer).collect();
    let mut found = vec![Vector3::zeros(); halo.particles.len()];
    for (places, values) in places.iter().zip(ranks::exchange(&answers)) {
        for (&p, value) in places.iter().zip(values.chunks_exact(3)) {
            found[p] = Vector3::from_column_slice(value);
        }
    }
    found
}

/// Writes `final.json` as `sprung run` does. An error ends all ranks.
pub fn write_final_state(path: &Path, scene: &str, total: u64, steps: u64, part: &Part, state: &State) {
    let dimension = part.system.dimension();
    let pass = |mut file: Option<&mut AtomicFile>| -> io::Result<()> {
        if let Some(file) = &mut file {
            let (scene, time) = (serde_json::to_string(scene)?, serde_json::to_string(&state.time)?);
            write!(file, "{{\"scene\":{scene},\"time\":{time},\"steps\":{steps}")?;
        }
        for (name, vectors) in [("positions", &state.positions), ("velocities", &state.velocities)] {
            let mine = by_number(&part.halo, total, vectors);
            let mut separator = format!(",\"{name}\":[");
            for rank in 0..ranks::ranks() {
                let mut parcels = vec![Vec::new(); ranks::ranks()];
                if rank == ranks::rank() {
                    parcels[0] = mine.concat();
                }
                let received = ranks::exchange(&parcels).concat();
                let Some(file) = &mut file else { continue };
                for row in received.chunks_exact(3) {
                    file.write_all(separator.as_bytes())?;
                    serde_json::to_writer(&mut **file, &row[..dimension])?;
                    separator = ",".into();
                }
            }
            if let Some(file) = &mut file {
                // Of no particles the list is empty.
                file.write_all(if separator == "," { b"]" } else { separator.as_bytes() })?;
                if separator != "," {
                    file.write_all(b"]")?;
                }
            }
        }
        file.map_or(Ok(()), |file| file.write_all(b"}\n"))
    };
    if ranks::rank() == 0 {
        or_end(AtomicFile::write(path, |file| pass(Some(file))));
    } else {
        or_end(pass(None));
    }
}

/// Frames for ParaView: `frames/frame_000010.pvtp`, which joins a piece of every rank, and `frames.pvd`.
pub struct Frames {
    folder: PathBuf,
    every: NonZeroU64,
    /// The particles and springs of this rank's piece: each spring of the scene is in one of them.
    piece: System,
    pub series: Vec<(f64, u64)>,
}

impl Frames {
    /// Of the steps that `every` divides; goes on behind frames of an earlier part of the run.
    pub fn new(folder: &Path, every: NonZeroU64, part: &Part, series: Vec<(f64, u64)>) -> Self {
        let system = &part.system;
        let counted = (0..system.springs().len()).filter(|&spring| system.owns_spring(spring));
        let mut builder = SystemBuilder::new();
        // Where ends may coincide by now: positions play no part in a piece, and these never do.
        builder.positions = (0..system.particles()).map(|p| Vector3::new(p as f64, 0.0, 0.0)).collect();
        builder.velocities = vec![Vector3::zeros(); system.particles()];
        builder.masses = system.masses().to_vec();
        for spring in counted {
            builder.pairs.push(system.pairs()[spring]);
            builder.springs.push(system.springs()[spring]);
        }
        let (piece, _) = or_end(builder.build());
        Self { folder: folder.to_path_buf(), every, piece, series }
    }

    /// Writes the state after so many steps, if it is one that is wanted. An error ends all ranks.
    pub fn record(&mut self, state: &State, step: u64) {
        if !step.is_multiple_of(self.every.get()) {
            return;
        }
        let name = |rank: usize| format!("frames/frame_{step:06}_{rank:04}.vtp");
        or_end(write_frame(self.folder.join(name(ranks::rank())), &self.piece, state, &[]));
        self.series.push((state.time, step));
        // All pieces are there when the file that names them is.
        ranks::total(0);
        if ranks::rank() == 0 {
            let pieces: String = (0..ranks::ranks())
                .map(|rank| format!("  <Piece Source=\"{}\"/>\n", &name(rank)["frames/".len()..]))
                .collect();
            let array = |name: &str| format!("<PDataArray type=\"Float64\" Name=\"{name}\" NumberOfComponents=\"3\"/>");
            let text = format!(
                "<?xml version=\"1.0\"?>\n<VTKFile type=\"PPolyData\" version=\"1.0\" byte_order=\"LittleEndian\" \
                 header_type=\"UInt64\">\n <PPolyData GhostLevel=\"0\">\n  <PPointData Vectors=\"velocity\">{}</PPointData>\n  \
                 <PCellData Scalars=\"strain\"><PDataArray type=\"Float64\" Name=\"strain\" NumberOfComponents=\"1\"/></PCellData>\n  \
                 <PPoints>{}</PPoints>\n{pieces} </PPolyData>\n</VTKFile>\n",
                array("velocity"),
                array("position"),
            );
            or_end(write_text(&self.folder.join(format!("frames/frame_{step:06}.pvtp")), &text));
            or_end(self.write_list());
        }
    }

    fn write_list(&self) -> sprung::Result<()> {
        let entry = |&(time, step): &(f64, u64)| {
            format!("    <DataSet timestep=\"{time:?}\" part=\"0\" file=\"frames/frame_{step:06}.pvtp\"/>\n")
        };
        let entries: String = self.series.iter().map(entry).collect();
        let text = format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n  <Collection>\n{entries}  </Collection>\n\
             </VTKFile>\n"
        );
        write_text(&self.folder.join("frames.pvd"), &text)
    }
}

/// Removes the frames of an earlier run. What cannot be removed is found out when something is to take its place.
pub fn clear_frames(folder: &Path) {
    if ranks::rank() == 0 {
        remove_frames(folder);
    }
    // Nobody writes new ones before.
    ranks::total(0);
}

fn remove_frames(folder: &Path) {
    let _ = std::fs::remove_file(folder.join("frames.pvd"));
    for entry in std::fs::read_dir(folder.join("frames")).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let is_frame = |name: &str| name.starts_with("frame_") && (name.ends_with(".vtp") || name.ends_with(".pvtp"));
        if name.to_str().is_some_and(is_frame) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Writes a file whole or not at all.
///
/// # Errors
/// A file that cannot be written.
pub fn write_text(path: &Path, text: &str) -> sprung::Result<()> {
    AtomicFile::write(path, |file| file.write_all(text.as_bytes()))
}

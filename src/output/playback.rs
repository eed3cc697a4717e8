//! From an output folder to a motion that can be played.

use super::trajectory::{TRAJECTORY, array, list, wrong};
use crate::error::{Error, Result};
use crate::figure::{Animation, Binding, SceneTopology, Track};
use crate::report::number::{compact, typeset};
use nalgebra::Vector3;
use serde_json::Value;
use std::fs::File;
use std::io::{self, BufReader};
use std::path::Path;
use zip::ZipArchive;

/// The motion in a run's output folder: the frames of `trajectory.npz`, and where they exist the curves of `energy.csv` and the facts of
/// `summary.json`.
///
/// # Errors
/// [`Error::Io`] without a readable `trajectory.npz`, [`Error::Format`] for one that does not hold a motion.
pub fn playback(folder: &Path) -> Result<Animation> {
    let path = folder.join(TRAJECTORY);
    let file = File::open(&path).map_err(|source| Error::io(&path, source))?;
    let mut animation = read(folder, file).map_err(|error| Error::Format { file: path, message: error.to_string() })?;
    let summary = std::fs::read_to_string(folder.join("summary.json")).ok();
    let summary = summary.and_then(|text| serde_json::from_str::<Value>(&text).ok());
    describe(&mut animation, summary.as_ref());
    animation.tracks = energies(&folder.join("energy.csv")).unwrap_or_default();
    Ok(animation)
}

fn read(folder: &Path, file: File) -> io::Result<Animation> {
    let mut archive = ZipArchive::new(BufReader::new(file)).map_err(io::Error::from)?;
    let times: Vec<f64> = list(&mut archive, "times")?;
    let gravity: Vec<f64> = list(&mut archive, "gravity")?;
    let binding = |code: u8| match code {
        0 => Binding::Free,
        1 => Binding::Held,
        _ => Binding::Moved,
    };
    let topology = SceneTopology {
        dimension: gravity.len(),
        gravity: Vector3::from_fn(|axis, _| gravity.get(axis).copied().unwrap_or(0.0)),
        bindings: list(&mut archive, "bindings")?.into_iter().map(binding).collect(),
        pairs: rows(&list(&mut archive, "pairs")?),
        rest_lengths: list(&mut archive, "rest_lengths")?,
        stiffnesses: list(&mut archive, "stiffness")?,
        triangles: rows(&list(&mut archive, "triangles")?),
    };
    let n = topology.bindings.len();
    let mut particles = topology.pairs.iter().flatten().chain(topology.triangles.iter().flatten());
    if !(1..=3).contains(&topology.dimension) || !particles.all(|&p| (p as usize) < n) {
        return Err(wrong("its arrays do not fit together"));
    }
    if topology.rest_lengths.len() != topology.pairs.len() || topology.stiffnesses.len() != topology.pairs.len() {
        return Err(wrong("not every spring has a rest length and a stiffness"));
    }
    let axes = topology.dimension;
    let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut animation = Animation::new(name, topology);
    let positions = array(&mut archive, "positions")?;
    if *positions.shape() != [times.len() as u64, n as u64, axes as u64] {
        return Err(wrong("its positions do not fit to its times and masses"));
    }
    let mut values = positions.data::<f64>().map_err(|error| wrong(&error.to_string()))?;
    let mut frame = vec![Vector3::zeros(); n];
    for time in times {
        for value in frame.iter_mut().flat_map(|row| row.iter_mut().take(axes)) {
            *value = values.next().ok_or_else(|| wrong("it ends early"))??;
        }
        animation.push(time, &frame);
    }
    Ok(animation)
}

fn rows<const N: usize>(values: &[u32]) -> Vec<[u32; N]> {
    values.as_chunks().0.to_vec()
}

/// Adds the scene's name, the method and the outcome from a `summary.json`, and the interval of frames.
pub fn describe(animation: &mut Animation, summary: Option<&Value>) {
    let value = |key: &str| summary.and_then(|summary| summary.get(key));
    let text = |key: &str| value(key).and_then(Value::as_str).map(str::to_owned);
    if let Some(scene) = text("scene") {
        animation.title = scene;
    }
    let method = text("method").map(|method| match text("stiffness") {
        Some(stiffness) if stiffness != "none" => format!("{method}, stiffness {stiffness}"),
        _ => method,
    });
    // With adaptive steps dt is only the interval of records.
    let digits = |value: f64| typeset(&compact(value));
    let number = |key: &str| value(key).and_then(Value::as_f64).map(digits);
    let dt = match (number("rtol"), number("dt")) {
        (Some(rtol), _) => Some(format!("steps by rtol {rtol}")),
        (None, dt) => dt.map(|dt| format!("dt = {dt} s")),
    };
    let status = text("status").filter(|status| status != "completed").map(|status| {
        let message = value("failure").and_then(|failure| failure.get("message")).and_then(Value::as_str);
        format!("the run ended {status}{}", message.map(|message| format!(": {message}")).unwrap_or_default())
    });
    let apart = match animation.times[..] {
        [first, second, ..] => Some(format!("a frame every {} s", digits(second - first))),
        _ => None,
    };
    animation.remarks.extend([method, dt, status, apart].into_iter().flatten());
}

/// Columns of `energy.csv` that share a picture, in J: the energies, and their balance.
const ENERGIES: [&str; 4] = ["kinetic", "elastic", "gravitational", "total"];
const BALANCE: [&str; 3] = ["work", "dissipated", "imbalance"];

fn energies(path: &Path) -> Option<Vec<Track>> {
    let mut reader = csv::Reader::from_path(path).ok()?;
    let names: Vec<String> = reader.headers().ok()?.iter().map(str::to_owned).collect();
    let mut columns: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    for record in reader.records() {
        let record = record.ok()?;
        for (column, value) in columns.iter_mut().zip(record.iter()) {
            column.push(value.parse().unwrap_or(f64::NAN));
        }
    }
    let mut columns = names.into_iter().zip(columns);
    let (_, times) = columns.next().filter(|(name, _)| name == "time")?;
    Some(energy_tracks(&times, columns))
}

/// Curves of named columns over times in s: the energies together, their balance together, every other column by itself; none for a single time.
/// Gravitational and total energy are counted from the lowest gravitational energy of the motion: their zero is arbitrary.
pub fn energy_tracks(times: &[f64], columns: impl IntoIterator<Item = (String, Vec<f64>)>) -> Vec<Track> {
    if times.len() < 2 {
        return Vec::new();
    }
    let among = |names: &'static [&str]| move |(name, _): &(String, Vec<f64>)| names.contains(&name.as_str());
    let (mut energies, others): (Vec<_>, Vec<_>) = columns.into_iter().partition(among(&ENERGIES));
    let (balance, others): (Vec<_>, Vec<_>) = others.into_iter().partition(among(&BALANCE));
    let gravitational = energies.iter().filter(|(name, _)| name == "gravitational").flat_map(|(_, values)| values);
    let lowest = gravitational.copied().filter(|value| value.is_finite()).reduce(f64::min).unwrap_or(0.0);
    for (_, values) in energies.iter_mut().filter(|curve| among(&["gravitational", "total"])(curve)) {
        values.iter_mut().for_each(|value| *value -= lowest);
    }
    let title = if lowest == 0.0 { "energy" } else { "energy, gravitational from its lowest" };
    let track = |title: String, unit: &str, curves| Track { title, unit: unit.into(), times: times.to_vec(), curves };
    let mut tracks = vec![track(title.into(), "J", energies)];
    if !balance.is_empty() {
        tracks.push(track("balance of energy".into(), "J", balance));
    }
    tracks.extend(others.into_iter().map(|(name, values)| track(name.replace('_', " "), "", vec![(name, values)])));
    tracks
}

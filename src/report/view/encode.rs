//! An animation as its page carries it: a few facts in JSON, and one compressed block of bytes.
//!
//! Positions are whole multiples of one length h, the scene's largest extent over 65535: `x = origin + h q`, wrong by at most h/2. Strains would be
//! lost in that where springs are short: they are kept beside it, `s = s_max q|q|/n²` with n = 127 or 32767, wrong by at most `s_max (1/n + 1/(4n²))`.
//!
//! Every whole number is predicted as the last one (order 1) or along the line through the last two (order 2), and the remainder is kept modulo 2⁸ or
//! 2¹⁶, folded so that small ones of both signs are small numbers (0, −1, 1, −2, … become 0, 1, 2, 3, …). Low and high bytes are kept apart: of a
//! smooth motion the high ones are nearly all zero.

use crate::figure::{Animation, Binding, Track, Up};
use crate::report::list;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::DeflateEncoder;
use nalgebra::Vector3;
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write;

pub(super) struct Encoded {
    pub about: About,
    /// The bytes in base64.
    pub data: String,
}

#[derive(Serialize)]
pub(super) struct About {
    pub dimension: usize,
    /// True where all particles lie in a plane of constant z, always.
    pub depthless: bool,
    pub up: Up,
    pub particles: usize,
    pub springs: usize,
    pub frames: usize,
    /// Particles that are held or moved.
    pub marks: usize,
    /// True where a line stands for several springs.
    pub merged: bool,
    pub times: Vec<f64>,
    pub clock: [&'static str; 2],
    #[serde(skip_serializing_if = "Option::is_none")]
    pub amplitude: Option<Amplitude>,
    pub speed: f64,
    pub speeds: Vec<f64>,
    pub origin: [f64; 3],
    pub quantum: f64,
    bounds: Value,
    pub spacing: f64,
    pub strain: StrainScale,
    sections: BTreeMap<&'static str, [usize; 2]>,
    channels: Value,
    pub tracks: Vec<Value>,
}

/// The largest displacement of motions about a state, in m and as a part of the scene's extent.
#[derive(Serialize)]
pub(super) struct Amplitude {
    pub length: f64,
    pub part: f64,
}

#[derive(Serialize)]
pub(super) struct StrainScale {
    pub levels: i32,
    /// The largest size of a strain.
    pub largest: f64,
    /// The size from which on colours are the same.
    pub shown: f64,
}

impl StrainScale {
    pub fn error(&self) -> f64 {
        let level = 1.0 / f64::from(self.levels);
        self.largest * (level + level * level / 4.0)
    }
}

/// Encodes an animation in at most `limit` bytes, leaving out frames where it must.
pub(super) fn encode(animation: &Animation, limit: usize) -> Encoded {
    let mut every = animation.times.len().div_ceil(3000).max(1);
    loop {
        let encoded = with_frames(animation, every);
        if encoded.data.len() <= limit || encoded.about.frames <= 1 {
            return encoded;
        }
        let over = encoded.data.len() as f64 / limit.max(1) as f64;
        every = ((every as f64 * over * 1.02).ceil() as usize).max(every + 1);
    }
}

fn with_frames(animation: &Animation, every: usize) -> Encoded {
    let topology = animation.cast();
    let [particles, springs] = [topology.bindings.len(), topology.pairs.len()];
    let times: Vec<f64> = animation.times.iter().copied().step_by(every).collect();
    let frames = times.len();
    let positions = || animation.positions.chunks(particles.max(1)).step_by(every).flatten();
    let strains = || animation.strains.chunks(springs.max(1)).step_by(every).flatten();
    let (low, high) = extent(positions());
    let widest = (high - low).max();
    let quantum = if widest > 0.0 { widest / 65535.0 } else { 1.0 };
    let mut bytes = Vec::new();
    let mut sections = BTreeMap::new();
    let mut put = |name, data: &[u8]| {
        sections.insert(name, [bytes.len(), data.len()]);
        bytes.extend_from_slice(data);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    };
    put("pairs", &words(topology.pairs.iter().flatten().copied()));
    put("rest", &floats(&topology.rest_lengths));
    put("stiffness", &floats(&topology.stiffnesses));
    put("triangles", &words(topology.triangles.iter().flatten().copied()));
    put("kinds", &topology.bindings.iter().map(|&binding| binding as u8).collect::<Vec<_>>());
    if let Some(decimation) = animation.decimation() {
        put("particle_numbers", &words(decimation.founders.iter().copied()));
    }

    let places = [0, 1, 2].map(|axis| {
        let quanta: Vec<i32> = positions().map(|x| ((x[axis] - low[axis]) / quantum).round() as i32).collect();
        append(&mut bytes, &quanta, particles, true)
    });
    let scale = strain_scale(strains(), frames * springs <= 4_000_000);
    let levels = f64::from(scale.levels);
    let level = |&strain: &f32| {
        let part = f64::from(strain) / scale.largest;
        (levels * part.signum() * part.abs().sqrt()).round() as i32
    };
    let levels: Vec<i32> = strains().map(level).collect();
    let strain = append(&mut bytes, &levels, springs, scale.levels > 127);

    let speed = speed(&times);
    let about = About {
        dimension: topology.dimension,
        depthless: high.z - low.z <= 1e-6 * widest,
        up: Up::against(topology.gravity, topology.dimension),
        particles,
        springs,
        frames,
        marks: topology.bindings.iter().filter(|&&binding| binding != Binding::Free).count(),
        merged: animation.decimation().is_some(),
        speed,
        speeds: speeds(speed),
        times,
        clock: animation.clock,
        amplitude: None,
        origin: low.into(),
        quantum,
        bounds: json!({"low": low.as_slice(), "high": high.as_slice()}),
        spacing: spacing(&topology.pairs, animation.positions.get(..particles).unwrap_or_default(), widest),
        strain: scale,
        sections,
        channels: json!({"places": places, "strain": strain}),
        tracks: animation.all_tracks().iter().map(panel).collect(),
    };
    Encoded { about, data: compressed(&bytes) }
}

/// The corners of the box around all positions; of none, a point.
pub(super) fn extent<'a>(positions: impl Iterator<Item = &'a Vector3<f64>>) -> (Vector3<f64>, Vector3<f64>) {
    let boxes = positions.map(|x| (*x, *x));
    boxes.reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1))).unwrap_or_default()
}

/// The colours end where 39 of 40 strains lie below, at a round number.
fn strain_scale<'a>(strains: impl Iterator<Item = &'a f32>, fine: bool) -> StrainScale {
    let mut sizes: Vec<f32> = strains.map(|strain| strain.abs()).filter(|size| size.is_finite()).collect();
    let largest = sizes.iter().copied().fold(0.0, f32::max);
    let rank = sizes.len() * 39 / 40;
    let usual = if rank < sizes.len() { *sizes.select_nth_unstable_by(rank, f32::total_cmp).1 } else { largest };
    let largest = if largest > 0.0 { f64::from(largest) } else { 1e-6 };
    let shown = round_up(f64::from(usual).max(largest / 50.0).min(largest));
    StrainScale { levels: if fine { 32767 } else { 127 }, largest, shown }
}

/// The next larger of 1, 2 and 5 times a power of ten, for a positive value.
fn round_up(value: f64) -> f64 {
    let power = value.log10().floor() as i32;
    let rounds = [1, 2, 5].map(|digit| decimal(digit, power));
    rounds.into_iter().find(|&round| round >= 0.999 * value).unwrap_or(decimal(1, power + 1))
}

/// `digit · 10^power` as it is read from text, so that equal decimals are equal numbers.
fn decimal(digit: u32, power: i32) -> f64 {
    format!("{digit}e{power}").parse().unwrap_or(f64::INFINITY)
}

/// Seconds of motion in one second of playing: real time where that lasts between 2 and 30 s; else the next larger of 1, 2 and 5 times a power of ten with which it lasts about 8 s.
fn speed(times: &[f64]) -> f64 {
    let length = times.last().zip(times.first()).map_or(0.0, |(last, first)| last - first);
    if length <= 0.0 || (2.0..=30.0).contains(&length) { 1.0 } else { round_up(length / 8.0) }
}

/// Speeds to choose from: 1, 2 and 5 times powers of ten, from a thousandth of the one that the page begins with to ten times it and more.
fn speeds(first: f64) -> Vec<f64> {
    let power = first.log10().floor() as i32;
    (power - 3..=power + 1).flat_map(|power| [1, 2, 5].map(|k| decimal(k, power))).collect()
}

/// The median length of the springs in the first frame, of at most some thousands.
fn spacing(pairs: &[[u32; 2]], positions: &[Vector3<f64>], widest: f64) -> f64 {
    let length = |&[i, j]: &[u32; 2]| Some((positions.get(i as usize)? - positions.get(j as usize)?).norm());
    let mut lengths: Vec<f64> = pairs.iter().step_by(pairs.len() / 4096 + 1).filter_map(length).collect();
    let middle = lengths.len() / 2;
    if middle < lengths.len() { *lengths.select_nth_unstable_by(middle, f64::total_cmp).1 } else { widest / 10.0 }
}

fn words(values: impl Iterator<Item = u32>) -> Vec<u8> {
    values.flat_map(u32::to_le_bytes).collect()
}

fn floats(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|&value| (value as f32).to_le_bytes()).collect()
}

fn compressed(bytes: &[u8]) -> String {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::new(6));
    // Writing to memory does not fail.
    let packed = encoder.write_all(bytes).and_then(|()| encoder.finish());
    STANDARD.encode(packed.unwrap_or_default())
}

/// Curves over time, thinned evenly to 2000 points, more than a wide screen has pixels, and in six digits.
fn panel(track: &Track) -> Value {
    let every = track.times.len() / 2000 + 1;
    let thinned = |values: &[f64]| values.iter().copied().step_by(every).collect::<Vec<f64>>();
    let rounded = |value: f64| format!("{value:.5e}").parse().unwrap_or(value);
    let curves = list(&track.curves, |(name, values)| {
        let values: Vec<f64> = thinned(values).into_iter().map(rounded).collect();
        json!({"name": name, "values": values})
    });
    json!({"title": track.title, "unit": track.unit, "times": thinned(&track.times), "curves": curves})
}

/// The place of a channel among the bytes, and its prediction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
struct Channel {
    offset: usize,
    order: usize,
    wide: bool,
}

/// Appends the values of `count` items, frame after frame; `wide` ones have two bytes.
fn append(bytes: &mut Vec<u8>, values: &[i32], count: usize, wide: bool) -> Channel {
    let size = |order| remainders(values, count, order, wide).map(|rest| u64::from(16 - rest.leading_zeros())).sum();
    let order = [1, 2].into_iter().min_by_key(|&order| -> u64 { size(order) }).unwrap_or(1);
    let offset = bytes.len();
    bytes.extend(remainders(values, count, order, wide).map(|rest| rest as u8));
    if wide {
        bytes.extend(remainders(values, count, order, wide).map(|rest| (rest >> 8) as u8));
    }
    Channel { offset, order, wide }
}

fn remainders(values: &[i32], count: usize, order: usize, wide: bool) -> impl Iterator<Item = u16> + '_ {
    let before = move |i: usize, frames: usize| i.checked_sub(frames * count).and_then(|at| values.get(at)).copied();
    values.iter().enumerate().map(move |(i, &value)| {
        let guess = match (before(i, 1), before(i, 2)) {
            (Some(last), Some(earlier)) if order == 2 => 2 * last - earlier,
            (Some(last), _) => last,
            (None, _) => 0,
        };
        let rest = value - guess;
        if wide {
            let rest = rest as i16;
            ((rest << 1) ^ (rest >> 15)) as u16
        } else {
            let rest = rest as i8;
            u16::from(((rest << 1) ^ (rest >> 7)) as u8)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::append;

    /// As the page does it.
    fn restore(bytes: &[u8], channel: super::Channel, frames: usize, count: usize) -> Vec<i32> {
        let plane = frames * count;
        let mut values = vec![0i32; plane];
        for i in 0..plane {
            let low = i32::from(bytes[channel.offset + i]);
            let high = if channel.wide { i32::from(bytes[channel.offset + plane + i]) } else { 0 };
            let folded = low | high << 8;
            let rest = folded >> 1 ^ -(folded & 1);
            let guess = match i / count {
                0 => 0,
                frame if frame == 1 || channel.order == 1 => values[i - count],
                _ => 2 * values[i - count] - values[i - 2 * count],
            };
            values[i] = if channel.wide { i32::from((guess + rest) as u16) } else { i32::from((guess + rest) as i8) };
        }
        values
    }

    #[test]
    fn values_come_back_whatever_they_are() {
        let [frames, count] = [7, 5];
        let wide: Vec<i32> = (0..35).map(|i: i32| i * i * 7919 % 65536).collect();
        let narrow: Vec<i32> = (0..35).map(|i: i32| i * i * 31 % 255 - 127).collect();
        let edges: Vec<i32> = (0..35).map(|i| if i % 3 == 0 { 0 } else { 65535 }).collect();
        let mut bytes = vec![1, 2, 3];
        for (values, is_wide) in [(&wide, true), (&narrow, false), (&edges, true)] {
            let channel = append(&mut bytes, values, count, is_wide);
            assert_eq!(&restore(&bytes, channel, frames, count), values);
        }
    }

    /// Uniform motion costs nothing after its second frame.
    #[test]
    fn straight_motion_leaves_no_remainder() {
        let values: Vec<i32> = (0..10).flat_map(|frame| [100 + 300 * frame, 60_000 - 700 * frame]).collect();
        let mut bytes = Vec::new();
        assert_eq!(append(&mut bytes, &values, 2, true).order, 2);
        assert!(bytes[4..20].iter().chain(&bytes[24..]).all(|&byte| byte == 0), "{bytes:?}");
    }
}

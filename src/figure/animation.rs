//! A motion to be played: what stays the same, and the frames.

use super::SceneTopology;
use super::decimation::Decimation;
use crate::system::State;
use nalgebra::Vector3;

/// Curves over time that belong to a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// The title.
    pub title: String,
    /// Their unit, empty for plain numbers.
    pub unit: String,
    /// In s, ascending.
    pub times: Vec<f64>,
    /// Name and values, one for each time.
    pub curves: Vec<(String, Vec<f64>)>,
}

/// A motion. Where a scene is large, the particles that are shown stand for their neighbourhoods, see [`Decimation`].
#[derive(Debug, Clone)]
pub struct Animation {
    /// The scene's name.
    pub title: String,
    /// Further remarks: the method, how the run ended.
    pub remarks: Vec<String>,
    /// Everything that moves, as it was before decimation.
    whole: SceneTopology,
    decimation: Option<Decimation>,
    /// Time of every frame, in s; or another ascending number by which frames are found.
    pub times: Vec<f64>,
    /// The symbol and the unit of `times`: `t` and `s`.
    pub clock: [&'static str; 2],
    /// Positions of the shown particles, frame after frame, in m.
    pub positions: Vec<Vector3<f64>>,
    /// Strains of the shown springs, frame after frame.
    pub strains: Vec<f32>,
    /// The largest and the smallest strain of all springs in every frame.
    extremes: Vec<[f64; 2]>,
    /// Springs shorter than at rest, in every frame.
    compressed: Vec<f64>,
    /// Curves over time.
    pub tracks: Vec<Track>,
}

impl Animation {
    /// An animation without frames yet.
    pub fn new(title: impl Into<String>, topology: SceneTopology) -> Self {
        // More particles and springs do not play smoothly where no graphics hardware helps.
        Self::with_limits(title, topology, 20_000, 160_000)
    }

    /// As [`new`](Self::new), showing no more than so many particles and springs.
    pub fn with_limits(title: impl Into<String>, topology: SceneTopology, particles: usize, springs: usize) -> Self {
        Self {
            title: title.into(),
            remarks: Vec::new(),
            decimation: Decimation::of(&topology, particles, springs),
            whole: topology,
            times: Vec::new(),
            clock: ["t", "s"],
            positions: Vec::new(),
            strains: Vec::new(),
            extremes: Vec::new(),
            compressed: Vec::new(),
            tracks: Vec::new(),
        }
    }

    /// A scene at one state.
    pub fn still(title: impl Into<String>, topology: SceneTopology, state: &State) -> Self {
        let mut animation = Self::new(title, topology);
        animation.push(state.time, &state.positions);
        animation
    }

    /// Adds a frame: the time, in s, and the positions of all particles, in m.
    pub fn push(&mut self, time: f64, positions: &[Vector3<f64>]) {
        self.times.push(time);
        let strains: Vec<f64> = self.whole.strains(positions).collect();
        let most = strains.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let least = strains.iter().copied().fold(f64::INFINITY, f64::min);
        self.extremes.push([most, least]);
        self.compressed.push(strains.iter().filter(|&&strain| strain < 0.0).count() as f64);
        match &self.decimation {
            Some(decimation) => {
                self.positions.extend(decimation.positions(positions));
                self.strains.extend(decimation.mean_of_springs(&strains));
            }
            None => {
                self.positions.extend(positions);
                self.strains.extend(strains.iter().map(|&strain| strain as f32));
            }
        }
    }

    /// The shown part of the scene.
    pub fn cast(&self) -> &SceneTopology {
        self.decimation.as_ref().map_or(&self.whole, |decimation| &decimation.topology)
    }

    /// Particles and springs of the scene, whether shown or not.
    pub fn whole(&self) -> [usize; 2] {
        [self.whole.bindings.len(), self.whole.pairs.len()]
    }

    /// The smallest and the largest strain of all springs in all frames; `None` without springs.
    pub fn strain_range(&self) -> Option<[f64; 2]> {
        let least = self.extremes.iter().map(|ends| ends[1]).fold(f64::INFINITY, f64::min);
        let most = self.extremes.iter().map(|ends| ends[0]).fold(f64::NEG_INFINITY, f64::max);
        (least <= most).then_some([least, most])
    }

    /// The largest distance of a shown particle from its place in the first frame, in m.
    pub fn farthest(&self) -> f64 {
        let n = self.cast().bindings.len().max(1);
        let start = self.positions.get(..n).unwrap_or_default();
        let frames = self.positions.chunks(n);
        let distances = frames.flat_map(|frame| frame.iter().zip(start).map(|(x, x0)| (x - x0).norm()));
        distances.filter(|distance| distance.is_finite()).fold(0.0, f64::max)
    }

    /// The decimation of the scene, if it was too large.
    pub fn decimation(&self) -> Option<&Decimation> {
        self.decimation.as_ref()
    }

    /// All curves: those added, and the range of strains over the frames where there is more than one.
    pub fn all_tracks(&self) -> Vec<Track> {
        let mut all = self.tracks.clone();
        if self.times.len() > 1 && !self.whole.pairs.is_empty() {
            let percent = |end: usize| self.extremes.iter().map(|ends| 100.0 * ends[end]).collect();
            let track = |title: &str, unit: &str, curves| {
                let times = self.times.clone();
                Track { title: title.into(), unit: unit.into(), times, curves }
            };
            let strains = vec![("most stretched".into(), percent(0)), ("most compressed".into(), percent(1))];
            all.push(track("strain of all springs", "%", strains));
            all.push(track("compressed springs", "", vec![("compressed".into(), self.compressed.clone())]));
        }
        all
    }
}

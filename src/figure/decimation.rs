//! Showing a scene of a million particles by twenty thousand.
//!
//! Greedy aggregation: the first particle without a group founds one and takes free neighbours up to the group's size; then the groups are the
//! particles of a smaller scene, and so on. The founder stands for its group. All springs between two groups become one line, whose strain is
//! their mean; springs within a group are not shown.

use super::{Binding, SceneTopology};
use nalgebra::Vector3;

/// The particles that stand for their neighbourhoods.
#[derive(Debug, Clone)]
pub struct Decimation {
    /// The particles that are shown, by their numbers in the scene.
    pub founders: Vec<u32>,
    /// The scene that is shown: a particle for every group, and a line for every pair of groups that springs join.
    pub(super) topology: SceneTopology,
    /// The line of every spring; `u32::MAX` within a group, as everywhere here for nothing.
    line: Vec<u32>,
    /// One over the number of springs of every line.
    share: Vec<f64>,
}

impl Decimation {
    /// The decimation of a scene with more particles or springs than wanted; `None` for another.
    pub(super) fn of(topology: &SceneTopology, particles: usize, springs: usize) -> Option<Self> {
        let count = topology.bindings.len();
        if count <= particles && topology.pairs.len() <= springs {
            return None;
        }
        let mut wanted = particles.min(count).max(1);
        loop {
            let decimation = Self::with(topology, wanted);
            let lines = decimation.topology.pairs.len();
            if lines <= springs || wanted <= 1 {
                return Some(decimation);
            }
            // Groups have more neighbours than particles: fewer of them until their lines are few enough.
            let most = (wanted as f64 * springs as f64 / lines as f64) as usize;
            wanted = most.min(wanted - 1).max(1);
        }
    }

    fn with(topology: &SceneTopology, wanted: usize) -> Self {
        let count = topology.bindings.len();
        let mut founders: Vec<u32> = (0..count as u32).collect();
        let mut group = founders.clone();
        let mut pairs = topology.pairs.clone();
        while founders.len() > wanted {
            let before = founders.len();
            let bound =
                |g: usize| founders.get(g).and_then(|&p| topology.bindings.get(p as usize)) != Some(&Binding::Free);
            let (coarser, chosen) = gather(before, &pairs, before.div_ceil(wanted), bound);
            founders = chosen.iter().filter_map(|&g| founders.get(g as usize).copied()).collect();
            group.iter_mut().for_each(|g| *g = at(&coarser, *g));
            pairs = joined(&pairs, &coarser);
            if founders.len() * 20 > before * 19 {
                // Hardly any neighbours are left to take: every so-manieth group, and the others with the one before it.
                let every = founders.len().div_ceil(wanted).max(1) as u32;
                group.iter_mut().for_each(|g| *g /= every);
                founders = founders.into_iter().step_by(every as usize).collect();
                break;
            }
        }
        let lines = joined(&topology.pairs, &group);
        let line_of = |&[i, j]: &[u32; 2]| {
            let pair = ordered([at(&group, i), at(&group, j)]);
            lines.binary_search(&pair).map_or(u32::MAX, |line| line as u32)
        };
        let line: Vec<u32> = topology.pairs.iter().map(line_of).collect();
        let mut share = vec![0.0; lines.len()];
        line.iter().filter_map(|&l| share.get_mut(l as usize).map(|n| *n += 1.0)).for_each(drop);
        share.iter_mut().for_each(|n: &mut f64| *n = 1.0 / n.max(1.0));
        let mut triangles: Vec<[u32; 3]> =
            topology.triangles.iter().map(|corners| corners.map(|p| at(&group, p))).collect();
        triangles.retain(|[a, b, c]| a != b && b != c && c != a);
        triangles.sort_unstable();
        triangles.dedup();
        let mean = |values: &[f64]| means(&line, &share, values).map(f64::from).collect();
        let shown = SceneTopology {
            dimension: topology.dimension,
            gravity: topology.gravity,
            bindings: founders.iter().filter_map(|&p| topology.bindings.get(p as usize).copied()).collect(),
            rest_lengths: mean(&topology.rest_lengths),
            stiffnesses: mean(&topology.stiffnesses),
            pairs: lines,
            triangles,
        };
        Self { founders, topology: shown, line, share }
    }

    pub(super) fn positions<'a>(&'a self, positions: &'a [Vector3<f64>]) -> impl Iterator<Item = Vector3<f64>> + 'a {
        self.founders.iter().map(|&p| positions.get(p as usize).copied().unwrap_or_default())
    }

    /// For every line the mean of a value of its springs.
    pub(super) fn mean_of_springs(&self, values: &[f64]) -> impl Iterator<Item = f32> {
        means(&self.line, &self.share, values)
    }
}

fn means(line: &[u32], share: &[f64], values: &[f64]) -> impl Iterator<Item = f32> {
    let mut sums = vec![0.0; share.len()];
    for (&line, value) in line.iter().zip(values) {
        if let Some(sum) = sums.get_mut(line as usize) {
            *sum += value;
        }
    }
    sums.into_iter().zip(share).map(|(sum, share)| (sum * share) as f32)
}

/// Gathers particles into groups of at most `size`: the group of every particle, and the founder of every group. Bound particles found first: they are shown.
fn gather(count: usize, pairs: &[[u32; 2]], size: usize, bound: impl Fn(usize) -> bool) -> (Vec<u32>, Vec<u32>) {
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); count];
    for &[i, j] in pairs {
        for (from, to) in [(i, j), (j, i)] {
            if let Some(list) = neighbours.get_mut(from as usize) {
                list.push(to);
            }
        }
    }
    let mut group = vec![u32::MAX; count];
    let mut founders = Vec::new();
    for p in (0..count).filter(|&p| bound(p)).chain(0..count) {
        if at(&group, p as u32) != u32::MAX {
            continue;
        }
        let number = founders.len() as u32;
        founders.push(p as u32);
        let free = neighbours[p].iter().filter(|&&n| at(&group, n) == u32::MAX && !bound(n as usize));
        let members: Vec<u32> = free.copied().take(size.saturating_sub(1)).collect();
        for q in members.into_iter().chain([p as u32]) {
            if let Some(g) = group.get_mut(q as usize) {
                *g = number;
            }
        }
    }
    (group, founders)
}

/// Pairs of groups that are joined, each once, ascending.
fn joined(pairs: &[[u32; 2]], group: &[u32]) -> Vec<[u32; 2]> {
    let groups = pairs.iter().map(|&[i, j]| ordered([at(group, i), at(group, j)]));
    let mut joined: Vec<[u32; 2]> = groups.filter(|[a, b]| a != b && *b != u32::MAX).collect();
    joined.sort_unstable();
    joined.dedup();
    joined
}

fn ordered([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

fn at(list: &[u32], index: u32) -> u32 {
    list.get(index as usize).copied().unwrap_or(u32::MAX)
}

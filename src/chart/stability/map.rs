//! The map: an experiment in every cell, compared with what theory predicts there, and its pictures.

use super::experiment::{TileVerdict, experiment};
use super::limits::{Limit, Prediction, limits, prediction};
use super::turning;
use crate::accuracy::Configuration;
use crate::chart::{Deadline, Progress, configurations};
use crate::error::Result;
use crate::figure::{self, Series, Tiles};
use crate::integrate::{Method, StiffnessPolicy};
use crate::interrupt::Interrupt;
use crate::linear::SolverChoice;
use crate::verify::{Check, Claim};
use faer::Par;
use rayon::prelude::*;
use serde::Serialize;
use std::time::{Duration, Instant};

/// The quantity of the rows of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Varied {
    /// The stretch λ = l/l0, without damping.
    Stretch,
    /// The axial damping ratio ζ, at the stretch 2.
    Damping,
    /// The angle θ by which a step turns the spring, in rad.
    Turning,
}

impl Varied {
    /// The quantity, in a word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stretch => "stretch",
            Self::Damping => "damping",
            Self::Turning => "turning",
        }
    }

    /// The stretch and the damping ratio of a row; `None` for turning, which has another model.
    fn linear(self, row: f64) -> Option<[f64; 2]> {
        match self {
            Self::Stretch => Some([row, 0.0]),
            Self::Damping => Some([2.0, row]),
            Self::Turning => None,
        }
    }

    fn experiment(self, configuration: &Configuration, z: f64, row: f64) -> Result<TileVerdict> {
        match self.linear(row) {
            Some([stretch, ratio]) => experiment(configuration, z, stretch, ratio),
            None => turning::experiment(configuration, z, row),
        }
    }

    fn limits(self, method: Method, policy: StiffnessPolicy, row: f64) -> Vec<Limit> {
        match self.linear(row) {
            Some([stretch, ratio]) => limits(method, policy, stretch, ratio),
            None => turning::limits(method, policy, row),
        }
    }

    fn prediction(self, method: Method, policy: StiffnessPolicy, z: f64, row: f64, margin: f64) -> Prediction {
        match self.linear(row) {
            Some(model) => prediction(method, policy, z, model, margin),
            None => turning::prediction(method, policy, z, row, margin),
        }
    }
}

/// One method under one option.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tile {
    /// The method's name.
    pub method: &'static str,
    /// The stiffness policy's name; `none` for a method without matrices.
    pub stiffness: &'static str,
    /// The quantity of the rows.
    pub axis: Varied,
    /// z = ω dt of every column.
    pub columns: Vec<f64>,
    /// λ, ζ or θ of every row.
    pub rows: Vec<f64>,
    /// Row by row, what failed first.
    pub verdicts: Vec<Vec<TileVerdict>>,
    /// Row by row, the limits in closed form.
    pub limits: Vec<Vec<Limit>>,
    /// Cells about which theory says something.
    pub predicted: usize,
    /// Cells (z, row) in which it says something else than what was measured.
    pub contradictions: Vec<(f64, f64)>,
}

/// Tiles for every method and option.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StabilityMap {
    /// Over the stretch, then over damping, then over turning.
    pub tiles: Vec<Tile>,
    /// Tiles for which there was no time.
    #[serde(skip_serializing_if = "is_zero")]
    pub missing: usize,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// Columns of a map that shows where limits are, and how long finer ones take.
const COARSE: usize = 9;

fn geometric(low: f64, high: f64, count: usize) -> Vec<f64> {
    let ratio = (high / low).ln() / (count.max(2) - 1) as f64;
    (0..count).map(|i| low * (ratio * i as f64).exp()).collect()
}

impl StabilityMap {
    /// Measures with `resolution` columns over z = 0.1 … 10 and about two thirds as many rows.
    pub fn measure(resolution: usize, progress: &mut Progress<'_>) -> Result<Self> {
        Self::until(resolution, progress, Deadline::after(Duration::MAX / 16, Interrupt::NEVER))
    }

    /// As [`measure`](Self::measure), with as many columns up to `resolution` as a deadline allows; where even a coarse map takes longer, tiles are missing.
    pub fn within(resolution: usize, progress: &mut Progress<'_>, deadline: Deadline) -> Result<Self> {
        let begin = Instant::now();
        let coarse = Self::until(resolution.min(COARSE), progress, deadline)?;
        // Every cell takes as long, and a map has two thirds of the square of its columns; a fifth of the time is held back.
        let times = deadline.left().as_secs_f64() / begin.elapsed().as_secs_f64();
        let affordable = COARSE as f64 * (0.8 * times).sqrt();
        let columns = resolution.min(affordable as usize / 3 * 3);
        if coarse.missing > 0 || columns <= COARSE {
            return Ok(coarse);
        }
        let fine = Self::until(columns, progress, deadline)?;
        Ok(if fine.missing == 0 { fine } else { coarse })
    }

    fn until(resolution: usize, progress: &mut Progress<'_>, deadline: Deadline) -> Result<Self> {
        let begin = Instant::now();
        let columns = geometric(0.1, 10.0, resolution.max(4));
        // An odd number of rows has one at λ = 1.
        let count = resolution.max(4) / 3 * 2 + 1;
        let mut tiles = Vec::new();
        let mut missing = 0;
        for (axis, low, high) in
            [(Varied::Stretch, 0.5, 2.0), (Varied::Damping, 0.01, 10.0), (Varied::Turning, 0.003, 1.0)]
        {
            let rows = geometric(low, high, count);
            let methods = configurations(Par::Seq).into_iter().filter(|c| c.options.linear.solver == SolverChoice::Llt);
            for configuration in methods {
                if !deadline.allows(Duration::ZERO) {
                    missing += 1;
                    continue;
                }
                progress(begin.elapsed(), configuration.method.name());
                tiles.push(Tile::measure(&configuration, axis, &columns, &rows)?);
            }
        }
        Ok(Self { tiles, missing })
    }

    /// Cells that theory says something about, and those among them that contradict it.
    pub fn agreement(&self) -> (usize, usize) {
        let count = |of: fn(&Tile) -> usize| self.tiles.iter().map(of).sum();
        (count(|tile| tile.predicted), count(|tile| tile.contradictions.len()))
    }

    /// One check a tile: not one cell in which map and formula contradict each other.
    pub fn checks(&self) -> Vec<Check> {
        self.tiles.iter().map(Tile::check).collect()
    }
}

impl Tile {
    /// Measures every cell of one tile.
    pub fn measure(configuration: &Configuration, axis: Varied, columns: &[f64], rows: &[f64]) -> Result<Self> {
        let (method, policy) = (configuration.method, configuration.options.stiffness);
        let row =
            |&row: &f64| columns.iter().map(|&z| axis.experiment(configuration, z, row)).collect::<Result<Vec<_>>>();
        let verdicts = rows.par_iter().map(row).collect::<Result<Vec<_>>>()?;
        let margin = match columns {
            [first, second, ..] => second / first,
            _ => 1.0,
        };
        let mut predicted = 0;
        let mut contradictions = Vec::new();
        for (&row, verdicts) in rows.iter().zip(&verdicts) {
            for (&z, &verdict) in columns.iter().zip(verdicts) {
                let agrees = match axis.prediction(method, policy, z, row, margin) {
                    Prediction::Silent => continue,
                    Prediction::Stable => verdict == TileVerdict::Stable,
                    Prediction::Unstable => verdict != TileVerdict::Stable,
                    Prediction::Refused => verdict == TileVerdict::Indefinite,
                    Prediction::Definite => verdict != TileVerdict::Indefinite,
                };
                predicted += 1;
                if !agrees {
                    contradictions.push((z, row));
                }
            }
        }
        let limits = rows.iter().map(|&row| axis.limits(method, policy, row));
        Ok(Self {
            method: method.name(),
            stiffness: configuration.stiffness(),
            axis,
            columns: columns.to_vec(),
            rows: rows.to_vec(),
            verdicts,
            limits: limits.collect(),
            predicted,
            contradictions,
        })
    }

    /// No cell contradicts theory.
    pub fn check(&self) -> Check {
        let over = self.axis.name();
        let exact = match self.axis {
            Varied::Stretch | Varied::Damping => "the linear stability limits are exact on the model",
            Varied::Turning => "the limit of turning holds to a third for small angles",
        };
        let mut why = format!(
            "{exact}: none of {} cells further than one column from a limit may contradict them",
            self.predicted
        );
        if let Some((z, row)) = self.contradictions.first() {
            why += &format!("; the first that does is z = {z:.3}, {over} {row:.3}");
        }
        let name = format!("stability map of {} over {over}", self.method);
        Check::new(Claim::Stability, name, self.stiffness, self.contradictions.len() as f64, 0.0, why)
    }

    /// As a field of cells with the limits in closed form over it.
    pub fn figure(&self) -> Tiles {
        let (over, y) = match self.axis {
            Varied::Stretch => ("over the stretch", figure::Axis::linear("stretch λ = l/l0")),
            Varied::Damping => ("over damping, at λ = 2", figure::Axis::logarithmic("axial damping ratio ζ")),
            Varied::Turning => ("over turning", figure::Axis::logarithmic("turn per step θ, rad")),
        };
        let option = if self.stiffness == "none" { String::new() } else { format!(" ({})", self.stiffness) };
        let mut curves: Vec<Series> = Vec::new();
        for (&row, limits) in self.rows.iter().zip(&self.limits) {
            for limit in limits {
                match curves.iter_mut().find(|curve| curve.name == limit.formula) {
                    Some(curve) => curve.points.push((limit.z, row)),
                    None => curves.push(Series::line(limit.formula, vec![(limit.z, row)])),
                }
            }
        }
        if let (Some(first), Some(last)) = (self.columns.first(), self.columns.last()) {
            curves.retain(|curve| curve.points.iter().any(|(z, _)| (first..=last).contains(&z)));
        }
        Tiles {
            title: format!("{}{option}, {over}", self.method),
            conclusion: self.conclusion(),
            x: figure::Axis::logarithmic("ω dt"),
            y,
            columns: self.columns.clone(),
            rows: self.rows.clone(),
            cells: self.verdicts.iter().map(|row| row.iter().map(|&verdict| verdict as usize).collect()).collect(),
            classes: TileVerdict::NAMES.map(Into::into).to_vec(),
            curves,
        }
    }

    /// Up to which step nothing goes wrong in any row, and what does first beyond.
    fn conclusion(&self) -> String {
        let column = |at: usize| self.verdicts.iter().filter_map(move |row| row.get(at));
        let wrong = |at: usize| column(at).find(|verdict| **verdict != TileVerdict::Stable);
        let rows = match self.axis {
            Varied::Stretch => "at any stretch",
            Varied::Damping => "at any damping",
            Varied::Turning => "at any turn",
        };
        match (0..self.columns.len()).find_map(|at| Some((at, wrong(at)?))) {
            None => format!("Nothing goes wrong {rows}, whatever the step."),
            Some((0, first)) => format!("Something goes wrong at every step shown, first: {}.", first.name()),
            Some((at, first)) => {
                let longest = self.columns.get(at - 1).copied().unwrap_or(f64::NAN);
                format!("Nothing goes wrong {rows} up to ω dt = {longest:.2}; first beyond: {}.", first.name())
            }
        }
    }

    /// A name for a file: method, option and axis.
    pub fn file_name(&self) -> String {
        format!("stability-{}-{}-{}", self.method, self.stiffness, self.axis.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, Ordering};

    #[test]
    fn a_small_map_agrees_with_theory() {
        let mut told = Vec::new();
        let map = StabilityMap::measure(12, &mut |_, what: &str| told.push(what.to_owned())).unwrap();
        assert_eq!(told, map.tiles.iter().map(|tile| tile.method).collect::<Vec<_>>());
        // Three axes, without the ways that differ in their solver alone: those by conjugate gradients.
        assert_eq!((map.tiles.len(), map.checks().len()), (3 * 19, 3 * 19));
        assert!(map.tiles.iter().all(|tile| (tile.columns.len(), tile.rows.len()) == (12, 9)));
        let middle = |tile: &Tile| if tile.axis == Varied::Stretch { 1.0 } else { 0.1f64.sqrt() };
        assert!(map.tiles[..38].iter().all(|tile| (tile.rows[4] - middle(tile)).abs() < 1e-9));
        assert_eq!(map.agreement(), (map.tiles.iter().map(|tile| tile.predicted).sum(), 0));
        for check in map.checks() {
            assert!(check.passed(), "{} {}: {}", check.name, check.scene, check.why);
        }
        let verdicts = |tile: &Tile| tile.verdicts.concat();
        let refused = map.tiles.iter().flat_map(verdicts).filter(|v| *v == TileVerdict::Indefinite);
        assert!(refused.count() > 10);
        let (turning, linear): (Vec<_>, Vec<_>) = map.tiles.iter().partition(|tile| tile.axis == Varied::Turning);
        let silent = [Method::ForwardEuler, Method::Bdf2].map(Method::name);
        assert!(linear.iter().all(|tile| tile.predicted > 30 || silent.contains(&tile.method)));
        let braked: Vec<_> = turning.iter().filter(|tile| verdicts(tile).contains(&TileVerdict::Braked)).collect();
        assert!(braked.iter().any(|tile| tile.stiffness == "full" && tile.predicted > 30));
        assert!(braked.iter().all(|tile| tile.stiffness != "axial" || tile.method != "linear-backward-euler"));
    }

    /// What is complete stays when someone interrupts the map: here the first tile, of the first method with its first option.
    #[test]
    fn an_interrupted_map_has_the_tiles_that_are_complete() {
        static STOP: AtomicBool = AtomicBool::new(false);
        let mut progress = |_, _: &str| STOP.store(true, Ordering::Relaxed);
        let map =
            StabilityMap::until(12, &mut progress, Deadline::after(Duration::MAX / 16, Interrupt::on(&STOP))).unwrap();
        let [tile] = &map.tiles[..] else { panic!("{} tiles", map.tiles.len()) };
        assert_eq!(map.missing, 3 * 19 - 1);
        assert_eq!((tile.method, tile.stiffness, tile.axis), ("linear-backward-euler", "full", Varied::Stretch));
    }

    /// A moment is not enough for one tile, and a long time is for all columns asked for.
    #[test]
    fn a_map_is_as_fine_as_its_time_allows() {
        let within = |columns, time| {
            let deadline = Deadline::after(time, Interrupt::NEVER);
            StabilityMap::within(columns, &mut |_, _: &str| {}, deadline).unwrap()
        };
        let nothing = within(12, Duration::ZERO);
        assert_eq!((nothing.tiles.len(), nothing.missing), (0, 3 * 19));
        let all = within(12, Duration::MAX / 16);
        assert_eq!((all.tiles.len(), all.missing, all.tiles[0].columns.len()), (3 * 19, 0, 12));
    }

    /// Contradictions are counted, and named with their place.
    #[test]
    fn contradictions_are_told() {
        let (axis, verdicts, limits) = (Varied::Stretch, Vec::new(), Vec::new());
        let [columns, rows] = [vec![1.0, 2.0], vec![0.5]];
        let tile = Tile {
            method: "w2",
            stiffness: "full",
            axis,
            columns,
            rows,
            verdicts,
            limits,
            predicted: 7,
            contradictions: vec![(2.0, 0.5), (1.0, 0.5)],
        };
        assert_eq!(tile.file_name(), "stability-w2-full-stretch");
        // Of the limits those are drawn that lie between the first column and the last, ends included.
        let limit = |formula, z| Limit { formula, z };
        let limited = vec![vec![limit("a", 0.9), limit("b", 1.0), limit("c", 1.5), limit("d", 2.0), limit("e", 2.1)]];
        let curves = Tile { limits: limited, ..tile.clone() }.figure().curves;
        assert_eq!(curves.iter().map(|curve| curve.name.as_str()).collect::<Vec<_>>(), ["b", "c", "d"]);
        let tiles = vec![tile.clone(), Tile { predicted: 4, contradictions: Vec::new(), ..tile }];
        let map = StabilityMap { tiles, missing: 0 };
        assert_eq!(map.agreement(), (11, 2));
        let checks = map.checks();
        assert!(checks[0].why.ends_with("; the first that does is z = 2.000, stretch 0.500"), "{}", checks[0].why);
        assert_eq!(checks.iter().map(|check| check.value).collect::<Vec<_>>(), [2.0, 0.0]);
    }
}

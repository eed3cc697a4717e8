//! The map as pictures.

use super::{StabilityMap, Tile, TileVerdict, Varied};
use crate::figure::{self, Series, Tiles};

impl Tile {
    /// As a field of cells with the limits in closed form over it.
    pub fn figure(&self) -> Tiles {
        let (over, y) = match self.axis {
            Varied::Stretch => ("over the stretch", figure::Axis::linear("stretch λ = l/l0")),
            Varied::Damping => ("over damping, at λ = 2", figure::Axis::logarithmic("axial damping ratio ζ")),
            Varied::Turning => ("over turning", figure::Axis::logarithmic("turn per step θ, rad")),
        };
        let option = if self.stiffness == "none" { String::new() } else { format!(" ({})", self.stiffness) };
        let class = |verdict: &TileVerdict| TileVerdict::ALL.iter().position(|other| other == verdict).unwrap_or(0);
        let mut curves: Vec<Series> = Vec::new();
        for (&row, limits) in self.rows.iter().zip(&self.limits) {
            for limit in limits {
                match curves.iter_mut().find(|curve| curve.name == limit.formula) {
                    Some(curve) => curve.points.push((limit.z, row)),
                    None => curves.push(Series::line(limit.formula, vec![(limit.z, row)])),
                }
            }
        }
        let shown = |curve: &Series| {
            let ends = (self.columns.first(), self.columns.last());
            curve.points.iter().any(|(z, _)| ends.0.is_some_and(|low| z >= low) && ends.1.is_some_and(|high| z <= high))
        };
        curves.retain(shown);
        Tiles {
            title: format!("{}{option}, {over}", self.method),
            conclusion: self.conclusion(),
            x: figure::Axis::logarithmic("ω dt"),
            y,
            columns: self.columns.clone(),
            rows: self.rows.clone(),
            cells: self.verdicts.iter().map(|row| row.iter().map(class).collect()).collect(),
            classes: TileVerdict::ALL.iter().map(|verdict| verdict.name().into()).collect(),
            curves,
        }
    }

    /// Up to which step nothing goes wrong in any row, and what does first beyond.
    fn conclusion(&self) -> String {
        let column = |at: usize| self.verdicts.iter().filter_map(move |row| row.get(at));
        let wrong = |at: usize| column(at).find(|verdict| **verdict != TileVerdict::ALL[0]);
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

impl StabilityMap {
    /// Cells that theory says something about, and those among them that contradict it.
    pub fn agreement(&self) -> (usize, usize) {
        let count = |of: fn(&Tile) -> usize| self.tiles.iter().map(of).sum();
        (count(|tile| tile.predicted), count(|tile| tile.contradictions.len()))
    }
}

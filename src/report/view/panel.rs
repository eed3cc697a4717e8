//! Curves over time, as the page draws them.

use crate::figure::Track;
use serde::Serialize;

/// Points of a curve: more than a wide screen has pixels.
const POINTS: usize = 2000;

#[derive(Serialize)]
pub(super) struct Panel {
    title: String,
    unit: String,
    times: Vec<f64>,
    curves: Vec<Curve>,
}

#[derive(Serialize)]
struct Curve {
    name: String,
    values: Vec<f64>,
}

impl Panel {
    /// Thinned evenly where it has too many points, and in six digits: more are not shown.
    pub fn of(track: &Track) -> Self {
        let every = track.times.len() / POINTS + 1;
        let thin = |values: &[f64]| values.iter().step_by(every).map(|&value| six_digits(value)).collect();
        let curve = |(name, values): &(String, Vec<f64>)| Curve { name: name.clone(), values: thin(values) };
        Self {
            title: track.title.clone(),
            unit: track.unit.clone(),
            times: track.times.iter().copied().step_by(every).collect(),
            curves: track.curves.iter().map(curve).collect(),
        }
    }
}

fn six_digits(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

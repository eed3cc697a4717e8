//! Every figure of charts that no clock is in is the one that was measured when it was looked at: references, qualities, and the maps
//! of stability, method by method.

use crate::record::{Row, beside, hold};
use faer::Par;
use sprung::accuracy::{Pace, trial};
use sprung::chart::stability::{Tile, Varied};
use sprung::chart::{Quality, Reference, configurations, dop853};
use sprung::verify::built_in;
use std::time::{Duration, Instant};

/// Motions of ten steps, and how well others keep to them.
#[test]
fn references_and_what_is_held_to_them() {
    hold("chart_references", |seed| {
        let mut rows = Vec::new();
        let far = Instant::now() + Duration::from_secs(3600);
        let chosen = ["moving anchor", "one-dimensional", "planar truss", "tetrahedron", "two springs"];
        let subjects = built_in().unwrap();
        let subjects = subjects.iter().filter(|subject| chosen.contains(&&*subject.name));
        for subject in subjects.map(|subject| beside(subject, seed)) {
            let (system, start, duration) = (&subject.system, &subject.state, 10.0 * subject.dt);
            let reference = Reference::compute(system, start, [subject.dt, duration], Duration::from_secs(3600));
            let reference = reference.unwrap().unwrap();
            rows.push(Row::shown(subject.name.clone(), &reference));
            for tolerance in [1e-3, 1e-6] {
                let state = dop853(system, start, duration, tolerance, far).unwrap();
                let quality = Quality::of(system, &state, &reference.state, start);
                rows.push(Row::shown(format!("{} {tolerance:e}", subject.name), &(state, quality)));
            }
            let configuration = &configurations(Par::Seq)[0];
            let run = trial(system, start, configuration, Pace::Step(subject.dt / 2.0), duration, &|| true).unwrap();
            let quality = Quality::of(system, &run.state, &reference.state, start);
            rows.push(Row::shown(format!("{} steps", subject.name), &(run.status, run.steps, run.statistics, quality)));
        }
        rows
    });
}

fn tiles(axis: Varied, rows: &[f64]) {
    hold(&format!("chart_{}", axis.name()), |_| {
        let columns = [0.3, 1.7, 2.3, 12.0];
        let mut known = Vec::new();
        for (number, configuration) in configurations(Par::Seq).iter().enumerate() {
            let tile = Tile::measure(configuration, axis, &columns, rows).unwrap();
            let key = format!("{number} {} {}", tile.method, tile.stiffness);
            let said = (tile.check(), tile.figure());
            known.push(Row::shown(key, &(tile, said)));
        }
        known
    });
}

#[test]
fn stability_over_the_stretch() {
    tiles(Varied::Stretch, &[0.6, 2.5]);
}

#[test]
fn stability_over_damping() {
    tiles(Varied::Damping, &[0.1, 2.0]);
}

#[test]
fn stability_over_turning() {
    tiles(Varied::Turning, &[0.1, 0.5, 1.0, 2.0]);
}

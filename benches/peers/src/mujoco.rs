//! What `mujoco_curves.py` measured: MuJoCo's methods on the scenes that it can represent.

use crate::Failure;
use crate::curve::{Curve, Run, Side};
use serde::Deserialize;
use sprung::figure::Look;
use sprung::integrate::Method;
use std::collections::BTreeMap;
use std::path::Path;

/// The file that the script writes.
pub const FILE: &str = "mujoco.json";

/// Time in s, and the error where the run did not fail.
type Point = (f64, Option<f64>);

#[derive(Deserialize)]
pub struct Measured {
    pub version: String,
    /// By scene and method.
    scenes: BTreeMap<String, BTreeMap<String, Vec<Point>>>,
    /// Scenes that it cannot represent, and why.
    pub left_out: BTreeMap<String, String>,
}

impl Measured {
    /// `None` where nothing was measured.
    pub fn load(file: &Path) -> Result<Option<Self>, Failure> {
        match std::fs::read_to_string(file) {
            Ok(text) => Ok(Some(serde_json::from_str(&text)?)),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// The curves of a scene.
    pub fn curves(&self, scene: &str) -> Vec<Curve> {
        let curve = |(method, points): (&String, &Vec<Point>)| Curve {
            name: format!("MuJoCo {method}"),
            side: Side::Peer,
            look: look(method),
            runs: points.iter().map(|&(seconds, error)| Run { seconds, outcome: error.ok_or(FAILED.into()) }).collect(),
        };
        self.scenes.get(scene).into_iter().flatten().map(curve).collect()
    }
}

const FAILED: &str = "error above 100 %";

/// The colour of the method here that is most like it, hollow.
fn look(method: &str) -> Look {
    let like = match method {
        "Euler" => Method::SymplecticEuler,
        "implicitfast" => Method::LinearBackwardEuler,
        _ => Method::Verlet,
    };
    let number = Method::ALL.iter().position(|known| *known == like).unwrap_or(Method::ALL.len());
    Look { number, hollow: true }
}

//! A scene as it lies on the ranks before it is cut: consecutive particles and consecutive springs, by their numbers.

use crate::ranks;
use serde::{Deserialize, Serialize};
use sprung::scene::{Scene, TimeSettings};
use sprung::system::Axes;
use sprung::{Motion, Spring, State, System};

/// What all ranks know of a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    pub name: String,
    pub dimension: usize,
    pub gravity: [f64; 3],
    pub particles: u64,
    pub springs: u64,
    pub dt: Option<f64>,
    pub duration: Option<f64>,
    pub motions: Vec<Moves>,
    /// What decides about the bits of a run, in a few digits.
    pub fingerprint: String,
}

/// A [`Motion`] as it stands in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Moves {
    Held,
    Velocity([f64; 3]),
    Path { times: Vec<f64>, offsets: Vec<[f64; 3]> },
}

impl From<&Motion> for Moves {
    fn from(motion: &Motion) -> Self {
        match motion {
            Motion::Held => Self::Held,
            Motion::Velocity(v) => Self::Velocity((*v).into()),
            Motion::Path { times, offsets } => {
                Self::Path { times: times.clone(), offsets: offsets.iter().map(|&v| v.into()).collect() }
            }
        }
    }
}

impl From<&Moves> for Motion {
    fn from(motion: &Moves) -> Self {
        match motion {
            Moves::Held => Self::Held,
            Moves::Velocity(v) => Self::Velocity((*v).into()),
            Moves::Path { times, offsets } => {
                Self::Path { times: times.clone(), offsets: offsets.iter().map(|&v| v.into()).collect() }
            }
        }
    }
}

/// Numbers that describe a particle: position in m, velocity in m/s, mass in kg.
pub const PARTICLE: usize = 7;
/// A spring: its ends, as numbers of particles, k in N, l0 in m, b in N·s/m.
pub const SPRING: usize = 5;
/// A prescribed coordinate: particle, axis, number of its motion.
pub const LEAD: usize = 3;

/// One rank's share of a scene's lists. Whole numbers up to 2⁵³ are exact among the others.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Slab {
    /// Of the particles of [`ranks::ranges`].
    pub particles: Vec<f64>,
    /// Of the springs of [`ranks::ranges`].
    pub springs: Vec<f64>,
    /// Prescribed coordinates of this slab's particles, by particle and axis. Positions are those that motions start from.
    pub leads: Vec<f64>,
}

/// The whole of a scene that one process has.
pub fn whole(scene: &Scene, time: &TimeSettings, system: &System, state: &State) -> (Header, Slab) {
    let prescribed = system.prescribed();
    let header = Header {
        name: scene.name.clone(),
        dimension: system.dimension(),
        gravity: system.gravity().into(),
        particles: system.particles() as u64,
        springs: system.springs().len() as u64,
        dt: time.dt,
        duration: time.duration,
        motions: prescribed.motions().iter().map(Moves::from).collect(),
        fingerprint: sprung::output::fingerprint(system, state),
    };
    let mut slab = Slab::default();
    for ((x, v), &mass) in state.positions.iter().zip(&state.velocities).zip(system.masses()) {
        slab.particles.extend(x.iter().chain(v).copied().chain([mass]));
    }
    for (&[i, j], spring) in system.pairs().iter().zip(system.springs()) {
        let Spring { stiffness, rest_length, damping } = *spring;
        slab.springs.extend([f64::from(i), f64::from(j), stiffness, rest_length, damping]);
    }
    for (dof, start, motion) in prescribed.iter() {
        slab.leads.extend([dof.particle as f64, dof.axis as f64, motion as f64]);
        slab.particles[PARTICLE * dof.particle + dof.axis] = start;
    }
    (header, slab)
}

/// Shares out what rank 0 has.
pub fn share_out(whole: Option<(Header, Slab)>) -> (Header, Slab) {
    let text = whole.as_ref().map_or_else(String::new, |(header, _)| serde_json::to_string(header).unwrap_or_default());
    let text = ranks::share_text(&text);
    let header: Header = serde_json::from_str(&text).unwrap_or_else(|_| ranks::abort(1));
    let slab = whole.map(|(_, slab)| slab).unwrap_or_default();
    let ranges = [ranks::ranges(header.particles), ranks::ranges(header.springs)];
    let cut = |list: &[f64], ranges: &[u64], size: usize| -> Vec<f64> {
        let mut rest = list;
        let mut piece =
            |w: &[u64]| rest.split_off(..rest.len().min((w[1] - w[0]) as usize * size)).unwrap_or_default().to_vec();
        let parcels: Vec<Vec<f64>> = ranges.windows(2).map(&mut piece).collect();
        ranks::exchange(&parcels).swap_remove(0)
    };
    let particles = cut(&slab.particles, &ranges[0], PARTICLE);
    let springs = cut(&slab.springs, &ranges[1], SPRING);
    let mut parcels = vec![Vec::new(); ranks::ranks()];
    for lead in slab.leads.chunks_exact(LEAD) {
        parcels[ranks::owner(&ranges[0], lead[0] as u64)].extend_from_slice(lead);
    }
    let leads = ranks::exchange(&parcels).swap_remove(0);
    (header, Slab { particles, springs, leads })
}

/// Whether all rows of the matrix can be numbered, to be known before anything is made.
///
/// # Errors
/// What to do where they cannot.
pub fn check_rows(particles: u64, dimension: usize, most: u64) -> Result<(), String> {
    let rows = particles.saturating_mul(dimension as u64);
    if rows <= most {
        return Ok(());
    }
    Err(format!(
        "{particles} particles make {rows} rows of the matrix, and this PETSc numbers {most}: build sprung-mpi with one of 64-bit \
         indices"
    ))
}

/// An axis among all.
pub fn axis(number: f64) -> Axes {
    Axes::of(&[number as usize])
}

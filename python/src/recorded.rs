//! What is recorded of a run.

use crate::arrays::{flat, shaped};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sprung::integrate::Monitor;
use sprung::{Result, State, memory};
use std::num::NonZeroU64;

/// Columns of the energies: those of `energy.csv` without the time.
const COLUMNS: usize = 7;

/// Energies at every record, and every so many a frame.
#[derive(Debug, Clone)]
pub struct Recorded {
    dimension: usize,
    particles: usize,
    every: NonZeroU64,
    times: Vec<f64>,
    energies: Vec<f64>,
    frame_times: Vec<f64>,
    positions: Vec<f64>,
    velocities: Vec<f64>,
}

impl Recorded {
    /// Nothing yet, with room for a number of records.
    ///
    /// # Errors
    /// Frames that do not fit the memory.
    pub fn new(system: &sprung::System, records: u64, every: NonZeroU64) -> Result<Self> {
        let (dimension, particles) = (system.dimension(), system.particles());
        let frames = records / every + 2;
        let frame = dimension as u64 * particles as u64;
        memory::ensure(frames.saturating_mul(16 * frame), "the trajectory (every=N keeps fewer frames)")?;
        let room = (frames * frame) as usize;
        Ok(Self {
            dimension,
            particles,
            every,
            times: Vec::new(),
            energies: Vec::new(),
            frame_times: Vec::new(),
            positions: Vec::with_capacity(room),
            velocities: Vec::with_capacity(room),
        })
    }

    /// Whether the record of this number has a frame.
    pub fn is_frame(&self, number: u64) -> bool {
        number.is_multiple_of(self.every.get())
    }

    /// Records a state.
    pub fn push(&mut self, number: u64, state: &State, monitor: &Monitor) {
        let (energy, balance) = monitor.energy_at(state);
        self.times.push(state.time);
        self.energies.extend([energy.kinetic, energy.elastic, energy.gravitational, energy.total()]);
        self.energies.extend([balance.work, balance.dissipated, balance.imbalance]);
        if self.is_frame(number) {
            self.push_frame(state);
        }
    }

    /// Makes the end of a run the last frame.
    pub fn end(&mut self, state: &State) {
        if self.frame_times.last() != Some(&state.time) {
            self.push_frame(state);
        }
    }

    fn push_frame(&mut self, state: &State) {
        self.frame_times.push(state.time);
        self.positions.extend(flat(&state.positions, self.dimension));
        self.velocities.extend(flat(&state.velocities, self.dimension));
    }

    /// Hands the arrays out.
    ///
    /// # Errors
    /// None that could be caused.
    pub fn hand_out(self, py: Python<'_>, to: &Bound<'_, PyDict>) -> PyResult<()> {
        let (records, frames) = (self.times.len(), self.frame_times.len());
        let shape = [frames, self.particles, self.dimension];
        to.set_item("record_times", shaped(py, self.times, [records])?)?;
        to.set_item("energies", shaped(py, self.energies, [records, COLUMNS])?)?;
        to.set_item("times", shaped(py, self.frame_times, [frames])?)?;
        to.set_item("positions", shaped(py, self.positions, shape)?)?;
        to.set_item("velocities", shaped(py, self.velocities, shape)?)
    }
}

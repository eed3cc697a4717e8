//! `modes.npz`: normal modes as arrays.

use super::AtomicFile;
use crate::error::Result;
use crate::modes::{Mode, Modes};
use crate::scene::NpzWriter;
use crate::system::System;
use std::path::PathBuf;

/// Writes normal modes as NumPy arrays: `eigenvalues` (1/s²), `frequencies` (Hz, NaN where ω² is negative), `shapes` (modes × particles × axes, in
/// kg^{-1/2}), `damping_ratios` (NaN where there is none), `residuals` and `error_bounds` (1/s²), `effective_masses` (modes × 3, in kg), and `zero_shapes`, those of
/// the zero modes.
pub fn write_modes(target: impl Into<PathBuf>, system: &System, found: &Modes) -> Result<()> {
    let modes = || found.modes.iter();
    let count = found.modes.len();
    let shapes = |modes: &[Mode]| {
        let shapes = modes.iter().flat_map(|mode| found.shape(mode));
        let axes = system.dimension();
        shapes.flat_map(|u| u.data.0[0].into_iter().take(axes).collect::<Vec<_>>()).collect::<Vec<f64>>()
    };
    AtomicFile::write(target, |file| {
        let mut npz = NpzWriter::new(file);
        npz.put("eigenvalues", &[count], modes().map(|mode| mode.eigenvalue))?;
        npz.put("frequencies", &[count], modes().map(|mode| mode.frequency().unwrap_or(f64::NAN)))?;
        npz.put("damping_ratios", &[count], modes().map(|mode| mode.damping_ratio.unwrap_or(f64::NAN)))?;
        npz.put("residuals", &[count], modes().map(|mode| mode.residual))?;
        npz.put("error_bounds", &[count], modes().map(|mode| mode.error_bound))?;
        npz.put("effective_masses", &[count, 3], modes().flat_map(|mode| mode.effective_mass))?;
        for (name, modes) in [("shapes", &found.modes), ("zero_shapes", &found.zero_modes)] {
            let shape = [modes.len(), system.particles(), system.dimension()];
            npz.put(name, &shape, shapes(modes).into_iter())?;
        }
        npz.finish()
    })
}

//! The other two derivatives: damping matrix and damping force, energy and elastic force, by central differences.

use super::check::{Check, worst};
use super::claim::Claim;
use super::coloring::ColumnGroups;
use super::entries::for_each_entry;
use super::force_error::{ForceError, SECOND, U, block_rounding};
use super::reduced::{random_vector, reduce};
use super::verdict::{TABLE_ROWS, WorstEntries};
use crate::force::SpringGeometry;
use crate::operator::LinearOperator;
use crate::system::{Dof, State, System};
use nalgebra::Vector3;
use nalgebra_sparse::CscMatrix;

/// Random directions tried.
const DIRECTIONS: u64 = 4;

/// Compares every entry of G with the central difference of the damping force by velocity.
///
/// `force` is f_d over the free velocities at the positions of `state`, in N; `damping` is the whole G under test, in
/// N·s/m. f_d is linear in v, so there is no truncation and h is as large as the velocities. Value: the largest error
/// as a multiple of rounding. Sees every fault of an entry above 1e-14 of the dampers at its particle, damping counted
/// twice or of undamped springs; is blind to a direction n that is wrong in both.
pub fn damping_entries(
    system: &System,
    state: &State,
    mut force: impl FnMut(&[f64], &mut [f64]),
    damping: &CscMatrix<f64>,
    scene: &str,
) -> Check {
    let why = "1 is rounding: 80 u b for every damper of a particle and u of each sum, as f_d is linear in v and h is as large \
        as the velocities; no truncation";
    let check = |value, why: &str| Check::new(Claim::Consistency, "G against ∂f_d/∂v", scene, value, 1.0, why);
    let n = system.dofs().len();
    if (damping.nrows(), damping.ncols()) != (n, n) {
        return check(f64::NAN, "G does not have one row and one column for each free coordinate");
    }
    let mut allowed = vec![0.0; system.particles()];
    let mut springs = vec![0.0; system.particles()];
    for (_, ends, spring) in system.active() {
        for end in ends {
            springs[end] += 1.0;
            allowed[end] += U * spring.damping;
        }
    }
    allowed.iter_mut().zip(&springs).for_each(|(allowed, springs)| *allowed *= 80.0 + 2.0 * springs);
    let dofs: Vec<Dof> = system.dofs().iter().collect();
    let mut v = reduce(system, &state.velocities);
    let fastest = worst(state.velocities.iter().map(|v| v.amax()).chain([0.0]));
    let h = if fastest > 0.0 { fastest } else { 1.0 };
    let (mut after, mut before) = (vec![0.0; n], vec![0.0; n]);
    let mut entries = WorstEntries::new(TABLE_ROWS);
    let groups = ColumnGroups::of_system(system);
    for group in groups.groups() {
        let at: Vec<f64> = group.iter().map(|&column| v[column]).collect();
        group.iter().zip(&at).for_each(|(&column, at)| v[column] = at + h);
        force(&v, &mut after);
        group.iter().zip(&at).for_each(|(&column, at)| v[column] = at - h);
        force(&v, &mut before);
        group.iter().zip(&at).for_each(|(&column, at)| v[column] = *at);
        for (&column, at) in group.iter().zip(&at) {
            let width = (at + h) - (at - h);
            for_each_entry(damping, column, groups.rows(column), |row, value, coupled| {
                let quotient = if coupled { (after[row] - before[row]) / width } else { 0.0 };
                let allowed = if coupled { allowed[dofs[row].particle] } else { 0.0 };
                entries.compare(row, Some(column), value, quotient, allowed);
            });
        }
    }
    check(entries.worst(), why).with_table(entries.into_table(|entry| entry))
}

/// Checks that damping only takes energy out: `vᵀG v ≤ 0` for random velocities, relative to `Σ b ‖v_i − v_j‖²`.
///
/// Sees a wrong sign of G; is blind to its size.
pub fn damping_dissipates(system: &System, damping: &impl LinearOperator, scene: &str) -> Check {
    let why = "vᵀG v is a sum of −b (nᵀδv)², never positive, each rounded a few times: 32 u of Σ b δv²";
    let check =
        |value, why: &str| Check::new(Claim::Consistency, "damping takes energy out", scene, value, 32.0 * U, why);
    let n = system.dofs().len();
    if damping.order() != n {
        return check(f64::NAN, "G does not have one row for each free coordinate");
    }
    let power = |seed| {
        let v = random_vector(n, seed);
        let mut f = vec![0.0; n];
        damping.apply(&v, &mut f);
        let scale: f64 = system
            .active()
            .map(|(_, [i, j], s)| {
                let [vi, vj] = [i, j].map(|end| system.dofs().get(&v, end));
                s.damping * (vi.norm() + vj.norm()).powi(2)
            })
            .sum();
        let power: f64 = v.iter().zip(&f).map(|(v, f)| v * f).sum();
        if power == 0.0 { 0.0 } else { power / scale }
    };
    check(worst((0..DIRECTIONS).map(power)), why)
}

/// Compares the elastic force with the slope of the elastic energy, `f·w = −dU(x + s w)/ds`, by central differences.
///
/// `energy` is U over the free coordinates, in J; `force` is f_el under test, in N. Value: the largest error over
/// random directions as a multiple of what truncation and rounding of the whole sum allow. Sees a force or an energy
/// that is wrong somewhere by more than about 1e-8 of the whole; is blind to faults of single weak springs in large
/// scenes, which [`force_against_energy`](super::force_against_energy) sees.
pub fn energy_slope(
    system: &System,
    state: &State,
    mut energy: impl FnMut(&[f64]) -> f64,
    force: &[f64],
    scene: &str,
) -> Check {
    let check =
        |value, why: String| Check::new(Claim::Consistency, "f against −∇U by differences", scene, value, 1.0, why);
    if force.len() != system.dofs().len() {
        return check(f64::NAN, "the force does not have one component for each free coordinate".into());
    }
    let extensions = match SpringGeometry::at(system, &state.positions) {
        Ok(extensions) => extensions,
        Err(degenerate) => return check(f64::NAN, degenerate.to_string()),
    };
    let error = ForceError::new(system, &extensions);
    let x = reduce(system, &state.positions);
    let mut relative = 0.0;
    let ratios = (0..DIRECTIONS).map(|seed| {
        let w = direction(system, &error, seed);
        let bounds = Bounds::new(system, &error, state, &w, force);
        let h = (bounds.rounding(energy(&x)) / (2.0 * bounds.curvature)).cbrt();
        let h = if h.is_finite() { h.clamp(bounds.resolved, 0.125) } else { 0.125 };
        let along = |sign: f64| -> Vec<f64> { x.iter().zip(&w).map(|(x, w)| x + sign * h * w).collect() };
        let (ahead, behind) = (along(1.0), along(-1.0));
        let difference = energy(&ahead) - energy(&behind);
        let moved = ahead.iter().zip(&behind).map(|(a, b)| a - b);
        let work: f64 = moved.zip(force).map(|(moved, f)| moved * f).sum();
        let mismatch = (difference + work).abs() / (2.0 * h);
        let allowed = bounds.allowed(h, energy(&x));
        relative = worst([relative, mismatch / bounds.force]);
        if mismatch == 0.0 { 0.0 } else { mismatch / allowed }
    });
    let value = worst(ratios.collect::<Vec<_>>());
    let why = format!(
        "1 is truncation (2/√3) k h² δ³/(6 (l − hδ)²) of each spring and rounding of U, u for each spring of the sum, over h; \
         the mismatch is {relative:.1e} of Σ k δ"
    );
    check(value, why)
}

/// A random direction that moves no particle by more than half of its shortest spring.
fn direction(system: &System, error: &ForceError, seed: u64) -> Vec<f64> {
    let mut w = random_vector(system.dofs().len(), seed);
    for particle in 0..system.particles() {
        let shortest = error.shortest(particle);
        let reach = if shortest.is_finite() { shortest / (2.0 * 3.0_f64.sqrt()) } else { 0.0 };
        w[system.dofs().rows(particle)].iter_mut().for_each(|w| *w *= reach);
    }
    w
}

/// Error bounds of the energy's difference quotient along one direction.
struct Bounds {
    /// Factor of h² in the truncation error, with lengths as short as an eighth of the way makes them.
    curvature: f64,
    /// Rounding of the energies of single springs, in J.
    springs: f64,
    /// Roundings of the sum of energies: u for each term.
    sum: f64,
    /// Rounding of the force, of its product with w, and of the middle of the two points, in J.
    slope: f64,
    /// `Σ k ‖δ‖`, in J: the size of the terms that f·w is made of.
    force: f64,
    /// The smallest h at which x ± h w is resolved.
    resolved: f64,
}

impl Bounds {
    fn new(system: &System, error: &ForceError, state: &State, w: &[f64], force: &[f64]) -> Self {
        let dofs = system.dofs();
        let moves: Vec<Vector3<f64>> = (0..system.particles()).map(|particle| dofs.get(w, particle)).collect();
        let (mut curvature, mut springs, mut scale, mut middle) = (0.0, 0.0, 0.0, 0.0);
        for link in error.links() {
            let [i, j] = link.ends;
            let (delta, l, l0, k) =
                ((moves[i] - moves[j]).norm(), link.at.length, link.spring.rest_length, link.spring.stiffness);
            let strain = link.spring.strain(link.at).abs() + 0.125 * delta / l0;
            curvature += SECOND * k * delta.powi(3) / (6.0 * (l - 0.125 * delta).powi(2));
            springs += U * k * l0 * strain * (4.0 * (l + delta) / l0 + 6.0 * strain);
            scale += k * delta * (l / l0).max(1.0);
            let off = 2.0 * U * (state.positions[i].norm() + state.positions[j].norm());
            middle += off * delta * (block_rounding(link.spring, link.at) / (12.0 * U));
        }
        let product: f64 = force.iter().zip(w).map(|(f, w)| (f * w).abs()).sum();
        let own: f64 = moves.iter().enumerate().map(|(particle, w)| error.rounding(particle) * w.norm() * 2.0).sum();
        let slope = middle + own + U * force.len() as f64 * product;
        let far = |particle: usize| {
            let shortest = error.shortest(particle);
            if shortest.is_finite() { 128.0 * U * state.positions[particle].amax() / shortest } else { 0.0 }
        };
        let resolved = (0..system.particles()).map(far).fold(0.0, f64::max).min(0.125);
        Self { curvature, springs, sum: U * system.springs().len() as f64, slope, force: scale, resolved }
    }

    fn rounding(&self, energy: f64) -> f64 {
        self.springs + self.sum * energy
    }

    fn allowed(&self, h: f64, energy: f64) -> f64 {
        self.curvature * h * h + self.rounding(energy) / h + self.slope
    }
}

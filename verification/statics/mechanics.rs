//! Forces, energies and matrices of a scene, written a second time and densely.
//!
//! A spring pulls its ends together with `T = k (l − l₀)/g`, `g = l₀`, or 1 m where `l₀ = 0`; one that bears tension only, with nothing while it is shorter
//! than `l₀`. Of −K it makes the block `T/l (I − nnᵀ) + k/g nnᵀ`.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use sprung::{State, System};

/// A spring.
#[derive(Debug, Clone, Copy)]
pub struct Bar {
    pub ends: [usize; 2],
    pub stiffness: f64,
    pub rest: f64,
    pub bears_tension_only: bool,
}

impl Bar {
    fn gauge(&self) -> f64 {
        if self.rest == 0.0 { 1.0 } else { self.rest }
    }

    pub fn is_slack(&self, length: f64) -> bool {
        self.bears_tension_only && length < self.rest
    }

    pub fn tension(&self, length: f64) -> f64 {
        if self.is_slack(length) { 0.0 } else { self.stiffness * (length - self.rest) / self.gauge() }
    }

    fn axial(&self, length: f64) -> f64 {
        if self.is_slack(length) { 0.0 } else { self.stiffness / self.gauge() }
    }
}

/// A scene in plain numbers.
pub struct Model {
    pub dimension: usize,
    pub masses: Vec<f64>,
    /// Weight and constant loads.
    pub loads: Vec<Vector3<f64>>,
    /// Rows of the free coordinates.
    pub rows: Vec<[Option<usize>; 3]>,
    pub order: usize,
    /// Springs with a free end; numbers of all of them are those of the system.
    pub bars: Vec<(usize, Bar)>,
}

impl Model {
    pub fn new(system: &System) -> Self {
        let mut order = 0;
        let rows: Vec<[Option<usize>; 3]> = (0..system.particles())
            .map(|p| {
                [0, 1, 2].map(|axis| {
                    system.dofs().free_axes(p).contains(axis).then(|| {
                        order += 1;
                        order - 1
                    })
                })
            })
            .collect();
        let mut loads: Vec<Vector3<f64>> = system.masses().iter().map(|mass| system.gravity() * *mass).collect();
        loads.iter_mut().zip(&system.loads().forces).for_each(|(sum, f)| *sum += f);
        let bars = (0..system.springs().len()).filter_map(|number| {
            let (ends, spring) = (system.pair(number), system.springs()[number]);
            let bears_tension_only = system.behaviour().is_tension_only(number);
            let bar = Bar { ends, stiffness: spring.stiffness, rest: spring.rest_length, bears_tension_only };
            ends.iter().any(|&p| rows[p].iter().any(Option::is_some)).then_some((number, bar))
        });
        let bars = bars.collect();
        Self { dimension: system.dimension(), masses: system.masses().to_vec(), loads, rows, order, bars }
    }

    /// What springs and loads exert on the free coordinates, and the largest component of a load or tension.
    pub fn force(&self, x: &[Vector3<f64>]) -> (DVector<f64>, f64) {
        let mut force = DVector::zeros(self.order);
        let mut acting = self.loads.iter().fold(0.0f64, |largest, f| largest.max(f.amax()));
        let mut add = |p: usize, f: Vector3<f64>| {
            for axis in 0..3 {
                if let Some(row) = self.rows[p][axis] {
                    force[row] += f[axis];
                }
            }
        };
        self.loads.iter().enumerate().for_each(|(p, f)| add(p, *f));
        for (_, bar) in &self.bars {
            let d = x[bar.ends[1]] - x[bar.ends[0]];
            let length = d.norm();
            let tension = bar.tension(length);
            acting = acting.max(tension.abs());
            if length > 0.0 {
                add(bar.ends[0], d * (tension / length));
                add(bar.ends[1], d * (-tension / length));
            }
        }
        (force, acting)
    }

    /// What rounding of the coordinates makes the stiffest spring exert, over 1e-11: the least force that residuals are compared with.
    pub fn least_acting(&self, x: &[Vector3<f64>]) -> f64 {
        let extent = x.iter().fold(0.0f64, |extent, x| extent.max(x.amax()));
        let stiffest = self.bars.iter().map(|(_, bar)| bar.stiffness / bar.gauge()).fold(0.0, f64::max);
        stiffest * extent * f64::EPSILON / 1e-11
    }

    pub fn shortest(&self, x: &[Vector3<f64>]) -> f64 {
        let lengths = self.bars.iter().map(|(_, bar)| (x[bar.ends[0]] - x[bar.ends[1]]).norm());
        lengths.filter(|length| *length > 0.0).fold(f64::INFINITY, f64::min)
    }

    fn add_block(&self, matrix: &mut DMatrix<f64>, [i, j]: [usize; 2], block: &Matrix3<f64>) {
        for (p, q, sign) in [(i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)] {
            for (a, row) in self.rows[p].iter().enumerate() {
                for (b, column) in self.rows[q].iter().enumerate() {
                    if let (Some(row), Some(column)) = (row, column) {
                        matrix[(*row, *column)] += sign * block[(a, b)];
                    }
                }
            }
        }
    }

    /// −K.
    pub fn stiffness(&self, x: &[Vector3<f64>]) -> DMatrix<f64> {
        let mut matrix = DMatrix::zeros(self.order, self.order);
        for (_, bar) in &self.bars {
            let d = x[bar.ends[1]] - x[bar.ends[0]];
            let length = d.norm();
            let n = if length > 0.0 { d / length } else { Vector3::x() };
            let axial = bar.axial(length);
            let across = match bar.rest == 0.0 {
                true => axial,
                false => bar.tension(length) / length,
            };
            let along = n * n.transpose();
            self.add_block(&mut matrix, bar.ends, &((Matrix3::identity() - along) * across + along * axial));
        }
        matrix
    }

    /// The eigenvalues of a symmetric matrix; of an empty one there are none.
    pub fn eigenvalues(matrix: DMatrix<f64>) -> Vec<f64> {
        if matrix.is_empty() { Vec::new() } else { matrix.symmetric_eigenvalues().iter().copied().collect() }
    }

    /// −K with rows and columns over the roots of the masses.
    pub fn scaled_stiffness(&self, x: &[Vector3<f64>]) -> DMatrix<f64> {
        let root = self.row_masses().map(f64::sqrt);
        let mut matrix = self.stiffness(x);
        for i in 0..self.order {
            for j in 0..self.order {
                matrix[(i, j)] /= root[i] * root[j];
            }
        }
        matrix
    }

    pub fn row_masses(&self) -> DVector<f64> {
        let mut masses = DVector::zeros(self.order);
        for (rows, mass) in self.rows.iter().zip(&self.masses) {
            rows.iter().flatten().for_each(|row| masses[*row] = *mass);
        }
        masses
    }

    /// B over all springs of the system, of which those between held particles have rows of zero.
    pub fn compatibility(&self, x: &[Vector3<f64>], springs: usize) -> DMatrix<f64> {
        let mut matrix = DMatrix::zeros(springs, self.order);
        for (number, bar) in &self.bars {
            let n = (x[bar.ends[1]] - x[bar.ends[0]]).normalize();
            for (p, sign) in [(bar.ends[0], -1.0), (bar.ends[1], 1.0)] {
                for axis in 0..3 {
                    if let Some(row) = self.rows[p][axis] {
                        matrix[(*number, row)] += sign * n[axis];
                    }
                }
            }
        }
        matrix
    }

    /// `E(x + u) − E(x)` with a bound of its rounding. A difference of lengths is `(d + δ)² − d²` over their sum, without cancellation.
    pub fn energy_change(&self, x: &[Vector3<f64>], u: &[Vector3<f64>]) -> [f64; 2] {
        let (mut change, mut rounding) = (0.0, 0.0);
        for (f, u) in self.loads.iter().zip(u) {
            change -= f.dot(u);
            rounding += f64::EPSILON * f.abs().dot(&u.abs());
        }
        for (_, bar) in &self.bars {
            let [i, j] = bar.ends;
            let (d, moved) = (x[j] - x[i], u[j] - u[i]);
            let (before, after) = (d.norm(), (d + moved).norm());
            let longer = if before + after > 0.0 { moved.dot(&(d * 2.0 + moved)) / (before + after) } else { 0.0 };
            let (slack_before, slack_after) = (bar.is_slack(before), bar.is_slack(after));
            // Up to the rest length where the spring is slack at one of the two.
            let (from, by) = match (slack_before, slack_after) {
                (false, false) => (before - bar.rest, longer),
                (true, true) => continue,
                (true, false) => (0.0, after - bar.rest),
                (false, true) => (before - bar.rest, bar.rest - before),
            };
            change += bar.stiffness / bar.gauge() * by * (from + 0.5 * by);
            let size = from.abs() + f64::EPSILON * before + by.abs();
            rounding += 4.0 * f64::EPSILON * bar.stiffness / bar.gauge() * by.abs() * (size + before);
        }
        [change, rounding]
    }

    /// Bodies that springs connect, each with the axes along which nothing holds it; a particle held along all axes joins none.
    pub fn bodies(&self) -> Vec<(Vec<usize>, [bool; 3])> {
        let is_free = |p: usize| self.rows[p].iter().any(Option::is_some);
        let mut label: Vec<usize> = (0..self.rows.len()).collect();
        loop {
            let mut changed = false;
            for (_, bar) in &self.bars {
                let [i, j] = bar.ends;
                if is_free(i) && is_free(j) && label[i] != label[j] {
                    let low = label[i].min(label[j]);
                    (label[i], label[j], changed) = (low, low, true);
                }
            }
            if !changed {
                break;
            }
        }
        let mut found = Vec::new();
        for first in 0..label.len() {
            let members: Vec<usize> = (0..label.len()).filter(|&p| label[p] == first && is_free(p)).collect();
            if members.is_empty() {
                continue;
            }
            let touches_support = self.bars.iter().any(|(_, bar)| {
                let [i, j] = bar.ends;
                (label[i] == first && is_free(i) && !is_free(j)) || (label[j] == first && is_free(j) && !is_free(i))
            });
            let open = [0, 1, 2].map(|axis| {
                axis < self.dimension && !touches_support && members.iter().all(|&p| self.rows[p][axis].is_some())
            });
            found.push((members, open));
        }
        found
    }

    /// Particles of bodies that fall: along an axis on which nothing holds them, loads do not add up to zero.
    pub fn falling(&self) -> Vec<usize> {
        let mut found: Vec<usize> = Vec::new();
        for (members, open) in self.bodies() {
            let falls = (0..3).any(|axis| {
                let sum: f64 = members.iter().map(|&p| self.loads[p][axis]).sum();
                let size: f64 = members.iter().map(|&p| self.loads[p][axis].abs()).sum();
                open[axis] && sum.abs() > 1e-12 * size
            });
            if falls {
                found.extend(members);
            }
        }
        found.sort_unstable();
        found
    }
}

/// The end of a motion from a displaced position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Return {
    /// The energy of the displacement is gone, up to a thousandth.
    Returned,
    /// The energy fell below that of the start.
    Escaped,
    /// Neither, within the steps.
    Slow,
    /// The energy of the displacement is lost in rounding.
    Unclear,
}

/// Dynamic relaxation: unit steps of Newton's equations, each particle with a mass of which no vibration is too fast for them, all velocities set to zero
/// wherever the kinetic energy has passed a maximum.
pub fn relax(model: &Model, state: &State, displacement: &[Vector3<f64>], steps: usize) -> Return {
    let x = &state.positions;
    let mut u = displacement.to_vec();
    let [start, rounding] = model.energy_change(x, &u);
    if start.abs() <= 1e4 * rounding {
        return Return::Unclear;
    }
    if start < 0.0 {
        return Return::Escaped;
    }
    let stiffness = model.stiffness(x);
    // Twice Gershgorin's bound, as the stiffness changes on the way.
    let masses: Vec<f64> = (0..model.order).map(|row| 2.0 * stiffness.row(row).abs().sum()).collect();
    let mut velocity = DVector::<f64>::zeros(model.order);
    let mut kinetic = 0.0;
    let mut at: Vec<Vector3<f64>> = x.clone();
    for step in 0..steps {
        at.iter_mut().zip(x).zip(&u).for_each(|((at, x), u)| *at = x + u);
        let (force, _) = model.force(&at);
        let mut now = 0.0;
        for row in 0..model.order {
            velocity[row] += force[row] / masses[row];
            now += masses[row] * velocity[row].powi(2);
        }
        if now < kinetic {
            velocity.fill(0.0);
            now = 0.0;
        }
        kinetic = now;
        for (u, rows) in u.iter_mut().zip(&model.rows) {
            for axis in 0..3 {
                if let Some(row) = rows[axis] {
                    u[axis] += velocity[row];
                }
            }
        }
        if step % 10 == 0 {
            let [change, rounding] = model.energy_change(x, &u);
            if change < -(1e-3 * start + 10.0 * rounding) {
                return Return::Escaped;
            }
            if change < 1e-3 * start {
                return Return::Returned;
            }
        }
    }
    Return::Slow
}

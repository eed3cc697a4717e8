//! A system from any bytes.

use nalgebra::Vector3;
use sprung::integrate::{ImplicitOptions, Method, StiffnessPolicy};
use sprung::linear::{PreconditionerKind, SolverChoice, SolverOptions, Tolerance};
use sprung::system::Axes;
use sprung::{Constraint, Motion, Spring, State, System, SystemBuilder};

/// Bytes that choices are read from; zeros when they are used up.
pub struct Bytes<'a> {
    rest: &'a [u8],
}

impl<'a> Bytes<'a> {
    pub fn new(rest: &'a [u8]) -> Self {
        Self { rest }
    }

    fn byte(&mut self) -> u8 {
        let (first, rest) = self.rest.split_first().map_or((0, self.rest), |(first, rest)| (*first, rest));
        self.rest = rest;
        first
    }

    pub fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[usize::from(self.byte()) % choices.len()]
    }

    /// Log-uniform; of 16 bits, so that equal numbers come up.
    pub fn number(&mut self, low: f64, high: f64) -> f64 {
        let share = f64::from(u16::from_le_bytes([self.byte(), self.byte()])) / f64::from(u16::MAX);
        low * (high / low).powf(share)
    }

    /// From −1 to 1, now and then far beyond.
    fn coordinate(&mut self) -> f64 {
        let plain = f64::from(self.byte()) / 127.5 - 1.0;
        match self.byte() {
            0 => plain * 1e150,
            1 => plain * 1e-150,
            2 => plain * 1e8,
            fine => plain + f64::from(fine) * 1e-5,
        }
    }

    fn vector(&mut self, dimension: usize) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| if axis < dimension { self.coordinate() } else { 0.0 })
    }

    /// Up to twelve particles and forty springs; `None` where the description is refused.
    pub fn system(&mut self) -> Option<(System, State)> {
        let dimension = self.pick(&[1, 2, 3, 3]);
        let particles = usize::from(self.byte() % 12) + 1;
        let (low, high) = self.pick(&[(1e-2, 1e2), (1e-2, 1e2), (1e-12, 1e12), (1e-300, 1e300)]);
        let mut builder = SystemBuilder { dimension, gravity: self.vector(dimension), ..SystemBuilder::new() };
        for _ in 0..particles {
            builder.positions.push(self.vector(dimension));
            builder.velocities.push(self.vector(dimension));
            builder.masses.push(self.number(low, high));
        }
        for _ in 0..self.byte() % 40 {
            let [i, j] = [self.byte(), self.byte()].map(|p| u32::from(p) % particles as u32);
            let damping = if self.byte().is_multiple_of(2) { 0.0 } else { self.number(low, high) };
            let spring = Spring { stiffness: self.number(low, high), rest_length: self.number(low, high), damping };
            let length = builder.positions[i as usize] - builder.positions[j as usize];
            if i != j && length.norm() > 0.0 {
                builder.pairs.push([i, j]);
                builder.springs.push(spring);
            }
        }
        for _ in 0..self.byte() % 4 {
            let particle = usize::from(self.byte()) % particles;
            let axes = Axes::of(self.pick(&[&[0][..], &[0, 1], &[1, 2], &[0, 1, 2]]));
            let motion = match self.byte() % 3 {
                0 => Motion::Held,
                1 => Motion::Velocity(self.vector(dimension)),
                _ => Motion::Path {
                    times: vec![0.0, 0.01, 1.0],
                    offsets: (0..3).map(|_| self.vector(dimension)).collect(),
                },
            };
            builder.constraints.push(Constraint { particles: vec![particle], axes, motion });
        }
        builder.build().ok()
    }

    pub fn method(&mut self) -> Method {
        self.pick(&Method::ALL)
    }

    pub fn options(&mut self) -> ImplicitOptions {
        use SolverChoice::{Auto, Cg, CgAssembled, Ldlt, Llt};
        let stiffness = self.pick(&StiffnessPolicy::ALL);
        let kinds = [
            None,
            Some(PreconditionerKind::None),
            Some(PreconditionerKind::Jacobi),
            Some(PreconditionerKind::BlockJacobi),
            Some(PreconditionerKind::Multigrid),
        ];
        let solver = self.pick(&[Auto, Llt, Ldlt, Cg, CgAssembled]);
        let preconditioner = self.pick(&kinds);
        let fixed = [1e-10, 1e-4, 1e-13].map(Tolerance::Fixed);
        let tolerance = self.pick(&[fixed[0], fixed[1], fixed[2], Tolerance::Adaptive]);
        let linear = SolverOptions { solver, preconditioner, tolerance, ..SolverOptions::default() };
        ImplicitOptions { stiffness, linear }
    }
}

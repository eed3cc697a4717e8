//! A step of linear backward Euler under random rounding, from positions to momentum: what the suite allows its products, solves and sums holds
//! whatever way each operation rounds.
//!
//! The reference path is written a second time, dense: blocks of springs, A and b, Cholesky's and the conjugate gradients' solutions, and the
//! momentum that is left. Errors are measured in twice the precision, in units of 2u; see [`stochastic`](super::stochastic).

use crate::stochastic::{DRAWS, Stochastic, UNIT};

type Number = Stochastic;

/// Particles on the corners of a disturbed cube, every pair joined.
const CORNERS: usize = 8;
const N: usize = 3 * CORNERS;
const DT: f64 = 0.1;
const GRAVITY: [f64; 3] = [0.3, -9.81, 0.1];

/// Roundings that the suite allows.
const ALLOWED: f64 = 30.0;

fn number(x: f64) -> Number {
    Stochastic(x)
}

fn sum(terms: impl IntoIterator<Item = Number>) -> Number {
    terms.into_iter().fold(number(0.0), |sum, term| sum + term)
}

fn dot(a: &[Number], b: &[Number]) -> Number {
    sum(a.iter().zip(b).map(|(a, b)| *a * *b))
}

/// Some fixed number between 0 and 1.
fn fixed(k: usize) -> f64 {
    (f64::from(k as u32) * 12.9898).sin().abs()
}

fn mass(p: usize) -> f64 {
    1.0 + fixed(p + 90)
}

fn position(p: usize) -> [f64; 3] {
    [0, 1, 2].map(|axis| f64::from((p >> axis & 1) as u32) + 0.2 * fixed(3 * p + axis))
}

fn velocity(p: usize) -> [f64; 3] {
    [0, 1, 2].map(|axis| fixed(3 * p + axis + 50) - 0.5)
}

/// What springs give to a step: A by rows, b, and the largest elastic force.
struct Step {
    a: Vec<Vec<Number>>,
    b: Vec<Number>,
    blocks: Vec<([usize; 2], [[Number; 3]; 3])>,
    pull: f64,
}

fn step() -> Step {
    let zero = number(0.0);
    let (mut a, mut b) = (vec![vec![zero; N]; N], vec![zero; N]);
    let [dt, one] = [DT, 1.0].map(number);
    let (mut blocks, mut pull) = (Vec::new(), 0.0f64);
    for p in 0..CORNERS {
        let m = number(mass(p));
        for (axis, (v, g)) in velocity(p).into_iter().zip(GRAVITY).enumerate() {
            let k = 3 * p + axis;
            a[k][k] = m / (dt * dt);
            b[k] = m * number(v) / dt + m * number(g);
        }
    }
    for (i, j) in (0..CORNERS).flat_map(|i| (0..i).map(move |j| (i, j))) {
        let [stiffness, rest, damping] = [40.0 + 60.0 * fixed(i), 0.7, 0.4].map(number);
        let [xi, xj] = [position(i), position(j)];
        let d: [Number; 3] = std::array::from_fn(|axis| number(xi[axis]) - number(xj[axis]));
        let l = dot(&d, &d).sqrt();
        let n = d.map(|component| component / l);
        let strain = (l - rest) / rest;
        let (axial, across) = (stiffness / rest, stiffness * strain / l);
        let along = axial + damping / dt;
        let block: [[Number; 3]; 3] = std::array::from_fn(|r| {
            std::array::from_fn(|c| {
                let outer = n[r] * n[c];
                across * ((if r == c { one } else { zero }) - outer) + along * outer
            })
        });
        for r in 0..3 {
            let force = stiffness * strain * n[r];
            pull = pull.max(force.0.abs());
            b[3 * i + r] = b[3 * i + r] - force;
            b[3 * j + r] = b[3 * j + r] + force;
            for (p, q, sign) in [(i, i, one), (j, j, one), (i, j, -one), (j, i, -one)] {
                (0..3).for_each(|c| a[3 * p + r][3 * q + c] = a[3 * p + r][3 * q + c] + sign * block[r][c]);
            }
        }
        blocks.push(([i, j], block));
    }
    Step { a, b, blocks, pull }
}

impl Step {
    /// `A w` without A.
    fn product(&self, w: &[Number]) -> Vec<Number> {
        let dt = number(DT);
        let mut y: Vec<Number> = (0..N).map(|k| number(mass(k / 3)) * w[k] / (dt * dt)).collect();
        for ([i, j], block) in &self.blocks {
            let between: [Number; 3] = std::array::from_fn(|axis| w[3 * i + axis] - w[3 * j + axis]);
            for (r, row) in block.iter().enumerate() {
                let force = dot(row, &between);
                y[3 * i + r] = y[3 * i + r] + force;
                y[3 * j + r] = y[3 * j + r] - force;
            }
        }
        y
    }

    /// By the factorization `A = L Lᵀ`.
    fn cholesky(&self) -> Vec<Number> {
        let mut l = self.a.clone();
        for k in 0..N {
            for row in k..N {
                let rest = l[row][k] - dot(&l[row][..k], &l[k][..k]);
                l[row][k] = if row == k { rest.sqrt() } else { rest / l[k][k] };
            }
        }
        let mut x = self.b.clone();
        for k in 0..N {
            x[k] = (x[k] - dot(&l[k][..k], &x[..k])) / l[k][k];
        }
        for k in (0..N).rev() {
            x[k] = (x[k] - sum((k + 1..N).map(|row| l[row][k] * x[row]))) / l[k][k];
        }
        x
    }

    /// By conjugate gradients, with the residual that the recurrence claims at the end.
    fn conjugate_gradients(&self) -> (Vec<Number>, Vec<Number>) {
        let (mut x, mut r) = (vec![number(0.0); N], self.b.clone());
        let mut p = r.clone();
        let mut square = dot(&r, &r);
        let end = 1e-20 * square.0;
        while square.0 > end {
            let q = self.product(&p);
            let alpha = square / dot(&p, &q);
            x.iter_mut().zip(&p).for_each(|(x, p)| *x = *x + alpha * *p);
            r.iter_mut().zip(&q).for_each(|(r, q)| *r = *r - alpha * *q);
            let next = dot(&r, &r);
            let beta = next / square;
            p.iter_mut().zip(&r).for_each(|(p, r)| *p = *r + beta * *p);
            square = next;
        }
        (x, r)
    }

    fn norm(&self) -> f64 {
        self.a.iter().map(|row| row.iter().map(|a| a.0.abs()).sum::<f64>()).fold(0.0, f64::max)
    }

    /// `(b − A x)_i` in twice the precision.
    fn residual(&self, x: &[Number], row: usize) -> f64 {
        let mut total = [self.b[row].0, 0.0];
        for (Stochastic(a), Stochastic(x)) in self.a[row].iter().zip(x) {
            let product = -a * x;
            let sum = total[0] + product;
            let part = sum - total[0];
            total[1] += (-a).mul_add(*x, -product) + ((total[0] - (sum - part)) + (product - part));
            total[0] = sum;
        }
        total[0] + total[1]
    }
}

fn largest(of: impl Iterator<Item = f64>) -> f64 {
    of.fold(0.0, f64::max)
}

/// Products with and without a matrix, backward errors of Cholesky's solution, the residual that conjugate gradients claim, and the momentum after
/// the step: no draw uses more than its bound, and the worst of them more than a hundredth of it.
#[test]
fn bounds_of_a_step_hold_however_it_is_rounded() {
    const NAMES: [&str; 4] = ["product", "Cholesky", "conjugate gradients", "momentum"];
    let w: Vec<Number> = (0..N).map(|k| number(fixed(k + 7) - 0.5)).collect();
    let mut most = [0.0f64; 4];
    for _ in 0..DRAWS {
        let at = step();
        let free = at.product(&w);
        let product = largest((0..N).map(|row| {
            let size: f64 = at.a[row].iter().zip(&w).map(|(a, w)| (a.0 * w.0).abs()).sum();
            (dot(&at.a[row], &w).0 - free[row].0).abs() / size
        }));
        let size =
            |x: &[Number]| at.norm() * largest(x.iter().map(|x| x.0.abs())) + largest(at.b.iter().map(|b| b.0.abs()));
        let x = at.cholesky();
        let solved = largest((0..N).map(|row| at.residual(&x, row).abs())) / size(&x);
        let (y, claimed) = at.conjugate_gradients();
        let left = largest((0..N).map(|row| (at.residual(&y, row) - claimed[row].0).abs())) / size(&y);
        // By the velocities δx/dt, in the exact sums of the suite's unit: forces that add up to nothing.
        let momentum = largest((0..3).map(|axis| {
            let change =
                |p: usize| mass(p) * ((x[3 * p + axis] / number(DT)).0 - velocity(p)[axis] - DT * GRAVITY[axis]);
            (0..CORNERS).map(change).sum::<f64>().abs()
        }));
        let speeds = (0..N).map(|k| mass(k / 3) * (velocity(k / 3)[k % 3].abs() + x[k].0.abs() / DT) / DT);
        let weight = 9.81 * largest((0..CORNERS).map(mass));
        let forces = at.norm() * largest(x.iter().map(|x| x.0.abs())) + largest(speeds) + weight + at.pull;
        let errors = [product, solved, left, momentum / (CORNERS as f64 * DT * forces)];
        for (k, error) in errors.into_iter().enumerate() {
            let used = error / (ALLOWED * UNIT);
            assert!(used <= 1.0, "{}: {used} of its bound", NAMES[k]);
            most[k] = most[k].max(used);
        }
    }
    println!("worst of the bounds used: {most:.3?}");
    assert!(most.iter().all(|used| *used > 0.01), "{most:?}");
}

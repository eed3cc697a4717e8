//! The mathematics of one spring, without indices.
//!
//! A spring joins two particles i and j. With `d = x_i − x_j`, `l = ‖d‖`, `n = d/l` and the strain `l/l0 − 1`:
//!
//! | quantity | formula | unit |
//! |---|---|---|
//! | elastic force on i | `−k (l/l0 − 1) n` | N |
//! | elastic energy | `½ k (l − l0)²/l0` | J |
//! | damping force on i | `−b n nᵀ (v_i − v_j)` | N |
//! | stiffness block `K^s` | `k (1/l0 − 1/l) (I − nnᵀ) + (k/l0) nnᵀ` | N/m |
//! | damping block | `b nnᵀ` | N·s/m |
//!
//! The force on j is the opposite. `k` is a force (N per unit strain), not N/m: the stiffness against a change of length is `k/l0`. `K^s` is the
//! negative Jacobian of the force on i, `∂f_i/∂x_i = −K^s`, `∂f_i/∂x_j = +K^s`; it follows from `∂l/∂x_i = n` and `∂n/∂x_i = (I − nnᵀ)/l`. Source:
//! lecture notes "Review of Backward Euler Implementation", CS838-2, University of Wisconsin–Madison, 7 October 2011, whose force law this is. The
//! derivation is in the guide (`cargo xtask guide`), under theory: `spring`.
//!
//! A spring may have no rest length, `l0 = 0`. Then k is in N/m, the force is `−k d`, the energy `½ k l²`, and `K^s = k I` under every option: the
//! formulas hold with the [gauge length](Spring::gauge_length) of 1 m in place of l0. Such a spring may have length zero, where its damping vanishes.
//!
//! At `l = l0` the transverse coefficient is zero, so all options agree. It tends to −∞ as `l → 0`; at `l = 0` the direction does not exist and
//! [`Extension::between`] returns `None`: ends nearer than about 1e-162 m coincide, as their squared distance underflows.
//!
//! # Spring laws
//!
//! A [`SpringLaw`] replaces `T = k (l/l0 − 1)` by any tension T(l). At a given length it is represented by its *tangent*, the spring of the built-in
//! law with the same tension and the same slope `T' = dT/dl`, `k = T' l − T` and `l0 = k/T'`. Forces, stiffness blocks, options and the sign of the
//! tension all follow from the tangent; energies come from the law itself.
//!
//! Where tension does not rise with length there is no tangent, and `K^s` is indefinite along the spring. The slope is then replaced by 1e-9 of the
//! spring's own `k/l0`: forces stay exact. A tangent through `T = 0` at `l = 0` has no rest length; its slope is raised by 1e-8.

use nalgebra::{Matrix3, Vector3};
use std::fmt::Debug;

/// The parameters of one spring.
///
/// # Examples
/// ```
/// use sprung::nalgebra::Vector3;
/// use sprung::spring::{Extension, Spring, Stiffness};
///
/// let spring = Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 };
/// let at = Extension::between(&Vector3::new(3.0, 0.0, 0.0), &Vector3::zeros()).ok_or("coincident ends")?;
/// assert_eq!(spring.elastic_force(&at), Vector3::new(-10.0, 0.0, 0.0)); // 20 N · (3/2 − 1), pulling back
/// assert_eq!(spring.elastic_energy(&at), 5.0);
/// assert_eq!(spring.stiffness_block(&at, Stiffness::Full).axial, 10.0); // k/l0
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spring {
    /// k, the force per unit strain, in N; positive. The force per metre, in N/m, where the rest length is zero.
    pub stiffness: f64,
    /// l0, the rest length, in m; not negative.
    pub rest_length: f64,
    /// b, the damping along the spring, in N·s/m; not negative.
    pub damping: f64,
}

/// The stiffness block that enters the system matrix: options I, II and III of the lecture notes, and the absolute values of its eigenvalues.
///
/// Forces do not depend on it. Under all but `Full` every block is positive semidefinite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stiffness {
    /// The exact `K^s`. Indefinite for a compressed spring (`l < l0`).
    #[doc(alias = "option I")]
    Full,
    /// Drops the transverse term of compressed springs.
    #[doc(alias = "option II")]
    Tension,
    /// Drops the transverse term of every spring.
    #[doc(alias = "option III")]
    Axial,
    /// Every eigenvalue of `K^s` by its absolute value: `k |1/l0 − 1/l|` in place of the transverse coefficient.
    ///
    /// The minimum of such a quadratic model is as far away, along each eigenvector, as the maximum of the exact one. Source: Chen, Liu, Jacobson,
    /// Levin and Zheng, "Stabler Neo-Hookean Simulation: Absolute Eigenvalue Filtering for Projected Newton", SIGGRAPH 2024.
    Absolute,
}

impl Stiffness {
    /// The three options in the order of the lecture notes, and the absolute values.
    pub const ALL: [Self; 4] = [Self::Full, Self::Tension, Self::Axial, Self::Absolute];

    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Tension => "tension",
            Self::Axial => "axial",
            Self::Absolute => "absolute",
        }
    }
}

/// The direction and length of a spring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extension {
    /// n, the unit vector from j to i.
    pub direction: Vector3<f64>,
    /// l, in m.
    pub length: f64,
}

impl Extension {
    /// Coincident ends; the direction is arbitrary.
    pub(crate) const COLLAPSED: Self = Self { direction: Vector3::new(1.0, 0.0, 0.0), length: 0.0 };

    /// The extension between two positions, in m; `None` when they coincide.
    pub fn between(xi: &Vector3<f64>, xj: &Vector3<f64>) -> Option<Self> {
        let d = xi - xj;
        let length = d.norm();
        (length != 0.0).then(|| Self { direction: d / length, length })
    }
}

impl Spring {
    /// The length over which strain is measured, in m: the rest length, or 1 m if that is zero.
    #[inline]
    pub fn gauge_length(&self) -> f64 {
        if self.rest_length == 0.0 { 1.0 } else { self.rest_length }
    }

    /// `k/l0`, the stiffness against a change of length, in N/m.
    #[inline]
    pub fn axial_stiffness(&self) -> f64 {
        self.stiffness / self.gauge_length()
    }

    /// `l/l0 − 1`, negative under compression. Computed as `(l − l0)/l0`, whose difference is exact near rest.
    pub fn strain(&self, at: &Extension) -> f64 {
        (at.length - self.rest_length) / self.gauge_length()
    }

    /// True if the spring is shorter than its rest length, so that its transverse coefficient is negative.
    pub fn is_compressed(&self, at: &Extension) -> bool {
        at.length < self.rest_length
    }

    /// Elastic force on end i, `−k (l/l0 − 1) n`, in N.
    pub fn elastic_force(&self, at: &Extension) -> Vector3<f64> {
        at.direction * (-self.stiffness * self.strain(at))
    }

    /// Elastic energy `½ k (l − l0)²/l0`, in J.
    pub fn elastic_energy(&self, at: &Extension) -> f64 {
        let strain = self.strain(at);
        0.5 * self.stiffness * self.gauge_length() * strain * strain
    }

    /// Damping force on end i, `−b n nᵀ v` with `v = v_i − v_j`, in N.
    pub fn damping_force(&self, at: &Extension, v: &Vector3<f64>) -> Vector3<f64> {
        if at.length == 0.0 {
            return Vector3::zeros();
        }
        at.direction * (-self.damping * at.direction.dot(v))
    }

    /// Change of the damping force on end i when the ends move by `δd = δx_i − δx_j` at a fixed `v = v_i − v_j`, in N:
    /// `−b ((nᵀv) Pδd + n (vᵀPδd))` with `P = (I − nnᵀ)/l`, since `δn = Pδd`.
    pub fn damping_differential(&self, at: &Extension, v: &Vector3<f64>, d: &Vector3<f64>) -> Vector3<f64> {
        if at.length == 0.0 {
            return Vector3::zeros();
        }
        let n = &at.direction;
        let turn = (d - n * n.dot(d)) / at.length;
        (turn * n.dot(v) + n * v.dot(&turn)) * -self.damping
    }

    /// The stiffness block `K^s` under an option, in N/m.
    pub fn stiffness_block(&self, at: &Extension, option: Stiffness) -> SpringBlock {
        // No branch on compression: mispredictions cost more than the division below.
        let elongation = at.length - self.rest_length;
        let elongation = match option {
            Stiffness::Full => elongation,
            Stiffness::Tension => elongation.max(0.0),
            Stiffness::Axial => 0.0,
            Stiffness::Absolute => elongation.abs(),
        };
        // k (1/l0 − 1/l); the difference l − l0 is exact near rest.
        let transverse = self.stiffness * elongation / (self.rest_length * at.length);
        let axial = self.axial_stiffness();
        let transverse = if self.rest_length == 0.0 { axial } else { transverse };
        SpringBlock { direction: at.direction, transverse, axial }
    }

    /// The damping block `b nnᵀ`, in N·s/m.
    pub fn damping_block(&self, at: &Extension) -> SpringBlock {
        let axial = if at.length == 0.0 { 0.0 } else { self.damping };
        SpringBlock { direction: at.direction, transverse: 0.0, axial }
    }
}

/// The symmetric block `α (I − nnᵀ) + β nnᵀ` that a spring puts between its ends.
///
/// Its eigenvalues are α (twice) and β.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpringBlock {
    /// n, the spring's direction.
    pub direction: Vector3<f64>,
    /// α, the coefficient across the spring.
    pub transverse: f64,
    /// β, the coefficient along the spring.
    pub axial: f64,
}

impl std::ops::Mul<f64> for SpringBlock {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self { transverse: self.transverse * factor, axial: self.axial * factor, ..self }
    }
}

/// The sum of two blocks with the same direction.
impl std::ops::Add for SpringBlock {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { transverse: self.transverse + other.transverse, axial: self.axial + other.axial, ..self }
    }
}

impl SpringBlock {
    /// The smaller eigenvalue, `min(α, β)`.
    pub fn lowest(&self) -> f64 {
        self.transverse.min(self.axial)
    }

    /// The 3×3 matrix; symmetric to the bit.
    ///
    /// `1 − n_r²` on the diagonal is computed as the sum of the other two squares: near collapse, `|α| ≫ β`, the difference would lose β.
    pub fn matrix(&self) -> Matrix3<f64> {
        let Self { direction: n, transverse, axial } = self;
        let [xx, yy, zz] = [n.x * n.x, n.y * n.y, n.z * n.z];
        let diagonal = |along: f64, across: f64| axial * along + transverse * across;
        let excess = axial - transverse;
        let [xy, xz, yz] = [excess * (n.x * n.y), excess * (n.x * n.z), excess * (n.y * n.z)];
        Matrix3::new(
            diagonal(xx, yy + zz),
            xy,
            xz, //
            xy,
            diagonal(yy, xx + zz),
            yz, //
            xz,
            yz,
            diagonal(zz, xx + yy),
        )
    }

    /// The product with a vector, by [`matrix`](Self::matrix), so that matrix-free and assembled products have the same rounding error.
    #[inline]
    pub fn apply(&self, d: &Vector3<f64>) -> Vector3<f64> {
        self.matrix() * d
    }
}

/// The tension of a spring law at one length, and its slope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tension {
    /// T, in N; positive where the spring pulls its ends together.
    pub force: f64,
    /// T', in N/m.
    pub slope: f64,
}

/// A force law for all springs of a system in place of `T = k (l/l0 − 1)`; see
/// [`System::with_spring_law`](crate::System::with_spring_law). Damping along the spring is not affected.
///
/// # Examples
/// Springs that stiffen with the cube of their strain:
///
/// ```
/// use sprung::Spring;
/// use sprung::spring::{SpringLaw, Tension};
///
/// #[derive(Debug)]
/// struct Cubic;
///
/// impl SpringLaw for Cubic {
///     fn tension(&self, _: usize, spring: &Spring, length: f64) -> Tension {
///         let (k, strain) = (spring.stiffness, length / spring.rest_length - 1.0);
///         Tension { force: k * (strain + strain.powi(3)), slope: k * (1.0 + 3.0 * strain * strain) / spring.rest_length }
///     }
///
///     fn energy(&self, _: usize, spring: &Spring, length: f64) -> f64 {
///         let strain = length / spring.rest_length - 1.0;
///         spring.stiffness * spring.rest_length * (strain.powi(2) / 2.0 + strain.powi(4) / 4.0)
///     }
/// }
///
/// let spring = Spring { stiffness: 8.0, rest_length: 2.0, damping: 0.0 };
/// assert_eq!(Cubic.tension(0, &spring, 4.0), Tension { force: 16.0, slope: 16.0 });
/// ```
pub trait SpringLaw: Debug + Send + Sync {
    /// The tension of spring `number` with parameters `spring` at `length`, in m.
    fn tension(&self, number: usize, spring: &Spring, length: f64) -> Tension;

    /// The stored energy `∫ T dl` at `length`, in J. If it does not match the tension, line searches fail and runs end as `unstable`.
    fn energy(&self, number: usize, spring: &Spring, length: f64) -> f64;

    /// True if [`values`](Self::values) is to be called once for all springs, which pays for laws with costly calls, such as those written in Python.
    fn is_asked_at_once(&self) -> bool {
        false
    }

    /// Tension and energy of all springs of the system, those between held particles included, in order.
    fn values(&self, springs: &[Spring], lengths: &[f64]) -> Vec<LawValue> {
        let each = springs.iter().zip(lengths).enumerate();
        let value = |(number, (spring, &length)): (usize, (&Spring, &f64))| LawValue {
            tension: self.tension(number, spring, length),
            energy: self.energy(number, spring, length),
        };
        each.map(value).collect()
    }
}

/// Tension and energy of one spring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawValue {
    /// T and T'.
    pub tension: Tension,
    /// The stored energy, in J.
    pub energy: f64,
}

/// The values of a law that is evaluated for all springs at once; empty for other laws, which are evaluated spring by spring.
#[derive(Debug, Clone, Default)]
pub(crate) struct LawValues(Vec<LawValue>);

impl LawValues {
    /// No values.
    pub(crate) const NONE: &'static Self = &Self(Vec::new());

    /// The values at these lengths.
    pub(crate) fn of(law: &dyn SpringLaw, springs: &[Spring], lengths: &[f64]) -> Self {
        Self(law.values(springs, lengths))
    }

    /// The values of one spring.
    #[inline]
    pub(crate) fn get(&self, number: usize) -> Option<&LawValue> {
        self.0.get(number)
    }
}

impl Spring {
    /// The spring of the built-in law with the given tension and slope at `length`, and this spring's damping.
    pub(crate) fn tangent(&self, Tension { force, slope }: Tension, length: f64) -> Self {
        let mut slope = slope.max(1e-9 * self.axial_stiffness());
        if (slope * length - force).abs() < 1e-9 * slope * length {
            slope *= 1.0 + 1e-8;
        }
        let stiffness = slope * length - force;
        Self { stiffness, rest_length: stiffness / slope, damping: self.damping }
    }
}

#[cfg(test)]
mod tests {
    use super::{Extension, Spring, SpringBlock, Stiffness, Tension};
    use nalgebra::{Matrix3, Vector3};

    /// I + 9 nnᵀ with n = (2, −1, 2)/3.
    #[test]
    fn a_block_is_a_matrix_and_its_products() {
        let direction = Vector3::new(2.0, -1.0, 2.0) / 3.0;
        let block = SpringBlock { direction, transverse: 1.0, axial: 10.0 };
        let expected = Matrix3::new(5.0, -2.0, 4.0, -2.0, 2.0, -2.0, 4.0, -2.0, 5.0);
        assert!((block.matrix() - expected).amax() < 1e-14, "{}", block.matrix());
        assert!((block.apply(&Vector3::new(1.0, 2.0, 3.0)) - Vector3::new(13.0, -4.0, 15.0)).amax() < 1e-13);
        // Across a spring along an axis nothing is lost of what is small along it.
        let along = SpringBlock { direction: Vector3::x(), transverse: -1e20, axial: 3.0 };
        assert_eq!(along.matrix(), Matrix3::from_diagonal(&Vector3::new(3.0, -1e20, -1e20)));
    }

    /// Force and both coefficients of the block, of pulling and pushing springs; the force does not depend on a slope that is not positive.
    #[test]
    fn tangents_have_the_tension_and_its_slope() {
        let own = Spring { stiffness: 5.0, rest_length: 1.0, damping: 0.5 };
        for (force, slope) in [(3.0, 4.0), (-3.0, 4.0), (50.0, 4.0), (8.0, 4.0), (0.0, 1.0), (2.0, 0.0), (-2.0, -7.0)] {
            let at = Extension { direction: Vector3::x(), length: 2.0 };
            let tangent = own.tangent(Tension { force, slope }, at.length);
            assert!((tangent.elastic_force(&at).x + force).abs() < 1e-12 * (1.0 + force.abs()), "{force} {slope}");
            let block = tangent.stiffness_block(&at, Stiffness::Full);
            assert!((block.transverse - force / 2.0).abs() < 1e-12 * (1.0 + force.abs()), "{force} {slope}");
            assert!((block.axial - slope.max(0.0)).abs() < 1e-7, "{force} {slope}: {}", block.axial);
            assert!(tangent.stiffness_block(&at, Stiffness::Tension).transverse >= 0.0);
            assert_eq!(tangent.damping, 0.5);
        }
    }

    /// The slope is raised by 1e-8 near T = T' l, and to 1e-9 k/l0 = 2.5e-9 below that.
    #[test]
    fn slopes_are_changed_only_where_there_is_no_tangent() {
        let own = Spring { stiffness: 5.0, rest_length: 2.0, damping: 0.0 };
        let slope = |force: f64, slope: f64| {
            let tangent = own.tangent(Tension { force, slope }, 2.0);
            tangent.stiffness / tangent.rest_length
        };
        let more = 4.0 * (1.0 + 1e-8);
        for (off, expected) in [(-2e-9, 4.0), (-5e-10, more), (0.0, more), (5e-10, more), (2e-9, 4.0)] {
            let found = slope(8.0 * (1.0 + off), 4.0);
            assert!((found / expected - 1.0).abs() < 1e-14, "{off} {found}");
        }
        for (given, expected) in [(-1.0, 2.5e-9), (2e-9, 2.5e-9), (3e-9, 3e-9)] {
            assert!((slope(1.0, given) / expected - 1.0).abs() < 1e-14, "{given}");
        }
    }
}

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
//! The force on j is the opposite. `k` is a force (N per unit strain), not N/m: the stiffness against a change of
//! length is `k/l0`. `K^s` is the negative Jacobian of the force on i, `∂f_i/∂x_i = −K^s`, `∂f_i/∂x_j = +K^s`; it follows
//! from `∂l/∂x_i = n` and `∂n/∂x_i = (I − nnᵀ)/l`. Source: lecture notes "Review of Backward Euler Implementation",
//! CS838-2, University of Wisconsin–Madison, 7 October 2011, whose force law this is; the derivation is our own.
//!
//! A spring may have no rest length, `l0 = 0`. Its k is then in N/m, and all formulas hold with 1 m in place of l0 where something is divided by it or
//! multiplied with it, the [gauge length](Spring::gauge_length): the force is `−k d`, the energy `½ k l²`, and `K^s = k I` under every option. It
//! may lie at length zero; damping, which is along the spring, has no direction there and vanishes.
//!
//! **Edge cases.** At `l = l0` the transverse coefficient is zero, so all options agree. As `l → 0` it tends to −∞:
//! a spring may be short, and its block is right to rounding, but at `l = 0` the direction does not exist and
//! [`Extension::between`] returns `None`. The test is on the computed length, so ends nearer than about
//! 1e-162 m, whose squared distance underflows, count as coincident too.
//!
//! Derivations are in the guide (`cargo xtask guide`), under theory: `spring`.

mod law;

pub(crate) use law::LawValues;
pub use law::{LawValue, SpringLaw, Tension};

use nalgebra::{Matrix3, Vector3};

/// Parameters of one spring.
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

/// Which part of the stiffness block enters the system matrix: options I, II and III of the lecture notes.
///
/// Forces are never changed, only the matrix is. Under `Tension` and `Axial` every block is positive semidefinite.
///
/// # Examples
/// ```
/// use nalgebra::Vector3;
/// use sprung::spring::Extension;
/// use sprung::{Spring, Stiffness};
///
/// let spring = Spring { stiffness: 20.0, rest_length: 2.0, damping: 0.0 };
/// let d = Vector3::new(1.0, 0.0, 0.0);
/// let extension = Extension::between(&d, &Vector3::zeros()).ok_or("coincident ends")?;
/// let block = |option| spring.stiffness_block(&extension, option).matrix();
/// // k/l0 along the spring; across it k (1/l0 − 1/l), negative under compression, which `tension` leaves out.
/// assert_eq!(block(Stiffness::Full).diagonal(), Vector3::new(10.0, -10.0, -10.0));
/// assert_eq!(block(Stiffness::Tension).diagonal(), Vector3::new(10.0, 0.0, 0.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
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
}

impl Stiffness {
    /// The three options in the order of the lecture notes.
    pub const ALL: [Self; 3] = [Self::Full, Self::Tension, Self::Axial];

    /// The name used on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::Tension => "tension",
            Self::Axial => "axial",
        }
    }
}

/// Where a spring's ends are relative to each other: its direction and length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extension {
    /// n, the unit vector from j to i.
    pub direction: Vector3<f64>,
    /// l, in m.
    pub length: f64,
}

impl Extension {
    /// Of ends that coincide, in any direction.
    pub(crate) const COLLAPSED: Self = Self { direction: Vector3::new(1.0, 0.0, 0.0), length: 0.0 };

    /// From the positions of the ends, in m; `None` when they coincide.
    pub fn between(xi: &Vector3<f64>, xj: &Vector3<f64>) -> Option<Self> {
        let d = xi - xj;
        let length = d.norm();
        (length != 0.0).then(|| Self { direction: d / length, length })
    }
}

impl Spring {
    /// The length over which strain is measured, in m: the rest length, or 1 m where that is zero.
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

    /// Whether the spring is shorter than at rest, so that its transverse term is negative.
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
        // What an option drops, it drops here: to leave out the division below, a processor would have to guess which springs are compressed.
        let elongation = at.length - self.rest_length;
        let elongation = match option {
            Stiffness::Full => elongation,
            Stiffness::Tension => elongation.max(0.0),
            Stiffness::Axial => 0.0,
        };
        // k (1/l0 − 1/l), written with the exact difference l − l0 so that it keeps its digits near rest.
        let transverse = self.stiffness * elongation / (self.rest_length * at.length);
        let axial = self.axial_stiffness();
        // Without a rest length it is the same in all directions, and without a length too.
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
/// Its eigenvalues are α (twice) and β. Stiffness blocks, damping blocks and their combinations are all of this form.
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

/// The sum of two blocks of one spring: both must have the same direction, which the sum keeps.
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
    /// `1 − n_r²` on the diagonal is written as the sum of the other two squares: near collapse α is large against β, and
    /// the difference would lose β along a spring that lies near an axis.
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

    /// The product with a vector. It goes through [`matrix`](Self::matrix), so that a product without an assembled matrix
    /// has the componentwise rounding error of one with it.
    #[inline]
    pub fn apply(&self, d: &Vector3<f64>) -> Vector3<f64> {
        self.matrix() * d
    }
}

#[cfg(test)]
mod tests {
    use super::{Extension, Spring, SpringBlock, Stiffness};
    use nalgebra::{Matrix3, Vector3};

    const SPRING: Spring = Spring { stiffness: 20.0, rest_length: 2.5, damping: 3.0 };

    fn assert_near<const N: usize>(found: [f64; N], expected: [f64; N]) {
        let is_near = found.iter().zip(&expected).all(|(found, expected)| (found - expected).abs() < 1e-13);
        assert!(is_near, "{found:?} {expected:?}");
    }

    /// Ends at (4, 4, 1) and (1, 0, 1): l = 5 and n = (0.6, 0.8, 0), a strain of 1.
    fn stretched() -> Extension {
        Extension::between(&Vector3::new(4.0, 4.0, 1.0), &Vector3::new(1.0, 0.0, 1.0)).unwrap()
    }

    #[test]
    fn forces_and_energy_are_those_of_the_formulas() {
        let at = stretched();
        assert_eq!((at.length, at.direction), (5.0, Vector3::new(0.6, 0.8, 0.0)));
        assert!(Extension::between(&Vector3::x(), &Vector3::x()).is_none());
        assert_eq!((SPRING.strain(&at), SPRING.elastic_energy(&at)), (1.0, 25.0));
        assert_near(SPRING.elastic_force(&at).into(), [-12.0, -16.0, 0.0]);
        // n·v = 2.2, and the ends move apart.
        let v = Vector3::new(1.0, 2.0, 7.0);
        assert_near(SPRING.damping_force(&at, &v).into(), [-3.96, -5.28, 0.0]);
        // With δd = (1, 0, 0) the direction turns by (0.64, −0.48, 0)/5, against which v has −0.064.
        let turned = SPRING.damping_differential(&at, &v, &Vector3::x());
        assert_near(turned.into(), [-3.0 * (0.2816 - 0.0384), -3.0 * (-0.2112 - 0.0512), 0.0]);
    }

    /// Stretched to twice its length the transverse coefficient is 20 (1/2.5 − 1/5), at half of it 20 (1/2.5 − 1/1.25).
    #[test]
    fn blocks_have_their_coefficients() {
        let (stretched, shortened) = (stretched(), Extension { direction: Vector3::x(), length: 1.25 });
        for (option, transverse) in
            [(Stiffness::Full, [4.0, -8.0]), (Stiffness::Tension, [4.0, 0.0]), (Stiffness::Axial, [0.0, 0.0])]
        {
            let blocks = [stretched, shortened].map(|at| SPRING.stiffness_block(&at, option));
            assert_eq!(blocks.map(|block| block.transverse), transverse, "{}", option.name());
            assert_eq!(blocks.map(|block| block.axial), [8.0; 2]);
            assert_eq!(blocks.map(|block| block.lowest()), transverse);
        }
        assert_eq!(Stiffness::ALL.map(Stiffness::name), ["full", "tension", "axial"]);
        let damping = SPRING.damping_block(&stretched);
        assert_eq!((damping.transverse, damping.axial, damping.lowest()), (0.0, 3.0, 0.0));
        let sum = SPRING.stiffness_block(&stretched, Stiffness::Full) * 0.5 + damping;
        assert_eq!(sum, SpringBlock { direction: stretched.direction, transverse: 2.0, axial: 7.0 });
        let full = SPRING.stiffness_block(&stretched, Stiffness::Full);
        assert_eq!(full + full, full * 2.0);
    }

    /// I + 9 nnᵀ with n = (2, −1, 2)/3.
    #[test]
    fn a_block_is_a_matrix_and_its_products() {
        let direction = Vector3::new(2.0, -1.0, 2.0) / 3.0;
        let block = SpringBlock { direction, transverse: 1.0, axial: 10.0 };
        let expected = Matrix3::new(5.0, -2.0, 4.0, -2.0, 2.0, -2.0, 4.0, -2.0, 5.0);
        assert!((block.matrix() - expected).amax() < 1e-14, "{}", block.matrix());
        assert_near(block.apply(&Vector3::new(1.0, 2.0, 3.0)).into(), [13.0, -4.0, 15.0]);
        // Across a spring along an axis nothing is lost of what is small along it.
        let along = SpringBlock { direction: Vector3::x(), transverse: -1e20, axial: 3.0 };
        assert_eq!(along.matrix(), Matrix3::from_diagonal(&Vector3::new(3.0, -1e20, -1e20)));
    }

    /// A spring at its rest length is neither stretched nor compressed.
    #[test]
    fn compressed_is_shorter_than_at_rest() {
        let spring = Spring { stiffness: 3.0, rest_length: 2.0, damping: 0.0 };
        for (length, is_compressed) in [(1.999, true), (2.0, false), (2.001, false)] {
            let at = Extension { direction: Vector3::x(), length };
            assert_eq!(spring.is_compressed(&at), is_compressed, "{length}");
        }
    }
}

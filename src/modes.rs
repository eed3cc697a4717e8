//! Normal modes, with a proof by inertia that none is missing, and reduced models made of them: state space and harmonic response.
//!
//! ```text
//! −K φ = ω² M φ,      φᵀ M φ = 1,      frequency ω/2π
//! ```
//!
//! of the motion linearised about a state: small vibrations where that is an equilibrium. A negative ω² is a motion that grows as `exp(|ω| t)`.
//!
//! **Counted.** By Sylvester's law `−K − σM = L D Lᵀ` has as many negative pivots as there are ω² < σ. With σ just below the last mode reported, that
//! number proves that none is missing. With all rounding errors of residuals and of the count bounded (`eigen/enclosure.rs`, `linear/certificate.rs`)
//! count and enclosures are theorems about the stored K and M.
//!
//! **Zero modes.** Rigid motions, from which the search starts, and mechanisms have ω² = 0 up to rounding: that of sums, relative to ‖M⁻¹K‖, and that
//! of positions, which leaves springs strained that are at rest. Where all modes asked for grow, the zero modes above them are counted between two
//! shifts on both sides of zero.
//!
//! **Damping.** `φᵀ(−G)φ/(2ω)`, exact where modes diagonalise G.

mod hanging;

use crate::assembly::SymmetricMatrix;
use crate::eigen::{
    Accuracy, BlockLanczos, Eigenpair, End, Pencil, Search, ShiftInvert, Tolerance, enclosures, multigrid_for,
    preconditioner, product, scaled_products,
};
use crate::error::{Invalid, Result, check_length};
use crate::force::{SpringGeometry, add_elastic_force, add_external_forces, add_weight};
use crate::integrate::Matrices;
use crate::linear::{CostModel, FactorSize, Ldlt, PreconditionerKind, dot};
use crate::memory;
use crate::operator::{Combination, LinearOperator, SystemOperator};
use crate::rigid::{Body, bodies, combination, rigid_motions, sums_at_ends};
use crate::spring::Stiffness;
use crate::system::{DofMap, State, StateView, System};
use crate::work::Work;
use faer::{Par, c64};
use hanging::hanging;
use nalgebra::{DMatrix, DVector, Vector3};
use std::f64::consts::TAU;

/// An eigenvalue counts as zero up to this part of ‖M⁻¹K‖: some units in the last place of the sums in K and in `φᵀKφ`.
const ZERO: f64 = 32.0 * f64::EPSILON;

const ZEROS: usize = 1000;

/// One normal mode.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// ω², in 1/s².
    pub eigenvalue: f64,
    /// φ over the free degrees of freedom, `φᵀMφ = 1`, in kg^{-1/2}.
    pub vector: Vec<f64>,
    /// `‖M^{-1/2}(−Kφ − ω²Mφ)‖`, in 1/s²: an eigenvalue lies within this distance of ω².
    pub residual: f64,
    /// A bound of the error of ω², in 1/s², with all rounding errors: as many eigenvalues lie within these distances as there are modes. Where
    /// [`Modes::proven`] the k-th lowest eigenvalue lies within that of the k-th lowest mode. Infinite where nothing is shown.
    pub error_bound: f64,
    /// `φᵀ(−G)φ/(2ω)`; `None` where ω² is not positive.
    pub damping_ratio: Option<f64>,
    /// `(φᵀ M e)²` for unit motions e of all particles along x, y and z, in kg.
    pub effective_mass: [f64; 3],
}

impl Mode {
    /// ω/2π, in Hz; `None` where ω² is negative.
    pub fn frequency(&self) -> Option<f64> {
        (self.eigenvalue >= 0.0).then(|| self.eigenvalue.sqrt() / TAU)
    }

    /// The rate |ω|, in 1/s, by which a motion along a mode of negative ω² grows.
    pub fn growth_rate(&self) -> Option<f64> {
        (self.eigenvalue < 0.0).then(|| (-self.eigenvalue).sqrt())
    }
}

/// The lowest normal modes of a system at a state; see [`modes`].
#[derive(Debug, Clone)]
pub struct Modes {
    /// Modes other than zero modes, by ascending ω².
    pub modes: Vec<Mode>,
    /// Modes of ω² = 0: all of them, or none where the modes asked for end below zero.
    pub zero_modes: Vec<Mode>,
    /// The number of modes of ω² = 0, also where they lie above the modes asked for; `None` where it is not known there.
    pub zero_count: Option<usize>,
    /// Rigid motions that constraints admit and stresses do not resist.
    pub rigid_motions: usize,
    /// The parts of a scene of several that can move as a whole: their particles.
    pub parts: Vec<Vec<usize>>,
    /// Where there are mechanisms, the parts that one spring alone joins to the rest, with all that they carry: their particles.
    pub hanging: Vec<Vec<usize>>,
    /// The largest |ω²| that counts as zero and the smallest that does not, in 1/s²; infinite where there is none.
    pub gap: [f64; 2],
    /// Whether the number of eigenvalues below `counted_below` proves that no mode is missing.
    pub complete: bool,
    /// Whether that number is a theorem about the stored matrices: with a rigorous bound of the rounding errors of the count, the intervals that
    /// [`Mode::error_bound`] gives hold as many eigenvalues as there are modes below a shift, and no more lie below it. Otherwise the count holds to
    /// rounding.
    pub proven: bool,
    /// A shift just below the last mode, in 1/s².
    pub counted_below: f64,
    /// The largest force that is not balanced over the largest force that acts; zero at an equilibrium.
    pub imbalance: f64,
    /// Factorizations, solves and what else was done.
    pub work: Work,
    dofs: DofMap,
    damping: SymmetricMatrix,
}

/// The `count` lowest modes of a system linearised about a state, beside its zero modes: all of them where there are fewer.
///
/// # Errors
/// A state of another system; coincident ends of a spring; too little memory; no mode asked for; more than a thousand zero modes.
///
/// # Examples
/// ```
/// use sprung::modes::modes;
/// use sprung::{Spring, SystemBuilder};
///
/// // Two masses of 1 kg on a spring of k/l0 = 50 N/m, free in space: ω² = 2·50/1, and five rigid motions.
/// let mut builder = SystemBuilder::new();
/// builder.particle([0.0, 0.0, 0.0], 1.0);
/// builder.particle([2.0, 0.0, 0.0], 1.0);
/// builder.spring(0, 1, Spring { stiffness: 100.0, rest_length: 2.0, damping: 0.0 });
/// let (system, state) = builder.build()?;
/// let found = modes(&system, &state, 1)?;
/// assert!((found.modes[0].eigenvalue - 100.0).abs() < 1e-10);
/// assert_eq!((found.zero_modes.len(), found.complete), (5, true));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn modes(system: &System, state: &State, count: usize) -> Result<Modes> {
    if count == 0 {
        return Err(Invalid::new("modes", count, "must be at least 1").into());
    }
    let mut matrices = Matrices::new(system)?;
    matrices.update(state, Stiffness::Full)?;
    let (order, masses) = (system.dofs().len(), matrices.masses());
    let stiffness = matrices.k().scaled(-1.0);
    let pencil = Pencil { masses: Some(masses), ..Pencil::of(&stiffness) };
    let geometry = SpringGeometry::at(system, state)?;
    let rounding = Rounding { system, state, geometry: &geometry, of_sums: ZERO * pencil.norm() };
    let rigid = unresisted(&stiffness, masses, rigid_motions(system, &state.positions), &rounding);
    let rigid_motions = rigid.len();
    let mut work = Work::default();
    let costs = CostModel::of(system);
    // Because it counts, a factorization may cost some ten times what a search without one takes.
    let most = 1e4 * costs.iteration(PreconditionerKind::Multigrid);
    let is_worth = |size: FactorSize, bytes: u64| {
        costs.factorization(size) <= most && memory::ensure(bytes, "a factorization").is_ok()
    };
    let plan = || Ldlt::plan_if(stiffness.pattern(), Par::rayon(0), is_worth)?.allocate().ok();
    let factorization = if order > 0 { plan() } else { None };
    let Found { pairs, bounds, complete, proven, counted_below, zeros_above } = match factorization {
        None if order == 0 => Found { complete: true, proven: true, counted_below: f64::INFINITY, ..Found::default() },
        Some(mut factorization) => {
            work.symbolic_factorizations += 1;
            counted(pencil, &mut factorization, rigid, count, &rounding, &mut work)?
        }
        None => {
            let wanted = (count + rigid_motions).min(order);
            let pairs = uncounted(system, state, &stiffness, masses, &rigid, wanted, &mut work)?;
            Found { bounds: enclosures(&pencil, &pairs), pairs, counted_below: f64::NAN, ..Found::default() }
        }
    };
    let pairs = pairs.into_iter().zip(bounds);
    let (zeros, others): (Vec<_>, Vec<_>) = pairs.partition(|(pair, _)| rounding.hides(pair));
    let size = |(pair, _): &(Eigenpair, f64)| pair.value.abs();
    let gap = [zeros.iter().map(size).fold(0.0, f64::max), others.iter().map(size).fold(f64::INFINITY, f64::min)];
    let is_past_zero = zeros.len() + others.len() == order || others.last().is_some_and(|(pair, _)| pair.value > 0.0);
    let zero_count = if is_past_zero { Some(zeros.len()) } else { zeros_above };
    let damping = matrices.g();
    let mode = |(pair, bound): (Eigenpair, f64)| Mode::new(pair, bound, system.dofs(), masses, damping);
    let zero_modes: Vec<Mode> = zeros.into_iter().map(mode).collect();
    Ok(Modes {
        modes: others.into_iter().take(count).map(mode).collect(),
        rigid_motions,
        parts: loose_parts(system, state),
        zero_count,
        hanging: if zero_count.is_none_or(|zeros| zeros > rigid_motions) { hanging(system) } else { Vec::new() },
        zero_modes,
        gap,
        complete,
        proven,
        counted_below,
        imbalance: imbalance(system, state)?,
        work,
        dofs: system.dofs().clone(),
        damping: damping.clone(),
    })
}

/// Pairs, ascending, with bounds of their errors; see [`Modes`].
#[derive(Default)]
struct Found {
    pairs: Vec<Eigenpair>,
    bounds: Vec<f64>,
    complete: bool,
    proven: bool,
    counted_below: f64,
    /// The number of zero modes, where it is known though all pairs lie below them.
    zeros_above: Option<usize>,
}

/// The lowest pairs, `count` of them not zero, with a count of the eigenvalues below the last one.
fn counted(
    pencil: Pencil<'_>,
    factorization: &mut Ldlt,
    rigid: Vec<Eigenpair>,
    count: usize,
    rounding: &Rounding<'_>,
    work: &mut Work,
) -> Result<Found> {
    let (order, zero, rigid_motions) = (pencil.a.order(), rounding.of_sums, rigid.len());
    let mut wanted = (count + rigid_motions).min(order);
    let mut search = ShiftInvert::new(pencil, factorization, work);
    search.known = rigid;
    let mut pairs = loop {
        memory::ensure(32 * (wanted as u64 + 50) * order as u64, "the vectors of so many modes and zero modes")?;
        let pairs = search.lowest(wanted, Accuracy::FULL);
        let zeros = pairs.iter().filter(|pair| rounding.hides(pair)).count();
        if pairs.len() < wanted || wanted == order || pairs.len() - zeros >= count {
            break pairs;
        }
        // Mechanisms beside the rigid motions: about as many as there are eigenvalues below a little more than rounding.
        let zeros = search.below(1e3 * zero).unwrap_or(0).max(zeros + 1);
        if zeros > ZEROS {
            let rule = format!("must be at most {ZEROS}; `sprung mechanisms` counts them");
            return Err(Invalid::new("zero modes", zeros, rule).into());
        }
        wanted = (count + zeros).min(order);
        search.known = pairs;
    };
    let mut complete = search.edge.is_some() && !pairs.is_empty();
    let mut counted_below = search.edge.unwrap_or(f64::NAN);
    let last = (0..pairs.len()).filter(|&k| !rounding.hides(&pairs[k])).nth(count - 1);
    // Modes beyond those asked for were found on the way: the count is that below the last one reported.
    if let Some(last) = last.filter(|last| last + 1 < pairs.len()) {
        pairs.truncate(last + 1);
        let value = pairs[last].value;
        counted_below = value - (1e-6 * value.abs()).max(1e-12 * zero / ZERO);
        let found = pairs.iter().filter(|pair| pair.value < counted_below).count();
        complete = search.below(counted_below) == Some(found);
    }
    let lowest = counted_below - search.count_error;
    let ends_below = pairs.last().is_some_and(|pair| pair.value < 0.0 && !rounding.hides(pair));
    let zeros_above = if ends_below { zeros_counted(&mut search, rounding, rigid_motions) } else { None };
    let mut bounds = enclosures(&pencil, &pairs);
    let counted = pairs.iter().filter(|pair| pair.value < counted_below).count();
    let is_below = |(pair, bound): (&Eigenpair, &f64)| pair.value + bound < lowest;
    let proven = complete && lowest.is_finite() && pairs.iter().zip(&bounds).take(counted).all(is_below);
    // Of those that are not counted no eigenvalue lies below the shift.
    for (pair, bound) in pairs.iter().zip(&mut bounds).skip(counted).filter(|_| proven) {
        *bound = bound.max((pair.value - lowest) * (1.0 + f64::EPSILON));
    }
    Ok(Found { pairs, bounds, complete, proven, counted_below, zeros_above })
}

/// The number of eigenvalues within rounding of zero, where as many lie within a thousand times that: otherwise not all of them can be told from
/// others.
fn zeros_counted(search: &mut ShiftInvert<'_>, rounding: &Rounding<'_>, rigid_motions: usize) -> Option<usize> {
    let narrow = rounding.of_sums.max(rounding.of_positions_at_most());
    let [zeros, nearly] = [narrow, 1e3 * narrow].map(|band| search.below(band)?.checked_sub(search.below(-band)?));
    zeros.filter(|zeros| Some(*zeros) == nearly && *zeros >= rigid_motions)
}

fn loose_parts(system: &System, state: &State) -> Vec<Vec<usize>> {
    let bodies = bodies(system);
    if bodies.len() < 2 {
        return Vec::new();
    }
    let is_loose = |body: &Body| !body.rigid_motions(system, &state.positions).is_empty();
    bodies.into_iter().filter(is_loose).map(|body| body.particles).collect()
}

struct Rounding<'a> {
    system: &'a System,
    state: &'a State,
    geometry: &'a SpringGeometry,
    /// By that of the sums in K and in `φᵀKφ`, in 1/s².
    of_sums: f64,
}

impl Rounding<'_> {
    /// Whether an eigenvalue is zero to rounding; one that is known less exactly, where zero is within its residual.
    fn hides(&self, pair: &Eigenpair) -> bool {
        let limit = self.of_sums.max(pair.residual.min(1e3 * self.of_sums));
        pair.value.abs() <= limit || pair.value.abs() <= self.of_positions(&pair.vector)
    }

    /// Springs with `κ δ/l`, in N/m: rounding of the positions and of the rest length makes a length uncertain by `δ = ε (|xᵢ| + |xⱼ|)`, and the
    /// transverse stiffness T/l of a spring at rest by that.
    fn transverse(&self) -> impl Iterator<Item = ([usize; 2], f64)> + '_ {
        let size = |p: usize| self.state.positions[p].norm();
        self.geometry.springs(self.system).filter(|(_, at)| at.length > 0.0).map(move |((_, [i, j], spring), at)| {
            ([i, j], spring.axial_stiffness() * f64::EPSILON * (size(i) + size(j)) / at.length)
        })
    }

    /// `Σ κ (δ/l) |uᵢ − uⱼ|²`, no less than what they change an eigenvalue of zero by.
    fn of_positions(&self, vector: &[f64]) -> f64 {
        let dofs = self.system.dofs();
        self.transverse().map(|([i, j], size)| size * (dofs.get(vector, i) - dofs.get(vector, j)).norm_squared()).sum()
    }

    /// The largest [`of_positions`](Self::of_positions) that a vector with `uᵀMu = 1` can have: as `|uᵢ − uⱼ|² ≤ 2 |uᵢ|² + 2 |uⱼ|²`, twice the
    /// largest sum of `κ δ/l` at a particle over its mass.
    fn of_positions_at_most(&self) -> f64 {
        let sums = sums_at_ends(self.system, self.transverse());
        let free = self.system.masses().iter().enumerate().filter(|(p, _)| !self.system.dofs().rows(*p).is_empty());
        free.map(|(p, mass)| 2.0 * sums[p] / mass).fold(0.0, f64::max)
    }

    /// The square of the norm `‖M^{-1/2} f‖` of the forces that they give to a motion.
    fn of_forces(&self, motion: &[f64]) -> f64 {
        let (dofs, masses) = (self.system.dofs(), self.system.masses());
        let force =
            |([i, j], size): ([usize; 2], f64)| ([i, j], size * (dofs.get(motion, i) - dofs.get(motion, j)).norm());
        let forces = sums_at_ends(self.system, self.transverse().map(force));
        (0..forces.len()).filter(|&p| !dofs.rows(p).is_empty()).map(|p| forces[p].powi(2) / masses[p]).sum()
    }
}

/// The lowest pairs by products and multigrid, without a factorization and without a count: Davidson's method on `M⁻¹A`, preconditioned with
/// multigrid for `A + sM`, s small against ‖M⁻¹A‖, under option *tension* where A is not positive definite.
pub(crate) fn uncounted(
    system: &System,
    state: &State,
    a: &SymmetricMatrix,
    masses: &[f64],
    rigid: &[Eigenpair],
    wanted: usize,
    work: &mut Work,
) -> Result<Vec<Eigenpair>> {
    let n = masses.len();
    let search = Search::new(End::Lowest, wanted, 4);
    memory::ensure(16 * (search.capacity as u64 + 60) * n as u64, "the vectors of a search for modes")?;
    let geometry = SpringGeometry::at(system, state)?;
    let shift = 1e-9 * Pencil { masses: Some(masses), ..Pencil::of(a) }.norm();
    let shifted = |mass, option| {
        SystemOperator::new(system, &geometry, option, Combination { mass, damping: 0.0, stiffness: -1.0 })
    };
    let build = |option| multigrid_for(&shifted(shift, option), &state.positions);
    let mut multigrid = build(Stiffness::Full).or_else(|| build(Stiffness::Tension));
    let products = shifted(0.0, Stiffness::Full);
    let mut apply = scaled_products(&products, Some(masses));
    let mut precondition = preconditioner(multigrid.as_mut(), Some(masses), work);
    let rigid = rigid.iter().map(|pair| &pair.vector[..]);
    let mut space = BlockLanczos::from(n, Some(masses), search, 5, rigid, &mut apply);
    let tolerance = Tolerance { of_value: 1e-7, of_norm: 1e-14 };
    let found = space.iterate(tolerance, 300, &mut apply, Some(&mut precondition));
    Ok(found.into_iter().take(wanted).map(Eigenpair::from).collect())
}

/// The motions of a set, orthonormal in M, that a matrix does not resist.
fn unresisted(a: &SymmetricMatrix, masses: &[f64], motions: Vec<Vec<f64>>, rounding: &Rounding<'_>) -> Vec<Eigenpair> {
    if motions.is_empty() {
        return Vec::new();
    }
    let forces: Vec<Vec<f64>> = motions.iter().map(|motion| product(a, motion)).collect();
    // Of the rotations of a strained body some combinations may be free: those of the null space of RᵀAM⁻¹AR.
    let inner = |a: &[f64], b: &[f64]| a.iter().zip(b).zip(masses).map(|((a, b), mass)| a * b / mass).sum::<f64>();
    let form = DMatrix::from_fn(motions.len(), motions.len(), |i, j| inner(&forces[i], &forces[j]));
    let eigen = nalgebra::SymmetricEigen::new(form);
    let of_positions = motions.iter().map(|motion| rounding.of_forces(motion)).sum::<f64>().sqrt();
    let zero = rounding.of_sums.max(of_positions);
    let pair = |k: usize| {
        let vector = combination(&motions, eigen.eigenvectors.column(k));
        Eigenpair { value: 0.0, residual: eigen.eigenvalues[k].max(0.0).sqrt(), vector }
    };
    (0..motions.len()).map(pair).filter(|pair| pair.residual <= zero).collect()
}

pub(crate) fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |largest, value| value.abs().max(largest))
}

/// Weight and external forces on every particle at rest, in N.
pub(crate) fn loads_at_rest(system: &System, state: &State) -> Vec<Vector3<f64>> {
    let rest = vec![Vector3::zeros(); system.particles()];
    let mut forces = rest.clone();
    add_weight(system, &mut forces);
    add_external_forces(system, &StateView { velocities: &rest, ..state.moment() }, &mut forces);
    forces
}

/// The largest force on a free coordinate that nothing balances, over the largest force of one kind: of springs, weight or loads.
pub(crate) fn imbalance(system: &System, state: &State) -> Result<f64> {
    let mut springs = vec![Vector3::zeros(); system.particles()];
    let geometry = SpringGeometry::at(system, state)?;
    add_elastic_force(system, &geometry, &mut springs);
    let loads = loads_at_rest(system, state);
    let largest = |forces: &[Vector3<f64>]| largest(&system.dofs().reduced(forces));
    let tension = geometry.springs(system).map(|((_, _, spring), at)| spring.elastic_force(at).norm());
    let acting = tension.fold(largest(&springs).max(largest(&loads)), f64::max);
    let total: Vec<_> = springs.iter().zip(&loads).map(|(a, b)| a + b).collect();
    Ok(if acting > 0.0 { largest(&total) / acting } else { 0.0 })
}

impl Mode {
    fn new(pair: Eigenpair, error_bound: f64, dofs: &DofMap, masses: &[f64], damping: &SymmetricMatrix) -> Self {
        let Eigenpair { value: eigenvalue, mut vector, residual } = pair;
        // One of the two signs, the same each time.
        let largest =
            vector.iter().fold(0.0f64, |largest, &u| if u.abs() > 1.001 * largest.abs() { u } else { largest });
        if largest < 0.0 {
            vector.iter_mut().for_each(|u| *u = -*u);
        }
        let curvature = dot(&vector, &product(damping, &vector));
        let damping_ratio = (eigenvalue > 0.0).then(|| 0.0 - 0.5 * curvature / eigenvalue.sqrt());
        let mut participation = [0.0; 3];
        for ((dof, u), mass) in dofs.iter().zip(&vector).zip(masses) {
            participation[dof.axis] += mass * u;
        }
        Self { eigenvalue, vector, residual, error_bound, damping_ratio, effective_mass: participation.map(|p| p * p) }
    }
}

/// A linear system `x' = A x + B u, y = C x` whose states are the amplitudes of modes and their rates; there is no D.
#[derive(Debug, Clone, PartialEq)]
pub struct StateSpace {
    /// A, 2n × 2n: `[0 I; −Ω² ΦᵀGΦ]`.
    pub a: DMatrix<f64>,
    /// B, 2n × inputs: forces, in N.
    pub b: DMatrix<f64>,
    /// C, outputs × 2n: displacements, in m.
    pub c: DMatrix<f64>,
}

impl Modes {
    /// The displacement of every particle in a mode, in kg^{-1/2}.
    pub fn shape(&self, mode: &Mode) -> Vec<Vector3<f64>> {
        self.dofs.full(&mode.vector)
    }

    /// Φ and ΦᵀGΦ of zero modes and modes together, ascending in ω².
    fn reduced(&self) -> (Vec<&Mode>, DMatrix<f64>) {
        let mut all: Vec<&Mode> = self.zero_modes.iter().chain(&self.modes).collect();
        all.sort_by(|a, b| a.eigenvalue.total_cmp(&b.eigenvalue));
        let products: Vec<Vec<f64>> = all.iter().map(|mode| product(&self.damping, &mode.vector)).collect();
        let damping = DMatrix::from_fn(all.len(), all.len(), |i, j| dot(&all[i].vector, &products[j]));
        (all, damping)
    }

    fn check_rows(&self, name: &str, rows: &[usize]) -> Result<()> {
        let Some(index) = rows.iter().position(|row| *row >= self.dofs.len()) else { return Ok(()) };
        let rule = format!("must be below the number of degrees of freedom, {}", self.dofs.len());
        Err(Invalid::new(name, rows[index], rule).at(index).into())
    }

    /// The modes found, zero modes among them, as a linear system from forces at some degrees of freedom to displacements of others.
    ///
    /// # Errors
    /// A row that is no degree of freedom; see [`DofMap::row`].
    pub fn state_space(&self, inputs: &[usize], outputs: &[usize]) -> Result<StateSpace> {
        self.check_rows("inputs", inputs)?;
        self.check_rows("outputs", outputs)?;
        let (all, damping) = self.reduced();
        let n = all.len();
        let mut a = DMatrix::zeros(2 * n, 2 * n);
        for (k, mode) in all.iter().enumerate() {
            a[(k, n + k)] = 1.0;
            a[(n + k, k)] = -mode.eigenvalue;
        }
        a.view_mut((n, n), (n, n)).copy_from(&damping);
        let b = DMatrix::from_fn(2 * n, inputs.len(), |k, i| if k < n { 0.0 } else { all[k - n].vector[inputs[i]] });
        let c = DMatrix::from_fn(outputs.len(), 2 * n, |o, k| if k < n { all[k].vector[outputs[o]] } else { 0.0 });
        Ok(StateSpace { a, b, c })
    }

    /// The displacements, in m, that a force `Re(f e^{iωt})` on the free degrees of freedom drives, as complex amplitudes:
    /// `x = Φ (Ω² − ω² − iω ΦᵀGΦ)⁻¹ Φᵀ f` by the modes found. One vector for each frequency in Hz.
    ///
    /// # Errors
    /// A force whose length is not the number of degrees of freedom; a frequency at which an undamped mode resonates.
    pub fn harmonic_response(&self, force: &[f64], frequencies: &[f64]) -> Result<Vec<Vec<c64>>> {
        check_length("force", force.len(), self.dofs.len())?;
        let (all, damping) = self.reduced();
        let load = DVector::from_fn(all.len(), |k, _| c64::from(dot(&all[k].vector, force)));
        let response = |(index, &frequency): (usize, &f64)| {
            let omega = TAU * frequency;
            let mut matrix = damping.map(|g| c64::new(0.0, -omega * g));
            for (k, mode) in all.iter().enumerate() {
                matrix[(k, k)] += c64::from(mode.eigenvalue - omega * omega);
            }
            let amplitudes = matrix.lu().solve(&load).filter(|x| x.iter().all(|x| x.is_finite()));
            let resonance = || Invalid::new("frequencies", frequency, "must not be that of an undamped mode").at(index);
            let amplitudes = amplitudes.ok_or_else(resonance)?;
            let mut x = vec![c64::ZERO; self.dofs.len()];
            for (mode, amplitude) in all.iter().zip(&amplitudes) {
                x.iter_mut().zip(&mode.vector).for_each(|(x, u)| *x += amplitude * u);
            }
            Ok(x)
        };
        frequencies.iter().enumerate().map(response).collect()
    }
}

#[cfg(test)]
mod tests;

//! The searches for the ends of a spectrum: shifts beyond them, proven by factorizations, and solves with what was factored.

use super::eigenpair::{Eigenpair, eigenpair};
use super::krylov::{Krylov, Ritz};
use super::lanczos::{self, End, lanczos_ends};

use crate::assembly::SymmetricMatrix;
use crate::linear::Ldlt;
use crate::operator::LinearOperator;
use crate::work::Work;

/// Residual at which a search with solves stops, relative to the largest eigenvalue of the inverse, and the most steps it
/// takes, to which each wanted pair adds one; then the shift is moved nearer.
pub(super) const TOLERANCE: f64 = 1e-5;
pub(super) const STEPS: usize = 20;

/// The same where only what is certified is wanted: the error of a Rayleigh quotient is of the order of the square.
pub(super) const CERTIFIED_TOLERANCE: f64 = 1e-3;

/// The same for the last search, with a shift so near that it converges in a few steps.
const LAST_TOLERANCE: f64 = 1e-12;
const LAST_STEPS: usize = 5;

/// How often the shift is moved nearer, and by how much.
const MOVES: usize = 12;
const NEARER: f64 = 0.0625;

/// How far outside the spectrum may reach beyond what was found, relative to ‖A‖.
const ACCURACY: f64 = 5e-7;

/// The same relative to λ_min, where A is positive definite.
const RELATIVE_ACCURACY: f64 = 1e-3;

/// How near a bound from below must be, relative to λ_min, that spares a factorization of a [`LARGE`] matrix.
const BOUNDED: f64 = 1e-2;

/// Doublings of the distance to a shift: 1e-8 of ‖A‖ has then become far more than ‖A‖.
const LONGEST_RETREAT: usize = 60;

/// Products that tell where a spectrum ends, and those that find its upper end, of a matrix and of a [`LARGE`] one: by springs, a tenth of a
/// factorization of a cloth.
const ENDS_STEPS: usize = 60;
const LARGEST_STEPS: [usize; 2] = [240, 480];

/// From so many rows on every solve takes as long as thousands of products do for a small matrix, and digits beyond those that a search
/// with solves has found are not looked for.
pub(super) const LARGE: usize = 10_000;

/// How uncertain an upper end may be that is not searched for with solves, relative to ‖A‖.
const WIDEST: f64 = 1e-4;

/// The upper end of a spectrum, by products: a bound from below, and how far from an eigenvalue it may be.
pub(super) fn upper_end(a: &dyn LinearOperator) -> End {
    let [few, many] = LARGEST_STEPS;
    let steps = if a.order() < LARGE { few } else { many };
    lanczos::upper_end(a.order(), steps, &mut |x: &[f64], y: &mut [f64]| a.apply(x, y))
}

/// On which side of the spectrum a shift lies.
#[derive(Clone, Copy)]
enum Side {
    Below,
    Above,
}

impl Side {
    fn outwards(self) -> f64 {
        match self {
            Self::Below => -1.0,
            Self::Above => 1.0,
        }
    }
}

/// How exact an end is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Digits {
    /// As many as there are, vectors too.
    All,
    /// As many as are certified: a value, no vector.
    Certified,
}

impl Digits {
    /// Residual at which a search stops before the end is certified.
    fn tolerance(self) -> f64 {
        match self {
            Self::All => TOLERANCE,
            Self::Certified => CERTIFIED_TOLERANCE,
        }
    }
}

/// What is known of A before its spectrum.
pub(super) struct Known<'a> {
    /// A, by its fastest products.
    pub products: &'a dyn LinearOperator,
    /// The factorization is that of A, and positive; afterwards, whether it still is.
    pub is_factored: bool,
    /// A proven bound for λ_min from below, and one for λ_max from above.
    pub within: [f64; 2],
    /// `T ≥ A`, with an estimate of its λ_max.
    pub above: Option<(&'a SymmetricMatrix, f64)>,
    /// Where the spectrum of T ends at the latest, if that is found out.
    pub above_within: f64,
    /// The upper end of A by products, if that has been looked for.
    pub upper_end: Option<End>,
    /// How exact the ends are wanted.
    pub digits: Digits,
}

impl<'a> Known<'a> {
    /// Nothing but the matrix.
    pub fn nothing(a: &'a SymmetricMatrix) -> Self {
        let within = [f64::NEG_INFINITY, f64::INFINITY];
        Self {
            products: a,
            is_factored: false,
            within,
            above: None,
            above_within: f64::INFINITY,
            upper_end: None,
            digits: Digits::All,
        }
    }
}

/// A Krylov search at one end of the spectrum.
struct Target {
    side: Side,
    /// σ, beyond the end.
    shift: f64,
    wanted: usize,
    /// How many negative eigenvalues must be among those found.
    due: usize,
    /// How far the spectrum may reach beyond the first eigenvalue λ found: as a part of ‖A‖ and of |λ|.
    accuracy: [f64; 2],
    digits: Digits,
}

/// Steps of a search at most, for so many pairs.
fn longest(steps: usize, wanted: usize) -> usize {
    steps + wanted
}

/// ‖A‖, nearly.
pub(super) fn size(ends: &[End; 2]) -> f64 {
    ends.iter().fold(0.0f64, |size, end| size.max(end.value.abs()))
}

pub(super) struct Search<'a> {
    pub a: &'a SymmetricMatrix,
    /// A by its fastest products.
    pub products: &'a dyn LinearOperator,
    pub factorization: &'a mut Ldlt,
    pub work: &'a mut Work,
    /// What the spectrum lies between, proven.
    pub within: [f64; 2],
    /// The factorization is that of A itself, and positive.
    pub is_factored: bool,
}

impl<'a> Search<'a> {
    pub fn new(
        a: &'a SymmetricMatrix,
        products: &'a dyn LinearOperator,
        factorization: &'a mut Ldlt,
        work: &'a mut Work,
    ) -> Self {
        Self { a, products, factorization, work, within: [f64::NEG_INFINITY, f64::INFINITY], is_factored: false }
    }

    pub fn n(&self) -> usize {
        self.a.dofs().len()
    }

    /// Where the spectrum ends, roughly.
    pub fn ends(&self) -> [End; 2] {
        lanczos_ends(self.n(), ENDS_STEPS, |x, y| self.products.apply(x, y))
    }

    /// Products find it, and one factorization proves that they have; where they have not, it is searched for.
    pub fn largest(&mut self, ends: &[End; 2], known: &mut Known<'_>) -> f64 {
        let side = Side::Above;
        let End { value: found, residual } = known.upper_end.unwrap_or_else(|| upper_end(self.products));
        let margin = ACCURACY * size(ends);
        // What was proven of a larger matrix; where nobody asked for more digits that will do.
        if self.within[1] <= found + margin || known.digits == Digits::Certified && self.within[1].is_finite() {
            return found;
        }
        if let Some((above, _)) = known.above.filter(|&(_, largest)| largest <= found + 0.5 * margin)
            && self.proves_end(above, found + margin)
        {
            known.above_within = found + margin;
            return found;
        }
        if self.is_beyond(found + margin, side) {
            return found;
        }
        // The end of a dense band of eigenvalues, which products come as near to as they say.
        if residual > margin && residual <= WIDEST * size(ends) && self.is_beyond(found + residual, side) {
            return found;
        }
        let Some(shift) = self.factor_beyond(ends, side) else { return f64::NAN };
        let pairs = self.extreme(
            ends,
            &Target { side, shift, wanted: 1, due: 0, accuracy: [ACCURACY, f64::INFINITY], digits: Digits::Certified },
        );
        pairs.first().map_or(f64::NAN, |pair| pair.value)
    }

    /// The lowest pairs. As many of them as Sylvester's count says are negative are not missed for being multiple.
    pub fn lowest(&mut self, negative: usize, wanted: usize, digits: Digits, ends: &[End; 2]) -> Vec<Eigenpair> {
        let (side, due) = (Side::Below, negative.min(wanted));
        let accuracy = |relative| [ACCURACY, relative];
        // Below zero there is nothing to prove where there are eigenvalues.
        let target = if self.is_factored || negative == 0 && self.is_beyond(0.0, side) {
            Target { side, shift: 0.0, wanted, due, accuracy: accuracy(RELATIVE_ACCURACY), digits }
        } else {
            let Some(shift) = self.factor_beyond(ends, side) else { return Vec::new() };
            Target { side, shift, wanted, due, accuracy: accuracy(f64::INFINITY), digits }
        };
        self.extreme(ends, &target)
    }

    /// Searches at one end, with `A − σ` factored, until the end is certified; σ is moved nearer as long as it is not.
    fn extreme(&mut self, ends: &[End; 2], target: &Target) -> Vec<Eigenpair> {
        let Target { side, shift, accuracy, digits, .. } = *target;
        let size = size(ends);
        let mut distance = f64::INFINITY;
        let (tolerance, steps) = (digits.tolerance(), longest(STEPS, target.wanted));
        let mut pairs = self.search(target, Vec::new(), tolerance, steps);
        for _ in 0..MOVES {
            let Some(first) = pairs.first().map(|pair| pair.value) else { return pairs };
            let reach = (accuracy[0] * size).min(accuracy[1] * first.abs());
            let outside = |distance: f64| first + side.outwards() * distance;
            let has_enough_digits = digits == Digits::Certified || self.n() >= LARGE;
            // Where nobody asked for digits, a bound that springs and masses prove is as good as one by a factorization.
            let bounded = match digits {
                Digits::Certified if self.n() >= LARGE => first - BOUNDED * first.abs(),
                Digits::Certified | Digits::All => outside(reach),
            };
            let is_known = matches!(side, Side::Below) && bounded <= self.within[0];
            if is_known && has_enough_digits {
                return pairs;
            }
            let is_certified = self.is_beyond(outside(reach), side);
            if is_certified && has_enough_digits {
                return pairs;
            }
            if is_certified {
                return self.search(
                    &Target { shift: outside(reach), ..*target },
                    pairs,
                    LAST_TOLERANCE,
                    longest(LAST_STEPS, target.wanted),
                );
            }
            distance = (NEARER * distance.min((first - shift).abs())).max(2.0 * reach);
            while !self.is_beyond(outside(distance), side) {
                distance *= 2.0;
                if distance > 4.0 * size {
                    return pairs;
                }
            }
            pairs = self.search(&Target { shift: outside(distance), ..*target }, pairs, tolerance, steps);
        }
        pairs
    }

    /// The pairs nearest to the target's σ, for which `A − σ` is factored, from those found before; the outermost first.
    fn search(&mut self, target: &Target, before: Vec<Eigenpair>, tolerance: f64, steps: usize) -> Vec<Eigenpair> {
        let Target { side, shift, wanted, due, .. } = *target;
        let Self { a, factorization, work, .. } = self;
        let n = a.dofs().len();
        // (A − σ)⁻¹ below the spectrum, (σ − A)⁻¹ above it: positive definite both.
        let mut solve = |x: &[f64], y: &mut [f64]| {
            work.solves += (x.len() / n) as u64;
            y.iter_mut().zip(x).for_each(|(y, x)| *y = -side.outwards() * x);
            factorization.substitute_columns(n, y);
        };
        let start: Vec<Vec<f64>> = before.into_iter().map(|pair| pair.vector).collect();
        let mut space = Krylov::from_vectors(n, wanted, &start, &mut solve);
        let mut found = space.iterate(tolerance, steps, &mut solve);
        let missed = |pairs: &[Ritz]| pairs.iter().filter(|pair| shift + 1.0 / pair.value < 0.0).count() < due;
        for _ in 0..due {
            if !missed(&found) {
                break;
            }
            space.refresh(&mut solve);
            found = space.iterate(tolerance, steps, &mut solve);
        }
        let mut pairs: Vec<Eigenpair> = found.into_iter().map(|pair| eigenpair(*a, pair.vector)).collect();
        pairs.sort_by(|a, b| (side.outwards() * b.value).total_cmp(&(side.outwards() * a.value)));
        pairs
    }

    /// Factors `A − σ`; whether σ lies beyond that end of the spectrum.
    fn is_beyond(&mut self, shift: f64, side: Side) -> bool {
        let mut shifted = self.a.clone();
        shifted.shift(-shift);
        self.work.factorizations += 1;
        let is_beyond = self.factorization.factor(&shifted).is_ok()
            && self.factorization.pivots().all(|(_, d)| d * side.outwards() < 0.0);
        self.is_factored = is_beyond && shift == 0.0 && matches!(side, Side::Below);
        if is_beyond {
            let [low, high] = &mut self.within;
            match side {
                Side::Below => *low = low.max(shift),
                Side::Above => *high = high.min(shift),
            }
        }
        is_beyond
    }

    /// As [`is_beyond`](Self::is_beyond) above the spectrum of a larger matrix, and so above that of A.
    fn proves_end(&mut self, above: &SymmetricMatrix, shift: f64) -> bool {
        let mut shifted = above.clone();
        shifted.shift(-shift);
        self.work.factorizations += 1;
        self.is_factored = false;
        let is_beyond =
            self.factorization.factor(&shifted).is_ok() && self.factorization.pivots().all(|(_, d)| d < 0.0);
        if is_beyond {
            self.within[1] = self.within[1].min(shift);
        }
        is_beyond
    }

    /// Factors `A − σ` with a σ beyond one end of the spectrum, and returns σ.
    fn factor_beyond(&mut self, ends: &[End; 2], side: Side) -> Option<f64> {
        let [low, high] = ends;
        let size = low.value.abs().max(high.value.abs());
        let end = match side {
            Side::Below => low,
            Side::Above => high,
        };
        let mut margin = end.residual.max(0.02 * end.value.abs()).max(1e-8 * size);
        for _ in 0..LONGEST_RETREAT {
            let shift = end.value + side.outwards() * margin;
            if self.is_beyond(shift, side) {
                return Some(shift);
            }
            margin *= 2.0;
        }
        None
    }
}

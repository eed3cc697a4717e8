//! The pictures of an inspection.

use super::inertia::Inertia;
use super::inspection::{Inspection, Part, SkipReason};
use super::spectrum::{LARGEST_DENSE, smallest_eigenvalue};
use crate::assembly::{SpringPattern, SymmetricMatrix, SystemMatrix};
use crate::error::Result;
use crate::figure::{Axis, Drawing, Guide, Look, Plot, Series, Spy};
use crate::force::SpringGeometry;
use crate::linear::Ldlt;
use crate::operator::{Combination, SystemOperator};
use crate::spring::Stiffness;
use crate::system::{State, System};
use crate::work::Work;
use std::sync::Arc;

/// The pictures of an inspection.
#[derive(Debug, Clone, PartialEq)]
pub struct Pictures {
    /// The springs by strain, the worst culprits singled out, the lowest eigenvector as arrows.
    pub scene: Drawing,
    /// `λ_min(dt)·dt²/m_min` over dt under the three options; `None` where the inspection leaves it out.
    pub curve: Option<Plot>,
    /// The low end of the spectrum.
    pub spectrum: Plot,
    /// The sparsity patterns of A and of its factor L, this one in the order of elimination; `None` where the inspection was interrupted or nothing
    /// was factored.
    pub patterns: Option<[Spy; 2]>,
}

impl Pictures {
    /// The pictures of an inspection of this state.
    ///
    /// # Errors
    /// Coincident ends of a spring; a matrix that is too large.
    pub fn of(system: &System, state: &State, inspection: &Inspection) -> Result<Self> {
        let extensions = SpringGeometry::at(system, state)?;
        let is_drawn = !(system.dofs().is_empty() || inspection.lacks(Part::Curve));
        let is_whole =
            inspection.skipped_for(SkipReason::Interrupted).next().is_none() && inspection.estimated.is_empty();
        let (mut curve, mut patterns) = (None, None);
        if is_drawn || is_whole {
            let pattern = Arc::new(SpringPattern::of_stiffness(system)?);
            let mut factorization = Ldlt::analyse(pattern.pattern(), inspection.par)?;
            let matrix = |option, dt| {
                let operator = SystemOperator::new(system, &extensions, option, Combination::step(dt));
                SystemMatrix::assemble(pattern.clone(), &operator).into_matrix()
            };
            patterns = is_whole.then(|| patterns_of(&matrix(inspection.option, inspection.dt), &factorization));
            curve = is_drawn.then(|| curve_of(system, inspection, &matrix, &mut factorization));
        }
        Ok(Self { scene: scene(system, state, inspection), curve, spectrum: low_end(inspection), patterns })
    }

    /// With the scene's name at the end of every title.
    pub fn named(mut self, scene: &str) -> Self {
        let plots = self.curve.iter_mut().chain([&mut self.spectrum]).map(|plot| &mut plot.title);
        let patterns = self.patterns.iter_mut().flatten().map(|spy| &mut spy.title);
        for title in plots.chain(patterns).chain([&mut self.scene.title]) {
            *title = format!("{title}: {scene}");
        }
        self
    }
}

fn patterns_of(a: &SymmetricMatrix, factorization: &Ldlt) -> [Spy; 2] {
    let n = a.dofs().len();
    let entries = a.iter().filter(|&(_, _, value)| value != 0.0);
    let mut matrix = Spy::lower("Pattern of A, rows by particle", n, entries.map(|(row, column, _)| (row, column)));
    let diagonal = (0..n).map(|k| (k, k));
    let mut factor =
        Spy::lower("Pattern of L in A = L D Lᵀ, rows as eliminated", n, factorization.pattern().chain(diagonal));
    let filled = |spy: &Spy| format!("{:.2} % of the lower triangle", 100.0 * spy.filled());
    matrix.conclusion = format!("{} entries in {n} rows, {}.", matrix.entries, filled(&matrix));
    let growth = factor.entries as f64 / matrix.entries.max(1) as f64;
    factor.conclusion = format!("{} entries, {growth:.1} times those of A, {}.", factor.entries, filled(&factor));
    [matrix, factor]
}

fn scene(system: &System, state: &State, inspection: &Inspection) -> Drawing {
    let value = inspection.directions.first().map(|lowest| short(lowest.eigenvalue));
    let title = match (value, inspection.fold()) {
        (Some(value), Some(fold)) => format!("Strain, and one eigenvector of λₘᵢₙ = {value} N/m, {fold}"),
        (Some(value), None) => format!("Strain, and the eigenvector of λₘᵢₙ = {value} N/m"),
        (None, _) => "Strain".into(),
    };
    let mut drawing = Drawing::strains(title, system, state).concluding(blame(inspection));
    if let Some(lowest) = inspection.directions.first() {
        for culprit in lowest.culprits.iter().take(6).filter(|culprit| culprit.share >= 0.02) {
            let [i, j] = culprit.particles;
            let (strain, share) = (short(culprit.strain), 100.0 * culprit.share);
            let label = format!("spring {} ({i}–{j}): strain {strain}, share {share:.0} %", culprit.spring);
            drawing = drawing.highlight(culprit.spring, label);
        }
    }
    match inspection.spectrum.lowest.first() {
        Some(pair) => drawing.with_arrows(&system.dofs().full(&pair.vector)),
        None => drawing,
    }
}

fn blame(inspection: &Inspection) -> String {
    let Some(lowest) = inspection.directions.first() else { return "No coordinate is free to move.".into() };
    let Some(worst) = lowest.culprits.first() else {
        return match inspection.compressed_springs {
            0 => "No spring is compressed, and none has negative curvature along the arrows.".into(),
            several => format!("None of {several} compressed springs has negative curvature along the arrows."),
        };
    };
    let (spring, [i, j], share) = (worst.spring, worst.particles, 100.0 * worst.share);
    let does = if lowest.eigenvalue < 0.0 { "spoils A" } else { "softens A" };
    let others = match lowest.culprits.len() - 1 {
        0 => "no other spring does".into(),
        1 => "1 other does too".into(),
        several => format!("{several} others do too"),
    };
    format!("Spring {spring} ({i}–{j}) {does} most, with {share:.0} % of the negative curvature; {others}.")
}

/// λ_min over dt, scaled so that it begins at 1 for small steps: `A dt² → M`.
fn curve_of(
    system: &System,
    inspection: &Inspection,
    matrix: &dyn Fn(Stiffness, f64) -> SymmetricMatrix,
    factorization: &mut Ldlt,
) -> Plot {
    let limits = || inspection.options.iter().flat_map(|o| [o.critical.dt(), o.stable.dt()]).flatten();
    let middle = inspection.options[0].critical.dt().unwrap_or(inspection.dt);
    let low = limits().fold(middle, f64::min).min(inspection.dt) / 30.0;
    let high = limits().fold(middle, f64::max).max(inspection.dt) * 3.0;
    let points = if system.dofs().len() > LARGEST_DENSE { 17 } else { 49 };
    let steps = (0..points).map(|k| low * (high / low).powf(k as f64 / (points - 1) as f64));
    let [lightest, _] = system.free_masses();
    let mut work = Work::default();
    let mut plot = Plot::new(
        "Lowest eigenvalue of A over the time step",
        Axis::logarithmic("time step dt, s"),
        Axis::linear("λₘᵢₙ dt²/m, m the smallest mass"),
    );
    for (number, option) in Stiffness::ALL.into_iter().enumerate() {
        let mut values = Vec::with_capacity(points);
        for dt in steps.clone() {
            let a = matrix(option, dt);
            let scaled = smallest_eigenvalue(factorization, &a, &mut work) * dt * dt / lightest;
            // The curve begins at 1; what matters lies between that and zero.
            if scaled > 3.0 {
                break;
            }
            values.push((dt, scaled.max(-1.0)));
            if scaled < -1.0 {
                break;
            }
        }
        plot = plot.with_series(Series::line(option.name(), values).looking(Look { number, hollow: false }));
    }
    for option in &inspection.options {
        let name = option.option.name();
        let [definite, stable] = [option.critical, option.stable].map(|limit| limit.dt());
        for (what, limit) in [("definite", definite), ("stable", stable.filter(|_| stable != definite))] {
            if let Some(dt) = limit {
                let label = format!("{name} {what} up to {} s", short(dt));
                plot = plot.with_guide(Guide::Vertical { x: dt, label });
            }
        }
    }
    let definite = inspection.options.iter().map(|option| match option.critical.dt() {
        Some(dt) => format!("up to {} s under {}", short(dt), option.option.name()),
        None => format!("at every step under {}", option.option.name()),
    });
    plot.conclusion = format!("A is definite {}.", definite.collect::<Vec<_>>().join(", "));
    let here = Guide::Vertical { x: inspection.dt, label: format!("inspected: {} s", short(inspection.dt)) };
    plot.with_guide(here).with_guide(Guide::Level { y: 0.0, label: "definite above".into() })
}

fn low_end(inspection: &Inspection) -> Plot {
    let lowest = inspection.spectrum.lowest.iter().take(40).enumerate();
    let points: Vec<(f64, f64)> = lowest.map(|(k, pair)| (k as f64, pair.value)).collect();
    let title = format!("Lowest eigenvalues of A ({})", inspection.option.name());
    let (negative, positive): (Vec<_>, Vec<_>) = points.into_iter().partition(|&(_, value)| value < 0.0);
    let mut plot = Plot::new(title, Axis::linear("number, from 0"), Axis::linear("λ, N/m"));
    if let Some(lowest) = inspection.spectrum.lowest.first() {
        let Inertia { negative, zero, positive, .. } = inspection.examined().inertia;
        let below = match negative {
            0 => "None is negative".to_owned(),
            _ => format!("{negative} of {} are negative", negative + zero + positive),
        };
        plot.conclusion = format!("{below}; the lowest is {} N/m.", short(lowest.value));
    }
    for (number, (name, points)) in [("positive", positive), ("negative", negative)].into_iter().enumerate() {
        if !points.is_empty() {
            plot = plot.with_series(Series::scatter(name, points).looking(Look { number, hollow: false }));
        }
    }
    plot.with_guide(Guide::Level { y: 0.0, label: "definite above".into() })
}

/// Four digits, with a power of ten where the number is very large or small.
fn short(value: f64) -> String {
    match value.abs() {
        size if (1e-3..1e5).contains(&size) => {
            let decimals = (3.0 - size.log10().floor()).clamp(0.0, 6.0) as usize;
            format!("{value:.decimals$}").replace('-', "−")
        }
        _ => format!("{value:.3e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspect::fixtures::{pin, pinned};
    use crate::inspect::tests::chain;
    use faer::Par;

    fn inspected((system, state): &(System, State), dt: f64) -> Inspection {
        Inspection::at(system, state, dt, Stiffness::Full, Par::Seq).unwrap()
    }

    /// An eigenvalue of exactly zero, and one a little below: only this one spoils A and is drawn as negative.
    #[test]
    fn zero_is_not_negative() {
        for (mass, does, name) in [(10.0, "softens A", "positive"), (9.0, "spoils A", "negative")] {
            let held = pinned(&[pin(mass, 10.0)]);
            let found = inspected(&held, 1.0);
            assert_eq!(found.directions[0].eigenvalue, mass - 10.0);
            assert!(blame(&found).contains(does), "{}", blame(&found));
            let plot = low_end(&found);
            assert_eq!(plot.series.iter().map(|series| series.name.as_str()).collect::<Vec<_>>(), [name]);
            assert_eq!(found.clusters.len(), usize::from(mass < 10.0));
        }
    }

    /// Patterns are drawn at the end of a whole inspection: one that was interrupted has none.
    #[test]
    fn patterns_are_those_of_a_whole_inspection() {
        let held = chain(3, 1.25);
        let pictures = |inspection: &Inspection| Pictures::of(&held.0, &held.1, inspection).unwrap();
        let whole = inspected(&held, 0.1);
        assert!(pictures(&whole).patterns.is_some());
        // From 1 for short steps to −1, where it ends; the others stay where they began.
        let curve = pictures(&whole).curve.unwrap();
        let ends = |series: &Series| [series.points[0].1, series.points[series.points.len() - 1].1];
        let [[begin, end], [same, _], _] = [0, 1, 2].map(|k| ends(&curve.series[k]));
        assert!((begin - 1.0).abs() < 0.01 && end == -1.0 && (same - 1.0).abs() < 0.01, "{begin} {end} {same}");
        let interrupted = whole.without_curve();
        assert!(pictures(&interrupted).patterns.is_none() && pictures(&interrupted).curve.is_none());
    }
}

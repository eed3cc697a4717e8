//! A straight chain between two walls, of which everything is known in closed form.
//!
//! With N free particles of mass m and springs of stiffness k, rest length l0 and length l, −K has along the chain the eigenvalues `(k/l0) μⱼ` and
//! across it `k (1/l0 − 1/l) μⱼ`, with `μⱼ = 4 sin²(jπ/(2(N + 1)))`, j = 1 … N; A has `m/dt²` more.

use super::{Inertia, InertiaMethod, Inspection, LargestStep, Part, SkipReason, spectrum};
use crate::integrate::StepMatrices;
use crate::linear::norm;
use crate::spring::{Spring, Stiffness};
use crate::system::{State, System, SystemBuilder};
use crate::work::Work;
use faer::Par;
use std::f64::consts::PI;

const MASS: f64 = 2.0;
const STIFFNESS: f64 = 50.0;

/// In a plane, springs of length one.
pub(super) fn chain(free: usize, rest_length: f64) -> (System, State) {
    let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
    for p in 0..free + 2 {
        builder.particle([p as f64, 0.0, 0.0], MASS);
    }
    for p in 0..=free {
        builder.spring(p, p + 1, Spring { stiffness: STIFFNESS, rest_length, damping: 0.0 });
    }
    builder.hold(0);
    builder.hold(free + 1);
    builder.build().unwrap()
}

fn mu(free: usize) -> Vec<f64> {
    (1..=free).map(|j| 4.0 * (j as f64 * PI / (2.0 * (free as f64 + 1.0))).sin().powi(2)).collect()
}

fn coefficients(rest_length: f64) -> [f64; 2] {
    [STIFFNESS / rest_length, STIFFNESS * (1.0 / rest_length - 1.0)]
}

/// Eigenvalues of A, ascending.
pub(super) fn eigenvalues(free: usize, rest_length: f64, dt: f64) -> Vec<f64> {
    let mu = mu(free);
    let of = |c: f64| mu.iter().map(move |mu| MASS / (dt * dt) + c * mu);
    let mut values: Vec<f64> = coefficients(rest_length).into_iter().flat_map(of).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The step at which `m/dt²` is some number, in N/m.
pub(super) fn step_for(inertia: f64) -> f64 {
    (MASS / inertia).sqrt()
}

/// Small ones are diagonalised, large ones searched: pressed to four fifths of their length, and stretched to twice it. With 30 N/m the second pivot
/// of the pressed chain vanishes across it, and no eigenvalue does.
#[test]
fn spectra_are_those_of_the_closed_form() {
    for (free, rest_length, inertia) in
        [(130, 1.25, 33.0), (130, 1.25, 30.0), (130, 0.5, 33.0), (9, 1.25, 33.0), (130, 1.25, 60.0)]
    {
        let (system, state) = chain(free, rest_length);
        let dt = step_for(inertia);
        let a = StepMatrices::assemble(&system, &state, Stiffness::Full, dt).unwrap().a;
        let values = eigenvalues(free, rest_length, dt);
        let negative = values.iter().filter(|&&value| value < 0.0).count();
        let signs = Inertia::of(&a).unwrap();
        assert_eq!((signs.negative, signs.zero, signs.positive), (negative, 0, 2 * free - negative));
        assert!(signs.method != InertiaMethod::None && signs.factorization_error <= signs.band && signs.band < 1e-11);
        assert_eq!(signs.is_definite(), negative == 0);

        let wanted = 6;
        let mut work = Work::default();
        let found = spectrum(&a, &signs, wanted, Par::Seq, &mut work).unwrap();
        assert!(found.lowest.len() >= wanted && work.symbolic_factorizations == 1);
        let size = values.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
        for (pair, value) in found.lowest.iter().zip(&values) {
            // What is certified of both ends is half a millionth of ‖A‖.
            assert!((pair.value - value).abs() <= 5e-7 * size, "{} {value}", pair.value);
            assert!((norm(&pair.vector) - 1.0).abs() < 1e-12 && pair.residual < 1e-3 * size);
        }
        assert!((found.largest - values[2 * free - 1]).abs() <= 5e-7 * size, "{}", found.largest);
        assert_eq!(found.smallest(), found.lowest[0].value);
        // What is said to be proven is true, and as near as that.
        for ([low, high], value) in [(found.smallest_within, values[0]), (found.largest_within, values[2 * free - 1])] {
            assert!(low <= value && value <= high && high - low <= 2e-6 * size, "{low} {value} {high}");
        }
        assert_eq!(found.negative().len(), found.lowest.iter().filter(|pair| pair.value < 0.0).count());
        let nearest = values.iter().fold(f64::INFINITY, |nearest, value| nearest.min(value.abs()));
        // Of a definite matrix a thousandth of λ_min is certified.
        assert!((found.condition * nearest / size - 1.0).abs() < 2e-3, "{} {}", found.condition, size / nearest);
    }
}

/// All of it at once, at the state of a short chain.
#[test]
fn inspections_say_what_is_known() {
    let (free, inertia) = (7, 30.0);
    let (system, state) = chain(free, 1.25);
    let dt = step_for(inertia);
    let found = Inspection::at(&system, &state, dt, Stiffness::Full, Par::Seq).unwrap();
    let values = eigenvalues(free, 1.25, dt);
    let negative = values.iter().filter(|&&value| value < 0.0).count();
    assert!(negative > 1 && found.skipped.is_empty());
    assert_eq!((found.growing_modes, found.compressed_springs, found.dt), (free, free + 1, dt));
    let full = found.examined();
    assert_eq!((full.option, full.inertia.negative), (Stiffness::Full, negative));
    assert!((full.smallest - values[0]).abs() < 1e-9 && (full.largest - values[2 * free - 1]).abs() < 1e-9);
    let critical = step_for(10.0 * mu(free)[free - 1]);
    assert!(full.critical.dt().is_some_and(|dt| (dt / critical - 1.0).abs() < 1e-6));
    for option in &found.options[1..] {
        assert_eq!((option.inertia.negative, option.critical), (0, LargestStep::Every), "{}", option.option.name());
        // Without what is negative across, m/dt² is all there is; with the other sign more.
        let is_absolute = option.option == Stiffness::Absolute;
        assert!((option.smallest - inertia).abs() < 1e-9 || is_absolute && option.smallest > inertia + 1e-3);
    }
    assert_eq!(found.directions.len(), negative);
    for (direction, value) in found.directions.iter().zip(&values) {
        assert!((direction.eigenvalue - value).abs() < 1e-9);
        assert!((direction.stiffness_curvature - (value - inertia)).abs() < 1e-9);
        // Every spring is as strained, and bends the energy by its part of the whole.
        let shares: f64 = direction.culprits.iter().map(|culprit| culprit.share).sum();
        assert!((shares - 1.0).abs() < 0.01, "{shares}");
        for culprit in &direction.culprits {
            assert!((culprit.strain + 0.2).abs() < 1e-12 && culprit.curvature < 0.0);
            assert_eq!(culprit.particles, [culprit.spring, culprit.spring + 1]);
            assert!((culprit.share - culprit.curvature / direction.stiffness_curvature).abs() < 1e-12);
            // There is no part along: without its transverse term it bends nothing.
            assert!((culprit.relieved - (direction.eigenvalue - culprit.curvature)).abs() < 1e-9);
        }
        assert!(direction.movers.iter().all(|mover| mover.displacement.x.abs() < 1e-9));
    }
    let first = found.first.as_ref().unwrap();
    assert!(!first.definite && first.worst().is_some());
    assert!(
        found.smallest_set.is_some() && !found.clusters.is_empty() && (found.clusters[0].strain + 0.2).abs() < 1e-12
    );

    // A step so short that A is definite.
    let safe = Inspection::at(&system, &state, step_for(50.0), Stiffness::Full, Par::Seq).unwrap();
    assert!(safe.examined().inertia.is_definite() && safe.smallest_set.is_none() && safe.clusters.is_empty());
    assert!(safe.first.as_ref().is_none_or(|first| first.definite));
}

/// Figures of a matrix that is not factored, against its eigenvalues: proofs hold, estimates are near. A pressed chain is indefinite for a long step,
/// definite for a short one, and then only as far as is seen; a stretched one is definite.
#[test]
fn estimates_are_near_and_proofs_hold() {
    for (rest_length, inertia, definite, is_proven) in
        [(1.25, 33.0, false, true), (1.25, 60.0, true, false), (0.5, 33.0, true, true)]
    {
        let free = 130;
        let (system, state) = chain(free, rest_length);
        let dt = step_for(inertia);
        let values = eigenvalues(free, rest_length, dt);
        let (low, high) = (values[0], values[2 * free - 1]);
        let mut seen = Vec::new();
        let mut observer = |_: f64, found: &Inspection| seen.push(found.first.as_ref().map(|first| first.definite));
        let found =
            Inspection::estimated(&system, &state, dt, Stiffness::Full, SkipReason::TooMuchMemory, &mut observer)
                .unwrap();
        let first = found.first.as_ref().unwrap();
        assert_eq!((first.definite, first.is_proven), (definite, is_proven), "{rest_length} {inertia}");
        assert_eq!((found.is_definite(), found.is_proven()), (definite, is_proven));
        assert!(seen.contains(&Some(definite)));
        let full = &found.options[0];
        let size = high.max(-low);
        assert!((full.smallest - low).abs() <= 1e-2 * low.abs() && (full.largest - high).abs() <= 1e-2 * size);
        for ([below, above], value) in full.within.into_iter().zip([low, high]) {
            assert!(below <= value && value <= above + 1e-12 * size, "{below} {value} {above}");
        }
        assert!(full.within[0][0].is_finite() == (is_proven && definite));
        assert!(full.within[1][1] <= 4.0 * high);
        if !definite {
            assert!(!found.directions.is_empty() && !found.directions[0].culprits.is_empty());
            assert!(full.condition.is_nan());
        }
        for part in [Part::Spectrum(Stiffness::Full), Part::Spectrum(Stiffness::Axial)] {
            assert!(found.estimated.contains(&part) && !found.lacks(part));
        }
        assert_eq!(found.lacks(Part::Signs(Stiffness::Full)), rest_length > 1.0);
        assert!(!found.lacks(Part::Signs(Stiffness::Tension)) && found.lacks(Part::Turning(Stiffness::Axial)));
        assert_eq!((found.work.factorizations, found.work.symbolic_factorizations), (0, 0));
        // All other options are what they are where A is factored.
        let whole = Inspection::at(&system, &state, dt, Stiffness::Full, Par::Seq).unwrap();
        for (estimate, exact) in found.options.iter().zip(&whole.options) {
            assert!(
                (estimate.smallest - exact.smallest).abs() <= 1e-2 * exact.smallest.abs(),
                "{estimate:?} {exact:?}"
            );
            assert!((estimate.largest - exact.largest).abs() <= 1e-2 * exact.largest);
        }
        // In words: what is an estimate is called one.
        #[cfg(feature = "report")]
        {
            use crate::report::inspection::InspectionReport;
            let (step, time) = (0, 0.0);
            let report = InspectionReport { scene: "chain", step, time, inspection: &found, losses: None };
            let told = report.text();
            assert!(
                told.contains("  estimated    ") && told.contains("for the memory that a factor of A takes"),
                "{told}"
            );
            assert_eq!(told.contains("as far as is seen"), definite && !is_proven, "{told}");
            assert!(!told.contains("NaN") && !told.contains("inf"), "{told}");
        }
    }
}

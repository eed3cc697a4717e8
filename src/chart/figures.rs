//! What a chart shows, as plain pictures: speed against accuracy in time and in counted work, conservation, tolerances,
//! solvers.

use super::curve::{ADAPTIVE, Curve, curves};
use super::digits::short;
use super::monotone_range::tail;
use super::{Run, WorkPrecision};
use crate::figure::{Axis, Guide, Look, Plot, Series};
use crate::integrate::Method;
use std::collections::BTreeMap;

/// A plot with the name of its file and a sentence on how to read it.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// File name without extension.
    pub name: &'static str,
    /// How to read it.
    pub caption: String,
    /// The plot.
    pub plot: Plot,
}

/// The colour and shape of a method, the same in all pictures; hollow where its steps adapt.
pub fn look_of_method(method: &str) -> Look {
    let (name, hollow) = method.strip_suffix(ADAPTIVE).map_or((method, false), |name| (name, true));
    let known = Method::ALL.iter().position(|method| method.name() == name);
    Look { number: known.unwrap_or(Method::ALL.len()), hollow }
}

/// Those of a stiffness option, hollow with conjugate gradients.
fn look_of_option(stiffness: &str, solver: &str) -> Look {
    let known = ["full", "tension", "axial", "on-demand"].iter().position(|name| *name == stiffness);
    Look { number: known.unwrap_or(4), hollow: solver.starts_with("cg") }
}

impl Curve<'_> {
    /// How much the configuration costs, without regard to how far it was taken: the least of `cost · error^(1/2)` over its
    /// [tail](super::monotone_range()).
    fn coefficient(&self, floor: f64) -> f64 {
        let of_run = |run: &Run| run.useful_error().map(|error| run.cost * error.max(1e-15).sqrt());
        tail(self, floor).into_iter().filter_map(of_run).fold(f64::INFINITY, f64::min)
    }

    fn points(&self, y: impl Fn(&Run) -> f64) -> Vec<(f64, f64)> {
        self.runs.iter().filter_map(|run| Some((run.useful_error()?, y(run)))).collect()
    }
}

/// The runs that failed, by cause.
fn failures<'a>(runs: impl Iterator<Item = &'a Run>) -> BTreeMap<String, Vec<&'a Run>> {
    let mut failures: BTreeMap<String, Vec<&Run>> = BTreeMap::new();
    for run in runs {
        if let Some(cause) = run.cause() {
            failures.entry(cause).or_default().push(run);
        }
    }
    failures
}

/// Of each method the configuration that costs least, judged by runs that can be relied on; errors below `floor` are not told apart.
pub fn best_of_each(runs: &[Run], floor: f64) -> Vec<Curve<'_>> {
    let mut best: Vec<Curve<'_>> = Vec::new();
    for curve in curves(runs) {
        match best.iter_mut().find(|other| other.method == curve.method) {
            Some(other) if curve.coefficient(floor) < other.coefficient(floor) => *other = curve,
            Some(_) => {}
            None => best.push(curve),
        }
    }
    best
}

impl WorkPrecision {
    /// Every picture of the chart.
    pub fn figures(&self) -> Vec<Figure> {
        let best = best_of_each(&self.runs, self.floor());
        let by_method = |curve: &Curve<'_>| {
            let name = match (curve.stiffness, curve.solver) {
                ("none", _) => curve.method.clone(),
                (stiffness, "llt") => format!("{} ({stiffness})", curve.method),
                (stiffness, solver) => format!("{} ({stiffness}, {solver})", curve.method),
            };
            (name, look_of_method(&curve.method))
        };
        let implicit: Vec<Curve<'_>> = best.iter().filter(|curve| curve.stiffness != "none").cloned().collect();
        let mut figures = vec![
            self.work_precision("time", "Time against accuracy", "time of the run, s", &best, by_method, |run| {
                run.wall_seconds
            }),
            self.work_precision(
                "work",
                "Work against accuracy",
                "work, in force evaluations",
                &best,
                by_method,
                |run| run.cost,
            ),
            self.work_precision(
                "solves",
                "Linear solves against accuracy",
                "linear solves",
                &implicit,
                by_method,
                |run| run.work.solves as f64,
            ),
            self.errors(&best, by_method),
        ];
        for (name, method) in [("options-euler", "linear-backward-euler"), ("options-w2", "w2")] {
            let of_method: Vec<_> = curves(&self.runs).into_iter().filter(|curve| curve.method == method).collect();
            let title = format!("Stiffness options and solvers of {method}");
            let legend = |curve: &Curve<'_>| {
                (format!("{}, {}", curve.stiffness, curve.solver), look_of_option(curve.stiffness, curve.solver))
            };
            figures.push(
                self.work_precision(name, &title, "work, in force evaluations", &of_method, legend, |run| run.cost),
            );
        }
        figures.push(self.drift("energy", "Energy gained or lost", &best, by_method, |run| {
            run.quality.map(|quality| quality.energy_drift.abs())
        }));
        figures.push(self.drift("angular-momentum", "Angular momentum gained or lost", &best, by_method, |run| {
            run.quality.map(|quality| quality.angular_momentum_drift)
        }));
        figures.extend(self.tolerance_figures());
        figures.extend(self.size_figures());
        figures.retain(|figure| figure.plot.series.iter().any(|series| !series.points.is_empty()));
        for figure in &mut figures {
            figure.plot.conclusion = self.conclusion(figure).unwrap_or_default();
        }
        figures
    }

    fn work_precision(
        &self,
        name: &'static str,
        title: &str,
        cost: &str,
        curves: &[Curve<'_>],
        legend: impl Fn(&Curve<'_>) -> (String, Look),
        y: impl Fn(&Run) -> f64 + Copy,
    ) -> Figure {
        let mut plot = Plot::log_log(format!("{title}: {}", self.scene), "relative position error at the end", cost);
        for curve in curves {
            let (name, look) = legend(curve);
            plot = plot.with_series(Series::line(name, curve.points(y)).looking(look));
        }
        for curve in curves {
            for (cause, runs) in failures(curve.runs.iter().copied()) {
                let points = runs.iter().map(|run| (f64::INFINITY, y(run))).filter(|point| point.1 > 0.0).collect();
                plot = plot.with_series(Series::failures(cause, points).like(legend(curve).0));
            }
        }
        plot = self.with_floor(plot);
        // The guides pass where the curves are: through the middle of the most accurate half of the errors.
        let all: Vec<(f64, f64)> = plot.series.iter().flat_map(|series| series.points.iter().copied()).collect();
        if let Some(anchor) = middle(&all) {
            for order in [1.0, 2.0] {
                plot = plot.with_guide(Guide::Slope { slope: -1.0 / order, through: anchor });
            }
        }
        let caption: String =
            "To the left is more accurate, down is cheaper: the lowest curve at the error you need wins. Steps are \
            halved from point to point. A method of order 1 follows the slope −1, one of order 2 the slope −½."
                .into();
        let caption = match plot.series.iter().any(|series| series.like.is_some()) {
            true => format!(
                "{caption} Crosses at the right edge are runs that broke down or ended more than 100 % off, each cause in a lane of its \
                 own, at the cost they had until then."
            ),
            false => caption,
        };
        Figure { name, caption, plot }
    }

    fn with_floor(&self, plot: Plot) -> Plot {
        let x = self.reference.error_estimate;
        plot.with_guide(Guide::Vertical { x, label: format!("error of the reference: {x:.0e}") })
    }

    fn errors(&self, curves: &[Curve<'_>], legend: impl Fn(&Curve<'_>) -> (String, Look)) -> Figure {
        let title = format!("Error over the time step: {}", self.scene);
        let mut plot = Plot::log_log(title, "time step, s", "relative position error at the end");
        for curve in curves {
            let points = curve.runs.iter().filter_map(|run| Some((run.dt, run.useful_error()?))).collect();
            let (name, look) = legend(curve);
            plot = plot.with_series(Series::line(name, points).looking(look));
        }
        let all = super::curves(&self.runs);
        for curve in curves {
            // Those of the method's other configurations too.
            let of_method = all.iter().filter(|other| other.method == curve.method);
            for (cause, runs) in failures(of_method.flat_map(|curve| &curve.runs).copied()) {
                let points = runs.iter().map(|run| (run.dt, f64::INFINITY)).collect();
                plot = plot.with_series(Series::failures(cause, points).like(legend(curve).0));
            }
        }
        let all: Vec<(f64, f64)> =
            plot.series.iter().flat_map(|series| series.points.iter().copied()).filter(|p| p.1.is_finite()).collect();
        if let Some(anchor) = middle(&all) {
            plot = plot.with_guide(Guide::Slope { slope: 1.0, through: anchor });
            plot = plot.with_guide(Guide::Slope { slope: 2.0, through: anchor });
        }
        let level = Guide::Level { y: self.reference.error_estimate, label: "error of the reference".into() };
        let crosses = match plot.series.iter().any(|series| series.like.is_some()) {
            true => {
                " Crosses are runs of any of its configurations that failed, at their step, each cause in a lane of its own; the table below names them."
            }
            false => "",
        };
        let caption = format!("Where a curve falls straight its slope is the order of its method.{crosses}");
        Figure { name: "error", caption, plot: plot.with_guide(level) }
    }

    fn drift(
        &self,
        name: &'static str,
        title: &str,
        curves: &[Curve<'_>],
        legend: impl Fn(&Curve<'_>) -> (String, Look),
        y: impl Fn(&Run) -> Option<f64>,
    ) -> Figure {
        let title = format!("{title}: {}", self.scene);
        let mut plot = Plot::log_log(title, "time step, s", "difference from the reference, relative");
        for curve in curves {
            let useful = curve.runs.iter().filter(|run| run.useful_error().is_some());
            let points = useful.filter_map(|run| Some((run.dt, y(run)?))).filter(|point| point.1 > 0.0).collect();
            let (name, look) = legend(curve);
            plot = plot.with_series(Series::line(name, points).looking(look));
        }
        let caption =
            "At the end of the run, against the reference: what the method itself adds or takes away. Rounding \
            is about 10⁻¹⁵."
                .into();
        Figure { name, caption, plot }
    }

    fn tolerance_figures(&self) -> Vec<Figure> {
        let title = |what: &str| format!("Tolerance of conjugate gradients and {what}: {}", self.scene);
        let x = "tolerance: ‖b − A δx‖ / ‖b‖";
        let mut errors = Plot::log_log(title("error"), x, "relative position error at the end");
        let mut iterations = Plot::log_log(title("work"), x, "iterations in all");
        for method in ["linear-backward-euler", "w2"] {
            let of_method = || self.tolerances.iter().filter(|run| run.method == method);
            let points = |y: &dyn Fn(&Run) -> Option<f64>| {
                of_method().filter_map(|run| Some((run.tolerance?, y(run)?))).collect::<Vec<_>>()
            };
            let look = look_of_method(method);
            errors = errors.with_series(Series::line(method, points(&|run| run.useful_error())).looking(look));
            let of_iterations = points(&|run| Some(run.work.cg_iterations as f64));
            iterations = iterations.with_series(Series::line(method, of_iterations).looking(look));
        }
        let step = self.tolerances.first().map_or(String::new(), |run| format!(", with steps of {} s", short(run.dt)));
        let caption = format!(
            "Where the curve is flat the error of the step dominates and a looser tolerance costs no accuracy{step}."
        );
        let cost = format!("All iterations of the run together{step}.");
        vec![
            Figure { name: "tolerance-error", caption, plot: errors },
            Figure { name: "tolerance-work", caption: cost, plot: iterations },
        ]
    }

    fn size_figures(&self) -> Vec<Figure> {
        let mut figures = Vec::new();
        for (kind, name) in [("cloth", "sizes-cloth"), ("lattice", "sizes-lattice")] {
            let title = format!("Factorization or iteration: ready scenes, {kind}");
            let mut plot =
                Plot::new(title, Axis::logarithmic("degrees of freedom"), Axis::logarithmic("time of a step, s"));
            for solver in ["llt", "cg", "cg-assembled"] {
                let of_solver = self.sizes.iter().filter(|run| run.kind == kind && run.solver == solver);
                let points = of_solver.map(|run| (run.dofs as f64, run.seconds_per_step)).collect();
                plot = plot.with_series(Series::line(solver, points));
            }
            let caption =
                "One step of linearised backward Euler with the option tension: sparse Cholesky (llt) against \
                conjugate gradients to 10⁻¹⁰, without a matrix and on the assembled one."
                    .into();
            figures.push(Figure { name, caption, plot });
        }
        figures
    }
}

/// A point in the midst of others on logarithmic axes.
fn middle(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    let finite: Vec<&(f64, f64)> =
        points.iter().filter(|(x, y)| *x > 0.0 && *y > 0.0 && x.is_finite() && y.is_finite()).collect();
    let count = finite.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| (finite.iter().map(|p| of(p).ln()).sum::<f64>() / count).exp();
    (!finite.is_empty()).then(|| (mean(|p| p.0), mean(|p| p.1)))
}

#[cfg(test)]
mod tests {
    use super::middle;

    /// The geometric mean: of 1, 4 and 16 it is 4; what logarithmic axes do not show does not count.
    #[test]
    fn the_middle_is_that_of_what_is_shown() {
        let hidden = [(0.0, 5.0), (5.0, 0.0), (-1.0, 5.0), (5.0, -1.0), (f64::INFINITY, 5.0), (5.0, f64::NAN)];
        assert_eq!(middle(&hidden), None);
        let shown = [(1.0, 9.0), (4.0, 9.0), (16.0, 9.0)];
        let (x, y) = middle(&[&hidden[..], &shown].concat()).unwrap();
        assert!((x - 4.0).abs() < 1e-12 && (y - 9.0).abs() < 1e-12, "{x} {y}");
    }
}

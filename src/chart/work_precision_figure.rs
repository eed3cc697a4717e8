//! The pictures of a chart: speed against accuracy in time and in counted work, and conservation.

use super::curve::{Curve, best_of_each, cheapest_first, curves};
use super::decision::name;
use super::run::ADAPTIVE;
use super::{Run, WorkPrecision};
use crate::figure::{Guide, Look, Plot, Series};
use crate::integrate::Method;
use std::collections::BTreeMap;

/// A plot with the name of its file and a sentence on how to read it.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// File name without extension.
    pub name: &'static str,
    /// A sentence on how to read it.
    pub caption: String,
    /// The plot, of at most six curves, the cheapest first.
    pub plot: Plot,
    /// The plot with every curve, where `plot` leaves some out.
    pub full: Option<Plot>,
}

impl Figure {
    fn new(name: &'static str, caption: impl Into<String>, plot: Plot) -> Self {
        Self { name, caption: caption.into(), plot, full: None }
    }

    /// Leaves the first six curves in `plot`, with their failures, as more are not told apart at a glance, and keeps all of them in `full`.
    fn leave_leading(&mut self) {
        let lines = self.plot.series.iter().filter(|series| series.like.is_none() && !series.points.is_empty());
        let names: Vec<String> = lines.map(|series| series.name.clone()).collect();
        if let Some((leading, [_, ..])) = names.split_at_checked(6) {
            self.full = Some(self.plot.clone());
            self.plot.series.retain(|series| leading.contains(series.like.as_ref().unwrap_or(&series.name)));
        }
    }
}

type Legend = fn(&Curve<'_>) -> (String, Look);

/// The colour and shape of a method, the same in all pictures; hollow where its steps adapt.
fn look_of_method(method: &str) -> Look {
    let (name, hollow) = method.strip_suffix(ADAPTIVE).map_or((method, false), |name| (name, true));
    let known = Method::ALL.iter().position(|method| method.name() == name);
    Look { number: known.unwrap_or(Method::ALL.len()), hollow }
}

fn by_method(curve: &Curve<'_>) -> (String, Look) {
    (name(&curve.method, curve.stiffness, curve.solver), look_of_method(&curve.method))
}

fn by_option(curve: &Curve<'_>) -> (String, Look) {
    let known = ["full", "tension", "axial", "on-demand"].iter().position(|name| *name == curve.stiffness);
    let look = Look { number: known.unwrap_or(4), hollow: curve.solver.starts_with("cg") };
    (format!("{}, {}", curve.stiffness, curve.solver), look)
}

fn with_curves(plot: Plot, curves: &[Curve<'_>], legend: Legend, point: impl Fn(&Run) -> Option<(f64, f64)>) -> Plot {
    curves.iter().fold(plot, |plot, curve| {
        let (name, look) = legend(curve);
        plot.with_series(Series::line(name, curve.runs.iter().filter_map(|run| point(run)).collect()).looking(look))
    })
}

fn with_failures<'a>(
    plot: Plot,
    curves: &[Curve<'a>],
    legend: Legend,
    runs_of: impl Fn(&Curve<'a>) -> Vec<&'a Run>,
    point: impl Fn(&Run) -> (f64, f64),
) -> Plot {
    curves.iter().fold(plot, |plot, curve| {
        let mut failures: BTreeMap<String, Vec<(f64, f64)>> = BTreeMap::new();
        for run in runs_of(curve) {
            if let Some(cause) = run.cause() {
                let points = failures.entry(cause).or_default();
                points.extend(Some(point(run)).filter(|(x, y)| *x > 0.0 && *y > 0.0));
            }
        }
        failures
            .into_iter()
            .fold(plot, |plot, (cause, points)| plot.with_series(Series::failures(cause, points).like(legend(curve).0)))
    })
}

fn with_slopes(mut plot: Plot, slopes: [f64; 2]) -> Plot {
    let points: Vec<(f64, f64)> = plot.series.iter().flat_map(|series| series.points.iter().copied()).collect();
    if let Some(through) = middle(&points) {
        plot.guides.extend(slopes.map(|slope| Guide::Slope { slope, through }));
    }
    plot
}

fn has_failures(plot: &Plot) -> bool {
    plot.series.iter().any(|series| series.like.is_some())
}

impl WorkPrecision {
    /// Every picture of the chart.
    pub fn figures(&self) -> Vec<Figure> {
        let floor = self.floor();
        let best = cheapest_first(best_of_each(&self.runs, floor), floor);
        // The cheapest solver of every option before the others.
        let of_method = |method: &str| -> Vec<Curve<'_>> {
            let all = curves(&self.runs).into_iter().filter(|curve| curve.method == method).collect();
            let mut options = Vec::new();
            let is_first = |curve: &Curve<'_>| {
                let is_new = !options.contains(&curve.stiffness);
                options.push(curve.stiffness);
                is_new
            };
            let (first, others): (Vec<_>, Vec<_>) = cheapest_first(all, floor).into_iter().partition(is_first);
            [first, others].concat()
        };
        let work = "work, in force evaluations";
        let options = |method: &str| format!("Stiffness options and solvers of {method}");
        let [euler, w2] = ["linear-backward-euler", "w2"];
        let mut figures = vec![
            self.work_precision("time", "Time against accuracy", "time of the run, s", &best, by_method, |run| {
                run.wall_seconds
            }),
            self.work_precision("work", "Work against accuracy", work, &best, by_method, |run| run.cost),
            self.errors(&best),
            self.work_precision("options-euler", &options(euler), work, &of_method(euler), by_option, |run| run.cost),
            self.work_precision("options-w2", &options(w2), work, &of_method(w2), by_option, |run| run.cost),
            self.drift("energy", "Energy gained or lost", &best, |run| Some(run.quality?.energy_drift.abs())),
            self.drift("angular-momentum", "Angular momentum gained or lost", &best, |run| {
                Some(run.quality?.angular_momentum_drift)
            }),
        ];
        figures.retain(|figure| figure.plot.series.iter().any(|series| !series.points.is_empty()));
        for figure in &mut figures {
            figure.plot.conclusion = self.conclusion(figure).unwrap_or_default();
            figure.leave_leading();
        }
        figures
    }

    fn work_precision(
        &self,
        name: &'static str,
        title: &str,
        cost_title: &str,
        curves: &[Curve<'_>],
        legend: Legend,
        cost: impl Fn(&Run) -> f64,
    ) -> Figure {
        let title = format!("{title}: {}", self.scene);
        let plot = Plot::log_log(title, "relative position error at the end", cost_title);
        let plot = with_curves(plot, curves, legend, |run| Some((run.useful_error()?, cost(run))));
        let plot = with_failures(plot, curves, legend, |curve| curve.runs.clone(), |run| (f64::INFINITY, cost(run)));
        let x = self.reference.error_estimate;
        let plot = plot.with_guide(Guide::Vertical { x, label: format!("error of the reference: {x:.0e}") });
        let plot = with_slopes(plot, [-1.0, -0.5]);
        let mut caption: String =
            "To the left is more accurate, down is cheaper: the lowest curve at the error you need wins. Steps are \
            halved from point to point. A method of order 1 follows the slope −1, one of order 2 the slope −½."
                .into();
        if has_failures(&plot) {
            caption += " Crosses at the right edge are runs that broke down or ended more than 100 % off, each cause in a lane of its \
                own, at the cost they had until then.";
        }
        Figure::new(name, caption, plot)
    }

    fn errors<'a>(&'a self, curves: &[Curve<'a>]) -> Figure {
        let title = format!("Error over the time step: {}", self.scene);
        let plot = Plot::log_log(title, "time step, s", "relative position error at the end");
        let plot = with_curves(plot, curves, by_method, |run| Some((run.dt, run.useful_error()?)));
        let all = super::curve::curves(&self.runs);
        let of_method = |curve: &Curve<'_>| {
            all.iter().filter(|other| other.method == curve.method).flat_map(|other| other.runs.clone()).collect()
        };
        let plot = with_failures(plot, curves, by_method, of_method, |run| (run.dt, f64::INFINITY));
        let plot = with_slopes(plot, [1.0, 2.0]);
        let level = Guide::Level { y: self.reference.error_estimate, label: "error of the reference".into() };
        let mut caption = "Where a curve falls straight its slope is the order of its method.".to_owned();
        if has_failures(&plot) {
            caption += " Crosses are runs of any of its configurations that failed, at their step, each cause in a lane of its own.";
        }
        Figure::new("error", caption, plot.with_guide(level))
    }

    fn drift(
        &self,
        name: &'static str,
        title: &str,
        curves: &[Curve<'_>],
        drift: impl Fn(&Run) -> Option<f64>,
    ) -> Figure {
        let title = format!("{title}: {}", self.scene);
        let plot = Plot::log_log(title, "time step, s", "difference from the reference, relative");
        let plot = with_curves(plot, curves, by_method, |run| {
            run.useful_error()?;
            Some((run.dt, drift(run).filter(|drift| *drift > 0.0)?))
        });
        let caption = "At the end of the run, against the reference: what the method itself adds or takes away. Rounding \
            is about 10⁻¹⁵.";
        Figure::new(name, caption, plot)
    }
}

/// The geometric mean of the points that logarithmic axes show.
fn middle(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    let shown = |(x, y): &&(f64, f64)| *x > 0.0 && *y > 0.0 && x.is_finite() && y.is_finite();
    let points: Vec<&(f64, f64)> = points.iter().filter(shown).collect();
    let mean =
        |of: fn(&(f64, f64)) -> f64| (points.iter().map(|p| of(p).ln()).sum::<f64>() / points.len() as f64).exp();
    (!points.is_empty()).then(|| (mean(|p| p.0), mean(|p| p.1)))
}

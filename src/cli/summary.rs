//! The summary of a run for people.

use super::Stop;
use super::console::{Console, count, number, time_span, warning};
use super::view::PAGE;
use sprung::System;
use sprung::integrate::{Balance, percent};
use sprung::output::{ErrorKind, Summary, TRAJECTORY};
use std::fmt::{self, Display};
use std::path::Path;

/// The summary of a run for people: status, error, method and files, and with `{:#}` everything.
pub struct SummaryText<'a> {
    pub summary: &'a Summary,
    pub system: &'a System,
    pub folder: &'a Path,
    pub files: &'a [&'static str],
}

impl Display for SummaryText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { summary, folder, files, .. } = self;
        let Summary { scene, status, steps, time, wall_seconds, method, stiffness, .. } = summary;
        let (status, steps, time) = (status.name(), count(*steps, "step"), number(*time));
        writeln!(f, "{scene}: {status} at t = {time} s after {steps}, in {}", time_span(*wall_seconds))?;
        if let Some(error) = &summary.error {
            let kind = match error.kind {
                ErrorKind::Confirmed => "confirmed",
                ErrorKind::Indicator => "an estimate, accurate to about a factor of ten",
            };
            match error.estimate {
                0.0 => writeln!(f, "  error     none found (an estimate)")?,
                estimate => writeln!(f, "  error     about {} of the extent ({kind})", percent(estimate))?,
            }
        }
        match (summary.solver, summary.preconditioner) {
            ("none", _) => writeln!(f, "  method    {method}")?,
            (solver, "none") => writeln!(f, "  method    {method}, stiffness {stiffness}, solver {solver}")?,
            (solver, preconditioner) => {
                writeln!(f, "  method    {method}, stiffness {stiffness}, solver {solver} with {preconditioner}")?;
            }
        }
        if f.alternate() {
            self.details(f)?;
        }
        writeln!(f, "  files     {} in {}", files.join(", "), folder.display())?;
        if files.contains(&PAGE) {
            write!(f, "open {}", folder.join(PAGE).display())
        } else if files.contains(&TRAJECTORY) {
            write!(f, "  motion    kept; sprung view {} plays it", folder.display())
        } else {
            write!(f, "  motion    not kept; with --view the run writes a page that plays it")
        }
    }
}

impl SummaryText<'_> {
    /// Prints the reasons to doubt the run, and then the summary, whose last line is the page to open.
    pub fn print(&self, console: &Console) -> Result<(), Stop> {
        let summary = self.summary;
        summary.warnings.iter().for_each(warning);
        if summary.statistics.indefinite_solves > 0 {
            let solves = count(summary.statistics.indefinite_solves, "solve");
            console.note(format_args!("A was indefinite in {solves}: the motion may look right and be wrong"));
        }
        console.result(summary, self)
    }

    fn details(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Summary { solver, energy, statistics, particles, springs, dofs, .. } = self.summary;
        let work = &statistics.work;
        let mut line = |name: &str, text: String| writeln!(f, "  {name:<9} {text}");
        let parts = [(*particles, "particle"), (*springs, "spring"), (*dofs, "degree of freedom")];
        line("system", parts.map(|(n, noun)| count(n as u64, noun)).join(", "))?;
        // Maxwell's count: a spring is a condition on motions, and one that resists in every direction is one for every axis.
        let without_length = self.system.springs().iter().filter(|spring| spring.rest_length == 0.0).count();
        let conditions = springs + (self.system.dimension() - 1) * without_length;
        if let Some(free) = dofs.checked_sub(conditions).filter(|free| *free > 0) {
            let motions = if free == 1 { "1 motion stretches".into() } else { format!("{free} motions stretch") };
            line("floppy", format!("at least {motions} no spring; sprung mechanisms names them"))?;
        }
        let method_reason = self.summary.choice.as_ref().map(|choice| &choice.reason);
        for reason in method_reason.into_iter().chain(&self.summary.solver_choice) {
            line("chosen", reason.clone())?;
        }
        if *solver == "none" {
            line("work", count(work.force_evaluations, "force evaluation"))?;
        } else {
            let counts = [
                (work.solves, "solve"),
                (work.factorizations, "factorization"),
                (work.cg_iterations, "CG iteration"),
                (work.newton_iterations, "Newton iteration"),
            ];
            line("work", counts.map(|(n, noun)| count(n, noun)).join(", "))?;
            let (residual, tolerance) = (statistics.max_relative_residual, statistics.max_tolerance);
            let tolerance =
                if tolerance > 0.0 { format!("; asked for {tolerance:.1e} or less") } else { String::new() };
            line("residual", format!("at most {residual:.1e} of the right-hand side{tolerance}"))?;
        }
        if statistics.rejected_steps > 0 {
            line("rejected", format!("{} with too large an error", count(statistics.rejected_steps, "step")))?;
        }
        if statistics.softened_solves > 0 {
            let each = statistics.dropped_terms as f64 / statistics.softened_solves as f64;
            let solves = count(statistics.softened_solves, "solve");
            line("dropped", format!("{each:.1} transverse terms on average in {solves} where A was indefinite"))?;
        }
        line("energy", format!("{} J at the start, {} J at the end", number(energy.initial), number(energy.last)))?;
        let Balance { work, dissipated, imbalance } = energy.balance;
        // Of work and dissipation no more digits are right than what is unexplained leaves.
        let known = |value: f64| {
            let digits = (value / imbalance).abs().log10() + 1.0;
            rounded(value, if digits.is_finite() { digits.clamp(1.0, 6.0) as usize } else { 6 })
        };
        let [work, dissipated, imbalance] = [known(work), known(dissipated), rounded(imbalance, 2)].map(number);
        let text = format!("{work} J of work from outside, {dissipated} J dissipated, {imbalance} J unexplained");
        line("balance", text)
    }
}

fn rounded(value: f64, digits: usize) -> f64 {
    format!("{value:.*e}", digits - 1).parse().unwrap_or(value)
}

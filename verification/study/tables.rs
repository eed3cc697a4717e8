//! The counted outcomes, and their page.

use super::cases::{Case, WRONG, asked, cases, is_ordinary};
use super::record::Record;
use super::rows::{by, by_way, number, offenders, quantile, share, sorted, spread};
use super::runs::Ask;
use std::collections::BTreeMap;
use std::fmt::Write;

/// The page.
pub fn page(records: &[Record]) -> String {
    let seeds = || records.iter().filter_map(|record| record.seed);
    let random = seeds().count();
    let mut page = format!(
        "# Random scenes\n\n\
         Made by `cargo xtask study`, which writes this page: {random} random scenes and {} with names. Networks, cloths,\n\
         chains, rods, lattices and columns in one to three dimensions, soft to stiff, damped or not, held or moved, one scene for each\n\
         seed; the hard cases of `scenes/hard`; and ready scenes. Errors are relative position errors at the end against DOP853 (the\n\
         crate `ode_solvers`, tolerance 10⁻¹³) on a second writing of the forces; the same at 10⁻¹¹ tells how well they are known. `--export SEED\n\
         FILE` writes a scene for the command, `--only SEED` shows it run by run.\n\n\
         Seeds are {} to {}. Those from 0 to 999 are for development: constants were set by them, and promises are not judged on them.\n\n",
        records.len() - random,
        seeds().min().unwrap_or(0),
        seeds().max().unwrap_or(0),
    );
    page.push_str(&promises(records));
    let cases = cases(records);
    let of = |want: fn(&Ask) -> bool| cases.iter().copied().filter(|case| want(&case.run.ask)).collect::<Vec<_>>();
    page.push_str(&scenes(records));
    page.push_str(&fixed(&of(|ask| matches!(ask, Ask::Dt(_)))));
    page.push_str(&tolerances(&of(|ask| matches!(ask, Ask::Rtol(_)))));
    page.push_str(&accuracies(&of(|ask| matches!(ask, Ask::Accuracy(_)))));
    page
}

/// The promises, and their outcome.
fn promises(records: &[Record]) -> String {
    let cases = cases(records);
    let of = |what: &dyn Fn(&Case) -> bool| cases.iter().copied().filter(|case| what(case)).collect::<Vec<_>>();
    let count = |cases: &[Case], what: &dyn Fn(&Case) -> bool| cases.iter().filter(|case| what(case)).count();
    let fixed = of(&|case| matches!(case.run.ask, Ask::Dt(_)));
    let wrong = of(&|case| {
        matches!(case.run.ask, Ask::Dt(_)) && case.run.is_completed() && case.run.error() > WRONG && case.tells(WRONG)
    });
    let right = of(&|case| matches!(case.run.ask, Ask::Dt(_)) && case.is_right());
    let known = of(&|case| matches!(case.run.ask, Ask::Dt(_)) && case.ratio().is_some());
    let adaptive = of(&|case| {
        matches!(case.run.ask, Ask::Rtol(_)) && case.tells(5.0 * asked(case)) && case.run.status != "too-long"
    });
    let ordinary = of(&|case| {
        matches!(case.run.ask, Ask::Rtol(_))
            && case.tells(5.0 * asked(case))
            && case.is_ordinary()
            && case.run.is_completed()
    });
    let accurate = |accuracy: f64| of(&|case: &Case| case.run.ask == Ask::Accuracy(accuracy) && case.tells(accuracy));
    let within = |case: &Case, times: f64| case.run.is_completed() && case.run.error() <= times * asked(case);
    let mut text = String::from("## Promises\n\n| of | promised | measured |\n|---|---|---|\n");
    let mut line = |of: String, promised: &str, measured: String| {
        let _ = writeln!(text, "| {of} | {promised} | {measured} |");
    };
    if !fixed.is_empty() {
        let silent = count(&wrong, &|case| case.is_silent());
        let completed = count(&fixed, &|case| case.run.is_completed());
        line(
            format!("{completed} completed runs of fixed steps, {} with an error above 30 %", wrong.len()),
            "at most 0.3 % wrong by so much and without a warning",
            format!("{} ({:.2} %)", silent, 100.0 * silent as f64 / completed.max(1) as f64),
        );
        line(
            format!("{} with an error below 1 %", right.len()),
            "at most 5 % with a warning",
            share(count(&right, &|case| case.is_false_alarm()), right.len()),
        );
        line(
            format!("{} estimates of the error", known.len()),
            "at least 85 % within ten times",
            share(count(&known, &|case| case.ratio().is_some_and(|r| (0.1..=10.0).contains(&r))), known.len()),
        );
    }
    if !adaptive.is_empty() {
        line(
            format!("{} runs with `--rtol`", adaptive.len()),
            "at least 97 % within 5 times",
            share(count(&adaptive, &|case| within(case, 5.0)), adaptive.len()),
        );
        line(
            format!("{} of them on ordinary scenes", ordinary.len()),
            "none above 20 times",
            format!("{}", count(&ordinary, &|case| !within(case, 20.0))),
        );
    }
    for accuracy in [1e-2, 1e-4] {
        let cases = accurate(accuracy);
        if !cases.is_empty() {
            let completed: Vec<_> = cases.iter().copied().filter(|case| case.run.is_completed()).collect();
            line(
                format!("{} runs with `--accuracy {accuracy:e}`", cases.len()),
                "at most 0.5 % above R, none above 3 R, at most 5 % unconfirmed",
                format!(
                    "{}, {}, {}",
                    share(count(&completed, &|case| !within(case, 1.0)), cases.len()),
                    count(&completed, &|case| !within(case, 3.0)),
                    share(cases.len() - completed.len(), cases.len()),
                ),
            );
        }
    }
    text.push('\n');
    text
}

fn scenes(records: &[Record]) -> String {
    let mut shapes = BTreeMap::<&str, Vec<&Record>>::new();
    for record in records {
        shapes.entry(&record.shape).or_default().push(record);
    }
    let mut text = String::from(
        "## The scenes\n\nA deviation at the start grows by the factor that a disturbed reference shows. Ordinary scenes amplify it at most a\n\
         hundredfold, and no spring of theirs shrinks to a twentieth of its length. The reference's own error is an upper bound.\n\n\
         | kind | scenes | particles | Ω = ωT | damped | moved | ordinary | growth: median, 90 %, most | reference's error: median, 90 %, most | without reference |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    for (shape, records) in shapes {
        let count = |what: &dyn Fn(&Record) -> bool| records.iter().filter(|record| what(record)).count();
        let range = |values: Vec<f64>| {
            let values = sorted(values);
            values.first().zip(values.last()).map_or("–".into(), |(a, b)| format!("{a:.0} … {b:.0}"))
        };
        let _ = writeln!(
            text,
            "| {shape} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            records.len(),
            range(records.iter().map(|r| r.particles as f64).collect()),
            range(records.iter().filter_map(|r| r.pace).collect()),
            count(&|r| r.damped),
            count(&|r| r.moved),
            count(&is_ordinary),
            spread(records.iter().filter_map(|r| r.amplification).collect()),
            spread(records.iter().filter_map(|r| r.reference_error).collect()),
            count(&|r| r.reference_error.is_none()),
        );
    }
    text.push('\n');
    text
}

/// Runs of fixed steps.
fn fixed(cases: &[Case]) -> String {
    let mut text = String::from(
        "## Steps of fixed length\n\nT/30, T/100, T/300, and 0.01 s and 1/60 s where that makes 10 to 1000 steps. *Silent*: completed with an error above 30 % and \
         without\na warning. *Alarms*: warnings with an error below 1 %.\n\n\
         | method | runs | completed | error: median, 90 %, most | above 30 % | silent | below 1 % | alarms | with estimate | within 3 | within 10 times |\n\
         |---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for (name, cases) in by_way(cases).into_iter().chain([("all".to_owned(), cases.to_vec())]) {
        let _ = writeln!(text, "| {name} {}", fixed_row(&cases));
    }
    text.push_str("\nBy kind of scene, all methods:\n\n| kind | runs | completed | error: median, 90 %, most | above 30 % | silent | below 1 % | alarms | with estimate | within 3 | within 10 times |\n|---|---|---|---|---|---|---|---|---|---|---|\n");
    for (name, cases) in by(cases, |case| case.record.shape.clone()) {
        let _ = writeln!(text, "| {name} {}", fixed_row(&cases));
    }
    text.push_str("\nHow runs ended that did not complete:\n\n| method | ");
    let ends = by(cases, |case| case.run.status.clone());
    for end in ends.keys() {
        let _ = write!(text, "{end} | ");
    }
    text.push_str("\n|---|");
    text.push_str(&"---|".repeat(ends.len()));
    text.push('\n');
    for (name, cases) in by_way(cases) {
        let _ = write!(text, "| {name} |");
        for end in ends.keys() {
            let _ = write!(text, " {} |", cases.iter().filter(|case| case.run.status == *end).count());
        }
        text.push('\n');
    }
    let mut silent: Vec<_> = cases.iter().filter(|case| case.is_silent()).copied().collect();
    silent.sort_by(|a, b| b.run.error().total_cmp(&a.run.error()));
    text.push_str(&offenders("Silent though wrong, worst first", &silent));
    let mut alarms: Vec<_> = cases.iter().filter(|case| case.is_false_alarm()).copied().collect();
    alarms.sort_by(|a, b| a.run.error().total_cmp(&b.run.error()));
    text.push_str(&offenders("Alarms, most accurate first", &alarms));
    let mut misjudged: Vec<_> = cases.iter().filter(|case| case.ratio().is_some()).copied().collect();
    let distance = |case: &Case| case.ratio().map_or(0.0, |ratio| ratio.ln().abs());
    misjudged.sort_by(|a, b| distance(b).total_cmp(&distance(a)));
    text.push_str(&offenders("Estimates farthest from the truth", &misjudged));
    text.push('\n');
    text
}

fn fixed_row(cases: &[Case]) -> String {
    let completed: Vec<_> = cases.iter().filter(|case| case.run.is_completed()).collect();
    let errors = completed.iter().map(|case| case.run.error()).collect();
    let count = |what: &dyn Fn(&Case) -> bool| cases.iter().filter(|case| what(case)).count();
    let right = count(&|case| case.is_right());
    let ratios: Vec<f64> = cases.iter().filter_map(Case::ratio).collect();
    let within = |times: f64| share(ratios.iter().filter(|r| (1.0 / times..=times).contains(*r)).count(), ratios.len());
    format!(
        "| {} | {} | {} | {} | {} | {right} | {} | {} | {} | {} |",
        cases.len(),
        completed.len(),
        spread(errors),
        count(&|case| case.run.is_completed() && case.run.error() > WRONG && case.tells(WRONG)),
        count(&|case| case.is_silent()),
        share(count(&|case| case.is_false_alarm()), right),
        ratios.len(),
        within(3.0),
        within(10.0),
    )
}

/// Adaptive runs.
fn tolerances(cases: &[Case]) -> String {
    let mut text = String::from(
        "## Adaptive steps: `--rtol`\n\nErrors at the end over the tolerance, of runs that completed on scenes whose reference can tell.\n\n\
         | method, tolerance | runs | completed | error/rtol: median, 90 %, most | within 5 times | ordinary scenes: within 5 times | most | above 10 times, of these without a warning | force evaluations, median |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    let key = |case: &Case| match case.run.ask {
        Ask::Rtol(rtol) => (case.run.method.clone(), format!("{rtol:e}")),
        _ => Default::default(),
    };
    let told: Vec<_> = cases.iter().filter(|case| case.tells(5.0 * asked(case))).copied().collect();
    for ((method, rtol), cases) in by(&told, key) {
        let over = |cases: &[Case]| sorted(cases.iter().map(|case| case.run.error() / asked(case)).collect());
        let completed: Vec<_> = cases.iter().filter(|case| case.run.is_completed()).copied().collect();
        let ordinary: Vec<_> = completed.iter().filter(|case| case.is_ordinary()).copied().collect();
        let within = |ratios: &[f64]| share(ratios.iter().filter(|&&ratio| ratio <= 5.0).count(), ratios.len());
        let (all, ordinary) = (over(&completed), over(&ordinary));
        let above: Vec<_> = completed.iter().filter(|case| case.run.error() > 10.0 * asked(case)).collect();
        let silent = above.iter().filter(|case| case.run.warnings.is_empty()).count();
        let _ = writeln!(
            text,
            "| {method}, {rtol} | {} | {} | {} | {} | {} | {} | {}, {silent} | {:.0} |",
            cases.len(),
            completed.len(),
            spread(all.clone()),
            within(&all),
            within(&ordinary),
            ordinary.last().map_or("–".into(), |most| number(*most)),
            above.len(),
            quantile(&sorted(completed.iter().map(|case| case.run.evaluations as f64).collect()), 0.5),
        );
    }
    let mut worst: Vec<_> = told.iter().filter(|case| case.run.error() > 5.0 * asked(case)).copied().collect();
    worst.sort_by(|a, b| (b.run.error() / asked(b)).total_cmp(&(a.run.error() / asked(a))));
    text.push_str(&offenders("More than 5 times the tolerance or not completed, worst first", &worst));
    text.push('\n');
    text
}

/// Runs with a required accuracy.
fn accuracies(cases: &[Case]) -> String {
    let mut text = String::from(
        "## `--accuracy`\n\nA run that ends `unconfirmed` says that it could not promise; every other one that completed promises an error below R.\n\n\
         | R | runs | completed | unconfirmed | other ends | above R | above 3 R | largest error/R | total force evaluations, median, 90 % |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    let told: Vec<_> = cases.iter().filter(|case| case.tells(asked(case))).copied().collect();
    for (accuracy, cases) in by(&told, |case| format!("{:e}", asked(case))) {
        let completed: Vec<_> = cases.iter().filter(|case| case.run.is_completed()).collect();
        let over = sorted(completed.iter().map(|case| case.run.error() / asked(case)).collect());
        let above = |times: f64| share(over.iter().filter(|&&ratio| ratio > times).count(), cases.len());
        let unconfirmed = cases.iter().filter(|case| case.run.status == "unconfirmed").count();
        let work = sorted(cases.iter().map(|case| case.run.evaluations as f64).collect());
        let _ = writeln!(
            text,
            "| {accuracy} | {} | {} | {} | {} | {} | {} | {} | {:.0}, {:.0} |",
            cases.len(),
            completed.len(),
            share(unconfirmed, cases.len()),
            cases.len() - completed.len() - unconfirmed,
            above(1.0),
            above(3.0),
            over.last().map_or("–".into(), |most| number(*most)),
            quantile(&work, 0.5),
            quantile(&work, 0.9),
        );
    }
    let mut worst: Vec<_> = told.iter().filter(|case| case.run.error() > asked(case)).copied().collect();
    worst.sort_by(|a, b| {
        let key = |case: &Case| (case.run.is_completed(), case.run.error() / asked(case));
        key(b).0.cmp(&key(a).0).then(key(b).1.total_cmp(&key(a).1))
    });
    text.push_str(&offenders("Above R or not completed, broken promises first", &worst));
    text
}

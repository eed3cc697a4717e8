//! Draws what an indefinite matrix does to a motion: a compressed column three times, as it moves in truth, with the exact stiffness
//! where A is not definite, and with the few terms dropped that spoil it.
//!
//! `cargo run --release --example lost_definiteness` writes `docs/lost-definiteness.svg`, the first picture of the README.

use faer::Par;
use sprung::inspect::DefinitenessWatch;
use sprung::integrate::{ImplicitOptions, Method, StiffnessPolicy, TimeStepper};
use sprung::linear::{SolverChoice, SolverOptions};
use sprung::scene::builtin;
use sprung::{State, Stiffness, System};
use std::error::Error;
use std::fmt::Write;

/// The step of the two implicit runs, and how many of them.
const DT: f64 = 0.02;
const STEPS: usize = 12;
/// Steps of the true motion in one of theirs, and of these in one frame.
const FINE: usize = 2000;
const FRAMES: usize = 10;
/// Seconds for which a step is seen, and for which the end stays.
const SHOWN: f64 = 0.5;
const REST: f64 = 2.0;

/// One column on the sheet.
struct Column {
    title: &'static str,
    lines: Vec<String>,
    states: Vec<State>,
    /// Share of every spring in the negative curvature, for each state; empty where nothing is drawn of it.
    shares: Vec<Vec<f64>>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let (system, start) = builtin::column(9)?.build()?;
    let mut fine = Method::Verlet.stepper(&system, &start, &ImplicitOptions::default())?;
    let truth = record(fine.as_mut(), &start, DT / FINE as f64, STEPS * FINE, FINE / FRAMES)?;

    let ldlt = SolverOptions { solver: SolverChoice::Ldlt, ..SolverOptions::default() };
    let full = ImplicitOptions { stiffness: StiffnessPolicy::Always(Stiffness::Full), linear: ldlt };
    let mut exact = Method::LinearBackwardEuler.stepper(&system, &start, &full)?;
    let spoiled = record(exact.as_mut(), &start, DT, STEPS, 1)?;
    let on_demand = ImplicitOptions { stiffness: StiffnessPolicy::OnDemand, ..Default::default() };
    let mut softened = Method::LinearBackwardEuler.stepper(&system, &start, &on_demand)?;
    let mended = record(softened.as_mut(), &start, DT, STEPS, 1)?;

    let mut watch = DefinitenessWatch::new(&system, &start, Stiffness::Full, DT, Par::Seq)?;
    let mut shares = Vec::new();
    let mut negative = Vec::new();
    for state in &spoiled {
        let loss = watch.look(0, state)?;
        let mut each = vec![0.0; system.springs().len()];
        for culprit in loss.iter().flat_map(|loss| &loss.culprits) {
            each[culprit.spring] = culprit.share;
        }
        shares.push(each);
        negative.push(loss.map_or(0, |loss| loss.negative));
    }
    let aside = |state: &State| state.positions.iter().map(|x| x.x.abs()).fold(0.0, f64::max);
    let still = spoiled.iter().take_while(|state| aside(state) < 0.002).count() - 1;
    let thrown = spoiled.iter().map(aside).fold(0.0, f64::max);
    let stretch = spoiled.iter().flat_map(|state| strains(&system, state)).fold(0.0, f64::max);
    let farthest = |states: &[State]| states.iter().map(aside).fold(0.0, f64::max) * 1000.0;
    let statistics = softened.statistics();
    let columns = [
        Column {
            title: "the true motion",
            lines: vec![
                format!("verlet, steps of {} ms", 1000.0 * DT / FINE as f64),
                format!("at most {:.0} mm aside", farthest(&truth)),
            ],
            states: truth,
            shares: Vec::new(),
        },
        Column {
            title: "the exact stiffness",
            lines: vec![
                format!("A has {} negative eigenvalues:", negative[0]),
                format!("straight for {:.2} s, then thrown", still as f64 * DT),
                format!("{:.0} mm aside, stretched by {:.0} %", 1000.0 * thrown, 100.0 * stretch),
            ],
            states: spoiled,
            shares,
        },
        Column {
            title: "--stiffness on-demand",
            lines: vec![
                format!("{} terms dropped in {} solves:", statistics.dropped_terms, statistics.softened_solves),
                "A is definite, the column buckles".into(),
                format!("at once, at most {:.0} mm aside", farthest(&mended)),
            ],
            states: mended,
            shares: Vec::new(),
        },
    ];
    columns.iter().for_each(|column| println!("{}: {}", column.title, column.lines.join(" ")));
    std::fs::write("docs/lost-definiteness.svg", picture(&system, &columns)?)?;
    Ok(())
}

/// The states at the start and after every so many steps.
fn record(
    stepper: &mut dyn TimeStepper,
    start: &State,
    dt: f64,
    steps: usize,
    every: usize,
) -> Result<Vec<State>, Box<dyn Error>> {
    let mut state = start.clone();
    let mut states = vec![state.clone()];
    for step in 1..=steps {
        stepper.step(&mut state, dt).map_err(|failure| failure.to_string())?;
        state.time = start.time + step as f64 * dt;
        if step % every == 0 {
            states.push(state.clone());
        }
    }
    Ok(states)
}

fn strains<'a>(system: &'a System, state: &'a State) -> impl Iterator<Item = f64> + 'a {
    (0..system.springs().len()).map(|spring| {
        let [i, j] = system.pair(spring).map(|p| state.positions[p]);
        (i - j).norm() / system.springs()[spring].rest_length - 1.0
    })
}

const WIDTH: f64 = 264.0;
const TOP: f64 = 96.0;
/// Pixels of a metre.
const SCALE: f64 = 360.0;

fn picture(system: &System, columns: &[Column]) -> Result<String, std::fmt::Error> {
    let height = TOP + 0.95 * SCALE + 148.0;
    let width = WIDTH * columns.len() as f64;
    let mut svg = String::new();
    let heading = "A compressed column, steps of 20 ms: where A is not definite, the motion is wrong";
    writeln!(
        svg,
        r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img" aria-label="{heading}" font-family="system-ui, 'Segoe UI', Roboto, Helvetica, Arial, sans-serif" font-size="14" fill="#1b1f24">
<rect width="100%" height="100%" rx="8" fill="#ffffff"/>
<text x="20" y="32" font-size="16" font-weight="600">{heading}</text>"##
    )?;
    for (k, column) in columns.iter().enumerate() {
        let left = WIDTH * k as f64;
        let middle = left + WIDTH / 2.0;
        writeln!(svg, r#"<text x="{middle}" y="66" text-anchor="middle" font-weight="600">{}</text>"#, column.title)?;
        draw(&mut svg, system, column, middle)?;
        for (row, line) in column.lines.iter().enumerate() {
            let y = TOP + 0.95 * SCALE + 34.0 + 20.0 * row as f64;
            writeln!(svg, r##"<text x="{middle}" y="{y}" text-anchor="middle" fill="#56616b">{line}</text>"##)?;
        }
    }
    let y = height - 22.0;
    let slow = SHOWN / DT;
    writeln!(
        svg,
        r##"<g font-size="13" fill="#56616b"><line x1="20" x2="44" y1="{0}" y2="{0}" stroke="#2166ac" stroke-width="4"/><text x="50" y="{y}">compressed</text>
<line x1="140" x2="164" y1="{0}" y2="{0}" stroke="#d67722" stroke-width="4"/><text x="170" y="{y}">stretched (full colour at 5 %)</text>
<line x1="376" x2="400" y1="{0}" y2="{0}" stroke="#f0a3c4" stroke-width="12" stroke-linecap="round"/><text x="410" y="{y}">spoils A, as wide as its share</text><text x="{1}" y="{y}" text-anchor="end">{slow:.0} times slowed</text></g>
</svg>"##,
        y - 4.0,
        width - 20.0,
    )?;
    Ok(svg)
}

/// Springs as lines that move; nothing is drawn between the states of a run with long steps.
fn draw(svg: &mut String, system: &System, column: &Column, middle: f64) -> std::fmt::Result {
    let states = &column.states;
    let steps = states.len() > STEPS + 1;
    let whole = SHOWN * STEPS as f64 + REST;
    let times: Vec<String> = (0..states.len())
        .map(|k| format!("{:.4}", SHOWN * STEPS as f64 * k as f64 / (states.len() - 1) as f64 / whole))
        .chain(steps.then(|| "1".to_owned()))
        .collect();
    let timing = format!(
        r#"keyTimes="{}" dur="{whole}s" repeatCount="indefinite" calcMode="{}""#,
        times.join(";"),
        if steps { "linear" } else { "discrete" }
    );
    // Where nothing moves, the picture shows the middle of the motion.
    let shown = states.len() / 2;
    let animate = |svg: &mut String, name: &str, values: Vec<String>| {
        let last = values.last().cloned().filter(|_| steps);
        let list: Vec<String> = values.into_iter().chain(last).collect();
        writeln!(svg, r#"<animate attributeName="{name}" values="{}" {timing}/>"#, list.join(";"))
    };
    let place = |state: &State, p: usize, axis: usize| match axis {
        0 => format!("{:.1}", middle + SCALE * state.positions[p].x),
        _ => format!("{:.1}", TOP + 0.95 * SCALE - SCALE * state.positions[p].y),
    };
    let ends = [("x1", 0, 0), ("y1", 0, 1), ("x2", 1, 0), ("y2", 1, 1)];
    for layer in ["share", "strain"] {
        if layer == "share" && column.shares.is_empty() {
            continue;
        }
        for spring in 0..system.springs().len() {
            let pair = system.pair(spring);
            let at = |state: &State, end: usize, axis: usize| place(state, pair[end], axis);
            let fixed: String = ends
                .iter()
                .map(|&(name, end, axis)| format!(r#"{name}="{}" "#, at(&states[shown], end, axis)))
                .collect();
            let (paint, name, values) = if layer == "share" {
                let widths: Vec<String> =
                    column
                        .shares
                        .iter()
                        .map(|each| {
                            if each[spring] > 0.02 { format!("{:.0}", 4.0 + 110.0 * each[spring]) } else { "0".into() }
                        })
                        .collect();
                (
                    format!(r##"stroke="#f0a3c4" stroke-linecap="round" stroke-width="{}""##, widths[shown]),
                    "stroke-width",
                    widths,
                )
            } else {
                let colours: Vec<String> =
                    states.iter().map(|state| colour(strains(system, state).nth(spring).unwrap_or(0.0))).collect();
                (format!(r#"stroke-width="4" stroke="{}""#, colours[shown]), "stroke", colours)
            };
            writeln!(svg, "<line {fixed}{paint}>")?;
            for (name, end, axis) in ends {
                animate(svg, name, states.iter().map(|state| at(state, end, axis)).collect())?;
            }
            animate(svg, name, values)?;
            writeln!(svg, "</line>")?;
        }
    }
    for p in 0..system.particles() {
        let [x, y] = [0, 1].map(|axis| place(&states[shown], p, axis));
        if p == 0 || p + 1 == system.particles() {
            let [x, y] = [0, 1].map(|axis| place(&states[0], p, axis).parse::<f64>().unwrap_or(0.0) - 7.0);
            writeln!(svg, r##"<rect x="{x}" y="{y}" width="14" height="14" fill="#1b1f24"/>"##)?;
            continue;
        }
        writeln!(svg, r##"<circle cx="{x}" cy="{y}" r="4.5" fill="#2b3138">"##)?;
        for (name, axis) in [("cx", 0), ("cy", 1)] {
            animate(svg, name, states.iter().map(|state| place(state, p, axis)).collect())?;
        }
        writeln!(svg, "</circle>")?;
    }
    Ok(())
}

/// From blue (5 % compressed) over grey to orange (5 % stretched).
fn colour(strain: f64) -> String {
    let part = (strain / 0.05).clamp(-1.0, 1.0);
    let [grey, end] = [[160.0, 164.0, 168.0], if part < 0.0 { [33.0, 102.0, 172.0] } else { [214.0, 119.0, 34.0] }];
    let mixed: Vec<u8> = (0..3).map(|k| (grey[k] + (end[k] - grey[k]) * part.abs()) as u8).collect();
    format!("#{:02x}{:02x}{:02x}", mixed[0], mixed[1], mixed[2])
}

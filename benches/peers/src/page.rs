//! What the page shows of one scene: times, and a picture of them.

use crate::curve::{ACCURACIES, Curve, Side, fastest};
use sprung::figure::{Guide, Plot, Series};
use std::fmt::{Result, Write};

/// Of our curves those are drawn that take somewhere less than this many times the time of our fastest: more would hide each other.
const NEAR: f64 = 2.0;

/// The shortest time, in ms, of each contender for each accuracy.
pub fn table(page: &mut String, curves: &[Curve]) -> Result {
    write!(page, "| time in ms for an error below |")?;
    for accuracy in ACCURACIES {
        write!(page, " {accuracy:e} |")?;
    }
    writeln!(page, "\n|---|{}", "---|".repeat(ACCURACIES.len()))?;
    for curve in curves {
        write!(page, "| {} |", curve.name)?;
        for accuracy in ACCURACIES {
            match curve.shortest(accuracy) {
                Some(seconds) => write!(page, " {} |", milliseconds(seconds))?,
                None => write!(page, " – |")?,
            }
        }
        writeln!(page)?;
    }
    Ok(())
}

/// Two digits.
fn milliseconds(seconds: f64) -> String {
    let value = 1e3 * seconds;
    let digits = (1.0 - value.log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{value:.digits$}")
}

/// Time over error: all peers, and of ours what is fastest or nearly so.
pub fn picture(scene: &str, curves: &[Curve], floor: f64) -> Plot {
    let mut plot = Plot::log_log(
        format!("This crate and its peers: {scene}"),
        "relative position error at the end",
        "time of the run, s",
    )
    .concluding(conclusion(curves));
    let is_near = |curve: &Curve, accuracy: f64| {
        let times = curve.shortest(accuracy).zip(fastest(curves, Side::Ours, accuracy));
        times.is_some_and(|(own, (_, shortest))| own < NEAR * shortest)
    };
    let is_drawn =
        |curve: &&Curve| curve.side == Side::Peer || ACCURACIES.iter().any(|&accuracy| is_near(curve, accuracy));
    for curve in curves.iter().filter(is_drawn) {
        let front = curve.front();
        if !front.is_empty() {
            plot = plot.with_series(Series::line(&curve.name, front).looking(curve.look));
        }
    }
    plot.with_guide(Guide::Vertical { x: floor, label: "error of the reference".into() })
}

/// Who is fastest for few and for many digits, on both sides.
fn conclusion(curves: &[Curve]) -> String {
    let below = |accuracy: f64| match (fastest(curves, Side::Ours, accuracy), fastest(curves, Side::Peer, accuracy)) {
        (Some((ours, time)), Some((peer, other))) => {
            format!("{ours} in {:.2} of the time of {peer}", time / other)
        }
        (Some((ours, _)), None) => format!("{ours} alone"),
        (None, Some((peer, _))) => format!("{peer} alone"),
        (None, None) => "none".into(),
    };
    format!("Below 1 %: {}. Below 10⁻⁶: {}.", below(1e-2), below(1e-6))
}

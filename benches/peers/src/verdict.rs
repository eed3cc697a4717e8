//! Who is ahead: the fastest of ours over the fastest peer, scene by scene and error by error.

use crate::curve::{ACCURACIES, Curve, Side, fastest};
use std::fmt::{Result, Write};

/// Ours is as good as ahead up to this many times the time of the fastest peer.
const EVEN: f64 = 1.3;

/// What was measured on a scene.
pub struct Measured {
    pub scene: String,
    pub curves: Vec<Curve>,
}

/// Both sides' fastest for an error: name and time in s.
struct Duel<'m> {
    ours: Option<(&'m str, f64)>,
    peer: Option<(&'m str, f64)>,
}

/// A method of ours whose best step is known with hindsight only, and which has a twin that finds its steps.
const HINDSIGHT: &str = "dop853";

impl Measured {
    fn duels(&self) -> [Duel<'_>; ACCURACIES.len()] {
        self.duels_without("")
    }

    /// Where a method is not there.
    fn duels_without(&self, name: &str) -> [Duel<'_>; ACCURACIES.len()] {
        let find = |side, accuracy| fastest(self.curves.iter().filter(|curve| curve.name != name), side, accuracy);
        ACCURACIES.map(|accuracy| Duel { ours: find(Side::Ours, accuracy), peer: find(Side::Peer, accuracy) })
    }

    fn is_even(&self) -> bool {
        self.duels().iter().all(Duel::is_even)
    }
}

impl Duel<'_> {
    fn ratio(&self) -> Option<f64> {
        self.ours.zip(self.peer).map(|((_, ours), (_, peer))| ours / peer)
    }

    /// Where no peer gets there ours is ahead; where nobody does nobody is.
    fn is_even(&self) -> bool {
        self.ours.is_some() && self.ratio().is_none_or(|ratio| ratio <= EVEN)
    }
}

/// The tables of ratios and of names, and the count.
pub fn write(page: &mut String, all: &[Measured]) -> Result {
    let even = all.iter().filter(|measured| measured.is_even()).count();
    writeln!(
        page,
        "\nOurs is the lowest curve, or within {EVEN} of it, at every error on {even} of {} scenes.",
        all.len()
    )?;
    let without = all.iter().map(|measured| measured.duels_without(HINDSIGHT));
    let still_even = without.clone().filter(|duels| duels.iter().all(Duel::is_even)).count();
    let worst = without.flatten().filter_map(|duel| duel.ratio()).fold(0.0, f64::max);
    writeln!(
        page,
        "Without the fixed steps of `{HINDSIGHT}`, by its adaptive ones alone: on {still_even}, at worst {worst:.2}.\n"
    )?;
    write!(page, "Time of our fastest method over that of the fastest peer:\n\n| scene |")?;
    head(page, " within 1.3 at every error |")?;
    for measured in all {
        write!(page, "| {} |", measured.scene)?;
        for duel in measured.duels() {
            match duel.ratio() {
                Some(ratio) if duel.is_even() => write!(page, " {ratio:.2} |")?,
                Some(ratio) => write!(page, " **{ratio:.2}** |")?,
                None => write!(page, " {} |", if duel.ours.is_some() { "ours alone" } else { "not reached" })?,
            }
        }
        writeln!(page, " {} |", if measured.is_even() { "yes" } else { "no" })?;
    }
    write!(page, "\nThese are, ours first:\n\n| scene |")?;
    head(page, "")?;
    for measured in all {
        write!(page, "| {} |", measured.scene)?;
        for Duel { ours, peer } in measured.duels() {
            let name = |side: Option<(&str, f64)>| side.map_or("–".to_owned(), |(name, _)| name.replace(", ", " "));
            write!(page, " {}, {} |", name(ours), name(peer))?;
        }
        writeln!(page)?;
    }
    Ok(())
}

/// The rest of a table's head: errors, and columns behind them.
fn head(page: &mut String, behind: &str) -> Result {
    for accuracy in ACCURACIES {
        write!(page, " {accuracy:e} |")?;
    }
    let columns = 1 + ACCURACIES.len() + behind.matches('|').count();
    writeln!(page, "{behind}\n|{}", "---|".repeat(columns))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Run;
    use sprung::figure::Look;

    fn curve(name: &str, side: Side, runs: &[(f64, f64)]) -> Curve {
        let runs = runs.iter().map(|&(seconds, error)| Run { seconds, outcome: Ok(error) }).collect();
        Curve { name: name.into(), side, look: Look { number: 0, hollow: false }, runs }
    }

    /// Ours is ahead at first and then 1.25 times slower; a peer that is faster still for few digits makes it lose.
    #[test]
    fn a_scene_is_won_at_every_error_or_not() {
        let mut curves =
            vec![curve("a", Side::Ours, &[(1.0, 0.05), (5.0, 1e-9)]), curve("b", Side::Peer, &[(4.0, 1e-9)])];
        let measured = Measured { scene: "s".into(), curves };
        assert!(measured.is_even());
        let mut page = String::new();
        write(&mut page, std::slice::from_ref(&measured)).unwrap();
        assert!(page.contains("on 1 of 1 scenes") && page.contains("| s | 0.25 | 1.25 |"), "{page}");
        curves = measured.curves;
        curves.push(curve("c", Side::Peer, &[(0.7, 0.05)]));
        assert!(!Measured { scene: "s".into(), curves }.is_even());
    }

    /// What only ours reaches is ours, and what it does not reach is lost.
    #[test]
    fn errors_that_one_side_does_not_reach() {
        let ours = || curve("a", Side::Ours, &[(1.0, 1e-9)]);
        let peer = |error| curve("b", Side::Peer, &[(2.0, error)]);
        let even = |curves| Measured { scene: String::new(), curves }.is_even();
        assert!(even(vec![ours(), peer(1e-3)]) && !even(vec![peer(1e-9)]) && !even(Vec::new()));
    }
}

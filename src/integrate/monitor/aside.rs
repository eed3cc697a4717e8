//! How far prescribed paths go aside from the straight way of a step.
//!
//! Most methods know of a path only where it is at both ends of a step. Where it bends in between it is elsewhere, by δ(t). A spring of κ = k/l0 and
//! the direction n that it draws by then pulls with `κ n·δ` more, and what δ turns it by brings `‖δ‖/l` of the part of δ across it along it. That
//! gives the particle of mass m at its other end, on which springs of κ' in all pull, the velocity `κ ∫ n·δ dt/m`, and a vibration of
//! `ω = √(κ'/m)` of it the amplitude
//!
//! ```text
//! κ ∫ n·δ dt/√(κ' m).
//! ```
//!
//! The energy that springs hold on the way and not at its ends is up to `Σ κ δ²`, and `√(2 κ E) |δ|` where they hold E already:
//! the ledger, which sees the ends, cannot know it.

use crate::system::{Axes, Motion, State, System};
use nalgebra::Vector3;

/// A particle that is led along a path that bends.
struct Led {
    particle: usize,
    /// The path of each axis that has one.
    paths: [Option<usize>; 3],
}

/// A spring that such a particle draws.
struct Drawn {
    spring: usize,
    /// Where its ends are among those led.
    led: [Option<usize>; 2],
    /// κ', in N/m.
    around: f64,
}

/// All prescribed paths that bend.
pub(super) struct Aside<'s> {
    system: &'s System,
    led: Vec<Led>,
    drawn: Vec<Drawn>,
    /// Whether any part of the system has such a path.
    bends: bool,
}

/// How far paths went aside in a step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Detour {
    /// `√(Σ (κ ∫|n·δ| dt)²/κ')`, in m·√kg.
    pub way: f64,
    /// `Σ κ δ²` of the largest δ, in J.
    pub energy: f64,
}

/// Along one path: `∫|δ| dt`, in m·s, and the largest |δ|, in m, by axis.
#[derive(Clone, Copy, Default)]
struct Bend {
    area: Vector3<f64>,
    largest: Vector3<f64>,
}

impl<'s> Aside<'s> {
    pub fn new(system: &'s System) -> Self {
        let prescribed = system.prescribed();
        let bent = |motion: usize| matches!(prescribed.motions()[motion], Motion::Path { .. });
        let mut led: Vec<Led> = Vec::new();
        for (dof, _, motion) in prescribed.iter().filter(|(.., motion)| bent(*motion)) {
            match led.last_mut() {
                Some(last) if last.particle == dof.particle => last.paths[dof.axis] = Some(motion),
                _ => {
                    let mut paths = [None; 3];
                    paths[dof.axis] = Some(motion);
                    led.push(Led { particle: dof.particle, paths });
                }
            }
        }
        let mut drawn = Vec::new();
        if !led.is_empty() {
            let mut stiffness = vec![0.0; system.particles()];
            for (_, pair, spring) in system.active() {
                pair.into_iter().for_each(|p| stiffness[p] += spring.stiffness / spring.rest_length);
            }
            let among = |p: usize| led.binary_search_by_key(&p, |led| led.particle).ok();
            for (spring, pair, _) in system.active().filter(|(spring, ..)| system.counts(*spring)) {
                let ends = pair.map(among);
                let free = |p: usize| system.dofs().free_axes(p) != Axes::NONE;
                // Of two that are led the one that is free along other axes.
                let others = pair.into_iter().filter(|&p| free(p) && (among(p).is_none() || !ends.contains(&None)));
                let around = others.map(|p| stiffness[p]).fold(0.0, f64::max);
                if ends != [None; 2] && around > 0.0 {
                    drawn.push(Drawn { spring, led: ends, around });
                }
            }
        }
        let [bends] = system.largest([f64::from(u8::from(!drawn.is_empty()))]);
        Self { system, led, drawn, bends: bends > 0.0 }
    }

    /// In the step between two times, to a state.
    pub fn pass(&self, times: [f64; 2], state: &State) -> Detour {
        if !self.bends {
            return Detour::default();
        }
        let (mut way, mut energy) = (0.0, 0.0);
        let motions = self.system.prescribed().motions();
        let bends: Vec<Bend> = motions.iter().map(|motion| bend(motion, times)).collect();
        if bends.iter().any(|bend| bend.largest != Vector3::zeros()) {
            for Drawn { spring, led, around } in &self.drawn {
                let mut both = Bend::default();
                for Led { paths, .. } in led.iter().flatten().map(|&at| &self.led[at]) {
                    for (axis, path) in paths.iter().enumerate() {
                        let Some(path) = path else { continue };
                        both.area[axis] += bends[*path].area[axis];
                        both.largest[axis] += bends[*path].largest[axis];
                    }
                }
                let [i, j] = self.system.pair(*spring);
                let d = state.positions[i] - state.positions[j];
                let length = d.norm();
                // One, too, where the ends meet: the least of nothing over nothing and one.
                let turned = (both.largest.norm() / length).min(1.0);
                let along = d.abs().dot(&both.area) / length.max(f64::MIN_POSITIVE);
                let spring = &self.system.springs()[*spring];
                let stiffness = spring.stiffness / spring.rest_length;
                let pull = stiffness * along.max(turned * both.area.norm());
                way += pull * pull / around;
                energy += stiffness * both.largest.norm_squared();
            }
        }
        let [way, energy] = self.system.total([way, energy]);
        Detour { way: way.sqrt(), energy }
    }
}

/// How far a motion goes aside between two times.
fn bend(motion: &Motion, [start, end]: [f64; 2]) -> Bend {
    let Motion::Path { times, .. } = motion else { return Bend::default() };
    let within = times.partition_point(|&kink| kink <= start)..times.partition_point(|&kink| kink < end);
    let kinks = times.get(within).unwrap_or_default();
    let mut bend = Bend::default();
    for axis in 0..3 {
        let [from, to] = [start, end].map(|time| motion.offset(time, axis));
        let aside = |time: f64| {
            let straight = from + (to - from) * ((time - start) / (end - start));
            (time, (motion.offset(time, axis) - straight).abs())
        };
        let mut last = (start, 0.0);
        for next in kinks.iter().map(|&time| aside(time)).chain([(end, 0.0)]) {
            bend.area[axis] += 0.5 * (last.1 + next.1) * (next.0 - last.0);
            bend.largest[axis] = bend.largest[axis].max(next.1);
            last = next;
        }
    }
    bend
}

impl Detour {
    /// The energy that a ledger may miss where springs hold so much, in J.
    pub fn missed(&self, elastic: f64) -> f64 {
        self.energy + (2.0 * self.energy * elastic.max(0.0)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::{Aside, Detour};
    use crate::integrate::{
        ImplicitOptions, Method, Monitor, MonitorOptions, Schedule, Status, Warning, run_monitored,
    };
    use crate::spring::Spring;
    use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
    use nalgebra::Vector3;
    use std::ops::ControlFlow;

    /// An end is led along y by 0.5 m within 0.25 s, and back again by the time 1 s. Above it hangs a spring of 8 N/m and 1 m, of which another of 8 N/m
    /// holds the other end, and beside it one of 1 N/m, 2 m long.
    fn system() -> (System, State) {
        let mut builder = SystemBuilder::new();
        for at in [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0], [1.0, 1.0, 0.0]] {
            builder.particle(at, 1.0);
        }
        builder.spring(0, 1, Spring { stiffness: 4.0, rest_length: 0.5, damping: 0.0 });
        builder.spring(2, 0, Spring { stiffness: 2.0, rest_length: 2.0, damping: 0.0 });
        builder.spring(3, 1, Spring { stiffness: 8.0, rest_length: 1.0, damping: 0.0 });
        let offsets = [0.0, 0.5, 0.0].map(|y| Vector3::new(0.0, y, 0.0)).to_vec();
        let motion = Motion::Path { times: vec![0.0, 0.25, 1.0], offsets };
        builder.constrain(Constraint { particles: vec![0], axes: Axes::of(&[1]), motion });
        builder.hold(3);
        builder.build().unwrap()
    }

    fn close(a: f64, b: f64) -> bool {
        (a / b - 1.0).abs() < 1e-12
    }

    #[test]
    fn steps_with_kinks_inside_miss_what_is_between() {
        let (system, state) = system();
        let aside = Aside::new(&system);
        // Between kinks, and up to one, rounding aside.
        for step in [[0.0, 0.25], [0.25, 1.0], [0.3, 0.9], [1.0, 7.0], [0.25 - 1e-12, 0.5], [0.1, 0.25 + 1e-12]] {
            let found = aside.pass(step, &state);
            assert!(found.way < 1e-9 && found.energy < 1e-9, "{step:?}");
        }
        // A triangle of 0.5 m over 1 s: 8 N/m by 0.25 m·s, on which 16 N/m pull, and a quarter of that, by the angle of half a metre
        // in two, of the spring of 1 N/m.
        let way = |area: f64, turned: f64| ((8.0 * area).powi(2) / 16.0 + (turned * area).powi(2) / 1.0).sqrt();
        for step in [[0.0, 1.0], [0.0, 2.0]] {
            let found = aside.pass(step, &state);
            assert!(close(found.way, way(0.25, 0.25)) && close(found.energy, 9.0 * 0.25), "{found:?}");
        }
        // From 0.25 m at 0.125 s to 1/3 m at 0.5 s, by the kink at 0.25 s: by 0.5 − (0.25 + 1/36) m.
        let found = aside.pass([0.125, 0.5], &state);
        let by = 0.25 - 1.0 / 36.0;
        assert!(close(found.way, way(0.5 * by * 0.375, 0.5 * by)) && close(found.energy, 9.0 * by * by), "{found:?}");
    }

    /// A spring of 5 N/m and 5 m from (4, 6) to (1, 2), whose ends go up by 0.25 and 0.5 m within a second and back again, each free along x and z. Of 0.75 m·s
    /// four fifths are along it, which 0.75 m in five turn by less.
    #[test]
    fn both_ends_of_a_spring_may_go_aside() {
        let mut builder = SystemBuilder::new();
        for (at, most) in [([1.0, 2.0, 0.0], 0.5), ([4.0, 6.0, 0.0], 0.25)] {
            let p = builder.particle(at, 1.0);
            let offsets = [0.0, most, 0.0].map(|y| Vector3::new(0.0, y, 0.0)).to_vec();
            let motion = Motion::Path { times: vec![1.0, 2.0, 3.0], offsets };
            builder.constrain(Constraint { particles: vec![p], axes: Axes::of(&[1]), motion });
        }
        builder.spring(0, 1, Spring { stiffness: 25.0, rest_length: 5.0, damping: 0.0 });
        let (system, state) = builder.build().unwrap();
        let found = Aside::new(&system).pass([1.0, 3.0], &state);
        let along: f64 = 0.8 * 0.75;
        assert!(close(found.way, (5.0 * along).powi(2).sqrt() / 5f64.sqrt()), "{found:?}");
        assert!(close(found.energy, 5.0 * 0.75f64.powi(2)), "{found:?}");
    }

    /// Of springs between led ends no particle hears, and motions without kinks bend nowhere.
    #[test]
    fn what_moves_nothing_does_not_count() {
        let mut builder = SystemBuilder::new();
        let [i, j] = [0.0, 1.0].map(|x| builder.particle([x, 0.0, 0.0], 1.0));
        builder.spring(i, j, Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 });
        let offsets = [0.0, 0.5, 0.0].map(|y| Vector3::new(0.0, y, 0.0)).to_vec();
        let motion = Motion::Path { times: vec![0.0, 0.25, 1.0], offsets };
        builder.constrain(Constraint { particles: vec![i, j], axes: Axes::ALL, motion });
        let (system, state) = builder.build().unwrap();
        assert_eq!(Aside::new(&system).pass([0.0, 1.0], &state), Detour::default());
    }

    /// A particle of 4 kg hangs at rest on a spring of ω = 141/s whose other end goes up by half a metre and back within the first step of 0.01 s. It
    /// then swings by `ω ∫δ dt = 0.31 m`, 0.44 of the extent. Methods whose steps see nothing of that say so; the others see it.
    #[test]
    fn an_excursion_within_a_step_is_told() {
        let mut builder = SystemBuilder { dimension: 2, ..SystemBuilder::new() };
        builder.particle([0.0; 3], 1.0);
        builder.particle([0.0, -1.0, 0.0], 4.0);
        builder.spring(0, 1, Spring { stiffness: 8e4, rest_length: 1.0, damping: 0.0 });
        let offsets = [0.0, 0.5, 0.0].map(|y| Vector3::new(0.0, y, 0.0)).to_vec();
        let motion = Motion::Path { times: vec![0.0, 0.003, 0.009], offsets };
        builder.constrain(Constraint { particles: vec![0], axes: Axes::ALL, motion });
        let (system, start) = builder.build().unwrap();
        for method in Method::ALL {
            let cuts = method.cuts_at_kinks();
            let mut state = start.clone();
            let mut monitor = Monitor::new(&system, &state, MonitorOptions::default()).unwrap();
            let mut stepper = method.stepper(&system, &state, &ImplicitOptions::default()).unwrap();
            let schedule = Schedule::duration(0.01, 0.02);
            let observe = |_, _: &State, _: &Monitor| ControlFlow::Continue(());
            let outcome = run_monitored(&mut *stepper, &mut state, &schedule, &mut monitor, observe);
            assert_eq!(outcome.status(), Status::Completed, "{}", method.name());
            let moved = (state.positions[1] - start.positions[1]).norm() > 1e-3;
            assert_eq!(moved, cuts, "{}", method.name());
            let figures = monitor.figures(&state);
            let estimate = figures.estimate(method).unwrap();
            let is_told = figures.warnings(method, None).contains(&Warning::Bent(figures.aside));
            assert!(cuts || is_told && (0.3..0.6).contains(&estimate), "{}: {estimate}", method.name());
            // Of energy that came in by a path within a step nobody can say that it came from nowhere.
            assert_eq!(figures.gained, 0.0, "{}", method.name());
        }
    }

    #[test]
    fn energy_that_is_missed_grows_with_what_springs_hold() {
        let detour = Detour { way: 0.0, energy: 2.0 };
        assert_eq!([0.0, 4.0].map(|elastic| detour.missed(elastic)), [2.0, 6.0]);
    }
}

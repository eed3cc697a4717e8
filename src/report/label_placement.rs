//! Room for badges in a drawing: places that cover as little as can be.

use super::canvas::WIDTH;

/// Half the height of a badge.
pub(super) const BADGE: f64 = 17.0;

/// Free space around a badge.
const GAP: f64 = 4.0;

/// What is there already: springs, arrows, held and free particles as lines, and the badges that were placed.
pub(super) struct LabelPlacement {
    lines: Vec<[[f64; 2]; 2]>,
    /// Middle and half width of every badge.
    badges: Vec<[f64; 3]>,
    /// From every spring to its badge.
    leaders: Vec<[[f64; 2]; 2]>,
}

impl LabelPlacement {
    /// By lines, before any badge is placed.
    pub fn by(lines: Vec<[[f64; 2]; 2]>) -> Self {
        Self { lines, badges: Vec::new(), leaders: Vec::new() }
    }

    /// A place for a badge of some half width near a spring's middle, inside the sheet, clear of the other badges, and over as few lines as
    /// possible; of equally good places the nearest.
    pub fn place(&mut self, middle: [f64; 2], half: f64, height: f64) -> [f64; 2] {
        let around = [2.4, 3.4, 4.6, 6.0, 8.0, 11.0, 14.0].into_iter().flat_map(|radius| {
            (0..16).map(move |i| {
                let angle = std::f64::consts::FRAC_PI_8 * f64::from(i) - 1.2;
                [middle[0] + (radius * BADGE + half - BADGE) * angle.cos(), middle[1] + radius * BADGE * angle.sin()]
            })
        });
        let inside =
            |[x, y]: &[f64; 2]| (half..f64::from(WIDTH) - half).contains(x) && (BADGE..height - BADGE).contains(y);
        let apart = |[x, y]: [f64; 2]| {
            let clear =
                |[bx, by, other]: &[f64; 3]| (bx - x).abs() > half + other + GAP || (by - y).abs() > 2.0 * BADGE + GAP;
            self.badges.iter().all(clear)
        };
        let covered = |place: &[f64; 2]| {
            let lines = self.lines.iter().filter(|line| meets(line, *place, [half + GAP, BADGE + GAP])).count();
            // A badge over a badge hides a number: worse than any number of lines.
            let crossed = self.leaders.iter().filter(|leader| cross(leader, &[middle, *place])).count();
            lines + crossed + if apart(*place) { 0 } else { self.lines.len() + 1 }
        };
        let place = around.filter(inside).min_by_key(covered).unwrap_or(middle);
        self.badges.push([place[0], place[1], half]);
        self.leaders.push([middle, place]);
        place
    }
}

/// Whether two lines cross: the ends of each lie on different sides of the other.
fn cross(a: &[[f64; 2]; 2], b: &[[f64; 2]; 2]) -> bool {
    let side = |[from, to]: &[[f64; 2]; 2], p: [f64; 2]| {
        (to[0] - from[0]) * (p[1] - from[1]) - (to[1] - from[1]) * (p[0] - from[0])
    };
    side(a, b[0]) * side(a, b[1]) < 0.0 && side(b, a[0]) * side(b, a[1]) < 0.0
}

/// Whether a line passes through a rectangle around a point: the part of it between the rectangle's sides along one axis and the part between
/// those along the other overlap.
fn meets([a, b]: &[[f64; 2]; 2], centre: [f64; 2], half: [f64; 2]) -> bool {
    let mut part = (0.0_f64, 1.0_f64);
    for axis in [0, 1] {
        let (from, along) = (a[axis] - centre[axis], b[axis] - a[axis]);
        if along == 0.0 {
            if from.abs() > half[axis] {
                return false;
            }
            continue;
        }
        let (enter, leave) = ((-half[axis] - from) / along, (half[axis] - from) / along);
        part = (part.0.max(enter.min(leave)), part.1.min(enter.max(leave)));
    }
    part.0 <= part.1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_through_a_rectangle_are_seen() {
        let meets = |a, b| meets(&[a, b], [10.0, 10.0], [3.0, 2.0]);
        assert!(meets([0.0, 10.0], [20.0, 10.0]), "across");
        assert!(meets([10.0, 10.0], [10.5, 10.5]), "within");
        assert!(meets([6.0, 9.0], [9.0, 13.0]), "through a corner");
        assert!(!meets([0.0, 10.0], [6.0, 10.0]), "ends before it");
        assert!(!meets([0.0, 12.5], [20.0, 12.5]), "passes below");
        assert!(!meets([5.0, 10.0], [10.0, 20.0]), "passes a corner");
    }

    /// A spring in a row of them has its number where none of them is.
    #[test]
    fn badges_stand_beside_lines_and_each_other() {
        let end = |i: i32| [60.0 + 70.0 * f64::from(i), 200.0];
        let mut taken = LabelPlacement::by((0..9).map(|i| [end(i), end(i + 1)]).collect());
        for i in 0..9 {
            let place = taken.place([95.0 + 70.0 * f64::from(i), 200.0], 20.0, 400.0);
            assert!(!taken.lines.iter().any(|line| meets(line, place, [20.0, BADGE])), "{place:?} covers a spring");
        }
        for (k, leader) in taken.leaders.iter().enumerate() {
            assert!(!taken.leaders[..k].iter().any(|other| cross(leader, other)), "leader {k} crosses another");
        }
        for (k, [x, y, half]) in taken.badges.iter().enumerate() {
            let apart = |other: &[f64; 3]| (other[0] - x).abs() > half + other[2] || (other[1] - y).abs() > 2.0 * BADGE;
            assert!(taken.badges[..k].iter().all(apart), "badge {k} covers another");
        }
    }
}

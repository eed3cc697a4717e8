//! Which way is up.

use nalgebra::Vector3;
use serde::Serialize;

/// The axis that points upwards in pictures: against gravity where that follows an axis of a scene in space; y elsewhere.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Up {
    /// Its number.
    pub axis: usize,
    /// 1 or −1.
    pub sign: f64,
}

impl Up {
    /// Of a scene with so many axes.
    pub fn against(gravity: Vector3<f64>, dimension: usize) -> Self {
        let axis = gravity.iamax();
        match dimension {
            3 if gravity[axis].abs() > 0.9 * gravity.norm() => Self { axis, sign: -gravity[axis].signum() },
            _ => Self { axis: 1, sign: 1.0 },
        }
    }

    /// The same vector with this axis as y, turned and not mirrored.
    pub fn upright(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = match self.axis {
            0 => [z, x, y],
            1 => [x, y, z],
            _ => [y, z, x],
        };
        if self.sign < 0.0 { [-x, -y, z] } else { [x, y, z] }
    }
}

#[cfg(test)]
mod tests {
    use super::Up;
    use nalgebra::Vector3;

    /// What stands against gravity points upwards, and right hands stay right.
    #[test]
    fn pictures_stand_upright() {
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                let gravity = Vector3::ith(axis, -9.81 * sign);
                let up = Up::against(gravity, 3);
                assert_eq!(up.upright((-gravity).into())[1], 9.81);
                let turned = [0, 1, 2].map(|k| Vector3::from(up.upright(Vector3::ith(k, 1.0).into())));
                assert_eq!(turned[0].cross(&turned[1]), turned[2]);
            }
        }
        let askew = Vector3::new(1.0, -1.0, 0.0);
        assert_eq!(
            [Up::against(askew, 3), Up::against(-Vector3::y(), 2), Up::against(Vector3::y(), 2)].map(|up| up.axis),
            [1; 3]
        );
    }
}

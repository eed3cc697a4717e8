//! Units of rounding worked out by hand, and a chain whose energies are the work of its forces.

use super::*;
use crate::spring::Spring;
use crate::system::SystemBuilder;
use crate::verify::fixtures;

/// Springs of k = 4 N, l0 = 2 m and of k = 12 N, l0 = 4 m between particles of 2, 1 and 5 kg at 1, 4 and 9 m.
fn line() -> (System, State) {
    fixtures::line().build().unwrap()
}

/// The pulls are 10, 37 and 27 N, so that moves of 1/2 and 1 m are work of 5 + 37 J; forces of 2 and 3 N reach over 5 and 13 m, at
/// both of their ends.
#[test]
fn units_of_rounding_by_hand() {
    let (system, state) = line();
    let links = reference::links(&system, &state.positions);
    let w = [0.5, -1.0, 0.0].map(|x| Vector3::new(x, 0.0, 0.0));
    assert_eq!(elastic_unit(&links, [7.0, 11.0], &w, &state.positions), U * (18.0 + 42.0 + 2.0 * (10.0 + 39.0)));
    assert_eq!(weight_unit(&system, &state.positions), U * (2.0 + 4.0 + 45.0) * 2.0);
    assert_eq!([share(0.0, 0.0), share(0.0, 2.0), share(3.0, 2.0)], [0.0, 0.0, 1.5]);
    assert_eq!(dot(&w, &[2.0, 3.0, 4.0].map(|x| Vector3::new(x, 1.0, 1.0))), -2.0);
}

/// Of a bent chain, stretched here and compressed there, the quadrature finds the work up to rounding.
#[test]
fn energies_of_a_chain_are_the_work_of_its_forces() {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.5, -9.0, 0.25);
    for n in 0..6 {
        let t = f64::from(n);
        let particle = builder.particle([1.1 * t, (0.9 * t).sin(), 3.0 + (0.7 * t).cos()], 1.0 + 0.1 * t);
        if n > 0 {
            builder.spring(
                particle - 1,
                particle,
                Spring { stiffness: 40.0, rest_length: 1.0 + 0.1 * t, damping: 0.0 },
            );
        }
    }
    builder.hold(0);
    let (system, state) = builder.build().unwrap();
    let checks = measure(&TestCase { name: "chain".into(), system, state, dt: 0.1 }).unwrap();
    let names: Vec<&str> = checks.iter().map(|check| check.name.as_str()).collect();
    assert_eq!(names, ["elastic energy is work", "gravitational energy is work"]);
    assert!(checks.iter().all(|check| check.passed() && check.bound == 30.0 + 6.0 + 5.0));
}

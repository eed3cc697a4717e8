//! A step after the first allocates nothing.

use sprung::integrate::*;
use sprung::linear::{PreconditionerKind, SolverChoice, SolverOptions};
use sprung::multigrid::Multigrid;
use sprung::scene::{Scene, builtin};
use sprung::{Spring, Stiffness, SystemBuilder};

const PRECONDITIONERS: [PreconditionerKind; 4] = [
    PreconditionerKind::None,
    PreconditionerKind::Jacobi,
    PreconditionerKind::BlockJacobi,
    PreconditionerKind::Multigrid,
];

#[test]
fn a_step_after_the_first_allocates_nothing() {
    let mut builder = SystemBuilder::new();
    builder.gravity(0.0, -9.81, 0.0);
    for p in 0..30 {
        builder.particle([p as f64 * 0.8, (p % 3) as f64, 0.1 * (p % 4) as f64], 1.0);
    }
    for p in 0..29 {
        builder.spring(p, p + 1, Spring { stiffness: 100.0, rest_length: 1.0, damping: 0.1 });
        builder.spring(p, (p + 5) % 30, Spring { stiffness: 30.0, rest_length: 4.0, damping: 0.0 });
    }
    builder.hold(0);
    let (system, start) = builder.build().unwrap();

    let policies = [StiffnessPolicy::OnDemand, Stiffness::Tension.into()];
    for solver in [SolverChoice::Llt, SolverChoice::Ldlt, SolverChoice::Cg, SolverChoice::CgAssembled] {
        for kind in PRECONDITIONERS {
            for stiffness in policies {
                let linear = SolverOptions { solver, preconditioner: Some(kind), ..Default::default() };
                let options = ImplicitOptions { stiffness, linear };
                for method in Method::ALL {
                    // At dt = 0.3 the on-demand policy changes between full and tension: that must not allocate either.
                    let dt = if method == Method::LinearBackwardEuler {
                        0.3
                    } else if method.is_implicit() {
                        0.02
                    } else {
                        0.001
                    };
                    let mut stepper = method.stepper(&system, &start, &options).unwrap();
                    let mut state = start.clone();
                    stepper.step(&mut state, dt).unwrap();
                    let counted = allocation_counter::measure(|| {
                        for _ in 0..5 {
                            stepper.step(&mut state, dt).unwrap();
                        }
                    });
                    assert_eq!(counted.count_total, 0, "{} {solver:?} {kind:?} {stiffness:?}", stepper.name());
                }
            }
        }
    }
}

/// Enough particles for coarse levels, which are also recomputed in these steps.
#[test]
fn multigrid_allocates_nothing_after_the_first_step() {
    let (system, start) = builtin::cloth(20).unwrap().build().unwrap();
    let linear = SolverOptions {
        solver: SolverChoice::Cg,
        preconditioner: Some(PreconditionerKind::Multigrid),
        ..Default::default()
    };
    let options = ImplicitOptions { stiffness: Stiffness::Tension.into(), linear };
    let mut stepper = LinearBackwardEuler::new(&system, &start, &options).unwrap();
    let mut state = start.clone();
    stepper.step(&mut state, 0.01).unwrap();
    let counted = allocation_counter::measure(|| (0..10).for_each(|_| stepper.step(&mut state, 0.01).unwrap()));
    assert_eq!(counted.count_total, 0);
    assert!(stepper.statistics().work.multigrid_setups > 1);
}

/// K and G of another state are values on the same pattern.
#[test]
fn matrices_of_another_state_allocate_nothing() {
    let (system, mut state) = builtin::cloth(20).unwrap().build().unwrap();
    let mut matrices = Matrices::new(&system).unwrap();
    matrices.update(&state, Stiffness::Full).unwrap();
    state.positions.iter_mut().for_each(|x| *x *= 1.1);
    let counted = allocation_counter::measure(|| matrices.update(&state, Stiffness::Tension).unwrap());
    assert_eq!(counted.count_total, 0);
}

/// Reading and building allocate for lists, not for what is in them: sixteen times as many springs are four more doublings of every list.
/// Both are large enough for the system to be asked whether there is room, which takes allocations, too.
#[test]
fn a_scene_is_read_and_built_without_allocating_for_every_spring() {
    let [small, large] = [80, 320].map(|size| {
        let json = builtin::cloth(size).unwrap().to_json();
        let counted = allocation_counter::measure(|| {
            let (system, _) = Scene::from_json(&json).unwrap().build().unwrap();
            assert_eq!(system.particles(), size * size);
        });
        counted.count_total
    });
    println!("{small} allocations, {large} for sixteen times as many springs");
    assert!(large <= small + 16, "{large}, {small}");
}

/// Multigrid takes at most the 500 bytes a spring and 3000 a particle that are asked for.
#[test]
fn multigrid_takes_what_is_asked_for() {
    for scene in [builtin::cloth(60).unwrap(), builtin::lattice(12).unwrap()] {
        let (system, _) = scene.build().unwrap();
        let counted = allocation_counter::measure(|| drop(Multigrid::down_to(&system, 0).unwrap()));
        let asked = 500 * system.springs().len() as u64 + 3000 * system.particles() as u64;
        assert!(counted.bytes_max <= asked, "{} of {asked}", counted.bytes_max);
    }
}

/// Bytes that are asked for before a run, for a spring and for a particle, cover what is taken: where springs are many and where they are few.
#[test]
fn what_is_asked_for_covers_what_is_taken() {
    for scene in [builtin::cloth(60).unwrap(), builtin::lattice(12).unwrap(), builtin::chain(3000).unwrap()] {
        let (system, state) = scene.build().unwrap();
        let taken = |new: &dyn Fn()| allocation_counter::measure(new).bytes_max;
        let options = MonitorOptions::default();
        for (what, [spring, particle], bytes) in [
            ("monitor", [100, 400], taken(&|| drop(Monitor::new(&system, &state, options).unwrap()))),
            ("verlet", [40, 150], taken(&|| drop(Verlet::new(&system, &state).unwrap()))),
            ("symplectic Euler", [40, 150], taken(&|| drop(ExplicitEuler::symplectic(&system, &state).unwrap()))),
            ("dop853", [40, 700], taken(&|| drop(Dop853::new(&system, &state).unwrap()))),
        ] {
            let asked = spring * system.springs().len() as u64 + particle * system.particles() as u64;
            // Reading how much room there is takes a few kilobytes itself.
            assert!(bytes <= asked + 20_000, "{what}, {}: {bytes} of {asked}", scene.name);
            assert!(4 * bytes >= asked, "{what}, {}: {bytes} of {asked}", scene.name);
        }
    }
}

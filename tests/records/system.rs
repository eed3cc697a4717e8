//! Every figure of ready scenes, and of what solvers and multigrid make of their matrices, is the one that was measured when it was
//! looked at.

use crate::record::{Row, beside, hold};
use faer::Par;
use sprung::Stiffness;
use sprung::force::Extensions;
use sprung::linear::{
    Assurance, CholeskyPlan, CostModel, PreconditionerKind, Prepare, SolverChoice, SolverOptions, select,
};
use sprung::multigrid::Multigrid;
use sprung::operator::{Combination, SystemOperator};
use sprung::scene::{Kind, Scene, builtin};
use sprung::verify::{Subject, built_in};
use sprung::work::Work;

#[test]
fn ready_scenes() {
    hold("scene_ready", |_| {
        let mut rows = Vec::new();
        for kind in Kind::ALL {
            let least = *kind.sizes().start();
            for size in [least.saturating_sub(1), least, least + 1, least + 2, 5, 6, 9, kind.sizes().end() + 1] {
                let scene = builtin(kind, size);
                let built = scene.as_ref().ok().map(|scene| scene.build().map(|(_, state)| state));
                let found = (scene.as_ref().map_err(ToString::to_string), built.map(|b| b.map_err(|e| e.to_string())));
                rows.push(Row::shown(format!("{} {size} of {}", kind.name(), rows.len()), &found));
            }
        }
        for seed in 1..4 {
            let network = sprung::scene::builtin::network(7, seed).unwrap();
            rows.push(Row::shown(format!("network of seed {seed}"), &network));
        }
        rows
    });
}

/// What is written is read again.
#[test]
fn arrays_there_and_back() {
    for kind in Kind::ALL {
        for size in [kind.default_size().min(12), *kind.sizes().start()] {
            let scene = builtin(kind, size).unwrap();
            let mut file = std::io::Cursor::new(Vec::new());
            scene.write_npz(&mut file).unwrap();
            let again = Scene::from_npz(file).unwrap();
            let (system, state) = scene.build().unwrap();
            let (same_system, same_state) = again.build().unwrap();
            assert_eq!(state, same_state, "{}", kind.name());
            assert_eq!(system.masses(), same_system.masses());
            assert_eq!((system.pairs(), system.springs()), (same_system.pairs(), same_system.springs()));
            assert_eq!(system.dofs().iter().collect::<Vec<_>>(), same_system.dofs().iter().collect::<Vec<_>>());
        }
    }
}

fn subjects() -> Vec<Subject> {
    let ready = [(Kind::Cloth, 9), (Kind::Lattice, 4), (Kind::Network, 4), (Kind::Column, 8)];
    let mut all = built_in().unwrap();
    all.truncate(13);
    all.extend(ready.map(|(kind, size)| Subject::of_scene(&builtin(kind, size).unwrap()).unwrap()));
    all
}

/// A right-hand side without order in it.
fn right(n: usize) -> Vec<f64> {
    (0..n).map(|row| ((3 * row + 1) as f64).sin()).collect()
}

#[test]
fn solvers() {
    hold("linear_solvers", |seed| {
        let mut rows = Vec::new();
        let all = [Assurance::Definite, Assurance::MadeDefinite, Assurance::Unknown];
        for subject in subjects().iter().map(|subject| beside(subject, seed)) {
            let (system, state) = (&subject.system, &subject.state);
            let extensions = Extensions::at(system, &state.positions).unwrap();
            let n = system.dofs().len();
            let b = right(n);
            let costs = CostModel::of(system);
            let mut work = Work::default();
            let size = CholeskyPlan::new(system, Par::Seq, &mut work).unwrap().size();
            let solves = [costs.factorization(size), costs.direct_solve(size), costs.analysis(size), costs.glance()];
            let least = [costs.least_factorization(), costs.least_direct_solve(), costs.product(), costs.assembly()];
            let kinds = PreconditionerKind::ALL.map(|kind| (costs.iteration(kind), costs.preparation(kind)));
            let rest = [costs.multigrid_setup(), costs.iterative_solve(), costs.warm_start()];
            rows.push(Row::shown(format!("{} costs", subject.name), &(costs, size, solves, least, kinds, rest)));
            for (factor, option) in [(1.0, Stiffness::Tension), (8.0, Stiffness::Full)] {
                let a = SystemOperator::new(system, &extensions, option, Combination::step(factor * subject.dt));
                let chosen = SolverChoice::ALL.into_iter().flat_map(|solver| {
                    let kinds = match solver {
                        SolverChoice::Cg | SolverChoice::CgAssembled => &PreconditionerKind::ALL[..],
                        _ => &PreconditionerKind::ALL[..1],
                    };
                    kinds.iter().map(move |&kind| (solver, kind))
                });
                for (solver, kind) in chosen {
                    let options = SolverOptions::default().with_solver(solver);
                    let options =
                        if kind == PreconditionerKind::None { options } else { options.with_preconditioner(kind) };
                    for &assurance in if solver == SolverChoice::Auto { &all[..] } else { &all[..1] } {
                        let mut work = Work::default();
                        let mut x = vec![0.0; n];
                        let mut solver = select(system, &options, assurance, &mut work).unwrap();
                        solver.place(&state.positions);
                        let mut solved = Vec::new();
                        for _ in 0..3 {
                            let once =
                                solver.prepare(&a, &mut work).and_then(|mut ready| ready.solve(&b, &mut x, &mut work));
                            solved.push(once.map_err(|failure| failure.to_string()));
                        }
                        let key = format!(
                            "{} {} {} {assurance:?} {factor}",
                            subject.name,
                            options.solver.name(),
                            kind.name()
                        );
                        rows.push(Row::shown(key, &(solved, x, work, solver.name(), solver.preconditioner())));
                    }
                }
            }
        }
        rows
    });
}

#[test]
fn multigrid() {
    hold("multigrid_levels", |seed| {
        let mut rows = Vec::new();
        for subject in subjects().iter().map(|subject| beside(subject, seed)) {
            for least in [3, 20, 400] {
                let (system, state) = (&subject.system, &subject.state);
                let extensions = Extensions::at(system, &state.positions).unwrap();
                let a =
                    SystemOperator::new(system, &extensions, Stiffness::Tension, Combination::step(4.0 * subject.dt));
                let mut multigrid = Multigrid::down_to(system, least).unwrap();
                let made = multigrid.rebuild(&a).map_err(|refused| format!("{refused:?}"));
                let mut z = vec![0.0; system.dofs().len()];
                if made.is_ok() {
                    multigrid.apply(&right(z.len()), &mut z);
                }
                let key = format!("{} {least}", subject.name);
                // Bytes are those of the kernels that the processor has.
                let mut row = Row::shown(key, &(made, multigrid.levels(), z.len()));
                // Multigrid computes in single precision: sizes of a few parts of the vector.
                let part = |part: usize| z.iter().skip(part).step_by(7).map(|z| z * z).sum::<f64>().sqrt();
                row.rounded.extend((0..7).map(part));
                rows.push(row);
            }
        }
        rows
    });
}

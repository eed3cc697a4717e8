//! Every level against dense matrices: what it holds is what the module says it is, and a cycle is its formula.

use super::super::block::Block;
use super::super::galerkin::UNSMOOTHED;
use super::super::modes::Frames;
use super::super::prolongator::Prolongator;
use super::super::sparse::{BlockMatrix, Pattern, Rows};
use super::super::{Cycle as _, Hierarchy, LevelSize};
use super::{Dense, Level};
use crate::force::SpringGeometry;
use crate::operator::{Combination, LinearOperator as _, SystemOperator};
use crate::spring::{Spring, Stiffness};
use crate::system::{Axes, Constraint, Motion, State, System, SystemBuilder};
use nalgebra::{DMatrix, Vector3};
use std::sync::Arc;

/// What single precision leaves, with the errors of a few products.
const SINGLE: f64 = 2e-5;

fn random(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 11) as f64 / (1u64 << 53) as f64
}

/// A crooked grid with springs of many stiffnesses along its axes, and across in one direction, every eleventh so stiff that its ends are a tight
/// pair; two springs join the first pair. One particle is held, one along x, and one has no spring.
fn grid(counts: [usize; 3]) -> (System, State) {
    let dimension = counts.iter().filter(|&&count| count > 1).count();
    let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
    let mut seed = 7;
    let [nx, ny, nz] = counts;
    let number = |x: usize, y: usize, z: usize| (z * ny + y) * nx + x;
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let mut place = [x, y, z].map(|i| i as f64);
                place.iter_mut().take(dimension).for_each(|c| *c += 0.3 * random(&mut seed));
                builder.particle(place, 0.5 + random(&mut seed));
            }
        }
    }
    let mut count = 0;
    let mut join = |a: usize, b: usize| {
        count += 1;
        let stiffness = 1000.0 * (1.0 + 3.0 * random(&mut seed)) * if count % 11 == 0 { 90.0 } else { 1.0 };
        builder.spring(a, b, Spring { stiffness, rest_length: 0.7, damping: 0.0 });
    };
    join(0, 1);
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let here = number(x, y, z);
                for [dx, dy, dz] in [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1]] {
                    let there = [x + dx, y + dy, z + dz];
                    if there[0] < nx && there[1] < ny && there[2] < nz {
                        join(here, number(there[0], there[1], there[2]));
                    }
                }
            }
        }
    }
    builder.particle([-9.0, 0.0, 0.0], 2.0);
    builder.hold(4);
    builder.constrain(Constraint { particles: vec![7], axes: Axes::of(&[0]), motion: Motion::Held });
    builder.build().unwrap()
}

fn put<const R: usize, const C: usize>(dense: &mut DMatrix<f64>, row: usize, column: usize, block: &Block<R, C>) {
    for r in 0..R {
        for c in 0..C {
            dense[(row * R + r, column * C + c)] = block[r][c];
        }
    }
}

fn dense<const N: usize>(a: &impl Rows<N>) -> DMatrix<f64> {
    let rows = a.pattern().rows();
    let mut dense = DMatrix::zeros(rows * N, rows * N);
    (0..rows).for_each(|row| a.visit(row, |column, block| put(&mut dense, row, column, block)));
    dense
}

fn columns<const N: usize, const M: usize, I: Iterator<Item = (usize, Block<N, M, f32>)>>(
    rows: usize,
    count: usize,
    column: impl Fn(usize) -> I,
) -> DMatrix<f64> {
    let mut dense = DMatrix::zeros(rows * N, count * M);
    for aggregate in 0..count {
        column(aggregate)
            .for_each(|(row, block)| put(&mut dense, row, aggregate, &block.map(|row| row.map(f64::from))));
    }
    dense
}

/// Nodes and blocks of a column of T: the members of an aggregate.
fn tentative_column<const N: usize, const M: usize>(
    prolongator: &Prolongator<N, M>,
    aggregate: usize,
) -> impl Iterator<Item = (usize, Block<N, M, f32>)> {
    let nodes = 0..prolongator.matrix.pattern.rows();
    let rows = nodes.filter_map(|node| Some((node, prolongator.tentative_row(node)?)));
    rows.filter(move |(_, (column, _))| *column as usize == aggregate).map(|(node, (_, block))| (node, *block))
}

/// The blocks of a matrix for which this holds.
fn part(a: &DMatrix<f64>, size: usize, belongs: impl Fn(usize, usize) -> bool) -> DMatrix<f64> {
    DMatrix::from_fn(a.nrows(), a.ncols(), |r, c| if belongs(r / size, c / size) { a[(r, c)] } else { 0.0 })
}

fn assert_near(found: &DMatrix<f64>, expected: &DMatrix<f64>, tolerance: f64, what: &str) {
    let difference = (found - expected).amax();
    assert!(difference <= tolerance * expected.amax(), "{what}: {difference:e} of {:e}", expected.amax());
}

/// `Σ_j A_ij T̃_j` of a row for each aggregate, given the couplings of nodes: `T̃_j` is that of the aggregate of j, or where the row leaves that out
/// what stands in. An aggregate is left out where it has less than 15 % of what the row is coupled by, from the weakest on, up to 25 % in all.
fn filtered<const N: usize, const M: usize>(
    row: usize,
    a: &DMatrix<f64>,
    couplings: &DMatrix<f64>,
    prolongator: &Prolongator<N, M>,
    frames: &(impl Frames<N, M> + ?Sized),
) -> DMatrix<f64> {
    let aggregate = |node| prolongator.tentative_row(node).map(|(column, _)| column as usize);
    let count = prolongator.columns();
    let mut strength = vec![None; count];
    let neighbours = (0..couplings.nrows()).filter(|&j| a.view((row * N, j * N), (N, N)).amax() > 0.0);
    for (j, c) in neighbours.clone().filter_map(|j| Some((j, aggregate(j)?))) {
        *strength[c].get_or_insert(0.0) += couplings[(row, j)] / couplings.row(row).sum();
    }
    let own = aggregate(row);
    let mut weakest_first: Vec<usize> = (0..count).filter(|&c| strength[c].is_some() && Some(c) != own).rev().collect();
    weakest_first.sort_by(|&c, &d| strength[c].partial_cmp(&strength[d]).unwrap());
    let sum = |some: &[usize]| some.iter().map(|&c| strength[c].unwrap()).sum::<f64>();
    let left_out = (1..=weakest_first.len())
        .take_while(|&n| sum(&weakest_first[n - 1..n]) < 0.15 && sum(&weakest_first[..n]) <= 0.25)
        .last()
        .unwrap_or(0);
    let stands_in = weakest_first[left_out..].last().copied().or(own);
    let mut filtered = DMatrix::zeros(N, count * M);
    for (j, c) in neighbours.filter_map(|j| Some((j, aggregate(j)?))) {
        let c = if weakest_first[..left_out].contains(&c) { stands_in.unwrap() } else { c };
        let t = prolongator.modes[c].tentative(&frames.frame(j));
        let mut followed = DMatrix::zeros(N, M);
        put(&mut followed, 0, 0, &t);
        let mut sum = filtered.columns_mut(c * M, M);
        sum += a.view((row * N, j * N), (N, N)) * followed;
    }
    filtered
}

/// The matrix that a stage applies, by the formulas, after its parts have been compared with theirs. `motions` are rigid motions of all nodes, one a
/// column, `couplings` the weights of the graph. Levels from this one on are counted in `levels`.
fn reference<const N: usize, const M: usize>(
    stage: &Level<N, M>,
    a: &impl Rows<N>,
    factor: f64,
    motions: &DMatrix<f64>,
    couplings: &DMatrix<f64>,
    frames: &(impl Frames<N, M> + ?Sized),
    levels: &mut usize,
) -> DMatrix<f64> {
    *levels += 1;
    let unscaled = dense(a);
    let scaled = factor * &unscaled;
    let Some(level) = stage.coarse() else {
        assert!(matches!(stage, Level::Direct(_)));
        return scaled.try_inverse().unwrap();
    };
    let (order, count) = (scaled.nrows(), level.prolongator.columns());
    let identity = DMatrix::identity(order, order);
    let inverse_diagonal = part(&scaled, N, |r, c| r == c).try_inverse().unwrap();

    // T has orthonormal columns, and every rigid motion is one of its aggregates.
    let t = columns(order / N, count, |aggregate| tentative_column(&level.prolongator, aggregate));
    let gram = t.transpose() * &t;
    let present = |motion: usize| level.prolongator.modes[motion / M].has(motion % M);
    let expected = DMatrix::from_fn(count * M, count * M, |r, c| f64::from(u8::from(r == c && present(r))));
    assert_near(&gram, &expected, 1e-4, "TᵀT");
    let coarse_motions = t.transpose() * motions;
    // A node without neighbours has no aggregate: its equations stand alone.
    let has_aggregate = |row: usize| level.prolongator.tentative_row(row / N).is_some();
    let of_aggregates = DMatrix::from_fn(order, M, |r, c| if has_aggregate(r) { motions[(r, c)] } else { 0.0 });
    assert_near(&(&t * &coarse_motions), &of_aggregates, 1e-4, "rigid motions");

    // A node below stands for nodes of this level: the first of its own, and so on down.
    assert_eq!(stage.member(0, 3), 3);
    for aggregate in 0..count {
        let first = tentative_column(&level.prolongator, aggregate).map(|(node, _)| node).next().unwrap();
        assert_eq!((level.prolongator.member(aggregate), stage.member(1, aggregate)), (first, first));
    }
    if let Some(next) = level.level.coarse() {
        for aggregate in 0..next.prolongator.columns() {
            let first = tentative_column(&next.prolongator, aggregate).map(|(node, _)| node).next().unwrap();
            assert_eq!(stage.member(2, aggregate), level.prolongator.member(first));
        }
    }

    // P = T − ω D⁻¹ A T̃, which moves as one body where (I − ω D⁻¹A) T does.
    let rows: Vec<_> =
        (0..order / N).map(|row| filtered(row, &scaled, couplings, &level.prolongator, frames)).collect();
    let mut products = DMatrix::zeros(order, count * M);
    rows.iter().enumerate().for_each(|(row, block)| products.rows_mut(row * N, N).copy_from(block));
    let smoothed = |product: &DMatrix<f64>| &t - 2.0 / 3.0 * &inverse_diagonal * product;
    let of_bodies = |p: &DMatrix<f64>| p * &coarse_motions;
    assert_near(&of_bodies(&smoothed(&products)), &of_bodies(&smoothed(&(&scaled * &t))), 1e-4, "rigid motions of P");
    let column = |aggregate| level.prolongator.column(aggregate).map(|(node, block)| (node, *block));
    let p = columns(order / N, count, column);
    assert_near(&p, &smoothed(&products), SINGLE, "P");
    for (row, block) in (0..order / N).flat_map(|row| level.prolongator.matrix.row(row).map(move |entry| (row, entry)))
    {
        let entries = block.1;
        let found = DMatrix::from_fn(N, M, |r, c| f64::from(entries[r][c]));
        assert_eq!(found, p.view((row * N, block.0 * M), (N, M)));
    }

    // A_c = Pᵀ A P + ε Tᵀ A T, and an equation for every motion that is absent.
    let absent = DMatrix::from_fn(count * M, count * M, |r, c| f64::from(u8::from(r == c && !present(r))));
    let galerkin = p.transpose() * &unscaled * &p + UNSMOOTHED * (t.transpose() * &unscaled * &t) + absent;
    assert_near(&dense(&level.galerkin.coarse), &galerkin, SINGLE, "A_c");

    // Down, and both sweeps.
    let coarse = &level.galerkin.coarse;
    let member = DMatrix::from_fn(order / N, count, |node, aggregate| {
        f64::from(u8::from(level.prolongator.tentative_row(node).is_some_and(|(of, _)| of as usize == aggregate)))
    });
    let mut coarse_couplings = member.transpose() * couplings * &member;
    coarse_couplings.fill_diagonal(0.0);
    let below = reference(
        &level.level,
        coarse,
        factor,
        &coarse_motions,
        &coarse_couplings,
        &level.prolongator.modes[..],
        levels,
    );
    let forward = part(&scaled, N, |r, c| c <= r).try_inverse().unwrap();
    let around = |inner: DMatrix<f64>, first: &DMatrix<f64>| {
        let corrected = first + inner * (&identity - &scaled * first);
        &corrected + first.transpose() * (&identity - &scaled * &corrected)
    };
    around(&p * below * p.transpose(), &forward)
}

/// Rigid motions of all particles that have springs, on the nodes of the finest level.
fn rigid_motions<const D: usize, const M: usize>(
    hierarchy: &Hierarchy<D, M>,
    system: &System,
    state: &State,
) -> DMatrix<f64> {
    let nodes = hierarchy.finest.pattern.rows();
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let turns = if D == 2 { &axes[2..] } else { &axes[..] };
    DMatrix::from_fn(nodes * D, M, |row, motion| {
        let dof = hierarchy.finest.dof(row / D, Some(row % D));
        let is_joined = system.pairs().iter().flatten().any(|&p| p as usize == dof.particle);
        let x = state.positions[dof.particle];
        let u = if motion < D { axes[motion] } else { turns[motion - D].cross(&x) };
        if is_joined && dof.axis == row % D { u[row % D] } else { 0.0 }
    })
}

/// k/l0 between the nodes of the finest level.
fn couplings<const D: usize, const M: usize>(hierarchy: &Hierarchy<D, M>, system: &System) -> DMatrix<f64> {
    let nodes = hierarchy.finest.pattern.rows();
    let node = |particle| (0..nodes).find(|&node| hierarchy.finest.dof(node, None).particle == particle);
    let mut couplings = DMatrix::zeros(nodes, nodes);
    for (_, pair, spring) in system.active() {
        if let [Some(i), Some(j)] = pair.map(node) {
            couplings[(i, j)] += spring.stiffness / spring.rest_length;
            couplings[(j, i)] += spring.stiffness / spring.rest_length;
        }
    }
    couplings
}

fn check<const D: usize, const M: usize>(
    (system, state): (System, State),
    largest_dense: usize,
    expected_levels: usize,
) {
    assert_eq!(system.dimension(), D);
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    let a = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.1));
    let mut hierarchy = Hierarchy::<D, M>::new(&system, largest_dense).unwrap();
    hierarchy.finest.set_positions(&state.positions);
    hierarchy.refill(&a).unwrap();
    hierarchy.rebuild(&a).unwrap();

    // The finest matrix is that of the system, with x = 0 for axes that are held.
    let finest = hierarchy.finest.rows(&a);
    let found = dense(&finest);
    let row_of = |row: usize| Some(hierarchy.finest.dof(row / D, Some(row % D))).filter(|dof| dof.axis == row % D);
    let rows: Vec<Option<usize>> =
        (0..found.nrows()).map(|row| row_of(row).and_then(|dof| system.dofs().row(dof))).collect();
    let order = system.dofs().len();
    assert_eq!(rows.iter().flatten().count(), order);
    let mut whole = DMatrix::zeros(order, order);
    for (k, mut column) in whole.column_iter_mut().enumerate() {
        let mut unit = vec![0.0; order];
        unit[k] = 1.0;
        a.apply(&unit, column.as_mut_slice());
    }
    let expected = DMatrix::from_fn(found.nrows(), found.nrows(), |r, c| match (rows[r], rows[c]) {
        (Some(row), Some(column)) => whole[(row, column)],
        _ => f64::from(u8::from(r == c)),
    });
    assert_near(&found, &expected, 1e-13, "A");

    // The factor makes the largest mass term or spring block at least one and less than two.
    let factor = hierarchy.factor;
    let masses = system.masses().iter().map(|m| m * a.mass_factor());
    let springs = a.blocks().iter().map(|block| block.axial.max(block.transverse));
    let largest = masses.chain(springs).fold(0.0, f64::max);
    assert!((1.0..2.0).contains(&(factor * largest)) && factor.log2().fract() == 0.0, "{factor} {largest}");

    let mut levels = 0;
    let motions = rigid_motions(&hierarchy, &system, &state);
    let couplings = couplings(&hierarchy, &system);
    let by_formula =
        factor * reference(&hierarchy.level, &finest, factor, &motions, &couplings, &hierarchy.finest, &mut levels);
    let sizes: Vec<LevelSize> = hierarchy.level.sizes(&hierarchy.finest.pattern);
    assert_eq!((levels, sizes.len()), (expected_levels, expected_levels));
    let entries = found.iter().filter(|entry| **entry != 0.0).count();
    assert!(sizes[0].nodes * D == found.nrows() && sizes[0].unknowns == found.nrows() && sizes[0].entries >= entries);
    assert!(sizes.windows(2).all(|pair| pair[1].nodes < pair[0].nodes && pair[1].unknowns == M * pair[1].nodes));

    // A residual of any size, as it is no power of two that its scale takes out wholly.
    let mut applied = DMatrix::zeros(order, order);
    for (k, mut column) in applied.column_iter_mut().enumerate() {
        let mut r = vec![0.0; order];
        r[k] = 3e5;
        hierarchy.apply(&r, column.as_mut_slice());
    }
    let place = |row: usize| rows.iter().position(|&of| of == Some(row)).unwrap();
    let expected = DMatrix::from_fn(order, order, |r, c| 3e5 * by_formula[(place(r), place(c))]);
    assert_near(&applied, &expected, SINGLE, "B");
}

#[test]
fn a_cycle_on_a_line_is_its_formula() {
    check::<1, 1>(grid([120, 1, 1]), 3, 5);
}

#[test]
fn a_cycle_in_the_plane_is_its_formula() {
    check::<2, 3>(grid([9, 7, 1]), 10, 3);
}

#[test]
fn a_cycle_in_space_is_its_formula() {
    check::<3, 6>(grid([4, 4, 3]), 30, 3);
}

/// A particle that soft springs join to many places of a line has more aggregates around it than are added up at once, without those left out. One
/// spring of the line is stiff.
#[test]
fn a_cycle_around_a_hub_is_its_formula() {
    let mut builder = SystemBuilder { dimension: 1, ..SystemBuilder::new() };
    for x in 0..120 {
        builder.particle([f64::from(x), 0.0, 0.0], 1.0 + 0.1 * f64::from(x % 3));
    }
    for i in 1..120 {
        let stiffness = if i == 60 { 1e5 } else { 1000.0 + i as f64 };
        builder.spring(i - 1, i, Spring { stiffness, rest_length: 0.7, damping: 0.0 });
    }
    let hub = builder.particle([-50.0, 0.0, 0.0], 2.0);
    for i in (2..120).step_by(5) {
        builder.spring(i, hub, Spring { stiffness: 1.0 + 0.1 * i as f64, rest_length: 0.7, damping: 0.0 });
    }
    check::<1, 1>(builder.build().unwrap(), 3, 4);
}

/// The row of an entry that is not finite, or of a pivot that is not positive.
#[test]
fn bad_rows_are_told() {
    let pattern = Pattern::build(5, |row, columns| columns.push(row as u32)).unwrap();
    let with = |row: usize, entry: f64| {
        let mut matrix = BlockMatrix::<2, 2, f64>::zeros(Arc::new(pattern.clone()));
        for (at, block) in matrix.values.iter_mut().enumerate() {
            *block = [[2.0, 0.5], [0.5, if at == row { entry } else { 4.0 }]];
        }
        matrix
    };
    let mut dense = Dense::new(10);
    assert!(format!("{dense:?}").contains("order: 10"));
    for row in 0..5 {
        for entry in [f64::INFINITY, f64::NAN, -1.0] {
            assert_eq!(dense.update(&with(row, entry), 1.0), Err(row), "{entry}");
        }
    }
    // Beside the diagonal the row counts, not the column.
    let pattern =
        Pattern::build(5, |row, columns| columns.extend(if row == 3 { vec![1, 3] } else { vec![row as u32] }));
    let mut matrix = BlockMatrix::<2, 2, f64>::zeros(Arc::new(pattern.unwrap()));
    matrix.values.fill([[2.0, 0.5], [0.5, 4.0]]);
    matrix.values[3][1][0] = f64::INFINITY;
    assert_eq!(dense.update(&matrix, 1.0), Err(3));
    dense.update(&with(3, 1.0), 2.0).unwrap();
    let mut x = [[0.0f32; 2]; 5];
    dense.solve(&[[1.0, 3.0]; 5], &mut x);
    assert!(x.iter().enumerate().all(|(row, x)| {
        let last = if row == 3 { 1.0 } else { 4.0 };
        (4.0 * x[0] + x[1] - 1.0).abs() < 1e-6 && (x[0] + 2.0 * last * x[1] - 3.0).abs() < 1e-6
    }));
}

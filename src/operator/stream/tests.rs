//! Which springs are streamed, and products by hand-made shares.

use super::*;
use crate::force::SpringGeometry;
use crate::operator::{Combination, SystemOperator};
use crate::spring::{Spring, Stiffness};
use crate::system::{Axes, Constraint, Motion, State, SystemBuilder};
use nalgebra::Vector3;

/// A free chain of springs of rest length 1 that have these lengths and dampings.
fn chain(springs: &[(f64, f64)]) -> (System, State) {
    let mut builder = SystemBuilder::new();
    let (mut x, mut last) = (0.0, builder.particle([0.0; 3], 1.0));
    for &(length, damping) in springs {
        x += length;
        let next = builder.particle([x, 0.0, 0.0], 1.0);
        builder.spring(last, next, Spring { stiffness: 100.0, rest_length: 1.0, damping });
        last = next;
    }
    builder.build().unwrap()
}

/// Consecutive particles, so many for every share.
fn shares(system: &System, particles: &[usize]) -> Vec<ThreadPartition> {
    let mut start = 0;
    let mut share = |count: usize| {
        let particles = start..start + count;
        start += count;
        let ends_here = |position: &u32| system.pair(*position as usize).iter().any(|end| particles.contains(end));
        let springs = (0..system.springs().len() as u32).filter(ends_here).collect();
        ThreadPartition { particles, springs }
    };
    particles.iter().map(|&count| share(count)).collect()
}

/// With the sign that an operator says for these blocks.
fn update(stream: &mut SpringStream, system: &System, blocks: &[SpringBlock]) {
    let is_negative = |block: &SpringBlock| block.axial < 0.0;
    stream.update(system, blocks, if blocks.iter().any(is_negative) { -1.0 } else { 1.0 });
}

/// The positions of the springs that go through their matrix, for the blocks given.
fn by_matrix(system: &System, blocks: &[SpringBlock]) -> Vec<u32> {
    let mut stream = SpringStream::new(system, &shares(system, &[system.particles()]));
    update(&mut stream, system, blocks);
    let part = &stream.parts[0];
    let mut found = Vec::new();
    for (number, batch) in part.contiguous.batches.iter().enumerate() {
        let springs = part.contiguous.positions(number).into_iter().enumerate();
        found.extend(springs.filter(|(n, _)| batch.ends.by_matrix & (1 << n) != 0).map(|(_, position)| position));
    }
    let ends = part.others.batches.iter().flat_map(|batch| std::iter::zip(batch.ends[0], batch.ends[1]));
    found.extend(ends.filter(|ends| ends.0 == BY_MATRIX).map(|ends| ends.1));
    found
}

/// Springs longer than half their rest length are streamed, whatever sign the combination gives to the stiffness; a spring that the combination
/// leaves out, here one without damping, does not send the others through their matrix.
#[test]
fn only_short_springs_go_through_their_matrix() {
    let (system, state) = chain(&[(0.6, 0.0), (1.0, 3.0), (0.4, 0.0), (2.5, 1.0)]);
    let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    let damping = |factor: f64| Combination { damping: factor, ..Combination::MASS };
    for (combination, expected) in [
        (Combination::STIFFNESS, vec![2]),
        (Combination::step(0.1), vec![2]),
        (damping(1.0), vec![]),
        (damping(-1.0), vec![]),
        (Combination::MASS, vec![]),
    ] {
        let operator = SystemOperator::new(&system, &extensions, Stiffness::Full, combination);
        assert_eq!(by_matrix(&system, operator.blocks()), expected, "{combination:?}");
    }
}

/// 2 nnᵀ and −3 nnᵀ along x, in one operator: the product with (1, 0, 0), (0, 0, 0), (4, 0, 0) by hand.
#[test]
fn blocks_of_both_signs_may_be_mixed() {
    let (system, _) = chain(&[(1.0, 0.0), (1.0, 0.0)]);
    let block = |axial| SpringBlock { direction: Vector3::x(), transverse: 0.0, axial };
    let blocks = [block(2.0), block(-3.0)];
    assert_eq!(by_matrix(&system, &blocks), [0]);
    let mut stream = SpringStream::new(&system, &shares(&system, &[3]));
    update(&mut stream, &system, &blocks);
    let mut w = [0.0; 9];
    (w[0], w[6]) = (1.0, 4.0);
    let mut y = [f64::NAN; 9];
    stream.multiply(&system, &blocks, &[0.0; 9], &w, &mut y);
    let along: Vec<f64> = y.iter().step_by(3).copied().collect();
    for (value, expected) in along.into_iter().zip([2.0, -2.0 + 12.0, -12.0]) {
        assert!((value - expected).abs() <= 1e-14, "{y:?}");
    }
}

/// As the formulas say it, spring by spring: every row has its own term first. Then come, stretch by stretch, what its particle gets as the other end
/// of springs in a row, what it gets as the first of them, all together, and what it gets from any others.
fn one_by_one(system: &System, blocks: &[SpringBlock], diagonal: &[f64], w: &[f64]) -> Vec<f64> {
    let mut y: Vec<f64> = diagonal.iter().zip(w).map(|(m, w)| m * w).collect();
    let product = |position: u32| {
        let block = &blocks[position as usize];
        // What is held has no rows.
        let ends = ends(system, position).map(|end| system.dofs().rows(end));
        let g = block.direction * (block.axial - block.transverse).sqrt();
        let d: [f64; 3] = std::array::from_fn(|axis| {
            let [first, other] = ends.clone().map(|mut rows| rows.nth(axis).map_or(0.0, |row| w[row]));
            first - other
        });
        let along = g[0] * d[0] + g[1] * d[1] + g[2] * d[2];
        (ends, std::array::from_fn::<_, 3, _>(|axis| block.transverse * d[axis] + g[axis] * along))
    };
    let springs = |four: &Four| four.iter().copied().filter(|&p| p != NO_SPRING).collect::<Vec<_>>();
    for stretch in stretches(system) {
        for batches in stretch.contiguous.chunk_by(|a, b| a.0[0] == b.0[0]) {
            let mut sums = vec![0.0; y.len()];
            for position in batches.iter().flat_map(|(_, four)| springs(four)) {
                let ([first, other], s) = product(position);
                first.zip(s).for_each(|(row, s)| sums[row] += s);
                other.zip(s).for_each(|(row, s)| y[row] -= s);
            }
            y.iter_mut().zip(sums).for_each(|(y, sum)| *y += sum);
        }
        for position in stretch.others.iter().flat_map(springs) {
            let ([first, other], s) = product(position);
            first.zip(s).for_each(|(row, s)| y[row] += s);
            other.zip(s).for_each(|(row, s)| y[row] -= s);
        }
    }
    y
}

/// Enough particles for several stretches, crooked, numbered without order, with springs that share ends and some that do not. Some are held.
fn tangle(dimension: usize) -> (System, State) {
    let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
    let count = 301;
    for p in 0..count {
        let place = [f64::from(p), f64::from(p * p % 7), f64::from(p * p % 5)];
        builder.particle(std::array::from_fn(|axis| if axis < dimension { place[axis] } else { 0.0 }), 1.0);
    }
    let spring = |stiffness| Spring { stiffness, rest_length: 0.7, damping: 0.1 };
    for p in 0..count as usize {
        for reach in [1, 2, 150, 300 - p] {
            let end = (p + reach) % count as usize;
            if end != p {
                builder.spring(p, end, spring(1.0 + p as f64 / 7.0));
            }
        }
    }
    [0, 17].into_iter().chain(200..206).for_each(|p| _ = builder.hold(p));
    builder.build().unwrap()
}

/// In any registers the product is that of the plain loop, to the bit.
#[test]
fn four_springs_at_a_time_are_each_by_itself() {
    for dimension in 1..=3 {
        let (system, state) = tangle(dimension);
        let extensions = SpringGeometry::at(&system, &state.positions).unwrap();
        let operator = SystemOperator::new(&system, &extensions, Stiffness::Tension, Combination::step(0.1));
        let rows = system.dofs().len();
        let mut stream = SpringStream::new(&system, &shares(&system, &[system.particles()]));
        update(&mut stream, &system, operator.blocks());
        let part = &stream.parts[0];
        assert!(part.stretches.len() == 5 && by_matrix(&system, operator.blocks()).is_empty());
        assert_eq!(part.contiguous.batches.len() > 200, dimension == 3, "{}", part.contiguous.batches.len());
        assert!(part.others.batches.len() > 70, "{}", part.others.batches.len());
        let w: Vec<f64> = (0..rows).map(|row| (row as f64 * 12.9898).sin()).collect();
        let diagonal: Vec<f64> = (0..rows).map(|row| 1.0 + row as f64).collect();
        let expected = one_by_one(&system, operator.blocks(), &diagonal, &w);
        let springs = Springs { system: &system, blocks: operator.blocks(), sign: stream.sign };
        let mut y = vec![f64::NAN; rows];
        stream.multiply(&system, operator.blocks(), &diagonal, &w, &mut y);
        assert_eq!(y, expected, "{dimension}");
        y.fill(f64::NAN);
        let (part, diagonal, w) = (&stream.parts[0], &diagonal[..], &w[..]);
        macro_rules! portable {
            ($n:literal) => {
                Product::<_, $n> { simd: Portable, part, springs: &springs, diagonal, w, y: &mut y }
            };
        }
        match dimension {
            1 => pulp::NullaryFnOnce::call(portable!(1)),
            2 => pulp::NullaryFnOnce::call(portable!(2)),
            _ => pulp::NullaryFnOnce::call(portable!(3)),
        }
        assert_eq!(y, expected, "{dimension}");
    }
}

/// Springs that go through their matrix stand among the others, in their order: with them, too, the result does not depend on the shares, and it is
/// the product of the blocks.
#[test]
fn springs_of_both_kinds_may_be_mixed() {
    let (system, state) = tangle(3);
    let mut extensions = SpringGeometry::at(&system, &state.positions).unwrap();
    // Where particles are drawn together, springs are shorter than half their rest length.
    let mut positions = state.positions.clone();
    positions.iter_mut().take(100).for_each(|x| *x *= 0.03);
    extensions.update(&system, &positions).unwrap();
    let operator = SystemOperator::new(&system, &extensions, Stiffness::Full, Combination::step(0.1));
    let count = by_matrix(&system, operator.blocks()).len();
    assert!(count > 20 && count < system.springs().len() / 2, "{count}");
    let rows = system.dofs().len();
    let w: Vec<f64> = (0..rows).map(|row| (row as f64 * 12.9898).sin()).collect();
    let diagonal = vec![100.0; rows];
    let product = |particles: &[usize]| {
        let mut stream = SpringStream::new(&system, &shares(&system, particles));
        update(&mut stream, &system, operator.blocks());
        let mut y = vec![f64::NAN; rows];
        stream.multiply(&system, operator.blocks(), &diagonal, &w, &mut y);
        y
    };
    let one = product(&[301]);
    for particles in [&[150, 151][..], &[100, 100, 101], &[1, 299, 1], &[30, 31, 32, 33, 34, 141]] {
        assert_eq!(product(particles), one, "{particles:?}");
    }
    let mut expected: Vec<f64> = w.iter().map(|w| 100.0 * w).collect();
    let mut magnitudes = vec![0.0_f64; rows];
    for ((_, [i, j], _), block) in system.active().zip(operator.blocks()) {
        let s = block.matrix() * (system.dofs().get(&w, i) - system.dofs().get(&w, j));
        system.dofs().add(&mut expected, i, &s);
        system.dofs().add(&mut expected, j, &-s);
        let most = block.transverse.abs().max(block.axial.abs());
        [i, j].iter().for_each(|&end| system.dofs().rows(end).for_each(|row| magnitudes[row] += most));
    }
    // Components of w are at most 1, their differences 2, and a dozen roundings count.
    for ((y, expected), magnitude) in one.iter().zip(&expected).zip(&magnitudes) {
        assert!((y - expected).abs() <= 20.0 * f64::EPSILON * (100.0 + magnitude), "{y} {expected}");
    }
}

/// What is sorted: every active spring once, those in a row with the ends that they are said to have.
fn check_order(system: &System) -> [usize; 2] {
    let mut seen = vec![0; system.active_springs().len()];
    let mut count = [0; 2];
    for stretch in stretches(system) {
        for (rows, four) in &stretch.contiguous {
            for (lane, &position) in four.iter().enumerate().filter(|(_, position)| **position != NO_SPRING) {
                for (end, &row) in ends(system, position).into_iter().zip(rows) {
                    let row = row as usize + 3 * lane;
                    let is_held = rows[1] == NO_ROW && system.dofs().rows(end).is_empty();
                    assert!(is_held || system.dofs().rows(end) == (row..row + 3), "{rows:?} {four:?}");
                }
                seen[position as usize] += 1;
                count[0] += 1;
            }
            let fours = rows.iter().filter(|&&row| row != NO_ROW).map(|&row| row as usize);
            assert!(fours.flat_map(|row| (row..row + 12).step_by(3)).all(|row| system.dofs().dof(row).axis == 0));
        }
        for position in stretch.others.iter().flatten().filter(|position| **position != NO_SPRING) {
            seen[*position as usize] += 1;
            count[1] += 1;
        }
    }
    assert!(seen.iter().all(|times| *times == 1), "{seen:?}");
    count
}

/// In a chain of nine particles two fours begin with four particles each: the last spring of eight has none behind it that would make four.
#[test]
fn springs_are_in_a_row_where_ends_follow_each_other() {
    let chain_of = |count: usize, more: &[[usize; 2]], held: &[usize]| {
        let mut builder = SystemBuilder::new();
        (0..count).for_each(|p| _ = builder.particle([p as f64, 0.0, 0.0], 1.0));
        let spring = Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 };
        (1..count).for_each(|p| _ = builder.spring(p - 1, p, spring));
        more.iter().for_each(|&[i, j]| _ = builder.spring(i, j, spring));
        held.iter().for_each(|&p| _ = builder.hold(p));
        builder.build().unwrap().0
    };
    assert_eq!(check_order(&chain_of(9, &[], &[])), [8, 0]);
    // Of eight particles, four have no four behind them.
    assert_eq!(check_order(&chain_of(8, &[], &[])), [4, 3]);
    // One that is held is skipped, and its own springs are not in a row with others.
    assert_eq!(check_order(&chain_of(9, &[], &[0])), [4, 4]);
    assert_eq!(check_order(&chain_of(13, &[], &[3])), [7, 5]);
    // One that moves along two axes keeps its four from being in a row, first or others.
    let rail = Constraint { particles: vec![3], axes: Axes::of(&[0]), motion: Motion::Held };
    let mut builder = SystemBuilder::new();
    (0..13).for_each(|p| _ = builder.particle([f64::from(p), 0.0, 0.0], 1.0));
    let spring = Spring { stiffness: 1.0, rest_length: 1.0, damping: 0.0 };
    (1..13).for_each(|p| _ = builder.spring(p - 1, p, spring));
    builder.constrain(rail);
    assert_eq!(check_order(&builder.build().unwrap().0), [8, 4]);
    // Springs to four that are held, in either direction; the one to the last of them in the chain is alone with its distance.
    assert_eq!(check_order(&chain_of(12, &[[0, 4], [1, 5], [2, 6], [7, 3]], &[0, 1, 2, 3])), [8, 4]);
    // The second of two between the same ends, in either direction; and one that is alone with its distance.
    assert_eq!(check_order(&chain_of(9, &[[1, 0], [5, 4], [0, 3]], &[])), [8, 3]);
    // Springs across: of two with one distance.
    assert_eq!(check_order(&chain_of(9, &[[4, 0], [7, 3]], &[])), [10, 0]);
    for dimension in 1..=3 {
        check_order(&tangle(dimension).0);
    }
}

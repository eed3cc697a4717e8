//! Communication between ranks. All ranks call every function, in the same order.

use mpi::Rank;
use mpi::collective::SystemOperation;
use mpi::datatype::{Partition, PartitionMut};
use mpi::topology::SimpleCommunicator;
use mpi::traits::*;

/// What can be sent.
pub trait Sent: Equivalence + Copy + Default {}

impl<T: Equivalence + Copy + Default> Sent for T {}

fn world() -> SimpleCommunicator {
    SimpleCommunicator::world()
}

/// This rank.
pub fn rank() -> usize {
    world().rank() as usize
}

/// Number of ranks.
pub fn ranks() -> usize {
    world().size() as usize
}

/// Ends all ranks at once, with a status.
pub fn abort(status: i32) -> ! {
    world().abort(status)
}

/// Replaces numbers by their sums over all ranks, the same bits on all of them: one rank adds, and tells the others.
pub fn sum(numbers: &mut [f64]) {
    reduce(numbers, SystemOperation::sum());
}

/// Replaces numbers by the largest of all ranks.
pub fn largest(numbers: &mut [f64]) {
    reduce(numbers, SystemOperation::max());
}

fn reduce(numbers: &mut [f64], operation: SystemOperation) {
    let world = world();
    let root = world.process_at_rank(0);
    let mine = numbers.to_vec();
    if rank() == 0 {
        root.reduce_into_root(&mine[..], numbers, operation);
    } else {
        root.reduce_into(&mine[..], operation);
    }
    root.broadcast_into(numbers);
}

/// The sum of counts over all ranks.
pub fn total(count: u64) -> u64 {
    let mut all = 0;
    world().all_reduce_into(&count, &mut all, SystemOperation::sum());
    all
}

/// Whether something is so on any rank.
pub fn any(here: bool) -> bool {
    total(u64::from(here)) > 0
}

/// What every rank has, by rank.
pub fn all(number: u64) -> Vec<u64> {
    let mut all = vec![0; ranks()];
    world().all_gather_into(&number, &mut all[..]);
    all
}

/// Tells all ranks what rank 0 has.
pub fn share<T: Sent>(values: Vec<T>) -> Vec<T> {
    let world = world();
    let root = world.process_at_rank(0);
    let mut count = values.len() as u64;
    root.broadcast_into(&mut count);
    let mut shared = if rank() == 0 { values } else { vec![T::default(); count as usize] };
    // MPI counts in 32 bits.
    for piece in shared.chunks_mut(1 << 28) {
        root.broadcast_into(piece);
    }
    shared
}

/// Tells all ranks a text that rank 0 has.
pub fn share_text(text: &str) -> String {
    String::from_utf8_lossy(&share(text.as_bytes().to_vec())).into_owned()
}

/// Gives every rank what is meant for it; returns what every rank had for this one.
pub fn exchange<T: Sent>(parcels: &[Vec<T>]) -> Vec<Vec<T>> {
    let world = world();
    let counts: Vec<u64> = parcels.iter().map(|parcel| parcel.len() as u64).collect();
    let mut expected = vec![0u64; counts.len()];
    world.all_to_all_into(&counts[..], &mut expected[..]);
    let (counts, expected) = (lengths(&counts), lengths(&expected));
    // Never empty: an empty list of bytes begins at the address that MPI takes for "in place".
    let sent: Vec<T> = parcels.iter().flatten().copied().chain([T::default()]).collect();
    let mut received = vec![T::default(); 1 + expected.iter().map(|&count| count as usize).sum::<usize>()];
    world.all_to_all_varcount_into(
        &Partition::new(&sent[..], counts.clone(), starts(&counts)),
        &mut PartitionMut::new(&mut received[..], expected.clone(), starts(&expected)),
    );
    let mut rest = &received[..];
    expected.iter().map(|&count| rest.split_off(..count as usize).unwrap_or_default().to_vec()).collect()
}

/// Sends a list to rank 0, which gets all of them by rank; the others get nothing.
pub fn gather<T: Sent>(mine: &[T]) -> Vec<Vec<T>> {
    let mut parcels = vec![Vec::new(); ranks()];
    parcels[0] = mine.to_vec();
    let all = exchange(&parcels);
    if rank() == 0 { all } else { Vec::new() }
}

/// A value that would not fit ends in nonsense that is caught by MPI; 2³¹ numbers to or from one rank are 16 GB.
fn lengths(counts: &[u64]) -> Vec<i32> {
    counts.iter().map(|&count| i32::try_from(count).unwrap_or(-1)).collect()
}

fn starts(counts: &[i32]) -> Vec<i32> {
    counts.iter().scan(0i32, |end, &count| Some(std::mem::replace(end, end.wrapping_add(count)))).collect()
}

/// Sends every neighbour its list and fills in theirs; neither waits for anybody else.
pub fn swap(sent: &[(usize, Vec<f64>)], received: &mut [(usize, Vec<f64>)]) {
    let world = world();
    mpi::request::scope(|scope| {
        let receipts: Vec<_> = received
            .iter_mut()
            .map(|(rank, list)| world.process_at_rank(*rank as Rank).immediate_receive_into(scope, &mut list[..]))
            .collect();
        let sends: Vec<_> = sent
            .iter()
            .map(|(rank, list)| world.process_at_rank(*rank as Rank).immediate_send(scope, &list[..]))
            .collect();
        for request in receipts {
            request.wait();
        }
        for request in sends {
            request.wait();
        }
    });
}

/// Consecutive numbers shared out: where each rank's begin, and where all end.
pub fn ranges(total: u64) -> Vec<u64> {
    let ranks = ranks() as u64;
    (0..=ranks).map(|rank| total / ranks * rank + (total % ranks).min(rank)).collect()
}

/// Whose a number is.
pub fn owner(ranges: &[u64], number: u64) -> usize {
    ranges.partition_point(|&first| first <= number) - 1
}

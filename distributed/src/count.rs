//! `sprung-mpi count`: communication and balance of a scene on a given number of ranks.

use crate::load::Source;
use crate::slab::SPRING;
use crate::{Stop, or_end, petsc, ranks};
use std::collections::BTreeSet;

/// Count what cutting a scene costs: ghosts, messages and bytes of an exchange, for some numbers of ranks
///
/// Runs on one rank and simulates the others.
#[derive(Debug, clap::Args)]
pub struct Count {
    #[command(flatten)]
    source: Source,

    /// Numbers of ranks
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "1,2,4,8,16,32,64")]
    parts: Vec<usize>,

    /// Options of PETSc
    #[arg(long, value_name = "OPTIONS", default_value = "", allow_hyphen_values = true)]
    petsc: String,
}

impl Count {
    /// Runs the command.
    ///
    /// # Errors
    /// Why not.
    pub fn execute(&self) -> Result<(), Stop> {
        if ranks::ranks() != 1 {
            return Err(Stop::Unusable("count runs on one rank".into()));
        }
        let (header, slab) = self.source.load(petsc::MOST_ROWS)?;
        let petsc = or_end(petsc::Petsc::start(&self.petsc));
        let total = header.particles as usize;
        let pairs: Vec<[usize; 2]> =
            slab.springs.chunks_exact(SPRING).map(|spring| [spring[0] as usize, spring[1] as usize]).collect();
        let mut edges: Vec<[usize; 2]> = pairs.iter().flat_map(|&[i, j]| [[i, j], [j, i]]).collect();
        edges.sort_unstable();
        edges.dedup();
        let mut offsets = vec![0; total + 1];
        edges.iter().for_each(|edge| offsets[edge[0] + 1] += 1);
        (0..total).for_each(|v| offsets[v + 1] += offsets[v]);
        let neighbours: Vec<u64> = edges.iter().map(|edge| edge[1] as u64).collect();
        println!("ranks,particles_most,imbalance,springs_cut,ghosts_mean,ghosts_most,neighbours_most,bytes_most");
        for &parts in &self.parts {
            let part = if parts == 1 {
                vec![0; total]
            } else {
                or_end(petsc::partition(&petsc, "ptscotch", total, &offsets, &neighbours, parts))
            };
            let mut sizes = vec![0usize; parts];
            part.iter().for_each(|&p| sizes[p] += 1);
            let mut ghosts = vec![BTreeSet::new(); parts];
            let mut peers = vec![BTreeSet::new(); parts];
            let mut cut = 0;
            for &[i, j] in &pairs {
                if part[i] != part[j] {
                    cut += 1;
                    for (here, there) in [(i, j), (j, i)] {
                        ghosts[part[here]].insert(there);
                        peers[part[here]].insert(part[there]);
                    }
                }
            }
            let most = |counts: &mut dyn Iterator<Item = usize>| counts.max().unwrap_or(0);
            let largest = most(&mut sizes.iter().copied());
            let ghosts_most = most(&mut ghosts.iter().map(BTreeSet::len));
            let mean = ghosts.iter().map(BTreeSet::len).sum::<usize>() as f64 / parts as f64;
            let imbalance = largest as f64 * parts as f64 / total as f64;
            let peers_most = most(&mut peers.iter().map(BTreeSet::len));
            println!(
                "{parts},{largest},{imbalance:.3},{cut},{mean:.1},{ghosts_most},{peers_most},{}",
                24 * ghosts_most
            );
        }
        Ok(())
    }
}

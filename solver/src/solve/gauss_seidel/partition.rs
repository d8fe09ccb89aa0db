//! Division of a contact problem for parallel sweeps: bodies into ranges, pairs of bodies into colours.
//!
//! A range is swept by one thread; contacts of bodies of two ranges wait until both are swept. Pairs of one colour share no
//! moving body and fit into one vector. Both depend on the problem alone, so that no number of threads changes a result.

use std::ops::Range;

use rayon::prelude::*;

use crate::assemble::ContactProblem;
use crate::math::PAR_MIN_LEN;
use crate::scene::BodyId;
use crate::solve::gauss_seidel::packed::NO_INDEX;
use crate::state::ContactId;

/// Rule by which bodies are divided into ranges.
#[derive(Debug, Clone, Copy)]
pub struct PartitionRule {
    /// Smallest number of bodies in a range: tasks with fewer would wait for each other more than they work.
    pub min_bodies: usize,
    /// Whether the first rank of a range is rounded up, not down, if the ranges cannot be equal.
    pub rounds_up: bool,
}

/// Moving bodies of some rows in spatial order, divided into ranges of almost equal size. The number of ranges is a power of
/// two, so that halves can be halved again.
#[derive(Debug)]
pub struct BodyPartition {
    /// Moving bodies; the index of a body here is its rank.
    pub bodies: Vec<BodyId>,
    /// Ranks of the bodies of each row, [`NO_INDEX`] for a body that does not move.
    pub pairs: Vec<[u32; 2]>,
    /// First rank of each range, and the number of ranks.
    pub cuts: Vec<u32>,
    /// Range of each rank.
    ranges: Vec<u32>,
}

impl BodyPartition {
    /// Divides the moving bodies of the rows `active`.
    pub fn new(problem: &ContactProblem, active: &[ContactId], rule: PartitionRule) -> Self {
        let bodies_of = |&k: &ContactId| problem.rows[k.index()].bodies.map(|body| body.0);
        let mut pairs: Vec<[u32; 2]> = active.par_iter().with_min_len(PAR_MIN_LEN).map(bodies_of).collect();
        let mut touched = vec![false; problem.bodies.len()];
        pairs.as_flattened().iter().for_each(|&body| touched[body as usize] = true);
        let moves = |body: &BodyId| touched[body.index()] && problem.bodies[body.index()].inverse_mass > 0.0;
        let bodies: Vec<BodyId> =
            problem.order.par_iter().copied().map(BodyId).with_min_len(PAR_MIN_LEN).filter(moves).collect();
        let mut ranks = vec![NO_INDEX; problem.bodies.len()];
        for (rank, &body) in bodies.iter().enumerate() {
            ranks[body.index()] = rank as u32;
        }
        pairs.par_iter_mut().with_min_len(PAR_MIN_LEN).for_each(|pair| *pair = pair.map(|body| ranks[body as usize]));

        let count = 1 << (bodies.len() / rule.min_bodies).max(1).ilog2();
        let rounding = if rule.rounds_up { count - 1 } else { 0 };
        let cuts: Vec<u32> = (0..=count).map(|r| ((r * bodies.len() + rounding) / count) as u32).collect();
        let mut ranges = vec![0; bodies.len()];
        for r in 0..count {
            ranges[cuts[r] as usize..cuts[r + 1] as usize].fill(r as u32);
        }
        BodyPartition { bodies, pairs, cuts, ranges }
    }

    /// Number of ranges.
    pub fn range_count(&self) -> usize {
        self.cuts.len() - 1
    }

    /// Ranks of the bodies in a range.
    pub fn ranks(&self, range: usize) -> Range<usize> {
        self.cuts[range] as usize..self.cuts[range + 1] as usize
    }

    /// Range of a body; [`NO_INDEX`] for a body that does not move.
    pub fn range_of(&self, rank: u32) -> u32 {
        if rank == NO_INDEX { NO_INDEX } else { self.ranges[rank as usize] }
    }
}

/// Number of colours; pairs for which none is free are swept one at a time.
pub const MAX_COLOURS: usize = 64;

/// Returns the colour of each pair of ranks, the first that no earlier pair of its moving bodies has, or [`MAX_COLOURS`] if
/// none is free. A body outside `ranks` does not move and takes no colour.
pub fn colour_pairs(pairs: impl Iterator<Item = [u32; 2]>, ranks: Range<usize>) -> Vec<u8> {
    let unmoved = ranks.len();
    let mut masks = vec![0u64; unmoved + 1];
    let colour = |pair: [u32; 2]| {
        let [a, b] = pair.map(|rank| (rank.wrapping_sub(ranks.start as u32) as usize).min(unmoved));
        let free = (masks[a] | masks[b]).trailing_ones() as usize;
        if free < MAX_COLOURS {
            masks[a] |= 1 << free;
            masks[b] |= 1 << free;
            masks[unmoved] = 0;
        }
        free as u8
    };
    pairs.map(colour).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assemble::{ContactConstraint, SolverBody};
    use crate::math::Vec3;

    /// Seven bodies, of which 3 does not move and no row touches 5, in ranges of at least two.
    #[test]
    fn ranges_have_all_moving_bodies_in_order() {
        let body = |k: u32| SolverBody {
            v: Vec3::zeros(),
            inverse_mass: if k == 3 { 0.0 } else { 1.0 },
            w: Vec3::zeros(),
            inverse_inertia: 0.0,
            radius: 1.0,
        };
        let row = |bodies: [u32; 2]| ContactConstraint { bodies: bodies.map(BodyId), ..ContactConstraint::default() };
        let problem = ContactProblem {
            rows: [[0, 3], [1, 6], [2, 4], [4, 5]].map(row).to_vec(),
            block_data: None,
            rolling_constraints: vec![],
            memories: vec![],
            regularised: vec![],
            order: vec![6, 5, 4, 3, 2, 1, 0],
            bodies: (0..7).map(body).collect(),
        };
        let divided = |rounds_up| {
            BodyPartition::new(&problem, &[0, 1, 2].map(ContactId), PartitionRule { min_bodies: 2, rounds_up })
        };
        let (down, up) = (divided(false), divided(true));
        assert_eq!(down.bodies, [6, 4, 2, 1, 0].map(BodyId));
        assert_eq!(down.pairs, [[4, NO_INDEX], [3, 0], [2, 1]]);
        assert_eq!((down.cuts.clone(), up.cuts), (vec![0, 2, 5], vec![0, 3, 5]));
        assert_eq!([0, 2, NO_INDEX].map(|rank| down.range_of(rank)), [0, 1, NO_INDEX]);
    }

    #[test]
    fn pairs_of_a_colour_share_no_moving_body() {
        let pairs = [[4, 5], [5, 6], [4, NO_INDEX], [6, NO_INDEX], [5, NO_INDEX], [4, 6]];
        assert_eq!(colour_pairs(pairs.into_iter(), 4..7), [0, 1, 1, 0, 2, 2]);
        // Bodies that do not move have any number of pairs, others one a colour.
        let many = colour_pairs([[0, NO_INDEX]; 70].into_iter(), 0..1);
        assert_eq!(many[..64], std::array::from_fn::<u8, 64, _>(|k| k as u8));
        assert_eq!(many[64..], [64; 6]);
    }
}

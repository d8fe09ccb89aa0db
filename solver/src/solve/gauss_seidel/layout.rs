//! Choice of the layout in which a contact problem is swept.

use crate::assemble::ContactProblem;
use crate::math::simd::{BodyHalfLine, BodyHalfLineF32, BodyLine, BodyLineF32};
use crate::solve::gauss_seidel::block;
use crate::solve::gauss_seidel::block::batches::{BlockProblem, FrictionalPoint, FrictionlessPoint};
use crate::solve::gauss_seidel::diagonal::batches::{DiagonalProblem, contact_tasks};
use crate::solve::gauss_seidel::packed::{PackSource, PackedProblem};
use crate::solve::gauss_seidel::partition::BodyPartition;
use crate::solve::gauss_seidel::row_division::RowDivision;
use crate::solve::gauss_seidel::shares::DivisionCounts;
use crate::state::ContactId;

/// Smallest number of spheres in a block: tasks with fewer would wait for each other more than they work.
const MIN_SPHERES_IN_BLOCK: usize = 1024;
/// Smallest number of bodies of any shape in a block, which have several contacts with each neighbour.
const MIN_BODIES_IN_BLOCK: usize = 512;

/// Returns a problem packed for sweeps, in single precision if `single`.
pub fn pack_problem(source: &PackSource, single: bool) -> Box<dyn PackedProblem> {
    let is_full = source.problem.block_data.is_some();
    pack_in_blocks(source, single, smallest_block(is_full))
}

/// Returns the packed rows that this rank has of a problem of spheres and plates, in single precision if `single`.
pub fn pack_divided_rows(source: &PackSource, division: &RowDivision, single: bool) -> Box<dyn PackedProblem> {
    let (min_bodies, division) = (smallest_block(false), Some(division));
    match (division.is_some_and(|division| division.has_friction), single) {
        (true, false) => Box::new(DiagonalProblem::<BodyLine>::new(source, min_bodies, division)),
        (true, true) => Box::new(DiagonalProblem::<BodyLineF32>::new(source, min_bodies, division)),
        (false, false) => Box::new(DiagonalProblem::<BodyHalfLine>::new(source, min_bodies, division)),
        (false, true) => Box::new(DiagonalProblem::<BodyHalfLineF32>::new(source, min_bodies, division)),
    }
}

/// Smallest number of bodies in a block, of any shape if `is_full`. A test of the division among ranks may set another one:
/// small scenes would be one block, which is not divided.
pub fn smallest_block(is_full: bool) -> usize {
    #[cfg(feature = "mpi")]
    {
        use std::sync::LazyLock;
        static SET_BY_TEST: LazyLock<Option<usize>> =
            LazyLock::new(|| std::env::var("CD_TESTS_BLOCK").ok()?.parse().ok().filter(|&bodies| bodies > 0));
        if let Some(bodies) = *SET_BY_TEST {
            return bodies;
        }
    }
    if is_full { MIN_BODIES_IN_BLOCK } else { MIN_SPHERES_IN_BLOCK }
}

/// Counts of the division of the sweeps of a problem among `ranks`; `active`: rows to sweep, sorted.
pub fn division_counts(problem: &ContactProblem, active: &[ContactId], ranks: usize) -> DivisionCounts {
    let min_bodies = smallest_block(problem.block_data.is_some());
    let partition = BodyPartition::new(problem, active, min_bodies);
    if problem.block_data.is_some() {
        return block::batches::division_counts(problem, active, &partition, ranks);
    }
    let (_, tasks) = contact_tasks(&partition);
    DivisionCounts::new(&partition, &tasks, |_| 1, ranks)
}

/// Returns a problem packed in blocks of `min_bodies` bodies or more, in single precision if `single`.
///
/// Spheres and plates have diagonal blocks, bodies of any shape full ones. Without friction a contact has one unknown, and
/// spheres do not turn.
pub fn pack_in_blocks(source: &PackSource, single: bool, min_bodies: usize) -> Box<dyn PackedProblem> {
    let has_friction = source.problem.has_friction(source.active);
    match (&source.problem.block_data, has_friction, single) {
        (None, true, false) => Box::new(DiagonalProblem::<BodyLine>::new(source, min_bodies, None)),
        (None, true, true) => Box::new(DiagonalProblem::<BodyLineF32>::new(source, min_bodies, None)),
        (None, false, false) => Box::new(DiagonalProblem::<BodyHalfLine>::new(source, min_bodies, None)),
        (None, false, true) => Box::new(DiagonalProblem::<BodyHalfLineF32>::new(source, min_bodies, None)),
        (Some(data), true, false) => Box::new(BlockProblem::<FrictionalPoint<f64>>::new(source, data, min_bodies)),
        (Some(data), true, true) => Box::new(BlockProblem::<FrictionalPoint<f32>>::new(source, data, min_bodies)),
        (Some(data), false, false) => Box::new(BlockProblem::<FrictionlessPoint<f64>>::new(source, data, min_bodies)),
        (Some(data), false, true) => Box::new(BlockProblem::<FrictionlessPoint<f32>>::new(source, data, min_bodies)),
    }
}

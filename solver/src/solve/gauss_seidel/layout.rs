//! Choice of the layout in which a contact problem is swept.

use crate::math::simd::{BodyHalfLine, BodyHalfLineF32, BodyLine, BodyLineF32};
use crate::solve::gauss_seidel::block::batches::{BlockProblem, FrictionalPoint, FrictionlessPoint};
use crate::solve::gauss_seidel::diagonal::batches::DiagonalProblem;
use crate::solve::gauss_seidel::packed::{PackSource, PackedProblem};

/// Packs a problem for sweeps, in single precision if `single`.
///
/// Spheres and plates have diagonal blocks, bodies of any shape full ones. Without friction a contact has one unknown, and
/// spheres do not turn.
pub fn pack_problem(source: &PackSource, single: bool) -> Box<dyn PackedProblem> {
    let has_friction = source.problem.has_friction(source.active);
    match (&source.problem.block_data, has_friction, single) {
        (None, true, false) => Box::new(DiagonalProblem::<BodyLine>::new(source)),
        (None, true, true) => Box::new(DiagonalProblem::<BodyLineF32>::new(source)),
        (None, false, false) => Box::new(DiagonalProblem::<BodyHalfLine>::new(source)),
        (None, false, true) => Box::new(DiagonalProblem::<BodyHalfLineF32>::new(source)),
        (Some(data), true, false) => Box::new(BlockProblem::<FrictionalPoint<f64>>::new(source, data)),
        (Some(data), true, true) => Box::new(BlockProblem::<FrictionalPoint<f32>>::new(source, data)),
        (Some(data), false, false) => Box::new(BlockProblem::<FrictionlessPoint<f64>>::new(source, data)),
        (Some(data), false, true) => Box::new(BlockProblem::<FrictionlessPoint<f32>>::new(source, data)),
    }
}

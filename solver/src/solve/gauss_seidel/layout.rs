//! The problem in the layout that the sweeps of its contacts need.

use crate::assemble::{ContactProblem, SolverBody};
use crate::math::lanes::{BodyHalfLine, BodyHalfLineF32, BodyLine, BodyLineF32, SimdWidth};
use crate::solve::gauss_seidel::block;
use crate::solve::gauss_seidel::block::batches::{FrictionalPoint, FrictionlessPoint};
use crate::solve::gauss_seidel::diagonal::batches::DiagonalProblem;
use crate::solve::gauss_seidel::diagonal::sweep::{sweep_contacts, sweep_single};
use crate::solve::types::ContactReactions;

/// The rows `active` of a step, and the data that the sweeps change.
pub enum PackedProblem {
    /// Spheres and plates without friction: one unknown a contact.
    Frictionless(DiagonalProblem<BodyHalfLine>),
    FrictionlessSingle(DiagonalProblem<BodyHalfLineF32>),
    /// Spheres and plates: the blocks are diagonal.
    Diagonal(DiagonalProblem<BodyLine>),
    DiagonalSingle(DiagonalProblem<BodyLineF32>),
    /// Bodies of any shape, with full blocks; with and without friction.
    Full(block::batches::BlockProblem<FrictionalPoint<f64>>),
    FullSingle(block::batches::BlockProblem<FrictionalPoint<f32>>),
    FullFrictionless(block::batches::BlockProblem<FrictionlessPoint<f64>>),
    FullFrictionlessSingle(block::batches::BlockProblem<FrictionlessPoint<f32>>),
}

/// Statistics of a sweep.
#[derive(Debug, Clone, Copy)]
pub struct SweepStats {
    /// Whether the last change points against the momentum: sum of w_n (y - r).(r - r_before) > 0.
    pub needs_restart: bool,
    /// Norm of all r - y, N s.
    pub change: f64,
}

impl PackedProblem {
    /// Starts from `reactions` and from the velocities that result from them.
    pub fn new(
        system: &ContactProblem,
        active: &[u32],
        reactions: &ContactReactions,
        records: &[SolverBody],
        single: bool,
        width: SimdWidth,
    ) -> Self {
        match (&system.block_data, system.has_friction(active), single) {
            (None, true, false) => PackedProblem::Diagonal(DiagonalProblem::new(system, active, reactions, records)),
            (None, true, true) => {
                PackedProblem::DiagonalSingle(DiagonalProblem::new(system, active, reactions, records))
            }
            (None, false, false) => {
                PackedProblem::Frictionless(DiagonalProblem::new(system, active, reactions, records))
            }
            (None, false, true) => {
                PackedProblem::FrictionlessSingle(DiagonalProblem::new(system, active, reactions, records))
            }
            (Some(full), true, false) => {
                PackedProblem::Full(block::batches::BlockProblem::new(system, full, active, reactions, records, width))
            }
            (Some(full), true, true) => PackedProblem::FullSingle(block::batches::BlockProblem::new(
                system, full, active, reactions, records, width,
            )),
            (Some(full), false, false) => PackedProblem::FullFrictionless(block::batches::BlockProblem::new(
                system, full, active, reactions, records, width,
            )),
            (Some(full), false, true) => PackedProblem::FullFrictionlessSingle(block::batches::BlockProblem::new(
                system, full, active, reactions, records, width,
            )),
        }
    }

    /// Sweeps all contacts once, each from y = r + beta (r - r_before).
    pub fn sweep_contacts(&mut self, width: SimdWidth, beta: f64) -> SweepStats {
        let (uphill, change) = match self {
            PackedProblem::Frictionless(problem) => sweep_contacts(problem, width, beta).reduce(),
            PackedProblem::FrictionlessSingle(problem) => sweep_single(problem, width, beta).reduce(),
            PackedProblem::Diagonal(problem) => sweep_contacts(problem, width, beta).reduce(),
            PackedProblem::DiagonalSingle(problem) => sweep_single(problem, width, beta).reduce(),
            PackedProblem::Full(problem) => block::sweep::sweep_contacts(problem, width, beta).reduce(),
            PackedProblem::FullSingle(problem) => block::sweep::sweep_single(problem, width, beta).reduce(),
            PackedProblem::FullFrictionless(problem) => block::sweep::sweep_contacts(problem, width, beta).reduce(),
            PackedProblem::FullFrictionlessSingle(problem) => block::sweep::sweep_single(problem, width, beta).reduce(),
        };
        let unit = match self {
            PackedProblem::FrictionlessSingle(problem) => problem.units.impulse,
            PackedProblem::DiagonalSingle(problem) => problem.units.impulse,
            PackedProblem::FullSingle(problem) => problem.units.impulse,
            PackedProblem::FullFrictionlessSingle(problem) => problem.units.impulse,
            _ => 1.0,
        };
        SweepStats { needs_restart: uphill, change: change * unit }
    }

    /// Copies the impulses and moments of the swept rows, which belong to this system, into `reactions`.
    pub fn read_back(&self, width: SimdWidth, system: &ContactProblem, reactions: &mut ContactReactions) {
        match self {
            PackedProblem::Frictionless(problem) => problem.read_back(width, reactions),
            PackedProblem::FrictionlessSingle(problem) => problem.read_back(width, reactions),
            PackedProblem::Diagonal(problem) => problem.read_back(width, reactions),
            PackedProblem::DiagonalSingle(problem) => problem.read_back(width, reactions),
            PackedProblem::Full(problem) => problem.read_back(width, system, reactions),
            PackedProblem::FullSingle(problem) => problem.read_back(width, system, reactions),
            PackedProblem::FullFrictionless(problem) => problem.read_back(width, system, reactions),
            PackedProblem::FullFrictionlessSingle(problem) => problem.read_back(width, system, reactions),
        }
    }
}

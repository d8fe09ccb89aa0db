//! The problem laid out for the sweeps that its contacts need.

use crate::assemble::{Record, System};
use crate::math::lanes::{Half, Line, ShortHalf, ShortLine, Width};
use crate::solve::batches::Problem;
use crate::solve::full;
use crate::solve::full::batches::{Normal, Point};
use crate::solve::nlgs::Reactions;
use crate::solve::sweep::{sweep, sweep_single};

/// The rows `active` of a step, and what the sweeps change.
pub enum Laid {
    /// Spheres and plates without friction: one unknown a contact.
    Frictionless(Problem<Half>),
    FrictionlessSingle(Problem<ShortHalf>),
    /// Spheres and plates: the blocks are diagonal.
    Diagonal(Problem<Line>),
    DiagonalSingle(Problem<ShortLine>),
    /// Bodies of any shape, and those without friction.
    Full(full::batches::Problem<Point<f64>>),
    FullSingle(full::batches::Problem<Point<f32>>),
    FullFrictionless(full::batches::Problem<Normal<f64>>),
    FullFrictionlessSingle(full::batches::Problem<Normal<f32>>),
}

/// What a sweep did.
#[derive(Debug, Clone, Copy)]
pub struct Swept {
    /// Whether the last change points against the momentum: sum of w_n (y - r).(r - r_before) > 0.
    pub uphill: bool,
    /// Norm of all r - y, N s.
    pub change: f64,
}

impl Laid {
    /// Starts from `reactions` and from the velocities that they lead to.
    pub fn new(
        system: &System,
        active: &[u32],
        reactions: &Reactions,
        records: &[Record],
        single: bool,
        width: Width,
    ) -> Self {
        match (&system.full, system.resists(active), single) {
            (None, true, false) => Laid::Diagonal(Problem::new(system, active, reactions, records)),
            (None, true, true) => Laid::DiagonalSingle(Problem::new(system, active, reactions, records)),
            (None, false, false) => Laid::Frictionless(Problem::new(system, active, reactions, records)),
            (None, false, true) => Laid::FrictionlessSingle(Problem::new(system, active, reactions, records)),
            (Some(full), true, false) => {
                Laid::Full(full::batches::Problem::new(system, full, active, reactions, records, width))
            }
            (Some(full), true, true) => {
                Laid::FullSingle(full::batches::Problem::new(system, full, active, reactions, records, width))
            }
            (Some(full), false, false) => {
                Laid::FullFrictionless(full::batches::Problem::new(system, full, active, reactions, records, width))
            }
            (Some(full), false, true) => Laid::FullFrictionlessSingle(full::batches::Problem::new(
                system, full, active, reactions, records, width,
            )),
        }
    }

    /// Sweeps all contacts once, each from y = r + beta (r - r_before).
    pub fn sweep(&mut self, width: Width, beta: f64) -> Swept {
        let (uphill, change) = match self {
            Laid::Frictionless(problem) => sweep(problem, width, beta).seen(),
            Laid::FrictionlessSingle(problem) => sweep_single(problem, width, beta).seen(),
            Laid::Diagonal(problem) => sweep(problem, width, beta).seen(),
            Laid::DiagonalSingle(problem) => sweep_single(problem, width, beta).seen(),
            Laid::Full(problem) => full::sweep::sweep(problem, width, beta).seen(),
            Laid::FullSingle(problem) => full::sweep::sweep_single(problem, width, beta).seen(),
            Laid::FullFrictionless(problem) => full::sweep::sweep(problem, width, beta).seen(),
            Laid::FullFrictionlessSingle(problem) => full::sweep::sweep_single(problem, width, beta).seen(),
        };
        let unit = match self {
            Laid::FrictionlessSingle(problem) => problem.units.impulse,
            Laid::DiagonalSingle(problem) => problem.units.impulse,
            Laid::FullSingle(problem) => problem.units.impulse,
            Laid::FullFrictionlessSingle(problem) => problem.units.impulse,
            _ => 1.0,
        };
        Swept { uphill, change: change * unit }
    }

    /// Puts the impulses and moments of the rows swept, which are of this system, into `reactions`.
    pub fn read_back(&self, width: Width, system: &System, reactions: &mut Reactions) {
        match self {
            Laid::Frictionless(problem) => problem.read_back(width, reactions),
            Laid::FrictionlessSingle(problem) => problem.read_back(width, reactions),
            Laid::Diagonal(problem) => problem.read_back(width, reactions),
            Laid::DiagonalSingle(problem) => problem.read_back(width, reactions),
            Laid::Full(problem) => problem.read_back(width, system, reactions),
            Laid::FullSingle(problem) => problem.read_back(width, system, reactions),
            Laid::FullFrictionless(problem) => problem.read_back(width, system, reactions),
            Laid::FullFrictionlessSingle(problem) => problem.read_back(width, system, reactions),
        }
    }
}

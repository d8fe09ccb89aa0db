//! The problem laid out for the sweeps that its contacts need.

use crate::assemble::{Record, System};
use crate::math::lanes::{Half, Line, Width};
use crate::solve::batches::{Problem, Sums};
use crate::solve::full;
use crate::solve::nlgs::Reactions;
use crate::solve::sweep::sweep;

/// The rows `active` of a step, and what the sweeps change.
pub enum Laid {
    /// Spheres and plates without friction: one unknown a contact.
    Frictionless(Problem<Half>),
    /// Spheres and plates: the blocks are diagonal.
    Diagonal(Problem<Line>),
    /// Bodies of any shape, and those without friction.
    Full(full::batches::Problem<full::batches::Point>),
    FullFrictionless(full::batches::Problem<full::batches::Normal>),
}

impl Laid {
    /// Starts from `reactions` and from the velocities that they lead to.
    pub fn new(system: &System, active: &[u32], reactions: &Reactions, records: &[Record]) -> Self {
        match (&system.full, system.resists(active)) {
            (None, true) => Laid::Diagonal(Problem::new(system, active, reactions, records)),
            (None, false) => Laid::Frictionless(Problem::new(system, active, reactions, records)),
            (Some(full), true) => Laid::Full(full::batches::Problem::new(system, full, active, reactions, records)),
            (Some(full), false) => {
                Laid::FullFrictionless(full::batches::Problem::new(system, full, active, reactions, records))
            }
        }
    }

    /// Sweeps all contacts once, each from y = r + beta (r - r_before).
    pub fn sweep(&mut self, width: Width, beta: f64) -> Sums {
        match self {
            Laid::Frictionless(problem) => sweep(problem, width, beta),
            Laid::Diagonal(problem) => sweep(problem, width, beta),
            Laid::Full(problem) => full::sweep::sweep(problem, width, beta),
            Laid::FullFrictionless(problem) => full::sweep::sweep(problem, width, beta),
        }
    }

    /// Puts the impulses and moments of the rows swept into `reactions`.
    pub fn read_back(&self, reactions: &mut Reactions) {
        match self {
            Laid::Frictionless(problem) => problem.read_back(reactions),
            Laid::Diagonal(problem) => problem.read_back(reactions),
            Laid::Full(problem) => problem.read_back(reactions),
            Laid::FullFrictionless(problem) => problem.read_back(reactions),
        }
    }
}

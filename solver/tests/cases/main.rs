//! Whole cases through cd-solve, from DATBOX to OUTBOX: closed forms, invariants, refusals, the same
//! bytes again. Nothing here knows how the solver works inside.

mod absence;
mod adaptive;
mod bonds;
mod breaking;
mod case;
mod clusters;
mod driven_in_part;
mod elliptic;
mod envelope;
mod extremes;
mod faces;
mod first_gaps;
mod flight;
mod gravity;
mod invariants;
mod joints;
mod laws;
mod laws_of_lmgc90;
mod limits;
mod listing;
mod long_runs;
mod messages;
mod peer;
mod periodic;
mod polyhedra;
mod refusals;
mod rolling;
mod rotation;
mod same_bits;
mod solvers;
mod statics;
mod symmetry;
mod tunnelling;
mod walls;

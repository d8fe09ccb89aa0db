//! Whole cases through cd-solve, from DATBOX to OUTBOX: closed forms, invariants, refusals, the same
//! bytes again. Nothing here knows how the solver works inside.

mod bonds;
mod case;
mod extremes;
mod flight;
mod gravity;
mod invariants;
mod laws;
mod peer;
mod refusals;
mod rolling;
mod same_bits;
mod statics;
mod walls;

//! Room: the contact problem to impulses.
//!
//! | module | what it knows |
//! |---|---|
//! | [`local`] | one contact, exactly |
//! | [`batches`] | bodies and contacts laid out for sweeping |
//! | [`sweep`] | one sweep, in vectors of contacts and side by side |
//! | `nlgs` | when to sweep, with what momentum, and when to stop |
//! | [`full`] | the same for bodies whose contacts have full blocks |
//! | [`residual`] | judges, never solves |
//! | [`stored`] | the same problem given as a matrix |

pub mod batches;
pub mod full;
pub mod local;
mod nlgs;
pub mod residual;
pub mod stored;
pub mod sweep;

pub use nlgs::{Solution, nlgs};

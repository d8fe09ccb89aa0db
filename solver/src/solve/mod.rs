//! Room: the contact problem to impulses.
//!
//! | module | what it knows |
//! |---|---|
//! | [`local`] | one contact, exactly |
//! | [`batches`] | bodies and contacts laid out for sweeping |
//! | [`sweep`] | one sweep, in vectors of contacts and side by side |
//! | [`laid`] | which layout a problem needs |
//! | `nlgs` | when to sweep, with what momentum, and when to stop |
//! | [`full`] | the same for bodies whose contacts have full blocks |
//! | `choice` | who solves, and who comes after |
//! | [`norms`] | LMGC90's stopping criteria, for comparison |
//! | [`residual`] | judges, never solves |
//! | `rolling` | contacts with rolling and spinning friction |
//! | [`stored`] | the same problem given as a matrix |

pub mod batches;
mod choice;
pub mod full;
pub mod laid;
pub mod local;
mod nlgs;
pub mod norms;
pub mod residual;
mod rolling;
pub mod stored;
pub mod sweep;

pub use choice::{SolveRequest, solve_contact_problem, update_backoff};
pub use nlgs::{ContactReactions, ContactSolution, StoppingCriteria, solve_nlgs};

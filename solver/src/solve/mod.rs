//! Stage: solution of the contact problem for the impulses.
//!
//! | module | contents |
//! |---|---|
//! | [`local`] | exact solution of one contact of spheres |
//! | [`batches`] | bodies and contacts packed for sweeps |
//! | [`sweep`] | one sweep, in vectors of contacts and in ranges side by side |
//! | [`block`] | the same for bodies whose contacts have full 3x3 blocks |
//! | [`packed_problem`] | choice of the layout that a problem needs |
//! | `nlgs` | nonlinear Gauss-Seidel: iteration, momentum, stopping criteria |
//! | `strategy` | choice of the solver, and of the fallback for stagnating sweeps |
//! | [`lmgc90_criteria`] | LMGC90's stopping criteria, for comparison |
//! | [`residual`] | residual of a solution |
//! | `rolling` | contacts with rolling and spinning friction |
//! | [`matrix`] | solvers of a problem given by its matrix W |

pub mod batches;
pub mod block;
pub mod lmgc90_criteria;
pub mod local;
pub mod matrix;
mod nlgs;
pub mod packed_problem;
pub mod residual;
mod rolling;
mod strategy;
pub mod sweep;

pub use nlgs::{ContactReactions, ContactSolution, StoppingCriteria, solve_nlgs};
pub use strategy::{SolveRequest, solve_contact_problem, update_backoff};

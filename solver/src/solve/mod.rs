//! Stage: solution of the contact problem for the impulses.
//!
//! | module | contents |
//! |---|---|
//! | `types` | impulses, solution and stopping criteria |
//! | `strategy` | choice of the solver, and of the fallback for stagnating sweeps |
//! | `cost_model` | costs and thresholds of that choice |
//! | [`gauss_seidel`] | sweeps over the contacts: the solver of all scenes |
//! | [`matrix`] | solvers of a problem given by its matrix W |
//! | `bond_gradients` | bonds that carry moments, all at once |
//! | `regularised` | sweeps of scenes whose laws have springs or hold bodies together |
//! | [`residual`] | residual of a solution |
//! | [`lmgc90_criteria`] | LMGC90's stopping criteria, for comparison |

mod bond_gradients;
mod cost_model;
pub mod gauss_seidel;
pub mod lmgc90_criteria;
pub mod matrix;
mod regularised;
pub mod residual;
mod strategy;
mod types;

pub use gauss_seidel::driver::solve_nlgs;
pub use gauss_seidel::momentum::MOMENTUM_CYCLE;
pub use residual::keep_solution_memory;
pub use strategy::{SolveRequest, solve_by_sweeps, solve_contact_problem, solve_in_parts, update_backoff};
pub use types::{ContactReactions, ContactSolution, StoppingCriteria};

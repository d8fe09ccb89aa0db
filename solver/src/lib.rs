//! cd-solve: from `DATBOX/` to `OUTBOX/` by Non-Smooth Contact Dynamics.
//!
//! The contact problem of a body that comes down at 2 m/s and slides at 3 m/s, with W = 1/kg and a friction of 0.5:
//!
//! ```
//! use cd_solve::solve::matrix::{MatrixProblem, MatrixProblemError, MatrixSolver, SolverLimits, solve};
//!
//! let w = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
//! let problem = MatrixProblem::new(vec![0.5], vec![[-2.0, 0.0, 3.0]], [(0, 0, w)])?;
//! let limits = SolverLimits { tol: 1e-12, max_sweeps: 1000, max_time: None, max_cost: f64::INFINITY };
//! let solution = solve(&problem, MatrixSolver::Nlgs, &[], limits);
//! // 2 N s stop the body; friction, at most 0.5 times 2 N s, slows it down to 2 m/s.
//! assert!(solution.converged);
//! assert!(solution.r[0].iter().zip([2.0, 0.0, -1.0]).all(|(r, expected)| (r - expected).abs() < 1e-9));
//! # Ok::<(), MatrixProblemError>(())
//! ```
//!
//! This API is internal and may change with any version. The stable interface of the toolchain is its programs and their
//! files, described in the [manual](https://github.com/cd-toolchain/cd-toolchain/blob/main/docs/README.md).
//!
//! A time step is the function [`step::step`]; it lists the stages that the data pass through:
//!
//! ```text
//! integrate::predict_configuration → assemble (forces) → detect → assemble (contacts) → solve
//! → integrate::advance_state
//! ```
//!
//! Stages define the order, kernels the mathematics: `detect`, `assemble`, `solve`, `integrate`, `read` and `write` are
//! stages; `laws`, `gravity`, `geometry` and `math` are kernels; `scene` contains the data that are constant during a run
//! and `state` the data that change.

mod accuracy_control;
mod activity;
mod agreement;
pub mod assemble;
mod cli;
mod contact_division;
pub mod detect;
pub mod features;
pub mod geometry;
pub mod gravity;
pub mod integrate;
pub mod laws;
pub mod math;
mod plan;
mod probe;
mod progress;
pub mod ranks;
pub mod read;
mod run;
pub mod scene;
mod sinks_and_sources;
pub mod solve;
pub mod state;
pub mod step;
mod thread_pool;
mod verify;
pub mod write;

pub use cli::{command, run};
pub use plan::limits;

//! cd-solve: from `DATBOX/` to `OUTBOX/` by Non-Smooth Contact Dynamics.
//!
//! A time step is the function [`step::step`]; it lists the stages that the data pass through:
//!
//! ```text
//! integrate::predict → assemble (forces) → detect → assemble (contacts) → solve → integrate::advance
//! ```
//!
//! Stages define the order, kernels the mathematics: `detect`, `assemble`, `solve`, `integrate`, `read` and `write` are
//! stages; `laws`, `gravity`, `geometry` and `math` are kernels; `scene` contains the data that are constant during a run
//! and `state` the data that change.

mod activity;
pub mod assemble;
mod cli;
pub mod detect;
pub mod features;
pub mod geometry;
pub mod gravity;
pub mod integrate;
pub mod laws;
pub mod math;
mod plan;
mod progress;
pub mod read;
mod run;
pub mod scene;
pub mod solve;
pub mod state;
pub mod step;
mod thread_pool;
pub mod write;

pub use cli::{command, run};

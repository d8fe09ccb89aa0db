//! Room: the contact problem to impulses.

pub mod local;
mod nlgs;
pub mod residual;

pub use nlgs::{Solution, nlgs};

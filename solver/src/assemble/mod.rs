//! Room: forces to free velocities; contacts to the rows of the contact problem.

mod faces;
mod forces;
mod history;
mod rows;
mod stored;
mod turning;

pub use forces::{FreeMotion, GravityReport, AppliedEvents, apply_events, free_velocity, apply_torque_and_damping, potential_energy};
pub use history::connected_bodies;
pub use rows::{BlockData, SolverBody, RollingConstraint, ContactConstraint, ContactProblem, contact_arms, contact_problem, relative_velocity};
pub use stored::{StoredProblem, stored_problem};

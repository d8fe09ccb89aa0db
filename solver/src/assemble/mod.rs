//! Stage: forces to free velocities; contacts to the rows of the contact problem.

mod faces;
mod forces;
mod history;
mod rows;
mod stored;
mod turning;

pub use forces::{
    AppliedEvents, FreeMotion, GravityReport, apply_events, apply_torque_and_damping, free_velocity, potential_energy,
};
pub use history::connected_bodies;
pub use rows::{
    BlockData, ContactConstraint, ContactProblem, RollingConstraint, SolverBody, contact_problem, relative_velocity,
    velocity_at_arms,
};
pub use stored::{StoredProblem, stored_problem};

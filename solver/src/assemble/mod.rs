//! Stage: forces to free velocities; contacts to the rows of the contact problem.

mod bonded_faces;
mod closed_by_others;
mod context;
mod curvature;
mod events;
mod faces;
mod forces;
mod history;
mod impact_sequence;
mod interface_row;
mod kinematics;
mod messages;
mod pair_cohesion;
mod problem;
mod rigid_motion;
mod rows;
mod self_gravity;
mod stored;

pub use closed_by_others::contacts_closed_by_others;
pub use events::{AppliedEvents, apply_events, apply_torque_and_damping};
pub use forces::{FreeMotion, free_velocity, potential_energy, self_gravity_energy};
pub use history::connected_bodies;
pub use impact_sequence::take_unended_impacts;
pub use interface_row::InterfaceRow;
pub use kinematics::{contact_arms, relative_velocity, surface_velocity, velocity_at_arms};
pub use messages::ConstraintMessage;
pub use problem::{BlockData, ContactConstraint, ContactProblem, RegularisedRow, RollingConstraint, SolverBody};
pub use rows::{contact_problem, keep_problem_memory};
pub use self_gravity::GravityReport;
pub use stored::{StoredProblem, stored_problem};

//! Room: forces to free velocities; contacts to the rows of the contact problem.

mod faces;
mod forces;
mod history;
mod rows;
mod stored;
mod turning;

pub use forces::{Free, GravityReport, Happened, events, free_velocity, interventions, potential_energy};
pub use history::meeting;
pub use rows::{Full, Record, Roll, Row, System, arms, contact_problem, relative_velocity};
pub use stored::{StoredProblem, stored_problem};

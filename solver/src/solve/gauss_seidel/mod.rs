//! Nonlinear Gauss-Seidel: sweeps over the contacts, each solved exactly against the current velocities of its bodies.
//!
//! | module | contents |
//! |---|---|
//! | `driver` | iteration, stopping criteria, precision |
//! | `associated` | sweeps with the associated law of friction, where contacts rest |
//! | `momentum` | momentum of the sweeps and its restarts |
//! | [`layout`] | choice of the layout that a problem needs |
//! | [`partition`] | division of bodies into blocks and of constraints into tasks and colours |
//! | [`shares`] | division of a sweep among the ranks of a run |
//! | [`blocked`] | blocks with their constraints, and the order of a sweep |
//! | [`packed`] | interface, columns, units and sums of all layouts |
//! | `vector` | vectors of three components in lanes |
//! | [`diagonal`] | spheres and plates: the own block of a contact is diagonal |
//! | [`block`] | bodies of any shape: the own block of a contact is full |
//! | `rolling` | contacts with rolling and spinning friction |
//! | [`row_division`] | division of the rows among ranks that each have a part of them |

pub(super) mod associated;
pub mod block;
pub mod blocked;
pub mod diagonal;
pub(super) mod driver;
pub mod layout;
pub(super) mod momentum;
pub mod packed;
pub mod partition;
mod rolling;
pub mod row_division;
pub mod shares;
mod vector;

//! Results of the stages of a step that its last stages read.

use crate::assemble::{ContactProblem, FreeMotion};
use crate::integrate::ContactConfiguration;
use crate::laws::ContactLaw;
use crate::scene::Scene;
use crate::solve::{ContactSolution, SolveRequest};
use crate::state::Contact;

/// Results of integration, forces and detection, which change while the contact problem is solved until it is
/// admissible.
pub struct PredictedStep {
    pub q_c: ContactConfiguration,
    pub free: FreeMotion,
    /// Contacts ordered by key.
    pub contacts: Vec<Contact>,
}

/// Scene and final results of integration, forces and detection.
#[derive(Clone, Copy)]
pub struct StepContext<'a> {
    pub scene: &'a Scene,
    pub q_c: &'a ContactConfiguration,
    pub free: &'a FreeMotion,
    /// Contacts in the order of the rows of the contact problem.
    pub contacts: &'a [Contact],
}

/// Contact problem of the step and its solution.
pub struct SolvedProblem {
    pub request: SolveRequest,
    pub contact_problem: ContactProblem,
    pub solution: ContactSolution,
    /// Laws of the state, if the step is solved without their restitution; they return at its end.
    pub original_laws: Option<Vec<ContactLaw>>,
}

//! Decision whether the ranks of a run divide its contacts, made before the first step.
//!
//! Each rank then detects, assembles and keeps the contacts of its own candidates, see
//! [`CandidateDivision`](crate::state::CandidateDivision). Features that need the list of all contacts on each rank leave it
//! undivided.

use cd_formats::compute::ContactSolver;

use crate::laws::ContactLaw;
use crate::math::Vec3;
use crate::scene::Scene;
use crate::solve::gauss_seidel::layout::smallest_block;
use crate::state::State;

/// Reason why each rank of a run from this state has all contacts; `None` if ranks divide them.
pub fn undivided_reason(scene: &Scene, state: &State) -> Option<&'static str> {
    let options = &scene.options;
    let is_plain = |law: &ContactLaw| {
        law.cohesion().is_none()
            && law.pair_cohesion().is_none()
            && law.rescue().is_none()
            && !law.has_moments()
            && !law.can_bond()
            && !law.has_law_memory()
            && !law.is_regularised()
            && !law.has_irreversible_loss()
    };
    let reasons = [
        (
            scene.has_parts() || scene.needs_blocks() || !scene.links.is_empty(),
            "bodies other than free spheres and bodies whose motion is all imposed",
        ),
        (!state.laws.iter().all(is_plain), "laws with cohesion, bonds, moments, springs or a memory"),
        (scene.roster.is_some(), "bodies that enter or leave"),
        (state.cell.is_some(), "a deforming cell"),
        (scene.drives.iter().any(|drive| drive.surface.is_some()), "a wall whose surface moves"),
        (!scene.postpro.is_empty(), "commands of POSTPRO.DAT"),
        (!options.probes.is_empty(), "probes"),
        (options.lmgc90_norms, "the criteria of LMGC90"),
        (!matches!(options.solver, ContactSolver::Auto | ContactSolver::Nlgs), "the solver"),
        (scene.frame_angular_velocity() != Vec3::zeros(), "turning axes"),
        (state.step == scene.start.step && !state.contacts.is_empty(), "contacts of Vloc_Rloc.INI"),
        (scene.free.len() < 2 * smallest_block(false), "one block of bodies"),
    ];
    reasons.into_iter().find_map(|(applies, reason)| applies.then_some(reason))
}

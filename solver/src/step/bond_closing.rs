//! Correction of positions where the errors of many steps have opened bonds.
//!
//! A bond satisfies û_n = 0 only to the error of the solution: each step opens or closes its gap by the error of a velocity
//! times h, and these errors accumulate. The impulses of the next step do not close the gap again, since several bonds may
//! join the same bodies and one that closes would load the others. Therefore positions are corrected separately: once a bond
//! has opened by more than [`LARGEST_OPENING`], the bodies that bonds join to it are moved so that the gaps g_k of their
//! bonds return to the gaps b_k at which they were made. One sweep solves for each bond
//!
//! ```text
//! w_n λ = -(g_k - b_k + n·(Δx_a + Δφ_a × l_a - Δx_b - Δφ_b × l_b)),   Δx = ± λ n / m,   Δφ = ± J⁻¹ (l × λ n)
//! ```
//!
//! The centre of mass of the two bodies does not move, velocities and impulses do not change, and walls do not move. Bonds
//! that contradict each other share the remaining opening.

use rayon::prelude::*;

use crate::assemble::{self, ContactProblem};
use crate::laws::{ContactLaw, MAX_TOUCHING_GAP};
use crate::math::rotation::angular_velocity;
use crate::math::{PAR_MIN_LEN, Vec3, rotate_by_vector};
use crate::scene::{BodyId, Scene};
use crate::state::{Contact, SolvedContact, State};

/// Ratio of the opening of a bond to its effective radius, above which positions are corrected. A bond is made at a gap
/// of up to [`MAX_TOUCHING_GAP`] and acts up to twice that gap. One step opens a corner by up to three times the error
/// that [`super::velocity_errors`] accepts, which is `LARGEST_OPENING` per step.
pub const LARGEST_OPENING: f64 = 0.25 * MAX_TOUCHING_GAP;

/// Sweeps of a correction: the four corners of a cube are then closed to a hundredth of their opening. The remaining opening
/// of a long chain is corrected in the following steps.
const SWEEPS: usize = 10;

/// Moves the bodies of bonds that have opened too far. `state` is the state at the step's end, with the contacts of
/// `contact_problem`.
pub fn close_bonds(scene: &Scene, state: &mut State, contact_problem: &ContactProblem) {
    // Openings of elastic bonds are part of their law.
    let has_rigid_bonds = |law: &ContactLaw| law.has_stress() && law.bond_stiffness().is_none();
    if !state.laws.iter().any(has_rigid_bonds) {
        return;
    }
    let bond_opening = |solved: &SolvedContact| {
        let bond = solved.bond.filter(|_| has_rigid_bonds(&state.laws[solved.contact.law]));
        bond.map(|bond_gap| solved.contact.gap - bond_gap)
    };
    let is_too_far = |solved: &SolvedContact| {
        let contact = &solved.contact;
        let [a, b] = [
            (contact.candidate, contact.part_numbers.candidate),
            (contact.antagonist, contact.part_numbers.antagonist),
        ];
        bond_opening(solved).is_some_and(|bond_opening| bond_opening > LARGEST_OPENING * scene.effective_radius(a, b))
    };
    if !state.contacts.par_iter().with_min_len(PAR_MIN_LEN).any(is_too_far) {
        return;
    }
    let bonded: Vec<(usize, f64)> =
        state.contacts.iter().enumerate().filter_map(|(k, solved)| Some((k, bond_opening(solved)?))).collect();
    let contacts: Vec<Contact> = bonded.iter().map(|(k, _)| state.contacts[*k].contact).collect();
    let opened = bonded.iter().zip(&contacts).filter(|((k, _), _)| is_too_far(&state.contacts[*k]));
    let opened: Vec<&Contact> = opened.map(|(_, contact)| contact).collect();
    let is_connected = assemble::connected_bodies(scene, &contacts, &opened);
    let is_corrected =
        |contact: &Contact| [contact.candidate, contact.antagonist].iter().any(|body| is_connected[body.index()]);
    let corrected = bonded.iter().zip(&contacts).filter(|(_, contact)| is_corrected(contact));
    let corrected: Vec<(usize, f64)> = corrected.map(|(bond, _)| *bond).collect();
    let (shifts, turns) = corrections(contact_problem, &corrected, scene.bodies.len());
    for (i, (shift, turn)) in shifts.into_iter().zip(turns).enumerate() {
        state.x[i] += shift;
        if scene.oriented[i] && turn != Vec3::zeros() {
            state.q[i] = rotate_by_vector(&state.q[i], &turn);
        }
    }
    // The angular momentum stays, so bodies with unequal principal moments change their angular velocity.
    for (&i, momentum) in scene.free_rotors.iter().zip(&state.angular_momentum) {
        let i = i.index();
        state.w[i] = angular_velocity(&state.q[i], &scene.bodies[i].inertia, momentum);
    }
}

/// Displacements (m) and turns (rad) of all bodies that close the `openings`: indices of rows, each with its opening
/// in m.
fn corrections(contact_problem: &ContactProblem, openings: &[(usize, f64)], bodies: usize) -> (Vec<Vec3>, Vec<Vec3>) {
    let (mut shifts, mut turns) = (vec![Vec3::zeros(); bodies], vec![Vec3::zeros(); bodies]);
    for _ in 0..SWEEPS {
        for &(k, opening) in openings {
            let row = &contact_problem.rows[k];
            let [a, b] = row.bodies;
            let (w_n, _) = contact_problem.delassus_diagonal(k);
            let arms = [contact_problem.contact_arm(k, 0), contact_problem.contact_arm(k, 1)];
            let displacement_at = |body: BodyId, arm: &Vec3| shifts[body.index()] + turns[body.index()].cross(arm);
            let remaining = opening + row.normal.dot(&(displacement_at(a, &arms[0]) - displacement_at(b, &arms[1])));
            for ((body, arm), sign) in [a, b].into_iter().zip(&arms).zip([-1.0, 1.0]) {
                let share_of_gap = row.normal * (sign * remaining / w_n);
                shifts[body.index()] += contact_problem.velocity_change(body, &share_of_gap);
                turns[body.index()] += contact_problem.angular_velocity_change(body, &arm.cross(&share_of_gap));
            }
        }
    }
    (shifts, turns)
}

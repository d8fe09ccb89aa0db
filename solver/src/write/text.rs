//! Writes the state in LMGC90's text syntax, for `--text`.

use std::io::Write;
use std::path::{Path, PathBuf};

use cd_formats::atomic::{self, folder_entries};
use cd_formats::dof::{BodyDof, Dof};
use cd_formats::error::Faults;
use cd_formats::law_table::{INTERFACE_INTERNALS, INTERFACE_SOUNDNESS, LawInternals, law_internals};
use cd_formats::vloc_rloc::{ContactRecord, ContactSide, VlocRloc, lmgc90_tangents};

use super::text_inputs::INPUT_COPIES;
use crate::laws::Cohesion;
use crate::math::{Mat3, Twist, Vec3};
use crate::scene::{BodyId, BodyPart, BodyShape, ContactorShape, Scene};
use crate::state::{Contact, ContactId, ContactStatus, LawMemory, SolvedContact, State};

const DOF_PREFIX: &str = "DOF.OUT.";
const CONTACTS_PREFIX: &str = "Vloc_Rloc.OUT.";
/// State at the end of a run: motion and contacts.
const LAST_NAMES: [&str; 2] = ["DOF.LAST", "Vloc_Rloc.LAST"];

/// Whether a file of OUTBOX holds a state.
pub fn is_state_name(name: &str) -> bool {
    name.starts_with(DOF_PREFIX) || name.starts_with(CONTACTS_PREFIX) || LAST_NAMES.contains(&name)
}

/// Names of the text files that a new run writes: first output, state at the end, and copies of the input.
pub fn text_names_of_new_run() -> Vec<String> {
    let mut names = vec![format!("{DOF_PREFIX}1"), format!("{CONTACTS_PREFIX}1")];
    names.extend(LAST_NAMES.iter().chain(&INPUT_COPIES).map(ToString::to_string));
    names
}

/// Number of the output of a step, counted from 1 for the first after the start.
fn output_number(scene: &Scene, step: u64) -> u64 {
    let every = scene.options.output_every;
    step.div_ceil(every).saturating_sub(scene.start.step / every)
}

/// Offset that a run continuing from `state` adds to its output numbers; an earlier part may have had outputs closer
/// together. Errors: the folder cannot be read.
pub fn number_offset(outbox: &Path, scene: &Scene, state: &State) -> Result<u64, Faults> {
    Ok(last_output(outbox, state)?.map_or(0, |(k, step)| k.saturating_sub(output_number(scene, step))))
}

/// Whether the run has also written its last output, of the step of `state`, as text. Errors: the folder cannot be read.
pub fn is_written(outbox: &Path, state: &State) -> Result<bool, Faults> {
    Ok(last_output(outbox, state)?.is_some_and(|(_, step)| step == state.step))
}

/// Number and step of the last DOF.OUT that is not after `state`.
fn last_output(outbox: &Path, state: &State) -> Result<Option<(u64, u64)>, Faults> {
    let number_of = |path: &Path| path.file_name()?.to_str()?.strip_prefix(DOF_PREFIX)?.parse::<u64>().ok();
    let files = folder_entries(outbox)?.into_iter();
    let mut numbered_files: Vec<(u64, PathBuf)> = files.filter_map(|path| Some((number_of(&path)?, path))).collect();
    numbered_files.sort_unstable();
    // Outputs of later steps than the state do not count, as the run rewrites them.
    let number_and_step =
        |(k, path): &(u64, PathBuf)| Some((*k, Dof::read(path).ok()?.step)).filter(|(_, step)| *step <= state.step);
    Ok(numbered_files.iter().rev().find_map(number_and_step))
}

/// Writes DOF.OUT.k and Vloc_Rloc.OUT.k, where k is the number of the output plus `number_offset`.
pub fn write_text(outbox: &Path, scene: &Scene, state: &State, number_offset: u64) -> Result<(), Faults> {
    if state.step == scene.start.step {
        return Ok(()); // the initial state is in DATBOX
    }
    let k = output_number(scene, state.step) + number_offset;
    let names = [DOF_PREFIX, CONTACTS_PREFIX].map(|prefix| format!("{prefix}{k}"));
    write_state(outbox, names.each_ref().map(String::as_str), scene, state)
}

/// Writes the state at the end of a run.
pub fn write_last(outbox: &Path, scene: &Scene, state: &State) -> Result<(), Faults> {
    write_state(outbox, LAST_NAMES, scene, state)
}

/// Writes the motion and the contacts to the files with these names in OUTBOX.
fn write_state(outbox: &Path, [dof, contacts]: [&str; 2], scene: &Scene, state: &State) -> Result<(), Faults> {
    let texts = [(contacts, contact_records(scene, state).to_text()), (dof, dof_file(scene, state).to_text())];
    let write =
        |(name, text): (&str, String)| atomic::write_file(&outbox.join(name), |file| file.write_all(text.as_bytes()));
    texts.into_iter().try_for_each(write)
}

fn dof_file(scene: &Scene, state: &State) -> Dof {
    let bodies = (0..state.x.len())
        .map(|i| {
            let q = &state.q[i];
            let displacement = state.x[i] - scene.reference[i];
            let velocity = Twist { v: state.v[i], w: q.inverse_transform_vector(&state.w[i]) };
            BodyDof {
                line: 0,
                body: i,
                displacement: [displacement.x, displacement.y, displacement.z, 0.0, 0.0, 0.0],
                velocity: velocity.components(),
                axes: [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| (q * axis).into()),
            }
        })
        .collect();
    Dof { step: state.step, time: state.time, bodies }
}

/// Name of the contactor in LMGC90's Vloc_Rloc files, where SPHER stands for all spheres.
fn contactor_name(part: &BodyPart) -> &'static str {
    match part.geometry {
        ContactorShape::Sphere { .. } => "SPHER",
        ContactorShape::Plane { .. } => "PLANx",
        ContactorShape::Polyhedron(_) => "POLYR",
        ContactorShape::Cylinder { hollow: false, .. } => "CYLND",
        ContactorShape::Cylinder { hollow: true, .. } => "DNLYC",
        ContactorShape::Capsule { .. } => "CAPSx",
        ContactorShape::Mesh(_) => "MESHx",
    }
}

/// Contact kind in LMGC90. It has none between a polyhedron and a cylinder: PRPRx is the nearest. Contacts with surfaces,
/// which LMGC90 does not have, are SPMSx, PRMSx and CDMSx.
fn contact_kind(candidate: &str, antagonist: &str) -> &'static str {
    match (candidate, antagonist) {
        ("PT3Dx", _) => "PTPT3",
        ("POLYR", "PLANx") => "PRPLx",
        ("POLYR", "MESHx") => "PRMSx",
        ("POLYR", _) => "PRPRx",
        (_, "SPHER") => "SPSPx",
        ("CYLND", "PLANx") => "CDPLx",
        ("CYLND", "CYLND") => "CDCDx",
        ("CYLND", "MESHx") => "CDMSx",
        (_, "PLANx") => "SPPLx",
        (_, "POLYR") => "SPPRx",
        (_, "CYLND") => "SPCDx",
        (_, "MESHx") => "SPMSx",
        _ => "SPDCx",
    }
}

/// Status of a contact in LMGC90's files; `bond`: cohesion of its intact bond or liquid bridge. Contacts of a bond
/// have one status whether they slide or not; cohesion without memory has no statuses of its own.
fn status_text(status: ContactStatus, bond: Option<Cohesion>) -> &'static str {
    match (bond, status) {
        (Some(Cohesion::Bond { .. }), _) => "Mstck",
        (Some(Cohesion::Wet { .. }), ContactStatus::NoContact) => "Wnctc",
        (Some(Cohesion::Wet { .. }), ContactStatus::Stick) => "Wstck",
        (Some(Cohesion::Wet { .. }), ContactStatus::Slide) => "Wslid",
        (None | Some(Cohesion::Pair(_)), ContactStatus::NoContact) => "noctc",
        (None | Some(Cohesion::Pair(_)), ContactStatus::Stick) => "stick",
        (None | Some(Cohesion::Pair(_)), ContactStatus::Slide) => "slide",
    }
}

/// The contacts of the last step, with their laws, as a Vloc_Rloc file lists them.
fn contact_records(scene: &Scene, state: &State) -> VlocRloc {
    let side = |body: BodyId, part_number: u16| {
        // Numbers from the part count on are points PT3Dx.
        let parts = if scene.has_parts() { scene.parts_of(body).len() } else { 1 };
        if let Some(point) = usize::from(part_number).checked_sub(parts) {
            return ContactSide { body: body.index(), contactor: "PT3Dx".into(), number: point };
        }
        let (contactor, number) = match scene.bodies[body.index()].shape {
            BodyShape::Sphere { .. } => ("SPHER", 0),
            BodyShape::Plane { .. } => ("PLANx", 0),
            BodyShape::Parts => {
                let part = &scene.parts[scene.part_index(body, part_number).unwrap_or_default().index()];
                (contactor_name(part), part.contactor)
            }
        };
        ContactSide { body: body.index(), contactor: contactor.into(), number: number.into() }
    };
    let record = |(k, solved): (usize, &SolvedContact)| {
        let SolvedContact { contact, impulse, velocity, status, bond, .. } = solved;
        let link = scene.find_link([contact.candidate, contact.antagonist], contact.part_numbers);
        let candidate = side(contact.candidate, contact.part_numbers.candidate);
        let antagonist = side(contact.antagonist, contact.part_numbers.antagonist);
        let record = ContactRecord {
            line: 0,
            kind: contact_kind(&candidate.contactor, &antagonist.contactor).into(),
            candidate,
            antagonist,
            law: scene.law_names[contact.law].nickname.clone(),
            status: match link {
                Some(_) if *status == ContactStatus::NoContact => "vnish",
                _ => status_text(*status, bond.and(scene.laws[contact.law].cohesion)),
            }
            .into(),
            force: (impulse / state.h).into(),
            velocity: (*velocity).into(),
            gap: contact.gap + state.h * velocity.x,
            frame: contact.frame().map(Into::into),
            is_left_handed: false,
            point: contact.point.into(),
            internals: match link {
                Some(link) => vec![link.rest_length],
                None => {
                    let kind = &scene.law_names[contact.law].kind;
                    internal_values(kind, &state.law_memory(ContactId::new(k)))
                }
            },
        };
        let is_interface =
            link.is_none() && law_internals(&scene.law_names[contact.law].kind) == LawInternals::Interface;
        if !is_interface {
            return record;
        }
        let plate_axes = plate_axes(scene, state, contact);
        with_lmgc90_sliding(record, &state.law_memory(ContactId::new(k)).sliding, plate_axes)
    };
    VlocRloc { step: state.step, time: state.time, contacts: state.contacts.iter().enumerate().map(record).collect() }
}

/// First and third axis of a plate that is the antagonist of a contact.
fn plate_axes(scene: &Scene, state: &State, contact: &Contact) -> Option<[Vec3; 2]> {
    let body = contact.antagonist;
    let axes = match scene.bodies[body.index()].shape {
        BodyShape::Plane { .. } => state.q[body.index()],
        BodyShape::Parts => {
            let part = &scene.parts[scene.part_index(body, contact.part_numbers.antagonist)?.index()];
            matches!(part.geometry, ContactorShape::Plane { .. }).then(|| state.q[body.index()] * part.axes)?
        }
        BodyShape::Sphere { .. } => return None,
    };
    Some([axes * Vec3::x(), axes * Vec3::z()])
}

/// Length of a projection below which its direction is rounding.
const MIN_TANGENT: f64 = 1e-6;

/// Record of an interface with the pair in the order of LMGC90, and in the frame that LMGC90 computes: at a restart it reads
/// the components of the sliding, but no directions. `sliding`: of the candidate before a swap of the sides, m.
fn with_lmgc90_sliding(mut record: ContactRecord, sliding: &Vec3, plate_axes: Option<[Vec3; 2]>) -> ContactRecord {
    let [n, t, s] = record.frame.map(Vec3::from);
    let to_world = |[a, b, c]: [f64; 3]| n * a + t * b + s * c;
    let is_swapped = record.candidate.contactor == record.antagonist.contactor
        && (record.antagonist.body, record.antagonist.number) < (record.candidate.body, record.candidate.number);
    let sign = if is_swapped { -1.0 } else { 1.0 };
    let (force, velocity) = (to_world(record.force) * sign, to_world(record.velocity) * sign);
    if is_swapped {
        std::mem::swap(&mut record.candidate, &mut record.antagonist);
    }
    let n = n * sign;
    let [t, s] = match plate_axes {
        // On the side to which its third axis does not point, all axes of the contact are reversed.
        Some([first, third]) => {
            let side = n.dot(&third).signum();
            // On its rim, where LMGC90 has no contacts, the first axis may be along n.
            let t = (first - n * n.dot(&first)).try_normalize(MIN_TANGENT).unwrap_or(t) * side;
            [t, n.cross(&t) * side]
        }
        None => lmgc90_tangents(&record.kind, n.into()).map_or([t, n.cross(&t)], |tangents| tangents.map(Vec3::from)),
    };
    let rows = Mat3::from_rows(&[n.transpose(), t.transpose(), s.transpose()]);
    // The force is the sum of its components times the axes, which may not be orthogonal.
    let to_force_components = rows.transpose().try_inverse().unwrap_or(rows);
    record.force = (to_force_components * force).into();
    record.velocity = (rows * velocity).into();
    record.frame = [n, t, s].map(Into::into);
    let sliding = rows * sliding * sign;
    record.set_sliding([sliding.y, sliding.z]);
    record
}

/// Internal variables of a contact with a law of a kind, in LMGC90's order, without the sliding of an interface; unused ones
/// are 0.
fn internal_values(kind: &str, memory: &LawMemory) -> Vec<f64> {
    match law_internals(kind) {
        LawInternals::None => Vec::new(),
        LawInternals::Size => vec![0.0],
        LawInternals::ReferenceGap => vec![memory.reference_gap],
        LawInternals::SizeAndReferenceGap => vec![0.0, memory.reference_gap],
        LawInternals::Interface => {
            let mut internals = vec![0.0; INTERFACE_INTERNALS];
            internals[INTERFACE_SOUNDNESS] = memory.soundness;
            internals
        }
    }
}

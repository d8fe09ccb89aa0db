//! The last snapshot to the state that goes on from it.

use std::path::Path;

use cd_formats::error::{Fault, Faults};
use cd_formats::snapshot::{self, LawName, STATUS_NO_CONTACT, STATUS_SLIDE, Snapshot};
use nalgebra::{Quaternion, UnitQuaternion};

use crate::math::Vec3;
use crate::scene::Scene;
use crate::state::{Contact, SolvedContact, State, Status};

/// Puts the state of the last snapshot of `outbox` into `state`; nothing happens when there is none.
/// A snapshot of other bodies or laws than the scene's is refused.
pub fn last(outbox: &Path, scene: &Scene, state: &mut State) -> Result<Option<u64>, Faults> {
    let Some((step, path)) = snapshot::list(outbox).pop() else { return Ok(None) };
    let snapshot = Snapshot::read(&path)?;
    check(&path, scene, &snapshot)?;
    restore(snapshot, state);
    // What events have set follows from the events, so that flags may change the rest.
    for event in scene.events.iter().take(state.events_done) {
        state.set_by(&event.action);
    }
    Ok(Some(step))
}

fn check(path: &Path, scene: &Scene, snapshot: &Snapshot) -> Result<(), Faults> {
    let bodies = &snapshot.bodies;
    let mut faults = Faults::default();
    let mut refuse = |object: String, found: String, expected: String| {
        faults.push(Fault::new(path, None, object, found, expected));
    };
    if bodies.body_mass.len() != scene.bodies.len() {
        let found = format!("{} bodies", bodies.body_mass.len());
        refuse("snapshot".into(), found, format!("expected the {} of DATBOX", scene.bodies.len()));
    } else if let Some(i) = (0..scene.bodies.len()).find(|&i| {
        bodies.body_mass[i] != scene.bodies[i].mass || (bodies.body_driven[i] != 0) != scene.bodies[i].driven
    }) {
        let found = format!("mass {} kg, driven {}", bodies.body_mass[i], bodies.body_driven[i]);
        let body = &scene.bodies[i];
        refuse(
            format!("body {}", i + 1),
            found,
            format!("expected as in DATBOX: {} kg, driven {}", body.mass, body.driven),
        );
    }
    if snapshot.meta.laws != scene.law_names {
        let names = |laws: &[LawName]| -> Vec<String> {
            laws.iter().map(|law| format!("{} {} {:?}", law.nickname, law.kind, law.parameters)).collect()
        };
        let found = format!("laws {}", names(&snapshot.meta.laws).join(", "));
        refuse("snapshot".into(), found, format!("expected those of DATBOX: {}", names(&scene.law_names).join(", ")));
    }
    faults.into_result(())
}

fn restore(snapshot: Snapshot, state: &mut State) {
    let Snapshot { meta, bodies, contacts } = snapshot;
    let vectors = |rows: Vec<[f64; 3]>| rows.into_iter().map(Vec3::from).collect::<Vec<_>>();
    state.step = meta.step;
    state.time = meta.time;
    state.h = meta.h;
    state.x = vectors(bodies.body_x);
    // Already of unit norm; normalising again could change the last bit.
    state.q =
        bodies.body_q.iter().map(|&[w, x, y, z]| UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z))).collect();
    state.v = vectors(bodies.body_v);
    state.w = vectors(bodies.body_w_world);
    state.events_done = meta.parameters.events_done as usize;
    state.ledger = meta.ledger;
    state.contacts = (0..contacts.contact_body.len())
        .map(|k| SolvedContact {
            contact: Contact {
                candidate: contacts.contact_body[k][0],
                antagonist: contacts.contact_body[k][1],
                features: contacts.contact_feature[k].into(),
                point: Vec3::from(contacts.contact_point[k]),
                frame: contacts.contact_frame[k].map(Vec3::from),
                gap: contacts.contact_gap[k],
                law: contacts.contact_law[k],
            },
            impulse: Vec3::from(contacts.contact_impulse[k]),
            velocity: Vec3::from(contacts.contact_velocity[k]),
            status: match contacts.contact_status[k] {
                STATUS_NO_CONTACT => Status::NoContact,
                STATUS_SLIDE => Status::Slide,
                _ => Status::Stick,
            },
        })
        .collect();
}

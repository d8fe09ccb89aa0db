//! TACT_BEHAV.DAT and Vloc_Rloc.INI to laws, visibility and the contacts to start from.

use std::path::Path;

use cd_formats::compute::Action;
use cd_formats::error::{Fault, Faults};
use cd_formats::snapshot::LawName;
use cd_formats::tact_behav::{Side, TactBehav};
use cd_formats::vloc_rloc::VlocRloc;

use crate::laws::{Cohesion, KINDS, Law};
use crate::math::{Quat, Vec3};
use crate::scene::{Body, Scene, See, Shape, Visibility};
use crate::state::{Contact, SolvedContact, Status};

/// Puts laws and visibility into the scene.
pub fn laws(datbox: &Path, tact: &TactBehav, scene: &mut Scene, faults: &mut Faults) {
    let file = datbox.join("TACT_BEHAV.DAT");
    // Only laws that some row of the table uses are needed.
    let mut number = vec![None; tact.laws.len()];
    for see in &tact.visibility {
        let Some(k) = tact.laws.iter().position(|law| law.nickname == see.law) else { continue };
        if number[k].is_some() {
            continue;
        }
        let record = &tact.laws[k];
        let mut refuse = |found: String, expected: String| {
            faults.push(Fault::new(&file, Some(record.line), format!("law '{}'", record.nickname), found, expected));
        };
        match Law::new(&record.kind, &record.parameters) {
            None => refuse(
                format!("{} with {} parameters", record.kind, record.parameters.len()),
                format!("computed are {}", KINDS.join(", ")),
            ),
            Some(law) => match law.fault() {
                Some((name, value)) => {
                    refuse(format!("{name} {value}"), "expected restitutions from 0 to 1, others >= 0".into())
                }
                None => {
                    number[k] = Some(scene.laws.len() as u8);
                    scene.laws.push(law);
                    scene.law_names.push(LawName {
                        nickname: record.nickname.clone(),
                        kind: record.kind.clone(),
                        parameters: record.parameters.clone(),
                    });
                }
            },
        }
    }

    let colours = scene.colours.len().max(1);
    let class = |sphere: bool, colour: usize| if sphere { colour } else { colours + colour };
    for body in &mut scene.bodies {
        body.class = class(body.is_sphere(), body.colour as usize) as u16;
    }
    let classes = 2 * colours;
    let mut table: Vec<Option<See>> = vec![None; classes * classes];
    let class_of = |side: &Side| {
        let colour = scene.colours.iter().position(|colour| *colour == side.colour)?;
        match side.contactor.as_str() {
            "SPHER" => Some(class(true, colour)),
            "PLANx" => Some(class(false, colour)),
            _ => None,
        }
    };
    for row in &tact.visibility {
        let law = tact.laws.iter().position(|law| law.nickname == row.law).and_then(|k| number[k]);
        // A row about contactors or colours that no body has concerns nobody.
        let (Some(a), Some(b), Some(law)) = (class_of(&row.candidate), class_of(&row.antagonist), law) else {
            continue;
        };
        let see = See { law, alert: scene.options.alert.unwrap_or(row.alert) };
        table[a * classes + b] = Some(see);
        table[b * classes + a] = Some(see);
    }
    let radius = |body: &Body| if let Shape::Sphere { radius } = body.shape { radius } else { 0.0 };
    let largest = scene.bodies.iter().map(radius).fold(0.0, f64::max);
    let range = |see: &See| see.alert.max(scene.laws[see.law as usize].range(largest));
    scene.listing_range = table.iter().flatten().map(range).fold(0.0, f64::max);
    scene.visibility = Visibility { classes, table };
}

/// Refuses events about laws that no contact has, or about a cohesion that a law does not have.
pub fn check_events(scene: &Scene, faults: &mut Faults) {
    for (k, event) in scene.events.iter().enumerate() {
        let (Action::SetFriction(name, _) | Action::SetCohesion(name, _)) = &event.action else { continue };
        let mut refuse = |found: String, expected: String| {
            faults.push(Fault::new("options".as_ref(), None, format!("events, number {}", k + 1), found, expected));
        };
        match scene.law_names.iter().position(|law| law.nickname == *name) {
            None => {
                let known: Vec<&str> = scene.law_names.iter().map(|law| law.nickname.as_str()).collect();
                refuse(format!("law '{name}' is not in use"), format!("in use are {}", known.join(", ")));
            }
            Some(law)
                if matches!(event.action, Action::SetCohesion(..)) && !scene.laws[law].clone().set_cohesion(0.0) =>
            {
                refuse(format!("law '{name}' has no cohesion"), "expected a law with cohesion".into());
            }
            Some(_) => {}
        }
    }
}

/// The contacts of Vloc_Rloc.INI that this scene can have, to start the first step from.
pub fn history(
    datbox: &Path,
    history: &VlocRloc,
    scene: &Scene,
    orientations: &[Quat],
    faults: &mut Faults,
) -> Vec<SolvedContact> {
    let file = datbox.join("Vloc_Rloc.INI");
    let h = scene.options.dt;
    let mut contacts = Vec::new();
    for record in &history.contacts {
        let sides = [&record.candidate, &record.antagonist];
        if let Some(side) = sides.iter().find(|side| side.body >= scene.bodies.len()) {
            let expected = format!("expected 1 to {}", scene.bodies.len());
            faults.push(Fault::new(
                &file,
                Some(record.line),
                format!("body {}", side.body + 1),
                "does not exist",
                expected,
            ));
            continue;
        }
        let [a, b] = sides.map(|side| &scene.bodies[side.body]);
        let named = |side: &str, body: &Body| (side == "SPHER") == body.is_sphere();
        if !named(&record.candidate.contactor, a) || !named(&record.antagonist.contactor, b) || !a.is_sphere() {
            let found = format!("{} of bodies {} and {}", record.kind, sides[0].body + 1, sides[1].body + 1);
            faults.push(Fault::new(
                &file,
                Some(record.line),
                "contact",
                found,
                "expected SPSPx or SPPLx of the bodies' own contactors",
            ));
            continue;
        }
        let Some(see) = scene.visibility.see(a, b) else { continue };
        let status = match record.status.as_str() {
            status if status.ends_with("slide") || status.ends_with("slid") => Status::Slide,
            "noctc" | "nknow" => Status::NoContact,
            _ => Status::Stick,
        };
        let bonded = match scene.laws[see.law as usize].cohesion {
            Some(Cohesion::Bond { .. }) => record.status == "Mstck",
            Some(Cohesion::Wet { remembers, .. }) => remembers && record.status.starts_with('W'),
            None => false,
        };
        let frame = record.frame.map(Vec3::from);
        // The file does not name a plate's face; the normal tells.
        let third_axis = orientations[record.antagonist.body] * Vec3::z();
        let face = if b.is_sphere() || frame[0].dot(&third_axis) >= 0.0 { 0 } else { 1 };
        contacts.push(SolvedContact {
            contact: Contact {
                candidate: record.candidate.body as u32,
                antagonist: record.antagonist.body as u32,
                features: (0, face),
                point: Vec3::from(record.point),
                frame,
                gap: record.gap,
                law: see.law,
            },
            impulse: Vec3::from(record.force) * h,
            velocity: Vec3::from(record.velocity),
            status,
            bond: bonded.then_some(record.gap),
        });
    }
    contacts.sort_by_key(|solved| solved.contact.key());
    contacts.dedup_by_key(|solved| solved.contact.key());
    contacts
}

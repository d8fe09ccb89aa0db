//! Makes the laws, the visibility table and the initial contacts of the scene from TACT_BEHAV.DAT and Vloc_Rloc.INI, and
//! checks options and events that depend on laws.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use cd_formats::atomic::read_text;
use cd_formats::bodies::Bodies;
use cd_formats::compute::{Compute, ContactSolver, Event, EventAction, ExternalField, MAX_EVENTS, too_frequent_events};
use cd_formats::deforming_cell::CellState;
use cd_formats::doubts::{self, density, law_parameter};
use cd_formats::error::{Fault, Faults};
use cd_formats::geometry::convex_region::MAX_REGION_IMAGES;
use cd_formats::law_table::{
    INTERFACE_SLIDING, INTERFACE_SOUNDNESS, LawCohesion, ParameterFault, has_interface, is_law_of_points,
    law_parameters, needs_gauss_seidel, reference_gap_position,
};
use cd_formats::names::{count_text, number_text, rounded_number};
use cd_formats::probe::{EndCondition, ProbeQuantity, check_energy_conditions, named_bodies, unknown_bodies};
use cd_formats::report::FaultReport;
use cd_formats::scan::{AsciiText, TextLine};
use cd_formats::snapshot::LawName;
use cd_formats::tact_behav::{LawRecord, TactBehav, VisibilityRow, VisibilitySide};
use cd_formats::vloc_rloc::{ContactRecord, ContactSide, VlocRloc};

use crate::gravity::SummationMethod;
use crate::laws::{Cohesion, ContactLaw};
use crate::math::{Quat, Vec3, local_frame, to_local, to_world};
use crate::ranks::communicator;
use crate::read::bodies::InitialMotion;
use crate::read::contactors::{ContactorNumbers, ContactorTable, NamedContactor, POINT_NAME, part_number_in_scene};
use crate::scene::{
    BodyId, BodyPart, BodyShape, ContactSides, ContactorShape, EVENT_SLACK, InteractionRule, LawId, RigidBody, Scene,
    StepTime, VisibilityTable,
};
use crate::state::{Contact, ContactStatus, LawMemory, SolvedContact, UNKNOWN_FEATURE};

/// Names of the contactors that the visibility table distinguishes.
const CONTACTOR_NAMES: [&str; 7] = ["SPHER", "PLANx", "POLYR", "CYLND", "DNLYC", "MESHx", "CAPSx"];

/// Index of the kind of a contactor in [`CONTACTOR_NAMES`].
fn contactor_kind(geometry: &ContactorShape) -> usize {
    match geometry {
        ContactorShape::Sphere { .. } => 0,
        ContactorShape::Plane { .. } => 1,
        ContactorShape::Polyhedron(_) => 2,
        ContactorShape::Cylinder { hollow: false, .. } => 3,
        ContactorShape::Cylinder { hollow: true, .. } => 4,
        ContactorShape::Mesh(_) => 5,
        ContactorShape::Capsule { .. } => 6,
    }
}

/// Kind and class of a contactor by its body and the number of its part.
fn kind_and_class(scene: &Scene, body: BodyId, part_number: u16) -> (usize, u16) {
    match scene.bodies[body.index()].shape {
        BodyShape::Sphere { .. } => (0, scene.bodies[body.index()].class),
        BodyShape::Plane { .. } => (1, scene.bodies[body.index()].class),
        BodyShape::Parts => {
            let part = &scene.parts_of(body)[usize::from(part_number)];
            (contactor_kind(&part.geometry), part.class)
        }
    }
}

/// Parses a status of LMGC90. Some laws prefix the status with one of four letters. `None` for an unknown word.
fn parse_status(word: &str) -> Option<ContactStatus> {
    match word.strip_prefix(['C', 'W', 'M', 'E']).unwrap_or(word) {
        "stick" | "stck" => Some(ContactStatus::Stick),
        "slide" | "slid" | "slifw" | "slibw" | "slfw" | "slbw" => Some(ContactStatus::Slide),
        "noctc" | "nknow" | "nctc" | "nnow" | "vnish" => Some(ContactStatus::NoContact),
        "_RGR_" => Some(ContactStatus::Stick),
        _ => None,
    }
}

/// Sets laws and visibility of the scene.
pub fn set_laws_and_visibility(
    datbox: &Path,
    tact: &TactBehav,
    contactors: &ContactorTable,
    scene: &mut Scene,
    faults: &mut Faults,
) {
    let file = datbox.join("TACT_BEHAV.DAT");
    let numbers = set_laws(&file, tact, contactors, scene, faults);
    set_visibility(&file, tact, &numbers, scene, faults);
    check_periods(&file, tact, scene, faults);
    let text = read_text(&file).unwrap_or_default();
    let unseen = unseen_pairs(scene);
    scene.has_unseen_pairs = unseen.iter().any(|pair| pair.both_free);
    scene.notes.extend(unseen_contactors_note(scene, &unseen, &TactBehav::colour_pairs_without_law(&text)));
}

/// Sets the laws that rows of the table need; returns the number in the scene of each law of the file, if it has one.
fn set_laws(
    file: &Path,
    tact: &TactBehav,
    contactors: &ContactorTable,
    scene: &mut Scene,
    faults: &mut Faults,
) -> Vec<Option<LawId>> {
    // Only laws used by some row of the table are needed.
    let mut numbers = vec![None; tact.laws.len()];
    let mut is_checked = vec![false; tact.laws.len()];
    let mut uncomputed_laws = Vec::new();
    for row in &tact.visibility {
        let Some(k) = tact.laws.iter().position(|law| law.nickname == row.law) else { continue };
        if std::mem::replace(&mut is_checked[k], true) {
            continue;
        }
        let record = &tact.laws[k];
        let is_needed = tact.visibility.iter().any(|other| other.law == row.law && contactors.can_meet(other));
        let mut add_fault = |found: String, expected: String| {
            if !is_needed {
                uncomputed_laws.push(record);
                return;
            }
            faults.push(Fault::new(file, Some(record.line), format!("law '{}'", record.nickname), found, expected));
        };
        let model = match record.model() {
            Ok(model) => model,
            Err(error) => {
                add_fault(error.found().to_string(), error.expected().to_string());
                continue;
            }
        };
        let invalid = model.parameter_faults();
        if !invalid.is_empty() {
            for ParameterFault { parameter, found, expected } in invalid {
                add_fault(
                    format!("{} ({}) {found}", parameter.name(), parameter.label()),
                    format!("expected {expected}"),
                );
            }
        } else if needs_gauss_seidel(&record.kind)
            && !matches!(scene.options.solver, ContactSolver::Auto | ContactSolver::Nlgs)
        {
            let solver = scene.options.solver;
            add_fault(format!("{} with solver {solver}", record.kind), "expected solver auto or nlgs".into());
        } else if model.breaking_opening() > least_alert(tact, scene, &row.law) {
            let found = format!("bonds open by {:e} m until they break", model.breaking_opening());
            let alert = least_alert(tact, scene, &row.law);
            add_fault(found, format!("expected normal_cohesion/normal_stiffness up to the alert distance {alert:e} m"));
        } else if scene.laws.len() > u8::MAX.into() {
            add_fault("is the 257th law in use".into(), "expected at most 256 in use".into());
        } else {
            numbers[k] = Some(LawId::new(scene.laws.len()));
            scene.laws.push(ContactLaw::new(&model));
            scene.law_names.push(LawName {
                nickname: record.nickname.clone(),
                kind: record.kind.clone(),
                parameters: record.parameters.clone(),
            });
        }
    }

    uncomputed_laws.extend(
        (0..tact.laws.len()).filter(|&k| !is_checked[k] && tact.laws[k].model().is_err()).map(|k| &tact.laws[k]),
    );
    scene.notes.extend(uncomputed_laws_note(&uncomputed_laws));
    scene.notes.extend(unnamed_laws_note(tact));
    faults.0.extend(tact.check_laws(file, |row| contactors.can_meet(row)).0);
    scene.notes.extend(rows_without_law_note(tact, contactors));
    scene.notes.extend(idle_rows_notes(tact, contactors));
    scene.notes.extend(liquids_beyond_alert_note(tact, contactors));
    check_laws_of_points(file, tact, contactors, faults);
    numbers
}

/// Least alert distance of the rows of the visibility table with a law, m.
fn least_alert(tact: &TactBehav, scene: &Scene, law: &str) -> f64 {
    let alerts = tact.visibility.iter().filter(|row| row.law == law).map(|row| row.alert);
    scene.options.alert.unwrap_or_else(|| alerts.fold(f64::INFINITY, f64::min))
}

/// Sets the classes of contactors, the law of each pair of classes and the range of detection.
fn set_visibility(file: &Path, tact: &TactBehav, numbers: &[Option<LawId>], scene: &mut Scene, faults: &mut Faults) {
    let colours = scene.colours.len().max(1);
    let class = |kind: usize, colour: u16| (kind * colours + colour as usize) as u16;
    for body in &mut scene.bodies {
        body.class = class(usize::from(!body.is_sphere()), body.colour);
    }
    for part in &mut scene.parts {
        part.class = class(contactor_kind(&part.geometry), part.colour);
    }
    let classes = CONTACTOR_NAMES.len() * colours;
    let mut table: Vec<Option<InteractionRule>> = vec![None; classes * classes];
    let class_of = |side: &VisibilitySide| {
        let colour = scene.colours.iter().position(|colour| *colour == side.colour)?;
        let kind = CONTACTOR_NAMES.iter().position(|name| *name == side.contactor)?;
        Some(class(kind, colour as u16) as usize)
    };
    for row in &tact.visibility {
        let law = tact.laws.iter().position(|law| law.nickname == row.law).and_then(|k| numbers[k]);
        // Rows with contactors or colours that no body has are ignored.
        let (Some(a), Some(b), Some(law)) = (class_of(&row.candidate), class_of(&row.antagonist), law) else {
            continue;
        };
        let rule = InteractionRule { law, alert: scene.options.alert.unwrap_or(row.alert) };
        if let Some(expected) = uncomputed_pair([a, b].map(|class| CONTACTOR_NAMES[class / colours]))
            && let Some([moved, other]) = moving_bodies_of(scene, [a, b])
        {
            let found = format!("body {}, which is not all driven, and body {}", moved.number(), other.number());
            faults.push(Fault::new(file, Some(row.line), row.pair_name(), found, expected));
        }
        table[a * classes + b] = Some(rule);
        table[b * classes + a] = Some(rule);
    }
    let radius = |(index, body): (usize, &RigidBody)| {
        let is_flat = matches!(body.shape, BodyShape::Plane { .. }) || scene.is_mesh(BodyId::new(index));
        if is_flat { 0.0 } else { body.radius }
    };
    let curvatures =
        scene.parts.iter().map(|part| scene.part_curvature(part).value).filter(|curvature| *curvature > 0.0);
    let radii = scene.bodies.iter().enumerate().map(radius).chain(curvatures.map(f64::recip));
    let largest_radius = radii.fold(0.0, f64::max);
    let range = |rule: &InteractionRule| rule.alert.max(scene.laws[rule.law].interaction_range(largest_radius));
    scene.listing_range = table.iter().flatten().map(range).fold(0.0, f64::max);
    scene.visibility = VisibilityTable { classes, table };
}

/// Expectation about a row of two contactors whose contacts are not computed; `None` if they are.
fn uncomputed_pair(names: [&str; 2]) -> Option<&'static str> {
    match names {
        ["PLANx", "PLANx"] => Some(
            "expected no such row: LMGC90 has no contact of two plates; make one of them a POLYR with the eight corners of \
             the plate",
        ),
        ["DNLYC", "PLANx"] | ["PLANx", "DNLYC"] => Some(
            "expected no such row: a hollow cylinder has no contacts with plates; make the plate a POLYR with its eight \
             corners",
        ),
        ["MESHx", "PLANx"] | ["PLANx", "MESHx"] => Some(
            "expected no such row: a surface MESHx has no contacts with plates; make the plate a POLYR with its eight \
             corners",
        ),
        ["DNLYC", "DNLYC"] => Some("expected no such row: two hollow cylinders have no contacts"),
        ["MESHx", "DNLYC" | "MESHx"] | ["DNLYC", "MESHx"] => {
            Some("expected no such row: a surface MESHx has no contacts with hollow cylinders and other surfaces")
        }
        _ => None,
    }
}

/// Note about laws that could be computed, but that no row of the table names.
fn unnamed_laws_note(tact: &TactBehav) -> Option<String> {
    let is_named = |law: &LawRecord| tact.visibility.iter().any(|row| row.law == law.nickname);
    let laws: Vec<&LawRecord> = tact.laws.iter().filter(|law| !is_named(law) && law.model().is_ok()).collect();
    let names: Vec<String> = laws.iter().map(|law| format!("{} ({})", law.nickname, law.kind)).collect();
    let are = if laws.len() == 1 { "is" } else { "are" };
    Some(format!(
        "TACT_BEHAV.DAT:{}: {} {are} in no visibility row: {}",
        laws.first()?.line,
        count_text(laws.len(), "law"),
        names.join(", ")
    ))
}

/// Note about laws that are not computed and that no contact needs.
fn uncomputed_laws_note(laws: &[&LawRecord]) -> Option<String> {
    let mut laws: Vec<&&LawRecord> = laws.iter().collect();
    laws.sort_by_key(|law| law.line);
    laws.dedup_by_key(|law| law.line);
    let names: Vec<String> = laws.iter().map(|law| format!("{} ({})", law.nickname, law.kind)).collect();
    let law = laws.first()?;
    let (are, uses) = if laws.len() == 1 { ("is", "it") } else { ("are", "them") };
    Some(format!(
        "TACT_BEHAV.DAT:{}: {} {are} not computed: {}; no contact needs {uses}",
        law.line,
        count_text(laws.len(), "law"),
        names.join(", ")
    ))
}

/// Note about rows of laws that are not defined, for contactors of which no two can meet.
fn rows_without_law_note(tact: &TactBehav, contactors: &ContactorTable) -> Option<String> {
    let rows: Vec<_> =
        tact.rows_without_law().filter(|row| contactors.has_both(row) && !contactors.can_meet(row)).collect();
    let first = rows.first()?;
    let (have, need) = if rows.len() == 1 { ("has", "it") } else { ("have", "them") };
    Some(format!(
        "TACT_BEHAV.DAT:{}: {} {have} a law that is not defined: {} (first); no contact needs {need}",
        first.line,
        count_text(rows.len(), "visibility row"),
        first.law
    ))
}

/// Rejects laws of wires and rods for other contactors than points, and other laws for points.
fn check_laws_of_points(file: &Path, tact: &TactBehav, contactors: &ContactorTable, faults: &mut Faults) {
    for row in tact.visibility.iter().filter(|row| contactors.has_bodies_that_meet(row)) {
        let Some(law) = tact.laws.iter().find(|law| law.nickname == row.law) else { continue };
        let expected = match (contactors.joins_points(row), is_law_of_points(&law.kind)) {
            (true, false) if law.model().is_ok() => "expected no such row, or a law of wires or rods, as ELASTIC_WIRE",
            (false, true) => "expected PT3Dx on both sides",
            _ => continue,
        };
        let [a, b] = [&row.candidate, &row.antagonist].map(|side| format!("{} {}", side.contactor, side.colour));
        faults.push(Fault::new(
            file,
            Some(row.line),
            format!("{a} and {b}"),
            format!("law '{}', {}", row.law, law.kind),
            expected,
        ));
    }
}

/// Note about rows of liquids whose range exceeds the alert distance. LMGC90 lists no such pair, and they do not attract
/// there.
fn liquids_beyond_alert_note(tact: &TactBehav, contactors: &ContactorTable) -> Option<String> {
    let exceeds = |row: &&VisibilityRow| {
        let law = tact.laws.iter().find(|law| law.nickname == row.law).and_then(|law| law.model().ok());
        let cohesion = law.and_then(|law| law.cohesion());
        let is_longer = match cohesion {
            Some(LawCohesion::Liquid { range, .. }) => range > row.alert,
            None | Some(LawCohesion::Pair(_) | LawCohesion::Bond { .. }) => false,
        };
        is_longer && contactors.can_meet(row)
    };
    let rows: Vec<_> = tact.visibility.iter().filter(exceeds).collect();
    let first = rows.first()?;
    let (have, its) = if rows.len() == 1 { ("has", "its") } else { ("have", "their") };
    Some(format!(
        "TACT_BEHAV.DAT:{}: {} {have} a liquid that attracts beyond {its} alert distance: it does so here, not in LMGC90",
        first.line,
        count_text(rows.len(), "visibility row"),
    ))
}

/// Notes about rows that no contact can use.
fn idle_rows_notes(tact: &TactBehav, contactors: &ContactorTable) -> Vec<String> {
    let note = |is_idle: &dyn Fn(&VisibilityRow) -> bool, reason: &str| {
        let idle: Vec<usize> = tact.visibility.iter().filter(|row| is_idle(row)).map(|row| row.line).collect();
        let first = idle.first()?;
        let (rows, are) = (count_text(idle.len(), "visibility row"), if idle.len() == 1 { "is" } else { "are" });
        Some(format!("TACT_BEHAV.DAT:{first}: {rows} {are} for {reason}"))
    };
    let names_offset_sphere =
        |row: &VisibilityRow| [&row.candidate, &row.antagonist].iter().any(|s| s.contactor == "SPHEb");
    let ignored =
        "SPHEb, which LMGC90 ignores in visibility rows, and so does cd-solve: SPHER stands for all spheres there";
    let offset_spheres = note(&names_offset_sphere, ignored);
    let is_missing = |row: &VisibilityRow| !contactors.has_both(row) && !names_offset_sphere(row);
    let missing = note(&is_missing, "contactors or colours that no body has");
    // Rows without a law have a note of their own.
    let has_law = |row: &VisibilityRow| tact.laws.iter().any(|law| law.nickname == row.law);
    let joins_imposed_bodies = |row: &VisibilityRow| contactors.joins_imposed_bodies(row) && has_law(row);
    let imposed = note(
        &joins_imposed_bodies,
        "bodies whose motion is all imposed (of spheres: their translation): these do not meet",
    );
    let half_points =
        note(&|row| contactors.pairs_point_with_surface(row), "PT3Dx and another contactor: these do not meet");
    offset_spheres.into_iter().chain(missing).chain(imposed).chain(half_points).collect()
}

/// Returns two bodies with contactors of these classes of which contacts can push the first, if there are any.
fn moving_bodies_of(scene: &Scene, [a, b]: [usize; 2]) -> Option<[BodyId; 2]> {
    let parts_of_class = |class: usize| scene.parts.iter().filter(move |part| usize::from(part.class) == class);
    let is_pushed = |part: &&BodyPart| scene.bodies[part.body.index()].can_be_pushed();
    [[a, b], [b, a]].into_iter().find_map(|[first, second]| {
        let pushed = parts_of_class(first).find(is_pushed)?.body;
        let other = parts_of_class(second).find(|part| part.body != pushed)?.body;
        Some([pushed, other])
    })
}

/// Rejects attraction that reaches farther than the nearest image.
fn check_periods(file: &Path, tact: &TactBehav, scene: &Scene, faults: &mut Faults) {
    let Some(period) = scene.options.periods().into_iter().flatten().reduce(f64::min) else {
        return;
    };
    let largest = scene.free.iter().map(|&i| scene.bodies[i.index()].radius).fold(0.0, f64::max);
    for (law, name) in scene.laws.iter().zip(&scene.law_names) {
        let range = law.interaction_range(largest);
        if range > 0.0 && 2.0 * (2.0 * largest + range) >= period {
            let line = tact.laws.iter().find(|law| law.nickname == name.nickname).map(|law| law.line);
            let found = format!(
                "attracts bodies of {} m over {} m in a scene with the period {} m",
                rounded_number(largest),
                rounded_number(range),
                number_text(period)
            );
            let expected = "expected twice the radius plus the range to be less than half of that";
            faults.push(Fault::new(file, line, format!("law '{}'", name.nickname), found, expected));
        }
    }
}

/// Deforming cell at the start of a run, if it has one; it needs three periods.
pub fn initial_cell(scene: &Scene) -> Option<CellState> {
    let ([Some(x), Some(y), Some(z)], Some(control)) = (scene.options.periods(), &scene.options.cell) else {
        return None;
    };
    Some(CellState::new([x, y, z], control))
}

/// Rejects bodies in a deforming cell other than free grains, and commands of POSTPRO.DAT.
pub fn check_cell(datbox: &Path, scene: &Scene, faults: &mut Faults) {
    if scene.options.cell.is_none() {
        return;
    }
    let is_of_wall = |part: &BodyPart| match part.geometry {
        ContactorShape::Plane { .. } | ContactorShape::Mesh(_) => true,
        ContactorShape::Cylinder { hollow, .. } => hollow,
        ContactorShape::Sphere { .. } | ContactorShape::Polyhedron(_) | ContactorShape::Capsule { .. } => false,
    };
    let is_other = |i: &usize| {
        let body = &scene.bodies[*i];
        let is_plate = matches!(body.shape, BodyShape::Plane { .. });
        body.driven || is_plate || scene.all_parts_of(BodyId::new(*i)).iter().any(is_of_wall)
    };
    let others: Vec<usize> = (0..scene.bodies.len()).filter(is_other).collect();
    if let Some(first) = others.first() {
        let found = match others.len() {
            1 => "not a free grain, in a scene whose cell deforms".to_string(),
            count => {
                format!("not a free grain, like {} more, in a scene whose cell deforms", count_text(count - 1, "body"))
            }
        };
        let expected = "expected free grains: walls and imposed motions do not deform with the cell";
        faults.push(Fault::new(&datbox.join("BODIES.DAT"), None, format!("body {}", first + 1), found, expected));
    }
    if !scene.postpro.is_empty() {
        let (found, expected) =
            ("in a scene whose cell deforms", "expected no POSTPRO.DAT: its positions are those of a cell at rest");
        faults.push(Fault::new(&datbox.join("POSTPRO.DAT"), None, "file", found, expected));
    }
}

/// Rejects scenes for which `impacts: in_order` is not computed: bodies that are neither free spheres nor wholly
/// driven, deforming cells, and several ranks.
pub fn check_impacts(datbox: &Path, scene: &Scene, faults: &mut Faults) {
    if scene.options.impacts.is_simultaneous() {
        return;
    }
    let file = datbox.join("BODIES.DAT");
    let is_computed = |body: &RigidBody| body.is_imposed() || body.is_sphere() && !body.driven;
    if let Some(body) = scene.bodies.iter().position(|body| !is_computed(body)) {
        let found = "neither a free sphere nor a body whose whole motion is imposed, with impacts: in_order";
        let expected = "expected impacts: simultaneous: the order of impacts is computed for spheres";
        faults.push(Fault::new(&file, None, format!("body {}", body + 1), found, expected));
    }
    let mut add_fault = |found: &str| {
        let expected = "expected impacts: simultaneous";
        faults.push(Fault::new(&file, None, "file", format!("impacts: in_order {found}"), expected));
    };
    if scene.options.cell.is_some() {
        add_fault("in a scene whose cell deforms");
    }
    if communicator().size() > 1 {
        add_fault("on several ranks");
    }
}

/// Contactors of a class.
#[derive(Default)]
struct ClassMembers {
    /// Number of bodies that have one.
    count: usize,
    /// Last body that has one.
    last: Option<BodyId>,
    /// Whether one of them is on a body that moves freely, all or in part.
    free: bool,
}

/// Two classes of contactors without a rule, with bodies that could touch each other.
struct UnseenPair {
    classes: [u16; 2],
    /// Whether both have bodies that move freely, all or in part.
    both_free: bool,
}

/// Pairs of classes that no row lets touch each other, of which one at least has a body that moves freely.
fn unseen_pairs(scene: &Scene) -> Vec<UnseenPair> {
    let mut members: BTreeMap<u16, ClassMembers> = BTreeMap::new();
    let mut count = |class: u16, number: BodyId, body: &RigidBody| {
        let members = members.entry(class).or_default();
        // Parts of one body do not touch each other.
        members.count += usize::from(members.last != Some(number));
        members.last = Some(number);
        members.free |= body.can_be_pushed();
    };
    if scene.has_parts() {
        scene.parts.iter().for_each(|part| count(part.class, part.body, &scene.bodies[part.body.index()]));
    } else {
        (0..).zip(&scene.bodies).for_each(|(number, body)| count(body.class, BodyId(number), body));
    }
    let mut unseen = Vec::new();
    for (&a, members_a) in &members {
        for (&b, members_b) in members.range(a..) {
            let could_touch = (members_a.free || members_b.free) && (a != b || members_a.count > 1);
            if could_touch && scene.visibility.interaction_rule(a, b).is_none() {
                unseen.push(UnseenPair { classes: [a, b], both_free: members_a.free && members_b.free });
            }
        }
    }
    unseen
}

/// Warning about bodies that may pass through each other and whose self-gravity does not account for it.
pub fn pass_through_warning(scene: &Scene) -> Option<String> {
    if !(scene.has_self_gravity() && scene.has_unseen_pairs) {
        return None;
    }
    let option = match scene.gravity_solver().method_for(scene.free.len()) {
        SummationMethod::Direct if scene.options.gravity_quadrupole => "with gravity_quadrupole as if they were apart",
        SummationMethod::Direct => return None,
        _ => "by fmm as points; gravity: direct attracts them as balls",
    };
    Some(format!(
        "bodies that may pass through each other, as no row of TACT_BEHAV.DAT concerns them, attract {option}: their energy may change"
    ))
}

/// Difference of the moments of inertia of a body over the largest above which a tide turns it: well above their rounding in
/// files, and with a torque of a thousandth of that on a rod.
const MIN_INERTIA_SPREAD: f64 = 1e-3;

/// Warning about a lone body that the tide of a primary would turn: fields act at the centres of bodies. Bodies of unequal
/// moments that touch others are not reported: an aggregate of them is turned, and contacts turn a body on the ground.
pub fn tidal_torque_warning(scene: &Scene) -> Option<String> {
    let [body] = &scene.bodies[..] else { return None };
    let attracts = |field: &ExternalField| !matches!(field, ExternalField::RotatingFrame { .. });
    let [low, high] = [f64::min, f64::max].map(|extreme| body.inertia.into_iter().reduce(extreme).unwrap_or_default());
    let has_axes = high - low > MIN_INERTIA_SPREAD * high;
    let is_turned = !body.driven && has_axes && scene.options.fields.iter().any(attracts);
    is_turned.then(|| {
        "fields act at the centre of body 1, the only one: their tide does not turn it; an aggregate of grains is turned".into()
    })
}

/// Note about contactors of free bodies that no row lets touch others.
///
/// `declared`: pairs of colours that the file declares to have no row.
fn unseen_contactors_note(scene: &Scene, unseen: &[UnseenPair], declared: &[[String; 2]]) -> Option<String> {
    let count = scene.colours.len().max(1);
    let colour = |class: u16| scene.colours.get(class as usize % count).map_or("", String::as_str);
    let name = |class: u16| format!("{} {}", CONTACTOR_NAMES[class as usize / count], colour(class));
    let is_missed = |pair: &&UnseenPair| {
        let colours = pair.classes.map(colour);
        !declared.iter().any(|[a, b]| colours == [a, b] || colours == [b, a])
    };
    let missed = unseen.iter().filter(is_missed).map(|pair| pair.classes.map(name).join(" and "));
    let missed: Vec<String> = missed.collect();
    (!missed.is_empty())
        .then(|| format!("TACT_BEHAV.DAT: no row for {}: they pass through each other", missed.join(", ")))
}

/// Adds notes on contacts for which LMGC90 has no kind, if the state is also written as text; rejects capsules then.
pub fn check_text(datbox: &Path, scene: &mut Scene, faults: &mut Faults) {
    let is_capsule = |part: &&BodyPart| matches!(part.geometry, ContactorShape::Capsule { .. });
    if let Some(capsule) = scene.parts.iter().find(is_capsule).filter(|_| scene.options.text) {
        let (object, found) = (format!("body {}", capsule.body.number()), "a CAPSx, and the option text");
        let expected = "expected text: false: the text files of LMGC90 have no contacts of capsules";
        faults.push(Fault::new(&datbox.join("BODIES.DAT"), None, object, found, expected));
    }
    let polyhedra = scene.parts.iter().filter(|part| matches!(part.geometry, ContactorShape::Polyhedron(_)));
    let polyhedron_classes: Vec<u16> = polyhedra.map(|part| part.class).collect();
    let cylinders = scene.parts.iter().filter(|part| matches!(part.geometry, ContactorShape::Cylinder { .. }));
    let meets_polyhedra = |part: &BodyPart| {
        polyhedron_classes.iter().any(|&class| scene.visibility.interaction_rule(class, part.class).is_some())
    };
    if scene.options.text && cylinders.into_iter().any(meets_polyhedra) {
        let note =
            "Vloc_Rloc.OUT.k: contacts of polyhedra with cylinders are written as PRPRx: LMGC90 has no type for them";
        scene.notes.push(note.into());
    }
    if scene.options.text && scene.parts.iter().any(|part| matches!(part.geometry, ContactorShape::Mesh(_))) {
        let note = "Vloc_Rloc.OUT.k: contacts with surfaces MESHx are written as SPMSx, PRMSx and CDMSx, which LMGC90 \
                    does not have";
        scene.notes.push(note.into());
    }
}

/// Rejects events about laws that no contact has, or about a cohesion that a law does not have.
pub fn check_events(scene: &Scene, report: &mut FaultReport) {
    for (k, event) in scene.options.events.iter().enumerate() {
        let (EventAction::SetFriction(name, _) | EventAction::SetCohesion(name, _)) = &event.action else { continue };
        let path = format!("events.{k}.action.0");
        match scene.law_names.iter().position(|law| law.nickname == *name) {
            None => {
                let known: Vec<&str> = scene.law_names.iter().map(|law| law.nickname.as_str()).collect();
                report.add_unknown_name(&path, format!("law '{name}' is not in use"), name, &known);
            }
            Some(law)
                if matches!(event.action, EventAction::SetCohesion(..))
                    && !scene.laws[law].clone().set_cohesion(0.0) =>
            {
                report.add_fault(&path, format!("law '{name}' has no cohesion"), "a law with cohesion");
            }
            Some(law) if matches!(event.action, EventAction::SetFriction(..)) && !scene.laws[law].has_friction() => {
                report.add_fault(&path, format!("law '{name}' has no friction"), "a law with friction");
            }
            Some(_) => {}
        }
    }
}

/// Rejects probes and conditions of bodies that the scene does not have, conditions that can never hold, and regions of too
/// many periods. `gravity`: uniform gravity at the start, m/s².
pub fn check_probes(scene: &Scene, gravity: &[f64; 3], report: &mut FaultReport) {
    let has_potential = scene.options.has_potential(gravity, scene.free.len());
    check_energy_conditions(&scene.options.until, has_potential, "", report);
    let colours: Vec<&str> = scene.colours.iter().map(String::as_str).collect();
    let unknown = |bodies| unknown_bodies(bodies, scene.bodies.len(), &colours);
    for (path, bodies) in named_bodies(&scene.options.probes, &scene.options.until) {
        if let Some((found, expected)) = unknown(bodies) {
            report.add_fault(&path, found, expected);
        } else if scene.selected_bodies(bodies).is_empty() {
            report.add_fault(&path, "the scene has no such body", "bodies of the scene");
        }
    }
    for (k, condition) in scene.options.until.iter().enumerate() {
        if let EndCondition::Separation { between: (a, b), .. } = condition
            && a != b
            && [a, b].into_iter().all(|bodies| unknown(bodies).is_none())
            && scene.selected_bodies(a) == scene.selected_bodies(b)
        {
            report.add_fault(&format!("until.{k}.between"), "of the same bodies", "two different selections of bodies");
        }
    }
    for (k, probe) in scene.options.probes.iter().enumerate() {
        if let ProbeQuantity::Region { of, inside } = &probe.quantity
            && inside.convex_region().is_some()
            && unknown(of).is_none()
            && scene.region_images(inside, &scene.selected_bodies(of)).is_none()
        {
            let path = format!("probes.{k}.quantity.inside");
            let found = report.shown_text_or(&path, || format!("{inside:?}"));
            report.add_fault(&path, found, format!("a region of at most {MAX_REGION_IMAGES} periodic cells"));
        }
    }
}

/// Warns of probable mistakes of units: densities of free bodies, friction of laws in use and friction set by events.
///
/// Scenes without units have the density 1.
pub fn doubts(datbox: &Path, tact: &TactBehav, scene: &mut Scene, event_report: &mut FaultReport) {
    let mut questions = Faults::default();
    let file = datbox.join("BULK_BEHAV.DAT");
    let text = AsciiText::read_file(&file).ok();
    for (k, material) in scene.materials.iter().enumerate() {
        let question = density(material.density).filter(|_| material.density != 1.0);
        let is_free = |body: &RigidBody| !body.driven && usize::from(body.material) == k;
        if let Some(question) = question.filter(|_| scene.bodies.iter().any(is_free)) {
            let is_record =
                |line: &TextLine| line.columns(2, 6).trim() == material.name && !line.columns(46, 59).is_empty();
            let line = text.as_ref().and_then(|text| text.lines().find(is_record)).map(|line| line.number);
            let (object, found) = (format!("material {}, density", material.name), number_text(material.density));
            questions.push(Fault::new(&file, line, object, found, question));
        }
    }
    let file = datbox.join("TACT_BEHAV.DAT");
    for law in &scene.law_names {
        let line = tact.laws.iter().find(|known| known.nickname == law.nickname).map(|known| known.line);
        let mut questioned = Vec::new();
        for (parameter, value) in law_parameters(&law.kind).zip(&law.parameters) {
            let Some(question) = law_parameter(parameter, *value) else { continue };
            if !questioned.contains(value) {
                questioned.push(*value);
                let object = format!("law '{}', {}", law.nickname, parameter.label());
                questions.push(Fault::new(&file, line, object, number_text(*value), question));
            }
        }
    }
    doubts::events(&scene.options.events, "", event_report);
    questions.0.append(&mut event_report.warnings.0);
    scene.warnings.extend(questions.0.iter().map(Fault::to_string));
}

/// Rejects events that repeat too often up to the end of the run.
pub fn check_event_counts(scene: &Scene, report: &mut FaultReport) {
    for (k, repeats) in too_frequent_events(&scene.options.events, scene.end_time()) {
        let found = format!("happens {} times up to the end of the run", rounded_number(repeats));
        report.add_fault(&format!("events.{k}"), found, format!("at most {MAX_EVENTS:.0}"));
    }
}

/// Messages about options and events that have no effect in this scene.
pub fn ineffective_options(scene: &Scene) -> Vec<String> {
    let Compute { self_gravity, gravity, gravity_constant, gravity_moved, gravity_quadrupole, .. } = scene.options;
    let without_gravity = !self_gravity;
    let without_fmm = without_gravity || scene.gravity_solver().method_for(scene.free.len()) == SummationMethod::Direct;
    let sweeps = matches!(scene.options.solver, ContactSolver::Auto | ContactSolver::Nlgs);
    let sweeps_in_double = scene.laws.iter().any(|law| law.has_moments() || law.is_regularised());
    let has_impacts = scene.laws.iter().any(|law| law.restitution_at(0.0).is_some());
    let default = Compute::default();
    // Name of each option, whether it is set without an effect, and the feature that it needs.
    let table = [
        ("gravity", without_gravity && gravity != default.gravity, "self_gravity"),
        (
            "gravity_constant",
            without_gravity && scene.options.fields.is_empty() && gravity_constant != default.gravity_constant,
            "self_gravity or fields",
        ),
        ("gravity_error", without_gravity && scene.options.gravity_error.is_some(), "self_gravity"),
        ("gravity_order", without_fmm && scene.options.gravity_order.is_some(), "self_gravity by fmm"),
        ("gravity_opening", without_fmm && scene.options.gravity_opening.is_some(), "self_gravity by fmm"),
        ("gravity_refresh", without_gravity && scene.options.gravity_refresh.is_some(), "self_gravity"),
        ("gravity_moved", without_gravity && gravity_moved != default.gravity_moved, "self_gravity"),
        ("gravity_quadrupole", without_gravity && gravity_quadrupole, "self_gravity"),
        ("gravity_softening", without_gravity && scene.options.gravity_softening.is_some(), "self_gravity"),
        ("narrow_phase", !scene.has_parts() && scene.options.narrow_phase.is_some(), "polyhedra"),
        ("face_friction", !scene.has_parts() && scene.options.face_friction != default.face_friction, "polyhedra"),
        (
            "sweep_precision",
            (!sweeps || sweeps_in_double) && scene.options.sweep_precision != default.sweep_precision,
            "solver auto or nlgs, and laws without moments, springs or interfaces",
        ),
        ("check_every", !sweeps && scene.options.check_every.is_some(), "solver auto or nlgs"),
        ("impacts", !has_impacts && !scene.options.impacts.is_simultaneous(), "laws with restitution, such as RST_CLB"),
    ];
    let adaptive = scene.options.adaptive().is_on() && scene.changes_in_time();
    let adaptive = adaptive.then(|| "adaptive: steps are dt while an imposed velocity or force changes".to_string());
    let option_note =
        |(name, idle, needs): (&str, bool, &str)| idle.then(|| format!("{name}: without effect; needs {needs}"));
    let (start, end, dt) = (scene.start.time, scene.end_time(), scene.options.dt);
    let last_begin = end - dt;
    let event_note = |(k, event): (usize, &Event)| {
        let reason = match event.action {
            _ if event.time > last_begin + EVENT_SLACK * dt && end > start => {
                format!(
                    "no step begins at {} s or later, the last begins at {} s",
                    number_text(event.time),
                    rounded_number(last_begin)
                )
            }
            EventAction::Bond if !scene.has_bonds() && !scene.laws.iter().any(ContactLaw::has_law_memory) => {
                "Bond needs a law with bonds, liquid bridges or reference gaps".into()
            }
            _ => return None,
        };
        Some(format!("event {}: without effect; {reason}", k + 1))
    };
    let events = scene.options.events.iter().enumerate().filter_map(event_note);
    table.into_iter().filter_map(option_note).chain(adaptive).chain(events).collect()
}

/// Rejects contacts of Vloc_Rloc.INI with a law that TACT_BEHAV.DAT doesn't define, once for each name, and contacts without
/// the reference gap that their law keeps. LMGC90 stops at both.
pub fn check_laws_of_contacts(datbox: &Path, history: &VlocRloc, tact: &TactBehav, faults: &mut Faults) {
    let file = datbox.join("Vloc_Rloc.INI");
    let defined: Vec<&str> = tact.laws.iter().map(|law| law.nickname.as_str()).collect();
    let mut unknown = BTreeSet::new();
    for record in &history.contacts {
        let fault = |found: String, expected: String| Fault::new(&file, Some(record.line), "contact", found, expected);
        let Some(law) = tact.laws.iter().find(|law| law.nickname == record.law) else {
            if unknown.insert(&record.law) {
                let expected = format!("expected one of TACT_BEHAV.DAT: {}", defined.join(", "));
                faults.push(fault(format!("a law '{}'", record.law), expected));
            }
            continue;
        };
        if let Some(position) = reference_gap_position(&law.kind).filter(|&position| position >= record.internals.len())
        {
            let found = count_text(record.internals.len(), "internal variable");
            let expected = format!("expected those of {}, with the reference gap as number {}", law.kind, position + 1);
            faults.push(fault(found, expected));
        }
    }
}

/// Returns the contacts of Vloc_Rloc.INI that this scene can have, to start the first step from, and their memories;
/// adds notes on the others, and the contradictions of the file to `faults`.
pub fn initial_contacts(
    datbox: &Path,
    records: &Bodies,
    history: &VlocRloc,
    scene: &mut Scene,
    motion: &InitialMotion,
    faults: &mut Faults,
) -> (Vec<SolvedContact>, Vec<LawMemory>) {
    let file = datbox.join("Vloc_Rloc.INI");
    check_head(&file, history, scene, faults);
    let numbers = ContactorNumbers::from_contacts(records, history);
    let (positions, orientations) = (&motion.x[..], &motion.q[..]);
    let reader = ContactReader { file: &file, scene, records, numbers: &numbers, positions, orientations };
    let (mut contacts, mut left_out) = (Vec::new(), LeftOutContacts::default());
    for (number, record) in (0..).zip(&history.contacts) {
        let contact = reader.contact_of_record(number, record, &mut left_out);
        contacts.extend(faults.gather_result(contact).flatten());
    }
    scene.notes.extend(left_out.notes(&numbers));
    contacts.sort_by_key(|(solved, _)| solved.contact.key());
    let (contacts, mut memories): (Vec<SolvedContact>, Vec<LawMemory>) = contacts.into_iter().unzip();
    if !scene.laws.iter().any(ContactLaw::has_law_memory) {
        memories.clear();
    }
    check_duplicates(&file, history, &contacts, faults);
    (contacts, memories)
}

/// Rejects contacts of another step or time than DOF.INI has.
fn check_head(file: &Path, history: &VlocRloc, scene: &Scene, faults: &mut Faults) {
    let h = scene.options.dt;
    let StepTime { step, time } = scene.start;
    // Same rule as LMGC90, except for a file without contacts; times have seven digits.
    let differs = history.step != step || (history.time - time).abs() > 1e-3 * h + 1e-6 * time.abs();
    if differs && !history.contacts.is_empty() {
        let found = format!("step {}, time {} s", history.step, number_text(history.time));
        let expected = format!("expected step {step}, time {} s, those of DOF.INI", number_text(time));
        let text = AsciiText::read_file(file).ok();
        let line = text.and_then(|text| text.lines().find(|line| line.keyword() == "steps").map(|line| line.number));
        faults.push(Fault::new(file, line, "head", found, expected));
    }
}

/// Rejects contacts that are listed twice.
fn check_duplicates(file: &Path, history: &VlocRloc, contacts: &[SolvedContact], faults: &mut Faults) {
    for pair in contacts.chunk_by(|a, b| a.contact.key() == b.contact.key()).filter(|same| same.len() > 1) {
        let Contact { candidate, antagonist, .. } = pair[0].contact;
        let found = format!("bodies {} and {} occur {} times", candidate.number(), antagonist.number(), pair.len());
        let is_of_pair = |record: &&ContactRecord| {
            let bodies = [record.candidate.body, record.antagonist.body];
            bodies == [candidate.index(), antagonist.index()] || bodies == [antagonist.index(), candidate.index()]
        };
        let line = history.contacts.iter().filter(is_of_pair).nth(1).map(|record| record.line);
        faults.push(Fault::new(file, line, "contact", found, "expected each contact once"));
    }
}

/// Lines of the contacts of Vloc_Rloc.INI that are left out or read otherwise.
#[derive(Default)]
struct LeftOutContacts {
    /// Contacts whose pair has no row in TACT_BEHAV.DAT.
    unseen: Vec<usize>,
    /// Contacts whose contactors have other numbers in their bodies.
    renumbered: Vec<usize>,
    /// Contacts with a number that no contactor of the body has.
    unnumbered: Vec<usize>,
    /// Contacts of the end points of wires and rods.
    at_points: Vec<usize>,
}

impl LeftOutContacts {
    /// Notes about these contacts, one for each reason.
    fn notes(self, numbers: &ContactorNumbers) -> Vec<String> {
        let renumbering = match numbers {
            ContactorNumbers::OverAll(_) => "numbered over the contactors of all bodies",
            ContactorNumbers::InBody => "assigned to the only contactor of the kind, whatever its number",
        };
        let note = |(lines, reason): (Vec<usize>, &str)| {
            let first = lines.first()?;
            let are = if lines.len() == 1 { "is" } else { "are" };
            Some(format!("Vloc_Rloc.INI:{first}: {} {are} {reason}", count_text(lines.len(), "contact")))
        };
        let reasons = [
            (self.unseen, "left out: TACT_BEHAV.DAT has no row for the pair"),
            (self.at_points, "of PT3Dx: the state of wires and rods is that of the positions"),
            (self.unnumbered, "left out: the number of a contactor is none of its body's"),
            (self.renumbered, renumbering),
        ];
        reasons.into_iter().filter_map(note).collect()
    }
}

/// Converts records of Vloc_Rloc.INI to contacts, with the poses of the bodies at the start.
struct ContactReader<'a> {
    file: &'a Path,
    scene: &'a Scene,
    records: &'a Bodies,
    numbers: &'a ContactorNumbers,
    positions: &'a [Vec3],
    orientations: &'a [Quat],
}

impl ContactReader<'_> {
    /// Contact of the record `number`, and the memory of its law; `None` if it is left out, which `left_out` records.
    fn contact_of_record(
        &self,
        number: u32,
        record: &ContactRecord,
        left_out: &mut LeftOutContacts,
    ) -> Result<Option<(SolvedContact, LawMemory)>, Faults> {
        let &ContactReader { file, scene, orientations, .. } = self;
        let h = scene.options.dt;
        let fault = |object: &str, found: &str, expected: &str| {
            Faults::from(Fault::new(file, Some(record.line), object, found, expected))
        };
        let sides = [&record.candidate, &record.antagonist];
        if let Some(side) = sides.iter().find(|side| side.body >= scene.bodies.len()) {
            let expected = format!("expected 1 to {}", scene.bodies.len());
            return Err(fault(&format!("body {}", side.body + 1), "does not exist", &expected));
        }
        if sides.iter().all(|side| side.contactor == POINT_NAME) {
            left_out.at_points.push(record.line);
            return Ok(None);
        }
        let Some(part_numbers @ [part_a, part_b]) = self.parts_of_sides(record, left_out)? else { return Ok(None) };
        let [(kind_a, class_a), (kind_b, class_b)] =
            [0, 1].map(|k| kind_and_class(scene, BodyId::new(sides[k].body), part_numbers[k]));
        let Some(rule) = scene.visibility.interaction_rule(class_a, class_b) else {
            left_out.unseen.push(record.line);
            return Ok(None);
        };
        let Some(status) = parse_status(&record.status) else {
            let expected = "expected one of LMGC90's, such as stick, slide, noctc, Mstck or Wslid";
            return Err(fault("status", &record.status, expected));
        };
        let bonded = match scene.laws[rule.law].cohesion {
            Some(Cohesion::Bond { .. }) => record.status == "Mstck",
            Some(Cohesion::Wet { remembers, .. }) => remembers && record.status.starts_with('W'),
            None | Some(Cohesion::Pair(_)) => false,
        };
        let frame = record.frame.map(Vec3::from);
        let Some(normal) = frame[0].try_normalize(0.0) else {
            return Err(fault("contact", "a normal of length 0", "expected length 1"));
        };
        let order = [0, 1].map(|k| scene.candidate_order(BodyId::new(sides[k].body), part_numbers[k]));
        let swapped = order[0] > order[1];
        let (sign, [candidate, antagonist], kinds) =
            if swapped { (-1.0, [sides[1], sides[0]], [kind_b, kind_a]) } else { (1.0, sides, [kind_a, kind_b]) };
        let part_numbers = ContactSides { candidate: part_a, antagonist: part_b };
        let part_numbers = if swapped { part_numbers.swapped_sides() } else { part_numbers };
        let normal = normal * sign;
        let part = scene.find_part(BodyId::new(antagonist.body), part_numbers.antagonist);
        let axes = orientations[antagonist.body] * part.map_or_else(Quat::identity, |part| part.axes);
        let is_in_front = normal.dot(&(axes * Vec3::z())) >= 0.0;
        if record.is_left_handed && is_in_front {
            let expected = "expected right-handed axes on the side of a plate to which its third axis points";
            return Err(fault("contact", "left-handed axes n, t, s", expected));
        }
        // A plate's face is identified by the normal, all other features by the position.
        let features = match kinds.map(|kind| CONTACTOR_NAMES[kind]) {
            ["SPHER", "SPHER"] => [0, 0],
            ["SPHER", "PLANx"] => [0, if is_in_front { 0 } else { 1 }],
            _ => [UNKNOWN_FEATURE, number],
        };
        // The file has the tangents of LMGC90, which differ from the tangents of `local_frame`.
        let to_own_frame = |v: [f64; 3]| to_local(&local_frame(normal), &(to_world(&frame, &v.into()) * sign));
        let kind = &scene.law_names[rule.law].kind;
        if has_interface(kind) {
            let Some(soundness) = record.internals.get(INTERFACE_SOUNDNESS) else {
                let found = count_text(record.internals.len(), "internal variable");
                let expected =
                    format!("expected those of {kind}, with the soundness β as number {}", INTERFACE_SOUNDNESS + 1);
                return Err(fault("contact", &found, &expected));
            };
            if !(0.0..=1.0).contains(soundness) {
                return Err(fault(
                    "contact",
                    &format!("the soundness β = {}", number_text(*soundness)),
                    "expected 0 to 1",
                ));
            }
        }
        // The sliding is that of the candidate, too.
        let tangents = [frame[1] * sign, frame[2] * sign];
        let memory = law_memory(kind, &record.internals, tangents);
        let solved = SolvedContact {
            contact: Contact {
                candidate: BodyId::new(candidate.body),
                antagonist: BodyId::new(antagonist.body),
                part_numbers,
                features: features.into(),
                point: Vec3::from(record.point),
                image: Vec3::zeros(),
                normal,
                gap: record.gap,
                area: 0.0,
                law: rule.law,
            },
            impulse: to_own_frame(record.force) * h,
            moment: Vec3::zeros(),
            velocity: to_own_frame(record.velocity),
            status,
            bond: bonded.then(|| scene.laws[rule.law].bonded_at(record.gap)),
        };
        Ok(Some((solved, memory)))
    }

    /// Numbers of the parts on the two sides of a record; `None` if it is left out, which `left_out` records.
    fn parts_of_sides(
        &self,
        record: &ContactRecord,
        left_out: &mut LeftOutContacts,
    ) -> Result<Option<[u16; 2]>, Faults> {
        let &ContactReader { file, scene, records, numbers, positions, orientations } = self;
        let sides = [&record.candidate, &record.antagonist];
        let named = sides.map(|side| numbers.find(records, side));
        let may_be_bonded = record.status == "Mstck" || record.status.starts_with('C') || !record.internals.is_empty();
        if named.contains(&NamedContactor::Ambiguous) && !named.contains(&NamedContactor::OtherKind) && !may_be_bonded {
            left_out.unnumbered.push(record.line);
            return Ok(None);
        }
        let part_number = |k: usize| {
            let NamedContactor::Found(index) = named[k] else { return None };
            let body = sides[k].body;
            let point = orientations[body].inverse_transform_vector(&(Vec3::from(record.point) - positions[body]));
            part_number_in_scene(scene, BodyId::new(body), index, &point)
        };
        let [Some(part_a), Some(part_b)] = [0, 1].map(part_number) else {
            let name = |side: &ContactSide| format!("{} {} of body {}", side.contactor, side.number + 1, side.body + 1);
            let found = format!("{} of {} and {}", record.kind, name(sides[0]), name(sides[1]));
            let expected = "expected numbers and kinds of the bodies' own contactors";
            return Err(Fault::new(file, Some(record.line), "contact", found, expected).into());
        };
        if sides.iter().any(|side| !numbers.is_in_body(records, side)) {
            left_out.renumbered.push(record.line);
        }
        Ok(Some([part_a, part_b]))
    }
}

/// Memory of a law of a kind, from the internal variables of a contact of Vloc_Rloc.INI, with its tangents t, s, reversed
/// where the sides are swapped.
fn law_memory(kind: &str, internals: &[f64], [t, s]: [Vec3; 2]) -> LawMemory {
    let value = |k: usize| internals.get(k).copied().unwrap_or(0.0);
    if has_interface(kind) {
        let sliding = t * value(INTERFACE_SLIDING[0]) + s * value(INTERFACE_SLIDING[1]);
        return LawMemory { soundness: value(INTERFACE_SOUNDNESS), sliding, ..LawMemory::default() };
    }
    LawMemory { reference_gap: reference_gap_position(kind).map_or(0.0, value), ..LawMemory::default() }
}

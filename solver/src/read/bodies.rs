//! Makes the bodies of the scene, their imposed motion and their motion at the start from BODIES.DAT, BULK_BEHAV.DAT,
//! DRV_DOF.DAT and DOF.INI.

use std::path::Path;

use cd_formats::bodies::{Bodies, Body as BodyRecord, Contactor, ShapeRecord as FileShape};
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::compute::{Compute, PERIOD_NAMES};
use cd_formats::dof::{BodyDof, Dof};
use cd_formats::drv_dof::{DrivenKind, DrvDof, Evolution};
use cd_formats::error::{Fault, Faults, RecordFault, RecordPart};
use cd_formats::field::FieldShapes;
use cd_formats::names::{count_text, number_text, rounded_number};
use cd_formats::principal::AxesMatch;
use cd_formats::rotation::nearest_rotation;
use cd_formats::snapshot::{MaterialName, WallCriteria, are_walls};
use nalgebra::{Matrix3, UnitQuaternion};

use crate::math::{Quat, Twist, Vec3};
use crate::read::mirror;
use crate::read::parts::{PreparedBody, body_from_record};
use crate::scene::{
    BodyId, BodyPart, BodyShape, ContactorShape, ImposedLoad, ImposedVelocity, PartId, RigidBody, Scene, StepTime,
    VisibilityTable,
};

/// Files of DATBOX that describe bodies.
#[derive(Clone, Copy)]
pub struct BodyFiles<'a> {
    /// BODIES.DAT.
    pub records: &'a Bodies,
    /// BULK_BEHAV.DAT.
    pub bulk: &'a BulkBehav,
    /// DRV_DOF.DAT.
    pub driven: &'a DrvDof,
    /// DOF.INI.
    pub dof: &'a Dof,
}

/// Returns the scene without its laws and their visibility, links, events, `postpro` and `listing_range`. `has_links`:
/// whether wires or rods may join its points.
pub fn scene_without_laws(
    datbox: &Path,
    BodyFiles { records, bulk, driven, dof }: BodyFiles,
    has_links: bool,
    options: Compute,
    faults: &mut Faults,
) -> Scene {
    let file = datbox.join("BODIES.DAT");
    // A `BodyPart` takes several times the memory of a sphere's `RigidBody`; scenes of spheres and plates rarely need parts.
    let has_parts = has_links || !records.0.iter().all(is_sphere_or_plate);
    let part_list = if has_parts { PartList::Kept } else { PartList::Dropped };
    let BodyTables { mut bodies, mut parts, mut part_starts, extents, colours, frames, axes_matches, shapes } =
        body_tables(&file, records, bulk, part_list, faults);
    let (drives, loads) = imposed_motion(datbox, driven, &mut bodies, faults);
    check_extents(&file, records, &bodies, (&parts, &extents), &options, faults);
    drop(extents);
    let needs_parts = |body: &RigidBody| match body.shape {
        BodyShape::Parts => true,
        BodyShape::Plane { .. } => !body.is_imposed(),
        BodyShape::Sphere { .. } => body.is_driven_in_part(),
    };
    if !has_links && !bodies.iter().any(needs_parts) {
        (parts, part_starts) = (Vec::new(), Vec::new());
    } else if !has_parts {
        // Its faults are reported already.
        BodyTables { parts, part_starts, .. } =
            body_tables(&file, records, bulk, PartList::Kept, &mut Faults::default());
    }

    let indices = |is_chosen: &dyn Fn(&RigidBody) -> bool| -> Vec<BodyId> {
        bodies.iter().enumerate().filter(|(_, body)| is_chosen(body)).map(|(i, _)| BodyId::new(i)).collect()
    };
    let free = indices(&|body| !body.driven);
    let is_plane = |body: &RigidBody| matches!(body.shape, BodyShape::Plane { .. });
    let wall_criteria = |body: &RigidBody| WallCriteria { driven: body.imposed_components(), is_plane: is_plane(body) };
    let walls = are_walls(&bodies.iter().map(wall_criteria).collect::<Vec<_>>());
    let held_grains = indices(&RigidBody::is_driven_in_part).into_iter().filter(|i| !walls[i.index()]).collect();
    let spheres = indices(&RigidBody::is_sphere);
    let planes = indices(&is_plane);
    let mut oriented: Vec<bool> = bodies.iter().map(|body| !body.is_sphere() || options.orients_spheres()).collect();
    let bodies_with_moment = loads.iter().filter(|load| load.component >= 3).map(|load| load.body);
    bodies_with_moment.chain(drives.iter().map(|drive| drive.body)).for_each(|body| oriented[body.index()] = true);
    let free_rotors = indices(&|body| body.rotates_freely() && !body.is_isotropic());
    let constrained_rotors = indices(&|body| body.rotates_in_part() && !body.is_isotropic());
    let mut scene = Scene {
        drives,
        loads,
        wall_areas: Vec::new(),
        radii: Vec::new(),
        laws: Vec::new(),
        visibility: VisibilityTable::default(),
        has_unseen_pairs: false,
        events: Vec::new(),
        options,
        field_shapes: FieldShapes::default(),
        start: StepTime { step: dof.step, time: dof.time },
        continues_run: false,
        counted_from: StepTime { step: dof.step, time: dof.time },
        materials: bulk.materials.iter().map(|m| MaterialName { name: m.name.clone(), density: m.density }).collect(),
        colours,
        law_names: Vec::new(),
        reference: records.0.iter().zip(&frames).map(|(body, (shift, _))| Vec3::from(body.position) + shift).collect(),
        axes: frames.iter().map(|(_, axes)| *axes).collect(),
        roster: None,
        free,
        walls,
        held_grains,
        spheres,
        sphere_flags: bodies.iter().map(RigidBody::is_sphere).collect(),
        planes,
        has_round_parts: parts.iter().any(|part| matches!(part.geometry, ContactorShape::Sphere { .. })),
        has_rollers: parts.iter().any(|part| {
            let is_round = matches!(
                part.geometry,
                ContactorShape::Cylinder { hollow: false, .. } | ContactorShape::Capsule { .. }
            );
            is_round && !bodies[part.body.index()].is_imposed()
        }),
        has_drums: parts.iter().any(|part| matches!(part.geometry, ContactorShape::Cylinder { hollow: true, .. })),
        parts,
        part_starts,
        notes: shifted_centres_note(&bodies, &frames, records)
            .into_iter()
            .chain(eccentric_spheres_note(&bodies, records))
            .chain(axes_notes(dof, &axes_matches))
            .chain(shapes.note())
            .collect(),
        free_rotors,
        constrained_rotors,
        oriented,
        mean_radius: 0.0,
        smallest_radius: 0.0,
        warnings: Vec::new(),
        postpro: Vec::new(),
        links: Vec::new(),
        listing_range: 0.0,
        bodies,
    };
    let radii: Vec<f64> = scene.moving_bodies().iter().map(|&i| scene.bodies[i.index()].radius).collect();
    scene.mean_radius = radii.iter().sum::<f64>() / radii.len().max(1) as f64;
    scene.smallest_radius = radii.iter().copied().fold(f64::INFINITY, f64::min);
    check_free_motion(&datbox.join("DRV_DOF.DAT"), driven, &scene, faults);
    scene
}

/// Whether a table of bodies has a list of their parts.
#[derive(Clone, Copy, PartialEq)]
enum PartList {
    Kept,
    Dropped,
}

/// Bodies of BODIES.DAT with their parts.
struct BodyTables {
    bodies: Vec<RigidBody>,
    parts: Vec<BodyPart>,
    /// First part of each body, and the number of parts.
    part_starts: Vec<PartId>,
    /// Largest distance of a point of each body from its centre, m.
    extents: Vec<f64>,
    colours: Vec<String>,
    /// Shift of the centre (m) and axes of each body in the frame of the file.
    frames: Vec<(Vec3, Quat)>,
    axes_matches: Vec<AxesMatch>,
    shapes: ShapeCounts,
}

/// Whether a body has one contactor, which is a sphere or a plate.
fn is_sphere_or_plate(record: &BodyRecord) -> bool {
    let [contactor] = record.contactors.as_slice() else { return false };
    matches!(contactor.shape, FileShape::Sphere { .. } | FileShape::Plane { .. })
}

/// Makes the bodies of the records, with their parts if `part_list` says so; one that has a fault is replaced by a placeholder.
fn body_tables(
    file: &Path,
    records: &Bodies,
    bulk: &BulkBehav,
    part_list: PartList,
    faults: &mut Faults,
) -> BodyTables {
    let count = records.0.len();
    let mut colours: Vec<String> = Vec::new();
    let mut bodies = Vec::with_capacity(count);
    let (mut parts, mut part_starts) = (Vec::new(), Vec::new());
    let mut extents = Vec::with_capacity(count);
    let mut frames = Vec::with_capacity(count);
    let mut shapes = ShapeCounts::default();
    let mut axes_matches = Vec::with_capacity(count);
    let mut unsplit = Vec::new();
    for (index, record) in records.0.iter().enumerate() {
        let prepared =
            body_from_record(record, bulk, &mut colours).unwrap_or_else(|RecordFault { found, expected, part }| {
                let is_of_material = part == RecordPart::Material;
                let line = if is_of_material { Bodies::line_of_material(file, record) } else { record.line };
                let fault = Fault::new(file, Some(line), format!("body {}", index + 1), found, expected);
                if part == RecordPart::UnsplitSurface {
                    unsplit.push(fault)
                } else {
                    faults.push(fault)
                }
                placeholder_body()
            });
        bodies.push(prepared.body);
        shapes.add((index, record.line), &prepared.parts);
        let extent = |part: &BodyPart| part.offset.norm() + part.bounding_radius;
        extents.push(prepared.parts.iter().map(extent).fold(0.0, f64::max));
        if part_list == PartList::Kept {
            part_starts.push(PartId::new(parts.len()));
            parts.extend(prepared.parts.into_iter().map(|part| BodyPart { body: BodyId::new(index), ..part }));
        }
        frames.push((prepared.shift, prepared.axes));
        axes_matches.push(prepared.axes_match);
    }
    faults.0.extend(unsplit_fault(unsplit));
    part_starts.push(PartId::new(parts.len()));
    parts.shrink_to_fit();
    BodyTables { bodies, parts, part_starts, extents, colours, frames, axes_matches, shapes }
}

/// Rejects hollow cylinders none of whose motion is imposed, surfaces whose motion is not all imposed, and grains and
/// surfaces that are too long for a period.
fn check_extents(
    file: &Path,
    records: &Bodies,
    bodies: &[RigidBody],
    (parts, extents): (&[BodyPart], &[f64]),
    options: &Compute,
    faults: &mut Faults,
) {
    for part in parts.iter().filter(|part| !bodies[part.body.index()].driven) {
        let ContactorShape::Cylinder { hollow: true, .. } = part.geometry else { continue };
        let expected = "expected vlocy lines in DRV_DOF.DAT that impose some or all of its motion: a hollow cylinder is a \
                        wall, as its outside has no contacts";
        let (line, object) = (Some(records.0[part.body.index()].line), format!("body {}", part.body.number()));
        faults.push(Fault::new(file, line, object, "a DNLYC that may move freely", expected));
    }
    let is_mesh =
        |index: usize| matches!(records.0[index].contactors[..], [Contactor { shape: FileShape::Mesh { .. }, .. }]);
    for index in (0..bodies.len()).filter(|&index| is_mesh(index) && !bodies[index].is_imposed()) {
        let expected = "expected vlocy lines in DRV_DOF.DAT for all six components: a surface is a wall";
        let (line, object) = (Some(records.0[index].line), format!("body {}", index + 1));
        faults.push(Fault::new(file, line, object, "a MESHx whose motion is not all imposed", expected));
    }
    let is_plate = |body: &RigidBody| matches!(body.shape, BodyShape::Plane { .. });
    let moves = |body: &RigidBody| !body.driven || (body.is_driven_in_part() && !is_plate(body));
    let has_one_image = |index: usize| moves(&bodies[index]) || is_mesh(index);
    for (index, record) in records.0.iter().enumerate().filter(|(index, _)| has_one_image(*index)) {
        // A larger body would be met by more than its nearest image.
        let extent = 2.0 * extents[index];
        for period in options.periods().into_iter().flatten().filter(|period| 2.0 * extent >= *period) {
            let found =
                format!("up to {} m long in a scene with the period {} m", rounded_number(extent), number_text(period));
            faults.push(Fault::new(
                file,
                Some(record.line),
                format!("body {}", index + 1),
                found,
                "expected less than half of that",
            ));
        }
    }
}

/// Rejects bodies driven in part in a rotating frame, and scenes in which the whole motion of all bodies is imposed.
fn check_free_motion(file: &Path, driven: &DrvDof, scene: &Scene, faults: &mut Faults) {
    if scene.frame_angular_velocity() != Vec3::zeros() {
        for body in scene.drives.iter().map(|drive| drive.body).filter(|&i| scene.bodies[i.index()].is_driven_in_part())
        {
            let (object, found) = (format!("body {}", body.number()), "driven in part in a rotating frame");
            let expected = "expected all six components driven or none: Coriolis' force on such a body is not computed";
            let line = driven.0.iter().find(|row| row.body == body.index()).map(|row| row.line);
            faults.push(Fault::new(file, line, object, found, expected));
        }
    }
    if scene.moving_bodies().is_empty() {
        let (line, expected) =
            (driven.0.first().map(|row| row.line), "expected at least one whose motion is not all imposed");
        faults.push(Fault::new(file, line, "bodies", "none is free to move", expected));
    }
}

/// Body in place of a rejected one, so that the rest can be checked.
fn placeholder_body() -> PreparedBody {
    let shape = BodyShape::Sphere { radius: 1.0 };
    let body = RigidBody {
        shape,
        radius: 1.0,
        mass: 1.0,
        inertia: [1.0; 3],
        driven: false,
        free_components: [true; 6],
        absent: false,
        material: 0,
        colour: 0,
        class: 0,
    };
    let (shift, axes, axes_match) = (Vec3::zeros(), Quat::identity(), AxesMatch::Same);
    PreparedBody { body, parts: Vec::new(), shift, axes, axes_match }
}

/// Fault of the first body whose surface cannot be split into convex pieces, with the lines of the others: their reasons may
/// differ, but the remedy is the same.
fn unsplit_fault(unsplit: Vec<Fault>) -> Option<Fault> {
    let mut faults = unsplit.into_iter();
    let mut first = faults.next()?;
    let lines: Vec<String> = faults.filter_map(|fault| fault.line).map(|line| line.to_string()).collect();
    if !lines.is_empty() {
        let shown = lines[..lines.len().min(MAX_LISTED_LINES)].join(", ");
        let more = if lines.len() > MAX_LISTED_LINES { ", ..." } else { "" };
        let others = match lines.len() {
            1 => "1 more body has such a surface: line".into(),
            many => format!("{many} more bodies have such surfaces: lines"),
        };
        first.found += &format!("; {others} {shown}{more}");
    }
    Some(first)
}

/// Largest number of lines listed for a repeated fault.
const MAX_LISTED_LINES: usize = 3;

/// Contactors of BODIES.DAT that are not computed as they are.
#[derive(Default)]
struct ShapeCounts {
    /// POLYR that are not convex, their pieces, and the first body that has one.
    split: usize,
    pieces: usize,
    first_split: usize,
    /// Line of the first body.
    line: usize,
}

impl ShapeCounts {
    fn add(&mut self, (index, line): (usize, usize), parts: &[BodyPart]) {
        for pieces in parts.chunk_by(|a, b| a.contactor == b.contactor).filter(|pieces| pieces.len() > 1) {
            self.split += 1;
            if self.split == 1 {
                (self.first_split, self.line) = (index + 1, line);
            }
            self.pieces += pieces.len();
        }
    }

    fn note(&self) -> Option<String> {
        let Self { split, pieces, first_split, line } = *self;
        let are = if split == 1 { "is" } else { "are" };
        (split > 0).then(|| {
            format!(
                "BODIES.DAT:{line}: {split} POLYR {are} not convex and split into {pieces} convex pieces (first: body {first_split})"
            )
        })
    }
}

/// Note about centres of mass that differ from the file by more than its digits.
fn shifted_centres_note(bodies: &[RigidBody], frames: &[(Vec3, Quat)], records: &Bodies) -> Option<String> {
    let is_shifted = |(_, (body, (shift, _))): &(usize, (&RigidBody, &(Vec3, Quat)))| shift.norm() > 1e-6 * body.radius;
    let shifted_bodies: Vec<(usize, f64)> = bodies
        .iter()
        .zip(frames)
        .enumerate()
        .filter(is_shifted)
        .map(|(i, (_, (shift, _)))| (i + 1, shift.norm()))
        .collect();
    let (body, largest) = shifted_bodies.iter().copied().reduce(|a, b| if b.1 > a.1 { b } else { a })?;
    let bodies = if shifted_bodies.len() == 1 { "body was" } else { "bodies were" };
    Some(format!(
        "BODIES.DAT:{}: {} {bodies} shifted from coo1 to coo3 to the centre of mass of the shape, by up to {largest:.3e} m (body {body})",
        records.0[body - 1].line,
        shifted_bodies.len()
    ))
}

/// Note about bodies of a single off-centre SPHEb, whose centre of mass LMGC90 2025 puts at the centre of the sphere.
fn eccentric_spheres_note(bodies: &[RigidBody], records: &Bodies) -> Option<String> {
    let is_eccentric = |(body, record): &(&RigidBody, &BodyRecord)| {
        let [contactor] = record.contactors.as_slice() else { return false };
        matches!(contactor.shape, FileShape::OffsetSphere { offset, .. } if offset != [0.0; 3]) && !body.is_imposed()
    };
    let lines: Vec<usize> = bodies.iter().zip(&records.0).filter(is_eccentric).map(|(_, record)| record.line).collect();
    let first = lines.first()?;
    let have = if lines.len() == 1 { "has" } else { "have" };
    Some(format!(
        "BODIES.DAT:{first}: {} of one SPHEb {have} the centre of mass at coo1 to coo3 of NO6xx, not at the centre of the \
         sphere as in LMGC90",
        count_text(lines.len(), "body")
    ))
}

/// Notes about bodies of DOF.INI whose axes LMGC90 may have chosen otherwise.
fn axes_notes(dof: &Dof, matches: &[AxesMatch]) -> Vec<String> {
    let note = |kind: AxesMatch, reason: &str| {
        let listed = dof.bodies.iter().filter(|row| matches.get(row.body) == Some(&kind));
        let listed: Vec<&BodyDof> = listed.collect();
        let first = listed.first()?;
        Some(format!(
            "DOF.INI:{}: {} without an inertia line in BODIES.DAT (first: {}) {reason}: in a file of LMGC90 axes may have \
             other signs; start from the BODIES.OUT next to it",
            first.line,
            count_text(listed.len(), "body"),
            first.body + 1
        ))
    };
    let reasons = [
        (AxesMatch::Arbitrary, "with equal moments of inertia, where rounding decides about axes"),
        (AxesMatch::ArbitrarySigns, "whose moments of inertia leave the signs of two axes to rounding"),
        (AxesMatch::TooSmall, "too small for LMGC90 to find principal axes"),
    ];
    reasons.into_iter().filter_map(|(kind, reason)| note(kind, reason)).collect()
}

/// Component of a plate's normal along a period up to which the plate is level along it: rounding of files.
const MAX_NORMAL_ALONG_PERIOD: f64 = 1e-6;

/// Notes about periods that the widest plate does not span: bodies next to it would fall forever. `q`: orientations.
pub fn period_gap_notes(scene: &Scene, q: &[Quat]) -> Vec<String> {
    let periods = PERIOD_NAMES.into_iter().zip(scene.options.periods());
    let missed = periods.enumerate().filter_map(|(axis, (name, period))| {
        // A plate across z need not span the period along z.
        let may_span = |plate: usize| axis < 2 || (q[plate] * Vec3::z())[axis].abs() < MAX_NORMAL_ALONG_PERIOD;
        let is_meant = |plate: &&BodyId| scene.bodies[plate.index()].driven && may_span(plate.index());
        let driven_planes = scene.planes.iter().filter(is_meant);
        let widest = driven_planes.map(|&plate| plate_extent(scene, q, plate.index(), axis)).reduce(f64::max)?;
        let period = period.filter(|period| widest < period * (1.0 - 1e-6))?; // rounding of files
        Some(format!(
            "{name}: the widest plate spans {} m of the period {} m; grains that miss it fall forever",
            rounded_number(widest),
            number_text(period)
        ))
    });
    missed.collect()
}

/// Rejects plates that span a period on a slope along it: their images would form stairs. `q`: orientations.
pub fn check_plates_are_level(datbox: &Path, records: &Bodies, scene: &Scene, q: &[Quat], faults: &mut Faults) {
    let periods: Vec<(&str, Option<f64>)> = PERIOD_NAMES.into_iter().zip(scene.options.periods()).collect();
    for &plate in &scene.planes {
        let plate = plate.index();
        let normal = q[plate] * Vec3::z();
        for (axis, (name, _)) in periods.iter().enumerate().filter(|(axis, (_, period))| {
            let spans = |period: f64| plate_extent(scene, q, plate, *axis) >= period * (1.0 - 1e-6); // rounding of files
            period.is_some_and(spans) && normal[*axis].abs() > MAX_NORMAL_ALONG_PERIOD
        }) {
            let found =
                format!("a plate as wide as {name} whose normal {:.4?} is inclined along it", normal.as_slice());
            let expected = format!(
                "expected {} 0 of the normal: images of an inclined plate form stairs; incline gravity instead",
                ["x", "y", "z"][axis]
            );
            let line = Some(records.0[plate].line);
            faults.push(Fault::new(&datbox.join("BODIES.DAT"), line, format!("body {}", plate + 1), found, expected));
        }
    }
}

/// Extent of a plate along a fixed axis, m.
fn plate_extent(scene: &Scene, q: &[Quat], plate: usize, axis: usize) -> f64 {
    let BodyShape::Plane { half_lengths } = scene.bodies[plate].shape else { return 0.0 };
    2.0 * q[plate].to_rotation_matrix().matrix().row(axis).abs().transpose().dot(&half_lengths)
}

/// Rejects bodies outside a hollow cylinder that they can touch: only its inside exerts contact forces.
pub fn check_bodies_are_inside_drums(
    datbox: &Path,
    records: &Bodies,
    scene: &Scene,
    x: &[Vec3],
    q: &[Quat],
    faults: &mut Faults,
) {
    for drum in &scene.parts {
        let ContactorShape::Cylinder { half_height, radius, hollow: true } = drum.geometry else { continue };
        let shape = FileShape::Cylinder { half_height, radius, hollow: true };
        let pose = |part: &BodyPart| {
            let i = part.body.index();
            (x[i] + q[i] * part.offset, q[i] * part.axes)
        };
        let (centre, axes) = pose(drum);
        let stands_outside = |part: &&BodyPart| {
            let local = axes.inverse_transform_vector(&(pose(part).0 - centre));
            let meets = part.body != drum.body && scene.visibility.interaction_rule(part.class, drum.class).is_some();
            meets && !scene.bodies[part.body.index()].driven && shape.is_outside_hollow(local.into())
        };
        let mut outside: Vec<BodyId> = scene.parts.iter().filter(stands_outside).map(|part| part.body).collect();
        outside.dedup();
        for body in outside {
            let found = format!("is outside the hollow cylinder of body {}", drum.body.number());
            let expected = "expected bodies that can touch it inside: it is closed and has contacts on its inside only";
            let line = Some(records.0[body.index()].line);
            faults.push(Fault::new(
                &datbox.join("BODIES.DAT"),
                line,
                format!("body {}", body.number()),
                found,
                expected,
            ));
        }
    }
}

/// Imposed velocities, ordered by body, and imposed loads of DRV_DOF.DAT; marks the driven bodies.
fn imposed_motion(
    datbox: &Path,
    driven: &DrvDof,
    bodies: &mut [RigidBody],
    faults: &mut Faults,
) -> (Vec<ImposedVelocity>, Vec<ImposedLoad>) {
    let file = datbox.join("DRV_DOF.DAT");
    let mut velocities: Vec<(usize, [Option<Evolution>; 6])> = Vec::new();
    let mut loads = Vec::new();
    for row in &driven.0 {
        let mut add_fault = |found: String, expected: &str| {
            faults.push(Fault::new(&file, Some(row.line), format!("body {}", row.body + 1), found, expected));
        };
        if row.body >= bodies.len() {
            add_fault("does not exist".into(), &expected_number(datbox, row.body, bodies.len()));
            continue;
        }
        match row.kind {
            DrivenKind::Force | DrivenKind::Pressure => {
                loads.push(ImposedLoad {
                    body: BodyId::new(row.body),
                    component: row.component,
                    value: row.evolution.clone(),
                    area: None,
                });
            }
            DrivenKind::SurfaceVelocity | DrivenKind::Pivot => {}
            DrivenKind::Velocity | DrivenKind::StrainRate => {
                let slot = match velocities.iter().position(|(body, _)| *body == row.body) {
                    Some(k) => k,
                    None => {
                        velocities.push((row.body, Default::default()));
                        velocities.len() - 1
                    }
                };
                // The velocity by a strain rate follows from positions.
                let is_strain = row.kind == DrivenKind::StrainRate;
                let velocity = if is_strain { Evolution::constant(0.0) } else { row.evolution.clone() };
                if velocities[slot].1[row.component].replace(velocity).is_some() {
                    add_fault(format!("component {} is driven twice", row.component + 1), "expected once");
                }
            }
        }
    }
    let mut drives = Vec::new();
    for (body, velocity) in velocities {
        bodies[body].driven = true;
        bodies[body].free_components = std::array::from_fn(|k| velocity[k].is_none());
        drives.push(ImposedVelocity::new(BodyId::new(body), velocity));
    }
    drives.sort_by_key(|drive| drive.body);
    (drives, loads)
}

/// Numbers of bodies that are expected instead of one, from 0, that is too large. BODIES.DAT may give that number to a body
/// at another position.
fn expected_number(datbox: &Path, body: usize, count: usize) -> String {
    match Bodies::position_of_number(&datbox.join("BODIES.DAT"), body + 1) {
        Some(position) => format!(
            "expected 1 to {count}: bodies are counted by position, and the one with the number {} in BODIES.DAT is body \
             {position}",
            body + 1
        ),
        None => format!("expected 1 to {count}"),
    }
}

/// Motion of all bodies at the start of a run.
pub struct InitialMotion {
    /// Positions of the centres of mass, m.
    pub x: Vec<Vec3>,
    /// Orientations.
    pub q: Vec<Quat>,
    /// Velocities, m/s.
    pub v: Vec<Vec3>,
    /// Angular velocities, rad/s, world frame.
    pub w: Vec<Vec3>,
}

/// Motion of the bodies by DOF.INI, with imposed components by DRV_DOF.DAT.
pub fn initial_motion(
    datbox: &Path,
    records: &Bodies,
    dof: &Dof,
    scene: &mut Scene,
    faults: &mut Faults,
) -> InitialMotion {
    let file = datbox.join("DOF.INI");
    let count = records.0.len();
    let mut x = scene.reference.clone();
    let mut q = scene.axes.clone();
    let mut v = vec![Vec3::zeros(); count];
    let mut w = vec![Vec3::zeros(); count];
    let mut left_handed = Vec::new();
    for row in &dof.bodies {
        let mut add_fault = |found: String, expected: &str| {
            faults.push(Fault::new(&file, Some(row.line), format!("body {}", row.body + 1), found, expected));
        };
        if row.body >= count {
            add_fault("does not exist".into(), &expected_number(datbox, row.body, count));
            continue;
        }
        let mut axes = row.axes.map(Vec3::from);
        let mut spin = Vec3::from_row_slice(&row.velocity[3..]);
        if axes[0].cross(&axes[1]).dot(&axes[2]) < 0.0 {
            let Some(axis) = mirror::reversible_axis(scene, BodyId::new(row.body)) else {
                add_fault(
                    "axes a, b, g are left-handed".into(),
                    "expected a right-handed triad, as the shape, or what is imposed on it, is not its own mirror image",
                );
                continue;
            };
            (axes, spin) = mirror::reverse_axis(axes, axis, &spin);
            left_handed.push(row.line);
        }
        let axes = Matrix3::from_columns(&axes); // body -> world
        let defect = (axes.transpose() * axes - Matrix3::identity()).norm();
        // Frames are written with 7 digits; their drift between writings is smaller.
        if defect > 1e-4 {
            add_fault(
                format!("axes a, b, g that miss a right-handed unit triad by {defect:.1e}"),
                "expected less than 1e-4",
            );
            continue;
        }
        let i = row.body;
        x[i] += Vec3::from_row_slice(&row.displacement[..3]);
        q[i] = UnitQuaternion::from_rotation_matrix(&nearest_rotation(&axes));
        v[i] = Vec3::from_row_slice(&row.velocity[..3]);
        w[i] = q[i] * spin;
    }
    for drive in &scene.drives {
        let i = drive.body.index();
        let imposed = scene.imposed_motion(drive, dof.time, &x, &q, 0.0, &Twist { v: v[i], w: w[i] });
        (v[i], w[i]) = (imposed.v, imposed.w);
    }
    assert_eq!(scene.bodies.len(), count);
    if let Some(line) = left_handed.first() {
        let bodies = count_text(left_handed.len(), "body");
        scene.notes.push(format!(
            "DOF.INI:{line}: left-handed axes of {bodies}: one is reversed, which leaves the shape as it is"
        ));
    }
    InitialMotion { x, q, v, w }
}

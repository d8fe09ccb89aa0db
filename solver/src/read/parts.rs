//! Converts a record of BODIES.DAT to a body: its contactors, mass, centre and principal axes.

use cd_formats::bodies::{self, Contactor, LocalFrame};
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::error::{RecordFault, RecordPart};
use cd_formats::mass::{CheckedBody, InertialProperties, SolidPiece};
use cd_formats::principal::{AxesMatch, PrincipalFrame};
use cd_formats::ron_text::known_names;
use cd_formats::rotation::nearest_rotation;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use crate::geometry::Polyhedron;
use crate::math::{Quat, Vec3};
use crate::scene::{BodyId, BodyPart, BodyShape, ContactorShape, RigidBody};

/// Body as it is computed, and its position in the frame of the file.
pub struct PreparedBody {
    pub body: RigidBody,
    /// Contactors; `body` and `class` are not set yet.
    pub parts: Vec<BodyPart>,
    /// Vector from the position in the file to the centre of mass, m.
    pub shift: Vec3,
    /// Orientation, body to world, if DOF.INI does not give it.
    pub axes: Quat,
    /// Whether LMGC90 has the same axes.
    pub axes_match: AxesMatch,
}

/// Contactor in the frame of its body.
struct ContactorPiece {
    contactor: u16,
    geometry: ContactorShape,
    /// Centre in the frame of the file.
    centre: Vec3,
    axes: Quat,
    radius: f64,
    colour: u16,
}

/// Converts a record of BODIES.DAT to a body with its parts; new colours are added to `colours`.
///
/// Errors: the material is not in BULK_BEHAV.DAT or has no density, or the contactors make no body that can be computed.
pub fn body_from_record(
    record: &bodies::Body,
    bulk: &BulkBehav,
    colours: &mut Vec<String>,
) -> Result<PreparedBody, RecordFault> {
    let Some(material) = bulk.materials.iter().position(|m| m.name == record.material) else {
        let names: Vec<&str> = bulk.materials.iter().map(|m| m.name.as_str()).collect();
        let expected = if names.is_empty() {
            "expected a material of BULK_BEHAV.DAT: none is defined".into()
        } else {
            known_names(&record.material, &names)
        };
        let found = format!("material '{}' is not defined", record.material);
        return Err(RecordFault::new(found, expected).in_part(RecordPart::Material));
    };
    let density = bulk.materials[material].density;
    if density <= 0.0 {
        let found = format!("material '{}' has the density {density}", record.material);
        return Err(RecordFault::new(found, "expected more than 0").in_part(RecordPart::Material));
    }
    let CheckedBody { pieces: solids, whole: solid_properties, inertial } = record.check_at_density(density)?;
    let is_single = record.contactors.len() == 1;
    let is_only_solid = solids.len() == 1 && solids[0].contactor == 0;
    let mut pieces: Vec<ContactorPiece> =
        solids.into_iter().map(|solid| contactor_piece(&record.contactors, solid, colours)).collect();
    let keeps_own_axes = is_single && !matches!(pieces[0].geometry, ContactorShape::Polyhedron(_));

    // Position of the centre of mass in the frame of the file.
    let off_centre = matches!(record.contactors[0].shape, bodies::ShapeRecord::OffsetSphere { .. });
    let shift = Vec3::from(record.centre_of_mass_offset(&solid_properties));
    pieces.iter_mut().for_each(|piece| piece.centre -= shift);
    let frame = record.computed_frame(&solid_properties);
    // A lone sphere, plate, cylinder or capsule keeps its own axes, so that its orientation keeps its meaning.
    let own_axes = || if keeps_own_axes { pieces[0].axes } else { Quat::identity() };
    let axes = frame.as_ref().map_or_else(own_axes, frame_rotation);
    let InertialProperties { mass, inertia, radius } = inertial;

    // A sphere with points of wires or rods, which are no solids, is a sphere if its moments are equal.
    let is_ball = inertia[0] == inertia[1] && inertia[1] == inertia[2] && pieces[0].centre == Vec3::zeros();
    let shape = match &pieces[0].geometry {
        ContactorShape::Sphere { radius } if !off_centre && (is_single || is_only_solid && is_ball) => {
            BodyShape::Sphere { radius: *radius }
        }
        ContactorShape::Plane { half_lengths, .. } if is_single => BodyShape::Plane { half_lengths: *half_lengths },
        _ => BodyShape::Parts,
    };
    let body = RigidBody {
        shape,
        radius,
        mass,
        inertia,
        driven: false,
        free_components: [true; 6],
        absent: false,
        material: material as u16,
        colour: pieces[0].colour,
        class: 0,
    };
    let part = |(number, piece): (usize, ContactorPiece)| BodyPart {
        body: BodyId(0),
        number: number as u16,
        contactor: piece.contactor,
        geometry: piece.geometry,
        offset: axes.inverse_transform_vector(&piece.centre),
        axes: axes.inverse() * piece.axes,
        bounding_radius: piece.radius,
        colour: piece.colour,
        class: 0,
    };
    let axes_match = frame.map_or(AxesMatch::Same, |frame| frame.lmgc90);
    Ok(PreparedBody { body, parts: pieces.into_iter().enumerate().map(part).collect(), shift, axes, axes_match })
}

/// Converts a solid of a record to a contactor; a new colour is added to `colours`.
fn contactor_piece(contactors: &[Contactor], solid: SolidPiece, colours: &mut Vec<String>) -> ContactorPiece {
    let SolidPiece { contactor: index, faces, volume_properties: mass } = solid;
    let contactor = &contactors[index];
    let index = index as u16;
    let colour = colours.iter().position(|c| *c == contactor.colour).unwrap_or_else(|| {
        colours.push(contactor.colour.clone());
        colours.len() - 1
    }) as u16;
    let (centre, axes) = match contactor.local_frame.as_deref() {
        Some(LocalFrame { axes, offset }) => {
            let columns = Matrix3::from_fn(|i, j| axes[j][i]);
            let rotation = nearest_rotation(&columns);
            let is_identity = *axes == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            (
                Vec3::from(*offset),
                if is_identity { Quat::identity() } else { UnitQuaternion::from_rotation_matrix(&rotation) },
            )
        }
        None => (Vec3::zeros(), Quat::identity()),
    };
    if let Some(faces) = faces {
        let shape = Polyhedron::from(faces);
        let (centre, radius) = (Vec3::from(mass.centre), shape.circumradius());
        let geometry = ContactorShape::Polyhedron(shape);
        return ContactorPiece { contactor: index, geometry, centre, axes, radius, colour };
    }
    let (geometry, centre, radius) = match &contactor.shape {
        bodies::ShapeRecord::Sphere { radius } => (ContactorShape::Sphere { radius: *radius }, centre, *radius),
        bodies::ShapeRecord::OffsetSphere { radius, offset } => {
            (ContactorShape::Sphere { radius: *radius }, Vec3::from(*offset), *radius)
        }
        bodies::ShapeRecord::Plane { half_lengths } => {
            let half_lengths = Vec3::from(*half_lengths);
            let geometry = ContactorShape::Plane { half_lengths, cuboid: Polyhedron::cuboid(&half_lengths) };
            (geometry, centre, half_lengths.norm())
        }
        bodies::ShapeRecord::Cylinder { half_height, radius, hollow } => {
            let (half_height, radius, hollow) = (*half_height, *radius, *hollow);
            (ContactorShape::Cylinder { half_height, radius, hollow }, centre, libm::hypot(radius, half_height))
        }
        bodies::ShapeRecord::Capsule { half_length, radius } => {
            let (half_length, radius) = (*half_length, *radius);
            (ContactorShape::Capsule { half_length, radius }, centre, half_length + radius)
        }
        bodies::ShapeRecord::Mesh { radius, surface: Some(surface), .. } => {
            (ContactorShape::Mesh(surface.clone()), centre, *radius)
        }
        bodies::ShapeRecord::Polyhedron { .. }
        | bodies::ShapeRecord::Point { .. }
        | bodies::ShapeRecord::Mesh { surface: None, .. } => {
            unreachable!("a polyhedron has faces, a point is no solid, and surfaces are read with their bodies")
        }
    };
    ContactorPiece { contactor: index, geometry, centre, axes, radius, colour }
}

/// Rotation from the principal axes to the axes of the file.
fn frame_rotation(frame: &PrincipalFrame) -> Quat {
    let columns = Matrix3::from_fn(|i, j| frame.axes[j][i]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns))
}

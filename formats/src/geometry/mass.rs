//! Volume, centre and inertia of contactors, one by one and combined to a body; mass properties of bodies.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use super::convex_pieces::{ConvexPiece, split_into_convex};
use super::faces::{ConvexMesh, MeshError};
use super::principal::PrincipalFrame;
use super::rotation::nearest_rotation;
use super::surface::{MassProperties, Surface, SurfaceFaults};
use crate::bodies::{Body, Contactor, ShapeRecord};
use crate::error::{RecordFault, RecordPart};
use crate::names::number_text;

impl Contactor {
    /// Mass properties in the frame of the file, at density 1; zero for a point.
    ///
    /// Errors: the faults of the surface of a polyhedron.
    pub fn mass_properties(&self) -> Result<MassProperties, SurfaceFaults> {
        let (offset, axes) = match &self.local_frame {
            Some(frame) => (frame.offset, Matrix3::from_fn(|i, j| frame.axes[j][i])),
            None => ([0.0; 3], Matrix3::identity()),
        };
        let ball = |radius: f64, centre: [f64; 3]| {
            let volume = 4.0 / 3.0 * PI * radius.powi(3);
            let inertia = Matrix3::from_diagonal_element(0.4 * volume * radius * radius);
            MassProperties { volume, centre, inertia: inertia.into() }
        };
        let centred_at_offset = |volume: f64, moments: [f64; 3]| {
            let inertia = axes * Matrix3::from_diagonal(&Vector3::from(moments)) * axes.transpose();
            MassProperties { volume, centre: offset, inertia: inertia.into() }
        };
        Ok(match &self.shape {
            ShapeRecord::Sphere { radius } => ball(*radius, offset),
            ShapeRecord::OffsetSphere { radius, offset } => ball(*radius, *offset),
            ShapeRecord::Plane { half_lengths: [a, b, c] } => {
                let volume = 8.0 * a * b * c;
                centred_at_offset(
                    volume,
                    [b * b + c * c, a * a + c * c, a * a + b * b].map(|square| volume / 3.0 * square),
                )
            }
            ShapeRecord::Cylinder { half_height, radius, .. } => {
                let volume = 2.0 * PI * radius * radius * half_height;
                let across = volume * (radius * radius / 4.0 + half_height * half_height / 3.0);
                centred_at_offset(volume, [across, across, volume * radius * radius / 2.0])
            }
            ShapeRecord::Capsule { half_length: h, radius: r } => {
                // A cylinder and two hemispheres, whose centres of mass are 3 r/8 beyond its ends.
                let [barrel, ball] = [2.0 * PI * r * r * h, 4.0 / 3.0 * PI * r.powi(3)];
                let across = barrel * (r * r / 4.0 + h * h / 3.0) + ball * (0.4 * r * r + h * h + 0.75 * h * r);
                let along = r * r * (0.5 * barrel + 0.4 * ball);
                centred_at_offset(barrel + ball, [across, across, along])
            }
            ShapeRecord::Polyhedron { vertices, triangles } => Surface::new(vertices, triangles)?.mass_properties(),
            ShapeRecord::Point { offset } => MassProperties { volume: 0.0, centre: *offset, inertia: [[0.0; 3]; 3] },
            // The motion of a surface is imposed: its mass has no effect.
            ShapeRecord::Mesh { radius, .. } => ball(*radius, offset),
        })
    }

    /// Moments of inertia of a contactor about its own axes; `whole` are its mass properties.
    fn own_moments(&self, whole: &MassProperties) -> [f64; 3] {
        let axes = self.local_frame.as_ref().map_or(Matrix3::identity(), |f| Matrix3::from_fn(|i, j| f.axes[j][i]));
        let rotation = nearest_rotation(&axes);
        let local = rotation.transpose() * Matrix3::from(whole.inertia) * rotation;
        [local.m11, local.m22, local.m33]
    }
}

/// Mass properties of a body in a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InertialProperties {
    /// Mass, kg.
    pub mass: f64,
    /// Principal moments, kg m^2.
    pub inertia: [f64; 3],
    /// Radius of a single sphere, else of the sphere of equal volume, m.
    pub radius: f64,
}

/// Contactor, or convex piece of one.
#[derive(Debug, Clone, PartialEq)]
pub struct SolidPiece {
    /// Index of the contactor in its body.
    pub contactor: usize,
    /// Faces of a polyhedron, about its own centre of mass.
    pub faces: Option<ConvexMesh>,
    /// Volume, centre and inertia in the frame of the file, at density 1.
    pub volume_properties: MassProperties,
}

/// Body whose shape and mass cd-solve accepts, with its mass properties.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedBody {
    /// Shapes that touch others, in the order of the contactors: none of a PT3Dx, several of a POLYR that is not convex.
    pub pieces: Vec<SolidPiece>,
    /// Mass properties of all contactors together.
    pub whole: MassProperties,
    /// Mass, moments and radius at the given density.
    pub inertial: InertialProperties,
}

impl CheckedBody {
    /// Radius of a ball about the centre of mass that contains the bounding balls of all contactors, m. `body`: body from
    /// which this was made.
    pub fn bounding_radius(&self, body: &Body) -> f64 {
        let shift = Vector3::from(body.centre_of_mass_offset(&self.whole));
        let reach = self.pieces.iter().map(|piece| {
            let radius = match (&body.contactors[piece.contactor].shape, &piece.faces) {
                (_, Some(faces)) => faces.circumradius,
                (ShapeRecord::Sphere { radius } | ShapeRecord::OffsetSphere { radius, .. }, _) => *radius,
                (ShapeRecord::Mesh { radius, .. }, _) => *radius,
                (ShapeRecord::Plane { half_lengths }, _) => Vector3::from(*half_lengths).norm(),
                (ShapeRecord::Cylinder { half_height, radius, .. }, _) => libm::hypot(*radius, *half_height),
                (ShapeRecord::Capsule { half_length, radius }, _) => half_length + radius,
                (ShapeRecord::Polyhedron { .. } | ShapeRecord::Point { .. }, _) => 0.0,
            };
            (Vector3::from(piece.volume_properties.centre) - shift).norm() + radius
        });
        reach.fold(0.0, f64::max)
    }
}

/// Largest relative difference of moments that counts as rounding of the file: below it the three moments are set equal, and
/// the body has no gyroscopic term.
const EQUAL_MOMENTS: f64 = 1e-7;

/// Relative excess of a moment over the sum of the other two that counts as rounding of the file, whose numbers have 7 or 8
/// digits: in a flat body the largest moment equals the sum of the other two.
const MOMENT_ROUNDING: f64 = 1e-6;

/// Largest relative difference of the radius of a sphere and its `avrd`, of which the file has 7 or 8 digits.
const RADIUS_ROUNDING: f64 = 1e-6;

/// Largest relative error of the volume of a radius that has been rounded to 7 digits.
const VOLUME_ROUNDING: f64 = 1e-6;

impl Body {
    /// The body at a density (kg/m^3), if cd-solve can compute it; cd-pre checks this before it writes a body.
    ///
    /// Errors: the first fault of the body.
    pub fn check_at_density(&self, density: f64) -> Result<CheckedBody, RecordFault> {
        let (mut pieces, mut parts) = (Vec::new(), Vec::new());
        for (index, contactor) in self.contactors.iter().enumerate() {
            let piece = |(faces, volume_properties)| SolidPiece { contactor: index, faces, volume_properties };
            match &contactor.shape {
                ShapeRecord::Polyhedron { vertices, triangles } => {
                    let (convex, contactor_properties) = convex_meshes(vertices, triangles)?;
                    pieces.extend(convex.into_iter().map(|(faces, properties)| piece((Some(faces), properties))));
                    parts.push(contactor_properties);
                }
                shape => {
                    let properties = contactor.mass_properties().map_err(|fault| polyhedron_fault(&fault))?;
                    if !matches!(shape, ShapeRecord::Point { .. }) {
                        pieces.push(piece((None, properties)));
                    }
                    parts.push(properties);
                }
            }
        }
        if pieces.is_empty() {
            let expected =
                "expected SPHER, SPHEb, PLANx, POLYR, CYLND, DNLYC, CAPSx or MESHx: points have no mass and no surface";
            return Err(RecordFault::new("no contactor but PT3Dx", expected));
        }
        let is_mesh = |contactor: &Contactor| matches!(contactor.shape, ShapeRecord::Mesh { .. });
        if self.contactors.len() > 1 && self.contactors.iter().any(is_mesh) {
            return Err(RecordFault::new(
                "a MESHx among other contactors",
                "expected it to be the only one of its body",
            ));
        }
        if let [Contactor { shape: ShapeRecord::Sphere { radius }, .. }] = self.contactors.as_slice() {
            let avrd = self.equivalent_radius;
            if avrd != 0.0 && (avrd - radius).abs() > RADIUS_ROUNDING * radius {
                let expected =
                    format!("expected 0 or the contactor's radius {radius}: a sphere's mass follows from its own size");
                return Err(RecordFault::new(format!("avrd {avrd}"), expected));
            }
        }
        let whole = MassProperties::composite(&parts);
        let inertial = self.inertial_properties(&whole, density);
        let InertialProperties { mass, inertia, .. } = inertial;
        let is_positive = |x: f64| x.is_finite() && x > 0.0;
        if !is_positive(mass) || !inertia.into_iter().all(is_positive) {
            let found = if is_positive(mass) {
                format!("principal inertia {} kg m²", inertia.map(number_text).join(", "))
            } else {
                format!("mass {} kg", number_text(mass))
            };
            return Err(RecordFault::new(found, "expected mass and inertia to be finite and > 0"));
        }
        let [i, j, k] = inertia;
        let is_too_large = |moment: f64, others: f64| others < (1.0 - MOMENT_ROUNDING) * moment;
        if is_too_large(k, i + j) || is_too_large(i, j + k) || is_too_large(j, k + i) {
            let found = format!("principal inertia {i:e}, {j:e}, {k:e} kg m²");
            let expected = "expected each principal moment to be at most the sum of the other two";
            return Err(RecordFault::new(found, expected));
        }
        Ok(CheckedBody { pieces, whole, inertial })
    }

    /// Mass properties of all contactors together. Errors: the faults of the contactors.
    pub fn mass_properties(&self) -> Result<MassProperties, SurfaceFaults> {
        let contactor_properties = self.contactors.iter().map(Contactor::mass_properties);
        Ok(MassProperties::composite(&contactor_properties.collect::<Result<Vec<_>, _>>()?))
    }

    /// Vector from `position` to the centre of mass, m; `whole` are the mass properties of all contactors together. Zero
    /// for a single SPHEb, and for several contactors with `avrd`, whose coordinates are relative to the centre of mass.
    pub fn centre_of_mass_offset(&self, whole: &MassProperties) -> [f64; 3] {
        let is_relative_to_centre = match self.contactors.as_slice() {
            [single] => matches!(single.shape, ShapeRecord::OffsetSphere { .. }),
            _ => self.equivalent_radius != 0.0,
        };
        if is_relative_to_centre { [0.0; 3] } else { whole.centre }
    }

    /// Principal axes in the frame of the file, if they have to be found: of a polyhedron or of several contactors without
    /// given inertia. `whole` are the mass properties of all contactors together. A lone sphere, plate, cylinder or
    /// capsule keeps its own axes; with a given inertia the axes of the file are the principal ones.
    pub fn computed_frame(&self, whole: &MassProperties) -> Option<PrincipalFrame> {
        let has_own_axes =
            matches!(self.contactors.as_slice(), [lone] if !matches!(lone.shape, ShapeRecord::Polyhedron { .. }));
        let has_inertia = self.inertia.is_some_and(|inertia| inertia != [0.0; 3]);
        (!has_own_axes && !has_inertia).then(|| whole.moved_to(self.centre_of_mass_offset(whole)).lmgc90_frame())
    }

    /// Mass properties at a density (kg/m^3); `whole` are the mass properties of all contactors together at density 1.
    /// Given values of `avrd` and `I1 I2 I3` are used, except for the moments of a single sphere, plate, cylinder or capsule, about
    /// its own axes, and the mass of a centred sphere. Moments that are not given are those of the contactors about the centre of
    /// mass, with their own volumes.
    pub fn inertial_properties(&self, whole: &MassProperties, density: f64) -> InertialProperties {
        let single = if let [single] = self.contactors.as_slice() { Some(single) } else { None };
        let simple = single.filter(|contactor| !matches!(contactor.shape, ShapeRecord::Polyhedron { .. }));
        let file_inertia = self.inertia.filter(|inertia| simple.is_none() && *inertia != [0.0; 3]);
        let frame_moments = || whole.moved_to(self.centre_of_mass_offset(whole)).lmgc90_frame().moments;
        let own_moments = || simple.map_or_else(frame_moments, |contactor| contactor.own_moments(whole));
        let inertia = file_inertia.unwrap_or_else(own_moments);
        let declared_volume = 4.0 / 3.0 * PI * self.equivalent_radius.powi(3);
        let uses_declared_volume = match simple.map(|contactor| &contactor.shape) {
            // Computed directly, the volume has more digits.
            Some(
                ShapeRecord::Plane { .. }
                | ShapeRecord::Cylinder { .. }
                | ShapeRecord::Capsule { .. }
                | ShapeRecord::OffsetSphere { .. },
            ) => (declared_volume / whole.volume - 1.0).abs() > VOLUME_ROUNDING,
            Some(_) => false,
            None => true,
        };
        let volume = if uses_declared_volume && declared_volume != 0.0 { declared_volume } else { whole.volume };
        let radius = match single.map(|contactor| &contactor.shape) {
            Some(ShapeRecord::Sphere { radius }) => *radius,
            _ => libm::cbrt(volume * 0.75 / PI),
        };
        let inertia = inertia.map(|moment| density * moment);
        let equal_moments = inertia.iter().all(|moment| (moment - inertia[0]).abs() <= EQUAL_MOMENTS * inertia[0]);
        InertialProperties {
            mass: density * volume,
            inertia: if equal_moments { [inertia[0]; 3] } else { inertia },
            radius,
        }
    }
}

/// Fault of a contactor POLYR.
fn polyhedron_fault(fault: &dyn std::error::Error) -> RecordFault {
    RecordFault::new(format!("contactor POLYR: {fault}"), "expected a closed surface")
}

/// Remedy for surfaces that cannot be split into convex pieces.
const EXPECTED_CONVEX: &str = "expected a convex surface, such as its hull, or a body of several convex POLYR";

/// Faces of the convex pieces of a POLYR, each with its mass properties, and the mass properties of the whole.
fn convex_meshes(
    vertices: &[[f64; 3]],
    triangles: &[[u32; 3]],
) -> Result<(Vec<(ConvexMesh, MassProperties)>, MassProperties), RecordFault> {
    let reason = match ConvexMesh::from_contactor(vertices, triangles) {
        Ok((faces, mass)) => return Ok((vec![(faces, mass)], mass)),
        Err(MeshError::NotConvex(reason)) => reason,
        Err(fault) => return Err(polyhedron_fault(&fault)),
    };
    let surface = Surface::new(vertices, triangles).map_err(|fault| polyhedron_fault(&fault))?;
    let split_fault = |why: String| {
        let found = format!("contactor POLYR: {reason}; it cannot be split into convex pieces: {why}");
        RecordFault::new(found, EXPECTED_CONVEX).in_part(RecordPart::UnsplitSurface)
    };
    let pieces = split_into_convex(&surface).map_err(|error| split_fault(error.to_string()))?;
    let mesh = |piece: &ConvexPiece| ConvexMesh::from_contactor(&piece.vertices, &piece.triangles);
    let meshes =
        pieces.iter().map(mesh).collect::<Result<_, _>>().map_err(|fault| split_fault(format!("one is {fault}")))?;
    Ok((meshes, surface.mass_properties()))
}

impl MassProperties {
    /// Mass properties of the same solid with `point`, m, as centre: inertia about that point, by Huygens' theorem.
    pub fn moved_to(&self, point: [f64; 3]) -> MassProperties {
        let d = Vector3::from(self.centre) - Vector3::from(point);
        let inertia = Matrix3::from(self.inertia)
            + (Matrix3::from_diagonal_element(d.norm_squared()) - d * d.transpose()) * self.volume;
        MassProperties { centre: point, inertia: inertia.into(), ..*self }
    }

    /// Mass properties of several parts as one body, by Huygens' theorem; overlaps of parts count twice.
    pub fn composite(parts: &[MassProperties]) -> MassProperties {
        let volume: f64 = parts.iter().map(|part| part.volume).sum();
        let centre = parts.iter().map(|part| Vector3::from(part.centre) * part.volume).sum::<Vector3<f64>>() / volume;
        let inertia: Matrix3<f64> = parts.iter().map(|part| Matrix3::from(part.moved_to(centre.into()).inertia)).sum();
        MassProperties { volume, centre: centre.into(), inertia: inertia.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::LocalFrame;

    fn contactor(shape: ShapeRecord, local_frame: Option<LocalFrame>) -> Contactor {
        Contactor { colour: "BLUEx".into(), shape, local_frame: local_frame.map(Box::new) }
    }

    #[test]
    fn a_dumbbell_of_balls() {
        let balls =
            [1.0, -1.0].map(|side| ShapeRecord::OffsetSphere { radius: 0.5, offset: [3.0 * side + 1.0, 0.0, 2.0] });
        let parts = balls.map(|ball| contactor(ball, None).mass_properties().unwrap());
        let whole = MassProperties::composite(&parts);
        let volume = 4.0 / 3.0 * PI * 0.125;
        let along = 2.0 * 0.4 * volume * 0.25;
        let across = along + 2.0 * volume * 9.0;
        // A few roundings of numbers up to 10.
        assert!((whole.volume - 2.0 * volume).abs() < 1e-15);
        assert!((Vector3::from(whole.centre) - Vector3::new(1.0, 0.0, 2.0)).norm() < 1e-15);
        let expected = Matrix3::from_diagonal(&Vector3::new(along, across, across));
        assert!((Matrix3::from(whole.inertia) - expected).norm() < 1e-14, "{whole:?}");
    }

    #[test]
    fn a_lone_sphere_weighs_what_its_radius_says() {
        let weighed = |contactors: Vec<Contactor>, equivalent_radius, inertia| {
            let material = "ROCKx".into();
            let body = Body { line: 0, material, equivalent_radius, inertia, position: [0.0; 3], contactors };
            body.inertial_properties(&body.mass_properties().unwrap(), 3.0)
        };
        let sphere = contactor(ShapeRecord::Sphere { radius: 2.0 }, None);
        let mass = 3.0 * 4.0 / 3.0 * PI * 8.0;
        let expected = InertialProperties { mass, inertia: [0.4 * mass * 4.0; 3], radius: 2.0 };
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-14 * b;
        for alone in [weighed(vec![sphere.clone()], 0.0, None), weighed(vec![sphere], 7.0, Some([9.0; 3]))] {
            assert!(close(alone.mass, mass) && close(alone.inertia[2], expected.inertia[2]) && alone.radius == 2.0);
        }
    }

    #[test]
    fn a_lone_sphere_off_the_centre_weighs_what_avrd_says() {
        let sphere = contactor(ShapeRecord::OffsetSphere { radius: 1.0, offset: [0.5, 0.0, 0.0] }, None);
        for (avrd, radius) in [(0.0, 1.0), (1.0, 1.0), (2.0, 2.0)] {
            let (material, contactors) = ("ROCKx".into(), vec![sphere.clone()]);
            let body =
                Body { line: 0, material, equivalent_radius: avrd, inertia: None, position: [0.0; 3], contactors };
            let found = body.check_at_density(3.0).unwrap().inertial;
            assert!((found.mass - 4.0 * PI * f64::powi(radius, 3)).abs() < 1e-13, "{avrd}: {found:?}"); // roundings
        }
    }

    #[test]
    fn several_contactors_have_their_own_centre_without_avrd_and_that_of_the_file_with_it() {
        // Two balls of volume V and radius 1/2, of which the centre is at x = 2; at density 3.
        let ball = |x: f64| contactor(ShapeRecord::OffsetSphere { radius: 0.5, offset: [x, 0.0, 0.0] }, None);
        let volume = 4.0 / 3.0 * PI * 0.125;
        let own = 2.0 * 0.1 * volume;
        let given = Some([1.0, 2.0, 2.0]);
        for (avrd, inertia, centre, mass, moments) in [
            (0.0, None, 2.0, 2.0 * volume, [own, own + 2.0 * volume, own + 2.0 * volume]),
            (0.0, given, 2.0, 2.0 * volume, [1.0, 2.0, 2.0]),
            // About the origin of the file, at the distances 1 and 3 of the balls.
            (1.0, None, 0.0, 4.0 / 3.0 * PI, [own, own + 10.0 * volume, own + 10.0 * volume]),
            (1.0, given, 0.0, 4.0 / 3.0 * PI, [1.0, 2.0, 2.0]),
        ] {
            let contactors = vec![ball(1.0), ball(3.0)];
            let material = "ROCKx".into();
            let body =
                Body { line: 0, material, equivalent_radius: avrd, inertia, position: [5.0, 0.0, 0.0], contactors };
            let whole = body.mass_properties().unwrap();
            let found = body.inertial_properties(&whole, 3.0);
            // Roundings of a few sums.
            let close = |a: f64, b: f64| (a - b).abs() <= 1e-14 * b;
            assert_eq!(body.centre_of_mass_offset(&whole), [centre, 0.0, 0.0]);
            assert!(close(found.mass, 3.0 * mass) && close(found.radius, libm::cbrt(mass * 0.75 / PI)), "{found:?}");
            assert!((0..3).all(|k| close(found.inertia[k], 3.0 * moments[k])), "{found:?}, {moments:?}");
            // BODIES.OUT has all of it in the file.
            let again = body.centred_body().unwrap();
            let whole = again.mass_properties().unwrap();
            assert_eq!((again.position, again.centre_of_mass_offset(&whole)), ([5.0 + centre, 0.0, 0.0], [0.0; 3]));
            let again = again.inertial_properties(&whole, 3.0);
            assert!(close(again.mass, found.mass) && (0..3).all(|k| close(again.inertia[k], found.inertia[k])));
        }
    }

    #[test]
    fn a_plate_and_a_cylinder_lie_as_their_frames_say() {
        // Third axis along x.
        let frame = LocalFrame { axes: [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], offset: [0.0, 5.0, 0.0] };
        let plate = contactor(ShapeRecord::Plane { half_lengths: [1.0, 2.0, 0.5] }, Some(frame.clone()));
        let plate = plate.mass_properties().unwrap();
        assert_eq!((plate.volume, plate.centre), (8.0, [0.0, 5.0, 0.0]));
        let of = |a: f64, b: f64| 8.0 / 3.0 * (a * a + b * b);
        // Half lengths 0.5 along x, 1 along y, 2 along z.
        let expected = Matrix3::from_diagonal(&Vector3::new(of(1.0, 2.0), of(0.5, 2.0), of(0.5, 1.0)));
        assert!((Matrix3::from(plate.inertia) - expected).norm() < 1e-14);
        let cylinder = ShapeRecord::Cylinder { half_height: 3.0, radius: 2.0, hollow: false };
        let cylinder = contactor(cylinder, Some(frame)).mass_properties().unwrap();
        let volume = 24.0 * PI;
        let across = volume * (1.0 + 3.0);
        let expected = Matrix3::from_diagonal(&Vector3::new(volume * 2.0, across, across));
        assert!((Matrix3::from(cylinder.inertia) - expected).norm() < 1e-12);
    }
}

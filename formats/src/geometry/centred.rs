//! Conversion of bodies of BODIES.DAT to their centres of mass and principal axes, with lines of inertia, as LMGC90 writes
//! them to BODIES.OUT and cd-solve with `--text`.

use nalgebra::{Matrix3, Vector3};

use super::surface::SurfaceFaults;
use crate::bodies::{Bodies, Body, Contactor, LocalFrame, ShapeRecord};

type Vec3 = Vector3<f64>;

impl Bodies {
    /// All bodies as [`Body::centred_body`] gives them. Errors: those of the first body that has any.
    pub fn centred_bodies(&self) -> Result<Bodies, SurfaceFaults> {
        Ok(Bodies(self.0.iter().map(Body::centred_body).collect::<Result<_, _>>()?))
    }
}

impl Body {
    /// Body with its position at the centre of mass, its contactors about it in the principal axes of DOF.INI, and
    /// its `avrd` and inertia filled in. Written to BODIES.DAT it is read with the same axes whatever program reads it.
    ///
    /// A hollow cylinder among other contactors has no place for a frame in the file: such a body is returned as it is.
    /// Errors: the errors of [`Body::mass_properties`].
    ///
    /// ```
    /// use cd_formats::bodies::{Body, Contactor, ShapeRecord};
    /// let vertices = vec![[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]];
    /// let shape = ShapeRecord::Polyhedron { vertices, triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] };
    /// let contactors = vec![Contactor { colour: "BLUEx".into(), shape, local_frame: None }];
    /// let material = "ROCKx".into();
    /// let body = Body { line: 0, material, equivalent_radius: 0.0, inertia: None, position: [0.0; 3], contactors };
    /// assert_eq!(body.centred_body().unwrap().position, [1.0; 3]);
    /// ```
    pub fn centred_body(&self) -> Result<Body, SurfaceFaults> {
        let is_single = self.contactors.len() == 1;
        let is_hollow = |c: &Contactor| matches!(c.shape, ShapeRecord::Cylinder { hollow: true, .. });
        if !is_single && self.contactors.iter().any(is_hollow) {
            return Ok(self.clone());
        }
        // Mass properties at density 1, about the position and along the axes of the file.
        let properties_in_file = self.mass_properties()?;
        let offset = Vec3::from(self.centre_of_mass_offset(&properties_in_file));
        // `I1 I2 I3` of BODIES.DAT are at density 1, m^5; the density of the material is in another file.
        let inertial = self.inertial_properties(&properties_in_file, 1.0);
        let frame = self.computed_frame(&properties_in_file);
        let axes =
            frame.map_or(Matrix3::identity(), |f| Matrix3::from_rows(&f.axes.map(|a| Vec3::from(a).transpose())));
        let moved_contactor = |contactor: &Contactor| contactor.in_frame(&offset, &axes, is_single);
        let contactors = self.contactors.iter().map(moved_contactor).collect();
        Ok(Body {
            equivalent_radius: if self.equivalent_radius == 0.0 { inertial.radius } else { self.equivalent_radius },
            inertia: Some(inertial.inertia),
            position: (Vec3::from(self.position) + offset).into(),
            contactors,
            ..self.clone()
        })
    }
}

impl Contactor {
    /// The contactor in a frame with this origin, m, and these axes, one a row; `is_single`: it is the only one of its body.
    fn in_frame(&self, origin: &Vec3, axes: &Matrix3<f64>, is_single: bool) -> Contactor {
        let centred_point = |point: [f64; 3]| -> [f64; 3] { (axes * (Vec3::from(point) - origin)).into() };
        let (mut shape, mut local_frame) = (self.shape.clone(), self.local_frame.clone());
        match &mut shape {
            ShapeRecord::Sphere { radius } => {
                let offset = centred_point([0.0; 3]);
                if offset != [0.0; 3] {
                    shape = ShapeRecord::OffsetSphere { radius: *radius, offset };
                }
            }
            ShapeRecord::OffsetSphere { offset, .. } | ShapeRecord::Point { offset } => {
                *offset = centred_point(*offset)
            }
            ShapeRecord::Polyhedron { vertices, .. } => {
                vertices.iter_mut().for_each(|vertex| *vertex = centred_point(*vertex));
            }
            // A surface has the frame of its body.
            ShapeRecord::Mesh { .. } => {}
            // The body has the frame of its only plate, cylinder or capsule.
            ShapeRecord::Plane { .. } | ShapeRecord::Cylinder { .. } | ShapeRecord::Capsule { .. } if is_single => {
                local_frame = None
            }
            ShapeRecord::Plane { .. } | ShapeRecord::Cylinder { .. } | ShapeRecord::Capsule { .. } => {
                let fixed = LocalFrame { axes: Matrix3::identity().into(), offset: [0.0; 3] };
                let frame = local_frame.map_or(fixed, |frame| *frame);
                let axes = frame.axes.map(|axis| (axes * Vec3::from(axis)).into());
                local_frame = Some(LocalFrame { axes, offset: centred_point(frame.offset) }.into());
            }
        }
        Contactor { colour: self.colour.clone(), shape, local_frame }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::scan::AsciiText;

    fn bodies(path: &str) -> Bodies {
        Bodies::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap()
    }

    /// A centred body has the mass, the centre and the moments of the body it was made of, and stays as it is.
    #[test]
    fn centred_bodies_are_the_same_bodies() {
        for path in ["tests/lmgc90_axes/BODIES.DAT", "tests/good/two-spheres/DATBOX/BODIES.DAT"] {
            let given = bodies(path);
            let text = given.centred_bodies().unwrap().to_long_text();
            let read = Bodies::parse("BODIES.OUT".as_ref(), &AsciiText::new(text.as_bytes())).unwrap();
            for (body, centred) in given.0.iter().zip(&read.0) {
                let before = body.mass_properties().unwrap();
                let after = centred.mass_properties().unwrap();
                let size = body.inertial_properties(&before, 1.0).radius;
                let [a, b] = [body.inertial_properties(&before, 1.0), centred.inertial_properties(&after, 1.0)];
                // Nine digits and more in the file.
                assert!(
                    (a.mass / b.mass - 1.0).abs() < 1e-7 && (a.radius / b.radius - 1.0).abs() < 1e-7,
                    "{a:?} {b:?}"
                );
                assert!(a.inertia.iter().zip(&b.inertia).all(|(a, b)| (a / b - 1.0).abs() < 1e-7), "{a:?} {b:?}");
                assert!(Vec3::from(after.centre).norm() < 1e-8 * size, "{after:?}");
                let moments = Matrix3::from(after.inertia);
                let off = moments - Matrix3::from_diagonal(&moments.diagonal());
                assert!(off.amax() < 1e-7 * moments.amax(), "{moments}");
            }
        }
    }

    #[test]
    fn plates_and_balls_of_a_cluster_keep_their_places() {
        let contactor = |shape, local_frame| Contactor { colour: "BLUEx".into(), shape, local_frame };
        let plate = ShapeRecord::Plane { half_lengths: [1.0, 1.0, 0.5] };
        let frame = LocalFrame { axes: [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], offset: [4.0, 0.0, 0.0] };
        let ball = contactor(ShapeRecord::Sphere { radius: 1.0 }, None);
        let contactors = vec![contactor(plate, Some(frame.into())), ball];
        let body = Body {
            line: 0,
            material: "ROCKx".into(),
            equivalent_radius: 0.0,
            inertia: None,
            position: [1.0, 2.0, 3.0],
            contactors,
        };
        let centred = body.centred_body().unwrap();
        let ShapeRecord::OffsetSphere { offset, .. } = centred.contactors[1].shape else { panic!("{centred:?}") };
        let placed = centred.contactors[0].local_frame.clone().unwrap();
        // The axes of the file are principal, so that only the origin moves: by the centre, along x.
        let shift = Vec3::from(centred.position) - Vec3::new(1.0, 2.0, 3.0);
        let volumes = [4.0, 4.0 / 3.0 * std::f64::consts::PI];
        assert!((shift - Vec3::new(16.0 / (volumes[0] + volumes[1]), 0.0, 0.0)).norm() < 1e-15);
        assert!((Vec3::from(offset) + shift).norm() < 1e-15);
        assert!((Vec3::from(placed.offset) - Vec3::new(4.0, 0.0, 0.0) + shift).norm() < 1e-15);
        assert_eq!(placed.axes, [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]);
        // A lone plate lends its frame to the body.
        let alone = Body { contactors: vec![body.contactors[0].clone()], ..body };
        let centred = alone.centred_body().unwrap();
        assert_eq!((centred.position, &centred.contactors[0].local_frame), ([5.0, 2.0, 3.0], &None));
    }
}

//! Left-handed axes in DOF.INI: of a body that is its own mirror image they are as good as right-handed ones.

use crate::math::Vec3;
use crate::scene::{BodyId, BodyPart, BodyShape, ContactorShape, Scene};

/// Ratio of distance to size, up to which a vertex is the mirror image of another: files have seven digits.
const MIRROR_TOLERANCE: f64 = 1e-5;

/// Axis that can be reversed without changing the shape of a body: its shape, with the points of wires and rods, is symmetric to
/// the plane across that axis, and no rotation or moment about it is imposed. `None` if there is none.
pub fn reversible_axis(scene: &Scene, body: BodyId) -> Option<usize> {
    let is_zero = |value: &cd_formats::drv_dof::Evolution| value.is_constant() && value.value_at(0.0) == 0.0;
    let is_imposed = |axis: usize| {
        let drives = scene.drives.iter().filter(|drive| drive.body == body);
        let driven = drives.flat_map(|drive| drive.rates_about(axis)).any(|value| !is_zero(value));
        let loads = scene.loads.iter().filter(|load| load.body == body && load.component == 3 + axis);
        driven || loads.into_iter().any(|load| !is_zero(&load.value))
    };
    // A point of a wire or rod would be moved.
    let is_linked = |axis: usize| {
        let ends = scene.links.iter().flat_map(|link| link.bodies.into_iter().zip(link.offsets));
        ends.into_iter().any(|(linked_body, offset)| linked_body == body && offset[axis] != 0.0)
    };
    (0..3).rev().find(|&axis| is_symmetric(scene, body, axis) && !is_imposed(axis) && !is_linked(axis))
}

/// Whether the shape of a body is its own mirror image across this of its axes; always so for spheres.
fn is_symmetric(scene: &Scene, body: BodyId, axis: usize) -> bool {
    if scene.bodies[body.index()].shape != BodyShape::Parts {
        return true;
    }
    let parts = scene.parts_of(body);
    let size = parts.iter().map(|part| part.offset.norm() + part.bounding_radius).fold(0.0, f64::max);
    // The sides of a surface would be exchanged.
    let is_mesh = |part: &BodyPart| matches!(part.geometry, ContactorShape::Mesh(_));
    !parts.iter().any(is_mesh)
        && parts.iter().all(|part| {
            let mirrored: Vec<Vec3> = corners(part)
                .into_iter()
                .map(|mut corner| {
                    corner[axis] = -corner[axis];
                    corner
                })
                .collect();
            parts.iter().any(|other| is_same_shape(part, other) && is_same_set(&mirrored, &corners(other), size))
        })
}

/// Whether two contactors have the same kind, colour and bounding radius.
fn is_same_shape(a: &BodyPart, b: &BodyPart) -> bool {
    std::mem::discriminant(&a.geometry) == std::mem::discriminant(&b.geometry)
        && a.colour == b.colour
        && (a.bounding_radius - b.bounding_radius).abs() <= MIRROR_TOLERANCE * a.bounding_radius
}

/// Whether each point has one of the others next to it.
fn is_same_set(points: &[Vec3], others: &[Vec3], size: f64) -> bool {
    let is_near = |a: &Vec3, b: &Vec3| (a - b).amax() <= MIRROR_TOLERANCE * size;
    points.len() == others.len() && points.iter().all(|point| others.iter().any(|other| is_near(point, other)))
}

/// Points of a part in the frame of its body, m, which determine its shape together with its kind and bounding radius.
fn corners(part: &BodyPart) -> Vec<Vec3> {
    let body_point = |local: Vec3| part.offset + part.axes * local;
    match &part.geometry {
        ContactorShape::Sphere { .. } => vec![part.offset],
        ContactorShape::Cylinder { half_height, .. } | ContactorShape::Capsule { half_length: half_height, .. } => {
            [1.0, -1.0].map(|side| body_point(Vec3::z() * side * *half_height)).into()
        }
        ContactorShape::Polyhedron(shape) => shape.vertices().iter().map(|vertex| body_point(*vertex)).collect(),
        ContactorShape::Plane { cuboid, .. } => cuboid.vertices().iter().map(|vertex| body_point(*vertex)).collect(),
        ContactorShape::Mesh(mesh) => mesh.vertices().iter().map(|vertex| body_point(*vertex)).collect(),
    }
}

/// Reverses one of three axes. Returns the axes, and the same vector in components along them.
pub fn reverse_axis(axes: [Vec3; 3], axis: usize, components: &Vec3) -> ([Vec3; 3], Vec3) {
    let (mut axes, mut components) = (axes, *components);
    axes[axis] = -axes[axis];
    components[axis] = -components[axis];
    (axes, components)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vector_is_the_same_along_reversed_axes() {
        let turn = crate::math::Quat::from_scaled_axis(Vec3::new(0.3, -1.1, 0.7));
        let axes = [turn * Vec3::x(), turn * Vec3::y(), -(turn * Vec3::z())];
        let components = Vec3::new(1.0, 2.0, 3.0);
        let sum = |axes: [Vec3; 3], components: Vec3| {
            axes[0] * components.x + axes[1] * components.y + axes[2] * components.z
        };
        for axis in 0..3 {
            let (turned, along) = reverse_axis(axes, axis, &components);
            assert!((sum(turned, along) - sum(axes, components)).norm() < 1e-15);
            assert!((turned[0].cross(&turned[1]).dot(&turned[2]) - 1.0).abs() < 1e-15);
        }
    }
}

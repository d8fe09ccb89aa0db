//! Rigid motion of the free bodies as a whole.

use crate::math::{Mat3, Quat, Vec3};
use crate::scene::Scene;

/// Mean over the free bodies, weighted by mass, of positions or velocities.
pub(super) fn centre_of_mass(scene: &Scene, x: &[Vec3]) -> Vec3 {
    let (moment, mass) = scene.free.iter().fold((Vec3::zeros(), 0.0), |(moment, mass), &i| {
        let m = scene.bodies[i.index()].mass;
        (moment + x[i.index()] * m, mass + m)
    });
    moment / mass
}

/// Rigid rotation (rad/s) of the free bodies that has the angular momentum `impulse` (N m s) about their centre of mass; 0 if
/// they lie on a line and have no inertia about it. In a scene that is periodic along one axis, which `impulse` is then
/// parallel to, the rotation is about this axis alone: the position of a body along it is arbitrary.
pub(super) fn rigid_spin(scene: &Scene, x: &[Vec3], q: &[Quat], impulse: Vec3) -> Vec3 {
    let centre = centre_of_mass(scene, x);
    let momentum = |spin: Vec3| -> Vec3 {
        scene.free.iter().map(|&i| i.index()).fold(Vec3::zeros(), |sum, i| {
            let (body, arm) = (&scene.bodies[i], x[i] - centre);
            sum + arm.cross(&spin.cross(&arm)) * body.mass + body.angular_momentum(&q[i], &spin)
        })
    };
    let inertia = Mat3::from_columns(&[Vec3::x(), Vec3::y(), Vec3::z()].map(momentum));
    if let Some(k) = scene.options.periods().iter().position(Option::is_some) {
        let moment = inertia[(k, k)];
        return Vec3::ith(k, if moment > 0.0 { impulse[k] / moment } else { 0.0 });
    }
    inertia.try_inverse().map_or(Vec3::zeros(), |inverse| inverse * impulse)
}

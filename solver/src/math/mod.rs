//! Kernel: vectors, rotations, orthonormal frames, spatial order.

pub mod morton;
pub mod random;
pub mod rotation;
pub mod simd;

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

pub type Vec3 = Vector3<f64>;
pub type Mat3 = Matrix3<f64>;
pub type Quat = UnitQuaternion<f64>;

/// Length of `v`. It equals that of nalgebra to the bit, which computes the root by an instruction that makes surrounding
/// code of wide vectors wait for 150 cycles.
#[inline(always)]
pub fn vector_length(v: &Vec3) -> f64 {
    v.norm_squared().sqrt()
}

/// The orthonormal local frame (n, t, s), one a row, n x t = s, for a unit normal `n`.
///
/// t and s are conventional: they are continuous in n except where n_z changes sign.
/// Source: T. Duff et al., Building an orthonormal basis, revisited, JCGT 6(1) (2017) 1-8.
///
/// ```
/// # use cd_solve::math::{Vec3, local_frame};
/// let [n, t, s] = local_frame(Vec3::z());
/// assert_eq!((n, t, s), (Vec3::z(), Vec3::x(), Vec3::y()));
/// ```
pub fn local_frame(n: Vec3) -> [Vec3; 3] {
    let sign = 1.0f64.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    let t = Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x);
    let s = Vec3::new(b, sign + n.y * n.y * a, -n.y);
    [n, t, s]
}

/// Components of `vector` along the rows of `frame`.
pub fn to_local(frame: &[Vec3; 3], vector: &Vec3) -> Vec3 {
    Vec3::new(frame[0].dot(vector), frame[1].dot(vector), frame[2].dot(vector))
}

/// Vector with `components` along the rows of `frame`.
pub fn to_world(frame: &[Vec3; 3], components: &Vec3) -> Vec3 {
    frame[0] * components.x + frame[1] * components.y + frame[2] * components.z
}

/// Square of the angle up to which four terms of cosine and sine are exact to round-off: (0.01/4)^4/8! < 1e-15.
const MAX_SERIES_ANGLE_SQUARED: f64 = 0.01;

/// Orientation `q` after a rotation by the vector `angle` (rad, world frame), of unit norm to round-off.
pub fn rotate_by_vector(q: &Quat, angle: &Vec3) -> Quat {
    // cos(a/2) and sin(a/2)/a.
    let a2 = angle.norm_squared();
    let (cos, sinc) = if a2 < MAX_SERIES_ANGLE_SQUARED {
        (
            1.0 - a2 / 8.0 * (1.0 - a2 / 48.0 * (1.0 - a2 / 120.0 * (1.0 - a2 / 224.0))),
            0.5 - a2 / 48.0 * (1.0 - a2 / 80.0 * (1.0 - a2 / 168.0)),
        )
    } else {
        let a = a2.sqrt();
        ((0.5 * a).cos(), (0.5 * a).sin() / a)
    };
    let v = angle * sinc;
    let turned = Quaternion::new(cos, v.x, v.y, v.z) * q.into_inner();
    // A Newton step for 1/sqrt, exact to round-off for a norm so near 1.
    let off = turned.norm_squared() - 1.0;
    if off.abs() < 1e-8 { Quat::new_unchecked(turned * (1.0 - 0.5 * off)) } else { Quat::new_normalize(turned) }
}

/// Smallest number of items per task, for loops of little work per item.
pub const PAR_MIN_LEN: usize = 2048;

/// Indices 0.. of `keys` grouped by key (each below `groups`) and in order within a group, and the start of each group with
/// the end of the last: a counting sort.
///
/// ```
/// # use cd_solve::math::group_by_key;
/// assert_eq!(group_by_key(&[2, 0, 2, 1], 3), (vec![1, 3, 0, 2], vec![0, 1, 2, 4]));
/// ```
pub fn group_by_key(keys: &[u32], groups: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0; groups + 1];
    keys.iter().for_each(|&key| starts[key as usize + 1] += 1);
    for g in 0..groups {
        starts[g + 1] += starts[g];
    }
    let mut next = starts.clone();
    let mut order = vec![0; keys.len()];
    for (index, &key) in keys.iter().enumerate() {
        order[next[key as usize] as usize] = index as u32;
        next[key as usize] += 1;
    }
    (order, starts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn local_frames_are_orthonormal_and_right_handed() {
        let mut normals = vec![Vec3::x(), -Vec3::x(), Vec3::y(), -Vec3::y(), Vec3::z(), -Vec3::z()];
        normals.extend((0..200).map(|k| {
            let k = k as f64;
            Vec3::new((1.3 * k).sin(), (2.1 * k).cos(), (0.7 * k).sin() * 1e-3).normalize()
        }));
        for n in normals {
            let [n, t, s] = local_frame(n);
            // Each entry is a handful of products of numbers up to 1.
            assert!((n.cross(&t) - s).norm() < 1e-15, "{n} {t} {s}");
            assert!((t.norm() - 1.0).abs() < 1e-15 && t.dot(&n).abs() < 1e-15);
        }
    }

    #[test]
    fn rotations_by_small_and_large_angles() {
        let q = Quat::from_euler_angles(0.3, -1.2, 2.0);
        for size in [0.0, 1e-300, 1e-9, 1e-3, 0.0999, 0.1, 0.1001, 2.0, 7.0] {
            let angle = Vec3::new(2.0, -1.0, 0.5).normalize() * size;
            let exact = Quat::from_scaled_axis(angle) * q;
            // A few roundings of numbers up to 1.
            assert!((rotate_by_vector(&q, &angle).coords - exact.coords).norm() < 5e-16, "{size}");
        }
    }

    #[test]
    fn rotations_keep_the_norm_over_many_steps() {
        let mut q = Quat::identity();
        for _ in 0..100_000 {
            q = rotate_by_vector(&q, &Vec3::new(0.01, -0.02, 0.003));
        }
        assert!((q.into_inner().norm() - 1.0).abs() < 1e-15);
    }
}

//! Kernel: vectors, motions and loads of bodies, rotations, orthonormal frames, spatial order.

pub mod morton;
pub mod random;
pub mod rotation;
pub mod simd;

use std::ops::Range;

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use rayon::prelude::*;

/// Vector.
pub type Vec3 = Vector3<f64>;
/// 3x3 matrix.
pub type Mat3 = Matrix3<f64>;
/// Orientation or rotation.
pub type Quat = UnitQuaternion<f64>;

/// Velocity (m/s) of a point of a body and its angular velocity (rad/s).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Twist {
    pub v: Vec3,
    pub w: Vec3,
}

impl Twist {
    /// Velocity of the body at the end of an `arm` (m) from the point, m/s.
    pub fn velocity_at(&self, arm: &Vec3) -> Vec3 {
        self.v + self.w.cross(arm)
    }

    /// Components of the velocity, then of the angular velocity.
    pub fn components(&self) -> [f64; 6] {
        six_components(&self.v, &self.w)
    }
}

/// Force (N) on a body and its torque (N m) about a point, or impulse (N s) and angular impulse (N m s).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Wrench {
    pub force: Vec3,
    pub torque: Vec3,
}

impl Wrench {
    /// Load of the same force about the point at the end of an `arm` (m) from this one.
    ///
    /// ```
    /// # use cd_solve::math::{Vec3, Wrench};
    /// let weight = Wrench { force: -Vec3::z(), torque: Vec3::zeros() };
    /// assert_eq!(weight.moved_by(&Vec3::x()).torque, -Vec3::y());
    /// ```
    pub fn moved_by(&self, arm: &Vec3) -> Wrench {
        Wrench { force: self.force, torque: self.torque - arm.cross(&self.force) }
    }

    /// Components of the force, then of the torque.
    pub fn components(&self) -> [f64; 6] {
        six_components(&self.force, &self.torque)
    }
}

fn six_components(a: &Vec3, b: &Vec3) -> [f64; 6] {
    [a.x, a.y, a.z, b.x, b.y, b.z]
}

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
        let (sin, cos) = libm::sincos(0.5 * a);
        (cos, sin / a)
    };
    let v = angle * sinc;
    let turned = Quaternion::new(cos, v.x, v.y, v.z) * q.into_inner();
    // A Newton step for 1/sqrt: its error is the square of that of the norm, below round-off.
    let norm_error = turned.norm_squared() - 1.0;
    if norm_error.abs() < 1e-8 {
        Quat::new_unchecked(turned * (1.0 - 0.5 * norm_error))
    } else {
        Quat::new_normalize(turned)
    }
}

/// Smallest number of items per task, for loops of little work per item.
pub const PAR_MIN_LEN: usize = 2048;

/// Consecutive ranges of at least `length` items, the last of the rest, that part no two neighbours which are the same.
///
/// ```
/// # use cd_solve::math::run_ranges;
/// assert_eq!(run_ranges(&[1, 2, 2, 2, 3, 3, 4], 2, |a, b| a == b), [0..4, 4..6, 6..7]);
/// ```
pub fn run_ranges<T>(list: &[T], length: usize, are_same: impl Fn(&T, &T) -> bool) -> Vec<Range<usize>> {
    let (mut ranges, mut start) = (Vec::with_capacity(list.len() / length + 1), 0);
    while start < list.len() {
        let mut end = list.len().min(start + length);
        while end < list.len() && are_same(&list[end - 1], &list[end]) {
            end += 1;
        }
        ranges.push(start..end);
        start = end;
    }
    ranges
}

/// The items of all lists, one list after the other.
pub fn concatenated_lists<T: Copy + Default + Send + Sync>(lists: Vec<Vec<T>>) -> Vec<T> {
    if rayon::current_num_threads() <= 2 {
        return lists.concat();
    }
    let mut all = vec![T::default(); lists.iter().map(Vec::len).sum()];
    let mut unfilled = &mut all[..];
    let parts: Vec<&mut [T]> =
        lists.iter().map(|list| unfilled.split_off_mut(..list.len()).unwrap_or_default()).collect();
    parts.into_par_iter().zip(lists).for_each(|(part, list)| part.copy_from_slice(&list));
    all
}

/// Sorts a list that consists of a few sorted runs by a key that no two items share. Merging them in parallel copies more,
/// and is faster from three threads on.
pub fn sort_runs_by_key<T: Send, K: Ord>(list: &mut [T], key: impl Fn(&T) -> K + Sync) {
    if rayon::current_num_threads() > 2 { list.par_sort_by_key(key) } else { list.sort_by_key(key) }
}

/// Indices 0.. of `keys` grouped by key (each below `groups`) and in order within a group, and the start of each group with
/// the end of the last: a counting sort.
///
/// ```
/// # use cd_solve::math::group_by_key;
/// assert_eq!(group_by_key(&[2, 0, 2, 1], 3), (vec![1, 3, 0, 2], vec![0, 1, 2, 4]));
/// ```
pub fn group_by_key(keys: &[u32], groups: usize) -> (Vec<u32>, Vec<u32>) {
    let tasks = rayon::current_num_threads().min(keys.len() / PAR_MIN_LEN);
    if tasks >= MIN_GROUPING_TASKS { group_in_tasks(keys, groups, tasks) } else { group_in_one_task(keys, groups) }
}

/// Smallest number of tasks that together group keys faster than one: each key is read and written twice.
const MIN_GROUPING_TASKS: usize = 4;

fn group_in_one_task(keys: &[u32], groups: usize) -> (Vec<u32>, Vec<u32>) {
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

/// Groups keys in tasks, first over ranges of keys and then over ranges of groups; the result does not depend on the tasks.
fn group_in_tasks(keys: &[u32], groups: usize, tasks: usize) -> (Vec<u32>, Vec<u32>) {
    let range_bits = groups.div_ceil(tasks).next_power_of_two().trailing_zeros();
    let ranges = groups.div_ceil(1 << range_bits);
    let length = keys.len().div_ceil(tasks);
    let by_range = |(task, keys): (usize, &[u32])| {
        let mut by_range = vec![Vec::new(); ranges];
        for (index, key) in ((task * length) as u32..).zip(keys) {
            by_range[(key >> range_bits) as usize].push(index);
        }
        by_range
    };
    let indices: Vec<Vec<Vec<u32>>> = keys.par_chunks(length).enumerate().with_max_len(1).map(by_range).collect();
    let indices_of = |range: usize| indices.iter().flat_map(move |by_range| &by_range[range]);

    let (mut order, mut starts) = (vec![0; keys.len()], vec![0; groups + 1]);
    let (mut order_left, mut first, mut parts) = (&mut order[..], 0, Vec::with_capacity(ranges));
    for (range, ends) in starts[1..].chunks_mut(1 << range_bits).enumerate() {
        let count = indices.iter().map(|by_range| by_range[range].len()).sum();
        parts.push((range, first, order_left.split_off_mut(..count).unwrap_or_default(), ends));
        first += count as u32;
    }
    parts.into_par_iter().with_max_len(1).for_each(|(range, first, order, ends)| {
        let group = |index: u32| keys[index as usize] as usize - (range << range_bits);
        indices_of(range).for_each(|&index| ends[group(index)] += 1);
        let mut next = vec![0; ends.len()];
        let mut sum = 0;
        for (next, end) in next.iter_mut().zip(&mut *ends) {
            *next = sum;
            sum += *end;
            *end = first + sum;
        }
        for &index in indices_of(range) {
            let next = &mut next[group(index)];
            order[*next as usize] = index;
            *next += 1;
        }
    });
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
    fn lists_are_concatenated_on_any_number_of_threads() {
        let lists: Vec<Vec<u32>> = (0..20u32).map(|k| (0..k % 5).map(|j| 10 * k + j).collect()).collect();
        for threads in [1, 4] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert_eq!(pool.install(|| concatenated_lists(lists.clone())), lists.concat());
        }
    }

    #[test]
    fn any_number_of_tasks_groups_alike() {
        let keys: Vec<u32> = (0..1000u32).map(|k| k * k % 97).collect();
        for groups in [97, 100, 5000] {
            let expected = group_in_one_task(&keys, groups);
            assert_eq!(expected.1.len(), groups + 1);
            for tasks in [1, 2, 3, 16, 200] {
                assert_eq!(group_in_tasks(&keys, groups, tasks), expected, "{groups} {tasks}");
            }
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

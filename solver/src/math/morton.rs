//! Order of points along Morton's curve, on which neighbours are near in space: bodies in this order are near in memory, and
//! blocks of them are compact.

use rayon::prelude::*;

use super::Vec3;

/// Bits of a key along each axis.
const AXIS_BITS: u32 = 21;

/// Points per task. Chosen: bounds, keys or the merge of as many points take 0.05 to 0.2 ms, far longer than the start of a
/// task.
pub const POINTS_PER_TASK: usize = 1 << 14;

/// A point with its position on the curve.
#[derive(Clone, Copy)]
pub struct MortonKey {
    pub key: u64,
    pub index: u32,
}

/// `count` points, not yet on a curve. They start in the order `approximate_order`, if it has this length: a nearly sorted
/// order reduces the time to sort, and does not change the result, except that points that all coincide keep it.
pub fn unsorted_keys(count: usize, approximate_order: &[u32]) -> Vec<MortonKey> {
    let key = |index| MortonKey { key: 0, index };
    if approximate_order.len() == count {
        approximate_order.iter().copied().map(key).collect()
    } else {
        (0..count as u32).map(key).collect()
    }
}

/// Indices of the points along the curve; a good `approximate_order`, such as the order of the last step, saves time.
pub fn morton_order(positions: &[Vec3], approximate_order: &[u32]) -> Vec<u32> {
    let mut keys = unsorted_keys(positions.len(), approximate_order);
    if !positions.is_empty() {
        sort_keys(&mut keys, positions);
    }
    keys.into_iter().map(|key| key.index).collect()
}

/// Sort key of a point: its position on the curve, then its index.
fn sort_key(key: &MortonKey) -> (u64, u32) {
    (key.key, key.index)
}

/// Spreads the low 21 bits of `x` to every third bit.
fn spread_bits(x: u64) -> u64 {
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// Computes the keys of the points on the curve through the cube around them, and sorts by key, then by index. Returns false, with
/// `keys` unchanged, if all points coincide.
pub fn sort_keys(keys: &mut [MortonKey], positions: &[Vec3]) -> bool {
    let bounds = |keys: &[MortonKey]| {
        let none = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
        keys.iter().fold(none, |(low, high), key| {
            let x = &positions[key.index as usize];
            (low.inf(x), high.sup(x))
        })
    };
    let all = keys.par_chunks(POINTS_PER_TASK).map(bounds).reduce_with(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)));
    let (low, high) = all.expect("points");
    let scale = (1u64 << AXIS_BITS) as f64 / (high - low).max();
    if !scale.is_finite() {
        return false;
    }
    let largest = (1u64 << AXIS_BITS) - 1;
    keys.par_chunks_mut(POINTS_PER_TASK).flatten_iter().for_each(|key| {
        let cell = (positions[key.index as usize] - low) * scale;
        let [x, y, z] = [cell.x, cell.y, cell.z].map(|x| spread_bits((x as u64).min(largest)));
        key.key = x | y << 1 | z << 2;
    });
    if try_insertion_sort(keys) {
        return true;
    }
    let parts = if keys.len() < 2 * POINTS_PER_TASK { 1 } else { rayon::current_num_threads().next_power_of_two() };
    merge_sort(keys, &mut keys.to_vec(), parts, false);
    true
}

/// Sorts by insertion, as long as keys move by at most one position on average; returns false if that was not enough.
fn try_insertion_sort(keys: &mut [MortonKey]) -> bool {
    let mut moved = 0;
    for i in 1..keys.len() {
        let key = keys[i];
        let mut to = i;
        while to > 0 && sort_key(&keys[to - 1]) > sort_key(&key) {
            keys[to] = keys[to - 1];
            to -= 1;
        }
        keys[to] = key;
        moved += i - to;
        if moved > keys.len() {
            return false;
        }
    }
    true
}

/// Sorts `parts` parts in parallel and merges them, into `buffer` if `into_buffer`, else into `keys`. At first `buffer` is a copy
/// of `keys`. The result does not depend on `parts`: no two keys are equal in key and index.
fn merge_sort(keys: &mut [MortonKey], buffer: &mut [MortonKey], parts: usize, into_buffer: bool) {
    if parts <= 1 {
        radix_sort(keys, buffer);
        if into_buffer {
            buffer.copy_from_slice(keys);
        }
        return;
    }
    let middle = keys.len() / 2;
    let ((left, right), (left_buffer, right_buffer)) = (keys.split_at_mut(middle), buffer.split_at_mut(middle));
    rayon::join(
        || merge_sort(left, left_buffer, parts / 2, !into_buffer),
        || merge_sort(right, right_buffer, parts / 2, !into_buffer),
    );
    if into_buffer { merge_runs(left, right, buffer) } else { merge_runs(left_buffer, right_buffer, keys) }
}

/// Merges two sorted runs into `merged`.
fn merge_runs(left: &[MortonKey], right: &[MortonKey], merged: &mut [MortonKey]) {
    if merged.len() > 2 * POINTS_PER_TASK {
        let (long, short) = if left.len() >= right.len() { (left, right) } else { (right, left) };
        let half = long.len() / 2;
        let cut = short.partition_point(|k| sort_key(k) < sort_key(&long[half]));
        let (low, high) = merged.split_at_mut(half + cut);
        rayon::join(
            || merge_runs(&long[..half], &short[..cut], low),
            || merge_runs(&long[half..], &short[cut..], high),
        );
        return;
    }
    let (mut i, mut j) = (0, 0);
    for key in merged {
        let takes_left = j == right.len() || (i < left.len() && sort_key(&left[i]) < sort_key(&right[j]));
        *key = if takes_left { left[i] } else { right[j] };
        (i, j) = (i + takes_left as usize, j + !takes_left as usize);
    }
}

/// Sorts by key: by counting over the first three digits, then by comparison among keys with equal first digits.
fn radix_sort(keys: &mut [MortonKey], buffer: &mut [MortonKey]) {
    const DIGIT_BITS: u32 = 11;
    const COUNTED_FROM_BIT: u32 = 3 * AXIS_BITS - 3 * DIGIT_BITS;
    // Comparison is faster for few keys, as there are more counts than keys.
    if keys.len() < 1 << 10 {
        return keys.sort_unstable_by_key(sort_key);
    }
    let mut starts = [[0u32; 1 << DIGIT_BITS]; 3];
    let digit = |k: &MortonKey, pass: usize| {
        (k.key >> (COUNTED_FROM_BIT + pass as u32 * DIGIT_BITS)) as usize & ((1 << DIGIT_BITS) - 1)
    };
    for k in &*keys {
        for (pass, starts) in starts.iter_mut().enumerate() {
            starts[digit(k, pass)] += 1;
        }
    }
    for starts in &mut starts {
        let mut sum = 0;
        for start in starts {
            (sum, *start) = (sum + *start, sum);
        }
    }
    let mut distribute = |from: &[MortonKey], to: &mut [MortonKey], pass: usize| {
        for k in from {
            let start = &mut starts[pass][digit(k, pass)];
            to[*start as usize] = *k;
            *start += 1;
        }
    };
    distribute(keys, buffer, 0);
    distribute(buffer, keys, 1);
    distribute(keys, buffer, 2);
    keys.copy_from_slice(buffer);
    for run in keys.chunk_by_mut(|a, b| a.key >> COUNTED_FROM_BIT == b.key >> COUNTED_FROM_BIT) {
        if run.len() > 1 {
            run.sort_unstable_by_key(sort_key);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nine in ten of the points are apart, the others coincide with one of these.
    fn points(count: usize) -> Vec<Vec3> {
        let at = |k: usize| Vec3::new(1.1, 2.3, 3.7).map(|f| (f * (k - k % 10 / 9) as f64).sin());
        (0..count).map(at).collect()
    }

    #[test]
    fn where_sorting_starts_changes_nothing() {
        for count in [0, 1, 2, 700, 40_000] {
            let x = points(count);
            let sorted = morton_order(&x, &[]);
            assert_eq!(sorted, morton_order(&x, &sorted));
            let back: Vec<u32> = sorted.iter().rev().copied().collect();
            assert_eq!(sorted, morton_order(&x, &back));
            let mut near = sorted.clone();
            near.chunks_exact_mut(7).for_each(|few| few.swap(2, 5));
            assert_eq!(sorted, morton_order(&x, &near));
            // An order for another number of points is not used.
            assert_eq!(sorted, morton_order(&x, &near[..count / 2]));
        }
    }

    #[test]
    fn few_out_of_place_are_sorted_by_moves() {
        let mut keys: Vec<MortonKey> = (0..1000).map(|k| MortonKey { key: k / 2, index: k as u32 }).collect();
        keys.chunks_exact_mut(10).for_each(|few| few.swap(3, 6));
        assert!(try_insertion_sort(&mut keys));
        assert!(keys.is_sorted_by_key(sort_key));
        keys.reverse();
        assert!(!try_insertion_sort(&mut keys));
    }
}

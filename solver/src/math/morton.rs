//! Points along Morton's curve: what is near on it is near in space.

use rayon::prelude::*;

use super::Vec3;

/// Bits of a key along each axis.
const BITS: u32 = 21;

/// Points that a task treats alike, one after the other.
pub const CHUNK: usize = 1 << 14;

/// A point, and where it is on the curve.
#[derive(Clone, Copy)]
pub struct Key {
    pub key: u64,
    pub index: u32,
}

/// `count` points, not yet on a curve. They start in the order `about`, if that has as many: one that is near to theirs
/// takes less time to sort, and no order changes the result.
pub fn unsorted(count: usize, about: &[u32]) -> Vec<Key> {
    let key = |index| Key { key: 0, index };
    if about.len() == count { about.iter().copied().map(key).collect() } else { (0..count as u32).map(key).collect() }
}

/// The points along the curve, from an order that may be near to theirs.
pub fn order(positions: &[Vec3], about: &[u32]) -> Vec<u32> {
    let mut keys = unsorted(positions.len(), about);
    if !positions.is_empty() {
        sort(&mut keys, positions);
    }
    keys.into_iter().map(|key| key.index).collect()
}

/// Where a point comes among others.
fn place(key: &Key) -> (u64, u32) {
    (key.key, key.index)
}

/// Spreads the low 21 bits of `x` to every third.
fn spread(x: u64) -> u64 {
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// Gives `keys` their points' places on the curve through the cube around them, and sorts them by these and their index;
/// false if all points coincide.
pub fn sort(keys: &mut [Key], positions: &[Vec3]) -> bool {
    let bounds = |keys: &[Key]| {
        let none = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
        keys.iter().fold(none, |(low, high), key| {
            let x = &positions[key.index as usize];
            (low.inf(x), high.sup(x))
        })
    };
    let all = keys.par_chunks(CHUNK).map(bounds).reduce_with(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)));
    let (low, high) = all.expect("points");
    let scale = (1u64 << BITS) as f64 / (high - low).max();
    if !scale.is_finite() {
        return false;
    }
    let most = (1u64 << BITS) - 1;
    keys.par_chunks_mut(CHUNK).flatten_iter().for_each(|key| {
        let at = (positions[key.index as usize] - low) * scale;
        let [x, y, z] = [at.x, at.y, at.z].map(|x| spread((x as u64).min(most)));
        key.key = x | y << 1 | z << 2;
    });
    if sort_few(keys) {
        return true;
    }
    let parts = if keys.len() < 2 * CHUNK { 1 } else { rayon::current_num_threads().next_power_of_two() };
    merge_sort(keys, &mut keys.to_vec(), parts, false);
    true
}

/// Moves each key down to its place, as long as they are moved by one place each in the mean; false if that was not enough.
fn sort_few(keys: &mut [Key]) -> bool {
    let mut moved = 0;
    for i in 1..keys.len() {
        let key = keys[i];
        let mut to = i;
        while to > 0 && place(&keys[to - 1]) > place(&key) {
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

/// Sorts as many `parts` side by side and merges them, in `keys` or `into` the other, which has the same content. The
/// result does not depend on the parts: no two keys are equal in key and index.
fn merge_sort(keys: &mut [Key], other: &mut [Key], parts: usize, into: bool) {
    if parts <= 1 {
        radix_sort(keys, other);
        if into {
            other.copy_from_slice(keys);
        }
        return;
    }
    let middle = keys.len() / 2;
    let ((one, two), (other_one, other_two)) = (keys.split_at_mut(middle), other.split_at_mut(middle));
    rayon::join(|| merge_sort(one, other_one, parts / 2, !into), || merge_sort(two, other_two, parts / 2, !into));
    if into { merge(one, two, other) } else { merge(other_one, other_two, keys) }
}

/// Merges two sorted runs.
fn merge(one: &[Key], two: &[Key], out: &mut [Key]) {
    if out.len() > 2 * CHUNK {
        let (long, short) = if one.len() >= two.len() { (one, two) } else { (two, one) };
        let half = long.len() / 2;
        let cut = short.partition_point(|k| place(k) < place(&long[half]));
        let (low, high) = out.split_at_mut(half + cut);
        rayon::join(|| merge(&long[..half], &short[..cut], low), || merge(&long[half..], &short[cut..], high));
        return;
    }
    let (mut i, mut j) = (0, 0);
    for key in out {
        let first = j == two.len() || (i < one.len() && place(&one[i]) < place(&two[j]));
        *key = if first { one[i] } else { two[j] };
        (i, j) = (i + first as usize, j + !first as usize);
    }
}

/// Sorts by key: by counting over the first bits, then by comparison among the few whose first bits agree.
fn radix_sort(keys: &mut [Key], other: &mut [Key]) {
    const DIGIT: u32 = 11;
    const LOWEST: u32 = 3 * BITS - 3 * DIGIT;
    if keys.len() < 1 << 10 {
        return keys.sort_unstable_by_key(place);
    }
    let mut starts = [[0u32; 1 << DIGIT]; 3];
    let digit = |k: &Key, pass: usize| (k.key >> (LOWEST + pass as u32 * DIGIT)) as usize & ((1 << DIGIT) - 1);
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
    let mut count_out = |from: &[Key], to: &mut [Key], pass: usize| {
        for k in from {
            let start = &mut starts[pass][digit(k, pass)];
            to[*start as usize] = *k;
            *start += 1;
        }
    };
    count_out(keys, other, 0);
    count_out(other, keys, 1);
    count_out(keys, other, 2);
    keys.copy_from_slice(other);
    for run in keys.chunk_by_mut(|a, b| a.key >> LOWEST == b.key >> LOWEST) {
        if run.len() > 1 {
            run.sort_unstable_by_key(place);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nine in ten of them apart, the others in one place with one of these.
    fn points(count: usize) -> Vec<Vec3> {
        let at = |k: usize| Vec3::new(1.1, 2.3, 3.7).map(|f| (f * (k - k % 10 / 9) as f64).sin());
        (0..count).map(at).collect()
    }

    #[test]
    fn where_sorting_starts_changes_nothing() {
        for count in [0, 1, 2, 700, 40_000] {
            let x = points(count);
            let sorted = order(&x, &[]);
            assert_eq!(sorted, order(&x, &sorted));
            let back: Vec<u32> = sorted.iter().rev().copied().collect();
            assert_eq!(sorted, order(&x, &back));
            let mut near = sorted.clone();
            near.chunks_exact_mut(7).for_each(|few| few.swap(2, 5));
            assert_eq!(sorted, order(&x, &near));
            // Of another number of points: no start.
            assert_eq!(sorted, order(&x, &near[..count / 2]));
        }
    }

    #[test]
    fn few_out_of_place_are_sorted_by_moves() {
        let mut keys: Vec<Key> = (0..1000).map(|k| Key { key: k / 2, index: k as u32 }).collect();
        keys.chunks_exact_mut(10).for_each(|few| few.swap(3, 6));
        assert!(sort_few(&mut keys));
        assert!(keys.is_sorted_by_key(place));
        keys.reverse();
        assert!(!sort_few(&mut keys));
    }
}

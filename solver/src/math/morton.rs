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

/// `count` points, not yet on a curve.
pub fn unsorted(count: usize) -> Vec<Key> {
    (0..count as u32).map(|index| Key { key: 0, index }).collect()
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
    let parts = if keys.len() < 2 * CHUNK { 1 } else { rayon::current_num_threads().next_power_of_two() };
    merge_sort(keys, &mut keys.to_vec(), parts, false);
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
    let place = |k: &Key| (k.key, k.index);
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
        return keys.sort_unstable_by_key(|k| (k.key, k.index));
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
            run.sort_unstable_by_key(|k| (k.key, k.index));
        }
    }
}

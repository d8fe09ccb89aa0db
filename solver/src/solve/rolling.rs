//! Rolling and spinning friction: a contact's moment follows its impulse.
//!
//! With the other impulses frozen the moment m of two bodies sees their relative angular velocity w = W_r m + b, of spheres
//! W_r = 1/I_a + 1/I_b. Its part in the tangent plane resists rolling and is at most mu_r R r̂_n, its part along n resists
//! spinning and is at most mu_s R r̂_n; below these bounds nothing rolls or spins, at them the moment is opposite to
//! w_T, or to w_n. As Coulomb's law of the sliding friction, with r̂_n of the same contact, just solved.
//!
//! A scene without such contacts never comes here.

use std::ops::Range;

use crate::assemble::System;
use crate::math::Vec3;
use crate::math::lanes::{Arithmetic, Number};
use crate::solve::batches::{BATCH, NONE, put};
use crate::solve::local::{Triple, dot, triple, within};

/// Resistance of sixteen contacts to rolling and spinning, [`crate::assemble::Roll`], and their moments.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct Rolls<T = f64> {
    shift: [[T; BATCH]; 3],
    /// 0 where nothing resists, as all else.
    inverse_w: [T; BATCH],
    /// Most moment over the normal impulse against rolling and against spinning, m.
    rolling: [T; BATCH],
    spinning: [T; BATCH],
    /// Moments on the candidates of the last sweep and of the one before, N m s.
    m: [[T; BATCH]; 3],
    previous: [[T; BATCH]; 3],
    /// Place among the system's rolls, or [`NONE`].
    places: [u32; BATCH],
}

impl<T: Number> Rolls<T> {
    pub const NONE: Self = Rolls {
        shift: [[T::ZERO; BATCH]; 3],
        inverse_w: [T::ZERO; BATCH],
        rolling: [T::ZERO; BATCH],
        spinning: [T::ZERO; BATCH],
        m: [[T::ZERO; BATCH]; 3],
        previous: [[T::ZERO; BATCH]; 3],
        places: [NONE; BATCH],
    };

    /// Puts the resistance of row `k` into a place, if it has one, to start from its moment.
    #[inline(never)] // so that what scenes spend on it can be counted
    pub fn put(&mut self, lane: usize, system: &System, k: u32, moments: &[Vec3]) {
        let Ok(place) = system.rolls.binary_search_by_key(&k, |roll| roll.row) else { return };
        let (roll, m) = (&system.rolls[place], &moments[place]);
        put(&mut self.shift, lane, &roll.shift);
        self.inverse_w[lane] = T::of(roll.inverse_w);
        self.rolling[lane] = T::of(roll.rolling * roll.radius);
        self.spinning[lane] = T::of(roll.spinning * roll.radius);
        put(&mut self.m, lane, m);
        put(&mut self.previous, lane, m);
        self.places[lane] = place as u32;
    }

    /// Puts the moments into `moments`, one a roll of the system.
    pub fn read_back(&self, moments: &mut [Vec3]) {
        for (lane, &place) in self.places.iter().enumerate().filter(|(_, place)| **place != NONE) {
            moments[place as usize] = Vec3::from(self.m.map(|m| m[lane].wide()));
        }
    }

    /// Solves the moments at `places`, each from y = m + beta (m - m_before); returns what they have changed by.
    ///
    /// `n`: normals, `pressing`: r̂_n, N s, `w`: angular velocity of the candidate against the antagonist with y at work,
    /// rad/s.
    #[inline(always)]
    pub fn solve<L: Arithmetic<T = T>>(
        &mut self,
        l: L,
        places: Range<usize>,
        beta: L::V,
        n: Triple<L::V>,
        pressing: L::V,
        w: Triple<L::V>,
    ) -> Triple<L::V> {
        let (m, before) = (load3(l, &self.m, &places), load3(l, &self.previous, &places));
        let shift = load3(l, &self.shift, &places);
        let y = triple!(k => l.mul_add(beta, l.sub(m[k], before[k]), m[k]));
        let inverse_w = l.load(&self.inverse_w[places.clone()]);
        let stopping = triple!(k => l.neg_mul_add(l.add(w[k], shift[k]), inverse_w, y[k]));
        let rolling = l.mul(l.load(&self.rolling[places.clone()]), pressing);
        let spinning = l.mul(l.load(&self.spinning[places.clone()]), pressing);
        let new = bounded(l, n, stopping, rolling, spinning);
        for k in 0..3 {
            l.store(&mut self.previous[k][places.clone()], m[k]);
            l.store(&mut self.m[k][places.clone()], new[k]);
        }
        triple!(k => l.sub(new[k], y[k]))
    }
}

#[inline(always)]
fn load3<L: Arithmetic>(l: L, columns: &[[L::T; BATCH]; 3], places: &Range<usize>) -> Triple<L::V> {
    triple!(k => l.load(&columns[k][places.clone()]))
}

/// The nearest moment to `m` whose part along `n` is at most `spinning`, and that across at most `rolling`.
#[inline(always)]
fn bounded<L: Arithmetic>(l: L, n: Triple<L::V>, m: Triple<L::V>, rolling: L::V, spinning: L::V) -> Triple<L::V> {
    let along = dot(l, n, m);
    let across = within(l, triple!(k => l.neg_mul_add(n[k], along, m[k])), rolling);
    let least = l.sub(l.splat(0.0), spinning);
    let along = l.min(l.select_greater(along, least, along, least), spinning);
    triple!(k => l.mul_add(n[k], along, across[k]))
}

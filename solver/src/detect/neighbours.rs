//! Pairs that are near each other, or may come near in the next steps: so that they need not be looked for in each.
//!
//! Each thing has room to move in before they must be looked for again, and so they do not depend on the fastest: the lists
//! of L. Verlet, Phys. Rev. 159 (1967) 98-103, with skins of their own. Nothing but time depends on when that is done.

use rayon::prelude::*;

use crate::detect::periodic;
use crate::math::{MANY, Vec3};
use crate::state::Neighbours;

/// Room of what does not move, over the mean radius.
const ROOM: f64 = 0.01;
/// What moves has room for so many steps besides.
const STEPS: f64 = 6.0;
/// Mean room over the mean radius, beyond which pairs that are not near cost more than they save.
const MOST: f64 = 0.2;
/// Room where nothing is to be saved: what rounding may make of a distance.
const NONE: f64 = 1e-9;

impl Neighbours {
    /// Makes the pairs hold for things that are at `centres` and `reach` so far, m; whether they had to be looked for.
    ///
    /// `travel`: how far each may get in a step, m; `size`: the mean radius, m.
    pub fn renew(
        &mut self,
        centres: &[Vec3],
        reach: &[f64],
        travel: impl Fn(usize) -> f64 + Sync,
        periods: [Option<f64>; 2],
        size: f64,
    ) -> bool {
        let known = self.centres.len() == centres.len();
        let stays =
            |k: usize| (centres[k] - self.centres[k]).norm() + (reach[k] - self.reach[k]).max(0.0) <= self.room[k];
        if known && (0..centres.len()).into_par_iter().with_min_len(MANY).all(stays) {
            self.last.copy_from_slice(centres);
            return false;
        }
        let way = |k: usize| if known { (centres[k] - self.last[k]).norm() } else { travel(k) };
        self.room = (0..centres.len()).map(|k| ROOM * size + STEPS * way(k)).collect();
        if self.room.iter().sum::<f64>() > MOST * size * reach.len() as f64 {
            self.room.fill(NONE * size);
        }
        (self.centres, self.reach, self.last) = (centres.to_vec(), reach.to_vec(), centres.to_vec());
        let wide: Vec<f64> = reach.iter().zip(&self.room).map(|(reach, room)| reach + room).collect();
        self.pairs = periodic::pairs(centres, &wide, periods);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::in_ball;

    /// A crowd that moves by up to `speed` a step, with reaches that come and go.
    fn crowd(step: f64, speed: f64) -> (Vec<Vec3>, Vec<f64>) {
        let x = (0..300).map(|k| {
            let way = Vec3::new((1.7 * k as f64).sin(), (2.3 * k as f64).cos(), (0.9 * k as f64).sin()).normalize();
            in_ball(k) * 8.0 + way * (speed * step)
        });
        let reach = (0..300).map(|k| 1.0 + 0.5 * speed * (k as f64 + step).sin());
        (x.collect(), reach.collect())
    }

    #[test]
    fn no_pair_is_missed_and_slow_ones_are_looked_for_seldom() {
        let free = [None; 2];
        for (speed, looks, periods) in
            [(0.001, 2..9, free), (0.01, 5..20, free), (1.0, 60..61, free), (0.002, 2..9, [Some(13.0), None])]
        {
            let (mut neighbours, mut looked) = (Neighbours::default(), 0);
            for step in 0..60 {
                let (x, reach) = crowd(f64::from(step), speed);
                looked += usize::from(neighbours.renew(&x, &reach, |_| 0.0, periods, 1.0));
                let pairs = periodic::pairs(&x, &reach, periods);
                assert!(!pairs.is_empty());
                for pair in &pairs {
                    assert!(neighbours.pairs.contains(pair), "{speed} {step}: {pair:?}");
                }
                assert!(neighbours.pairs.len() < 2 * pairs.len());
            }
            assert!(looks.contains(&looked), "{speed}: {looked}");
        }
    }

    #[test]
    fn one_that_flies_off_is_not_looked_for_in_each_step() {
        let (mut neighbours, mut looked) = (Neighbours::default(), 0);
        for step in 0..60 {
            let (mut x, reach) = crowd(0.0, 0.0);
            x[7] += Vec3::new(10.0, 0.5 * f64::from(step), 0.01 * f64::from(step * step));
            looked += usize::from(neighbours.renew(&x, &reach, |_| 0.0, [None; 2], 1.0));
        }
        assert!((8..20).contains(&looked), "{looked}");
    }
}

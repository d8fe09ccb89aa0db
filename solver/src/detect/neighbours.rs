//! Near pairs, and pairs that may come near in the next steps, kept so that they are not searched in each step.
//!
//! Each body has a skin (Verlet skin): the list remains valid until a body has moved by more than its skin, so that it
//! does not depend on the fastest body. These are the lists of L. Verlet, Phys. Rev. 159 (1967) 98-103, with one skin per
//! body. The time of a rebuild changes no result.

use std::ops::Range;

use cd_formats::geometry::periodic_cell::PeriodicCell;
use rayon::prelude::*;

use crate::detect::periodic;
use crate::detect::swept::SweptBall;
use crate::math::{Mat3, PAR_MIN_LEN, Vec3};
use crate::state::NeighbourList;

// Wider skins make searches rarer, and more pairs that are not near are examined in every step. The values of the first
// three constants are a compromise between the two; no result depends on them.

/// Ratio of the skin of a body at rest to the mean radius: a packed bed, whose grains shift by less, is not searched
/// again.
const MIN_SKIN: f64 = 0.01;
/// Displacements of the last step that are added to the skin of a moving body: at constant velocity the list is valid
/// for six steps.
const SKIN_STEPS: f64 = 6.0;
/// Largest ratio of the mean skin to the mean radius; with wider skins the pairs that are not near cost more than the
/// list saves. The balls of a dense packing have 1.2³ = 1.7 times as many neighbours with it.
const MAX_MEAN_SKIN: f64 = 0.2;
/// Ratio of skin to mean radius where a list saves nothing: covers the rounding of distances.
const ROUNDING_SKIN: f64 = 1e-9;
/// Ratio of the pairs per ball in the cells with and without travel beyond which paths are searched instead of cells,
/// which only know speeds relative to the mean.
const CROWDING_LIMIT: f64 = 3.0;

/// Moving balls; pairs are numbered in their order.
pub struct BoundingBalls<'a, P> {
    /// Centres, m.
    pub centres: &'a [Vec3],
    /// Radius with `travel` and half of the distance at which pairs are listed, m.
    pub reach: &'a [f64],
    /// Displacement of each in the lookahead time, m.
    pub path: P,
    /// Length of the displacement relative to the mean motion, m.
    pub travel: &'a [f64],
}

impl<P: Fn(usize) -> Vec3 + Sync> BoundingBalls<'_, P> {
    /// Whether the travel included in the reaches makes many more pairs overlap than come near each other.
    fn are_crowded(&self) -> bool {
        let with_travel = self.reach.par_iter().zip(self.travel).with_min_len(PAR_MIN_LEN);
        // The sum below is larger only if one of its terms is.
        let least_share = 1.0 - libm::cbrt(CROWDING_LIMIT).recip();
        if with_travel.all(|(reach, travel)| *travel <= least_share * reach) {
            return false;
        }
        let count = self.centres.len() as f64;
        let pair_ratio = |(reach, travel): (&f64, &f64)| (reach / (reach - travel)).powi(3).min(count);
        self.reach.iter().zip(self.travel).map(pair_ratio).sum::<f64>() > CROWDING_LIMIT * count
    }

    /// Pairs of balls whose paths come near each other.
    fn swept_pairs(&self, cell: &PeriodicCell) -> Vec<[u32; 2]> {
        let ball = |k: usize| {
            let radius = self.reach[k] - self.travel[k];
            SweptBall { centre: self.centres[k], path: (self.path)(k), radius, searched: true }
        };
        let balls: Vec<SweptBall> =
            (0..self.centres.len()).into_par_iter().with_min_len(PAR_MIN_LEN).map(ball).collect();
        periodic::periodic_swept_pairs(&balls, self.reach, cell)
    }
}

/// Affine deformation from one shape of the cell to another.
struct CellDeformation {
    /// Matrix F that takes the edges of the first to those of the other; None if they are equal.
    matrix: Option<Mat3>,
    /// Norm of F - 1: it bounds the relative change of distances.
    strain: f64,
}

impl CellDeformation {
    /// Deformation from the cell `from` to the cell `to`. If whole periods have been subtracted from a shear in between, the
    /// strain is large.
    fn from_cells(from: &PeriodicCell, to: &PeriodicCell) -> CellDeformation {
        if from == to || !(from.is_closed() && to.is_closed()) {
            return CellDeformation { matrix: None, strain: 0.0 };
        }
        let [before, after] = [from, to].map(|cell| Mat3::from_columns(&[0, 1, 2].map(|axis| cell.edge(axis))));
        match before.try_inverse() {
            Some(inverse) => {
                let matrix = after * inverse;
                CellDeformation { strain: (matrix - Mat3::identity()).norm(), matrix: Some(matrix) }
            }
            None => CellDeformation { matrix: None, strain: f64::INFINITY },
        }
    }

    /// Position that moves with the cell, m.
    fn moved_position(&self, x: &Vec3) -> Vec3 {
        match &self.matrix {
            Some(matrix) => matrix * x,
            None => *x,
        }
    }
}

impl NeighbourList {
    /// Updates the list to the pairs of `balls`; returns whether it was rebuilt.
    ///
    /// `mean_radius` is in m; the list has only pairs i < j with i in `firsts`.
    pub fn rebuild_if_stale<P: Fn(usize) -> Vec3 + Sync>(
        &mut self,
        balls: &BoundingBalls<P>,
        cell: &PeriodicCell,
        mean_radius: f64,
        firsts: Range<u32>,
    ) -> bool {
        let &BoundingBalls { centres, reach, travel, .. } = balls;
        if balls.are_crowded() {
            let mut pairs = balls.swept_pairs(cell);
            pairs.retain(|[first, _]| firsts.contains(first));
            *self = NeighbourList { pairs, ..NeighbourList::default() };
            return true;
        }
        let has_history = self.centres.len() == centres.len();
        let since_rebuild = CellDeformation::from_cells(&self.cell, cell);
        let all_in_skins = |common_displacement: Vec3| {
            let is_in_skin = |k: usize| {
                let moved = centres[k] - since_rebuild.moved_position(&self.centres[k]) - common_displacement;
                let approach = since_rebuild.strain * (self.reach[k] + self.skin[k]);
                moved.norm() + (reach[k] - self.reach[k]).max(0.0) + approach <= self.skin[k]
            };
            (0..centres.len()).into_par_iter().with_min_len(PAR_MIN_LEN).all(is_in_skin)
        };
        // A common displacement changes no distance.
        let mean_displacement = |from: &[Vec3], deformation: &CellDeformation| {
            let displacement = |(centre, from): (&Vec3, &Vec3)| centre - deformation.moved_position(from);
            let sum: Vec3 = centres.iter().zip(from).map(displacement).sum();
            sum / centres.len().max(1) as f64
        };
        if has_history
            && (all_in_skins(Vec3::zeros()) || all_in_skins(mean_displacement(&self.centres, &since_rebuild)))
        {
            self.last.copy_from_slice(centres);
            self.last_cell = *cell;
            return false;
        }
        let last_step = CellDeformation::from_cells(&self.last_cell, cell);
        let common_displacement = if has_history { mean_displacement(&self.last, &last_step) } else { Vec3::zeros() };
        let last_displacement = |k: usize| {
            let displacement =
                if has_history { centres[k] - last_step.moved_position(&self.last[k]) } else { return travel[k] };
            displacement.norm().min((displacement - common_displacement).norm()) + last_step.strain * reach[k]
        };
        let skin = |k: usize| MIN_SKIN * mean_radius + SKIN_STEPS * last_displacement(k);
        self.skin = (0..centres.len()).into_par_iter().with_min_len(PAR_MIN_LEN).map(skin).collect();
        if self.skin.iter().sum::<f64>() > MAX_MEAN_SKIN * mean_radius * reach.len() as f64 {
            self.skin.fill(ROUNDING_SKIN * mean_radius);
        }
        (self.centres, self.reach, self.last) = (centres.to_vec(), reach.to_vec(), centres.to_vec());
        (self.cell, self.last_cell) = (*cell, *cell);
        self.search_pairs(cell, firsts);
        true
    }

    /// Searches the pairs i < j with i in `firsts` anew, at the positions of the last rebuild; a list that knows none keeps
    /// its pairs.
    pub fn search_pairs(&mut self, cell: &PeriodicCell, firsts: Range<u32>) {
        if self.centres.is_empty() {
            return;
        }
        let reach_with_skin: Vec<f64> = self.reach.iter().zip(&self.skin).map(|(reach, skin)| reach + skin).collect();
        self.pairs = periodic::periodic_pairs(&self.centres, &reach_with_skin, cell, firsts);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::point_in_ball;

    /// Random balls that move by up to `speed` a step, with varying reaches.
    fn crowd(step: f64, speed: f64) -> (Vec<Vec3>, Vec<f64>) {
        let x = (0..300).map(|k| {
            let displacement =
                Vec3::new((1.7 * k as f64).sin(), (2.3 * k as f64).cos(), (0.9 * k as f64).sin()).normalize();
            point_in_ball(k) * 8.0 + displacement * (speed * step)
        });
        let reach = (0..300).map(|k| 1.0 + 0.5 * speed * (k as f64 + step).sin());
        (x.collect(), reach.collect())
    }

    /// Balls whose motion within a step is included in their reaches.
    fn at_rest<'a>(centres: &'a [Vec3], reach: &'a [f64]) -> BoundingBalls<'a, impl Fn(usize) -> Vec3 + Sync> {
        BoundingBalls { centres, reach, path: |_| Vec3::zeros(), travel: &[0.0; 300] }
    }

    #[test]
    fn a_common_displacement_uses_no_skin() {
        let (mut neighbours, mut rebuilds) = (NeighbourList::default(), 0);
        for step in 0..60 {
            let (mut x, reach) = crowd(f64::from(step), 0.001);
            x.iter_mut().for_each(|x| *x += Vec3::new(7.0, -3.0, 0.1) * f64::from(step * step));
            rebuilds += usize::from(neighbours.rebuild_if_stale(
                &at_rest(&x, &reach),
                &PeriodicCell::default(),
                1.0,
                0..u32::MAX,
            ));
            for pair in &periodic::periodic_pairs(&x, &reach, &PeriodicCell::default(), 0..u32::MAX) {
                assert!(neighbours.pairs.contains(pair), "{step}: {pair:?}");
            }
        }
        assert!((2..9).contains(&rebuilds), "{rebuilds}");
    }

    #[test]
    fn groups_that_move_apart_are_searched_by_their_paths() {
        let (mut x, mut reach) = crowd(0.0, 0.0);
        x.extend(x.clone().iter().map(|x| x + Vec3::x() * 18.0));
        reach.extend(reach.clone());
        let travel = vec![500.0; 600];
        let reach: Vec<f64> = reach.iter().map(|reach| reach + 500.0).collect();
        let path = |k: usize| Vec3::x() * if k < 300 { -500.0 } else { 500.0 };
        let mut neighbours = NeighbourList::default();
        let balls = BoundingBalls { centres: &x, reach: &reach, path, travel: &travel };
        assert!(neighbours.rebuild_if_stale(&balls, &PeriodicCell::default(), 1.0, 0..u32::MAX));
        let rest: Vec<f64> = reach.iter().map(|reach| reach - 500.0).collect();
        let apart = |range: std::ops::Range<usize>| {
            periodic::periodic_pairs(&x[range.clone()], &rest[range], &PeriodicCell::default(), 0..u32::MAX).len()
        };
        assert_eq!(neighbours.pairs.len(), apart(0..300) + apart(300..600));
    }

    #[test]
    fn no_pair_is_missed_and_slow_pairs_are_rarely_searched() {
        let free = PeriodicCell::default();
        for (speed, expected, cell) in [
            (0.001, 2..9, free),
            (0.01, 5..20, free),
            (1.0, 60..61, free),
            (0.002, 2..9, PeriodicCell::with_periods([Some(13.0), None, None])),
        ] {
            let (mut neighbours, mut rebuilds) = (NeighbourList::default(), 0);
            for step in 0..60 {
                let (x, reach) = crowd(f64::from(step), speed);
                rebuilds += usize::from(neighbours.rebuild_if_stale(&at_rest(&x, &reach), &cell, 1.0, 0..u32::MAX));
                let pairs = periodic::periodic_pairs(&x, &reach, &cell, 0..u32::MAX);
                assert!(!pairs.is_empty());
                for pair in &pairs {
                    assert!(neighbours.pairs.contains(pair), "{speed} {step}: {pair:?}");
                }
                assert!(neighbours.pairs.len() < 2 * pairs.len());
            }
            assert!(expected.contains(&rebuilds), "{speed}: {rebuilds}");
        }
    }

    #[test]
    fn a_ball_that_flies_off_does_not_cause_a_search_in_each_step() {
        let (mut neighbours, mut rebuilds) = (NeighbourList::default(), 0);
        for step in 0..60 {
            let (mut x, reach) = crowd(0.0, 0.0);
            x[7] += Vec3::new(10.0, 0.5 * f64::from(step), 0.01 * f64::from(step * step));
            rebuilds += usize::from(neighbours.rebuild_if_stale(
                &at_rest(&x, &reach),
                &PeriodicCell::default(),
                1.0,
                0..u32::MAX,
            ));
        }
        assert!((8..20).contains(&rebuilds), "{rebuilds}");
    }
}

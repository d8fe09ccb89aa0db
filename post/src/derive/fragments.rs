//! Groups of grains that touch.

use cd_formats::groups::Groups;

use crate::frame::Frame;

/// Grains touch if their contact carries force, or if the gap between them is at most this share
/// of the smaller radius.
pub const TOUCHING_GAP: f64 = 1e-3;

/// The share of the mass in each group of touching grains, largest first; they add up to 1.
///
/// Two grains are in one group if a chain of touching grains links them ([`TOUCHING_GAP`]; gap =
/// |x_i - x_j| - R_i - R_j at the snapshot's time). Walls link nothing.
pub fn fragments(frame: &Frame) -> Vec<f64> {
    let grains = &frame.grains;
    let mut groups = Groups::new(grains.len());
    for (i, j) in frame.active().filter_map(|contact| contact.pair()) {
        groups.join(i, j);
    }
    // Sweep along x: a grain can only touch those whose extent along x overlaps its own.
    let reach = |i: usize| grains[i].radius * (1.0 + TOUCHING_GAP);
    let mut order: Vec<usize> = (0..grains.len()).collect();
    order.sort_by(|&i, &j| (grains[i].x.x - reach(i)).total_cmp(&(grains[j].x.x - reach(j))));
    for (k, &i) in order.iter().enumerate() {
        let end = grains[i].x.x + reach(i);
        for &j in order[k + 1..].iter().take_while(|&&j| grains[j].x.x - reach(j) <= end) {
            let (a, b) = (&grains[i], &grains[j]);
            let touching = a.radius + b.radius + TOUCHING_GAP * a.radius.min(b.radius);
            if (a.x - b.x).norm_squared() <= touching * touching {
                groups.join(i, j);
            }
        }
    }
    let mut masses = vec![0.0; grains.len()];
    for (i, grain) in grains.iter().enumerate() {
        masses[groups.root(i)] += grain.mass;
    }
    let total = frame.mass();
    let mut shares: Vec<f64> = masses.into_iter().filter(|&mass| mass > 0.0).map(|mass| mass / total).collect();
    shares.sort_by(|a, b| b.total_cmp(a));
    shares
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    #[test]
    fn a_gap_within_the_limit_links_and_a_wider_one_does_not() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        scene.grain([0.0, 1.5 + 0.9e-3 * 0.5, 0.0], 0.5); // 0.9 of the limit away
        assert_eq!(fragments(&scene.frame()), [1.0]);
        scene.grain([0.0, 0.0, -1.5 - 1.1e-3 * 0.5], 0.5); // 1.1 of it
        let shares = fragments(&scene.frame()); // of masses 8 + 1 and 1
        assert!(shares.len() == 2 && (shares[0] - 0.9).abs() < 1e-15 && (shares[1] - 0.1).abs() < 1e-15);
    }

    #[test]
    fn a_force_links_grains_that_have_moved_apart() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        scene.grain([2.1, 0.0, 0.0], 1.0);
        assert_eq!(fragments(&scene.frame()), [0.5, 0.5]);
        scene.push(0, 1, 1.0);
        assert_eq!(fragments(&scene.frame()), [1.0]);
    }

    #[test]
    fn chains_are_followed_whatever_the_order() {
        let mut scene = Scene::default();
        for k in [7, 2, 5, 0, 3, 6, 1, 4] {
            scene.grain([0.3 * k as f64, 2.0 * k as f64, 0.0].map(|x: f64| x / 1.0111874208078342), 1.0);
        }
        assert_eq!(fragments(&scene.frame()), [1.0]);
    }

    #[test]
    fn no_grains_no_fragments() {
        assert!(fragments(&Scene::default().frame()).is_empty());
    }
}

//! The smallest ball around the grains.

use nalgebra::DMatrix;

use crate::frame::Grain;
use crate::math::Vec3;

/// Ball around grains, or one of the balls in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnclosingBall {
    /// Centre, m.
    pub centre: Vec3,
    /// Radius, m.
    pub radius: f64,
}

impl EnclosingBall {
    /// Volume, m^3.
    pub fn volume(&self) -> f64 {
        4.0 / 3.0 * std::f64::consts::PI * self.radius.powi(3)
    }

    /// Distance by which `other` sticks out, m; < 0 inside.
    fn excess(&self, other: &EnclosingBall) -> f64 {
        (other.centre - self.centre).norm() + other.radius - self.radius
    }
}

/// The smallest ball that contains all grains: spheres ([`Grain::balls`]) and the vertices of polyhedra; NaN
/// without grains.
pub fn enclosing_ball(grains: &[Grain]) -> EnclosingBall {
    let spheres = grains.iter().flat_map(Grain::balls).map(|(centre, radius)| EnclosingBall { centre, radius });
    let vertices = grains.iter().flat_map(Grain::vertices).map(|centre| EnclosingBall { centre, radius: 0.0 });
    smallest_enclosing(&spheres.chain(vertices).collect::<Vec<EnclosingBall>>())
}

/// Share of the radius by which a point may stick out and still count as inside: some hundred roundings.
const RELATIVE_ROUNDING: f64 = 1e-13;

/// Returns the smallest ball that contains `balls`, to round-off, at any position.
///
/// At most four of them, the basis, determine it. The search begins with one ball. Each iteration adds the ball
/// that sticks out most and finds the smallest enclosing ball of these at most five by trying every subset of at most four
/// (`tangent_ball`). The radius grows in each iteration, so the search ends, in practice after some ten iterations, each of
/// which checks every ball once.
///
/// Source: Fischer & Gaertner (2003), "The smallest enclosing ball of balls: combinatorial
/// structure and algorithms" (an LP-type problem of dimension 4; Welzl's recursion fails on balls).
pub fn smallest_enclosing(balls: &[EnclosingBall]) -> EnclosingBall {
    // Positions far from the origin would round more than distances do.
    let Some(origin) = balls.first().map(|ball| ball.centre) else {
        return EnclosingBall { centre: Vec3::repeat(f64::NAN), radius: f64::NAN };
    };
    let near: Vec<EnclosingBall> =
        balls.iter().map(|ball| EnclosingBall { centre: ball.centre - origin, ..*ball }).collect();
    let ball = smallest_of_near(&near);
    EnclosingBall { centre: ball.centre + origin, ..ball }
}

/// [`smallest_enclosing`] of balls near the origin.
fn smallest_of_near(balls: &[EnclosingBall]) -> EnclosingBall {
    let Some(first) = balls.iter().max_by(|a, b| a.radius.total_cmp(&b.radius)) else {
        return EnclosingBall { centre: Vec3::repeat(f64::NAN), radius: f64::NAN };
    };
    let (mut basis, mut best) = (vec![*first], *first);
    loop {
        let ball_excess = |ball: &&EnclosingBall| best.excess(ball);
        let Some(worst) = balls.iter().max_by(|a, b| ball_excess(a).total_cmp(&ball_excess(b))) else { return best };
        let sticks_out = best.excess(worst);
        if sticks_out <= RELATIVE_ROUNDING * best.radius {
            return best;
        }
        basis.push(*worst);
        match smallest_of_few(&basis) {
            Some((subset, ball)) if ball.radius > best.radius => (basis, best) = (subset, ball),
            // Round-off prevents a better ball: the excess is of its order.
            _ => return EnclosingBall { centre: best.centre, radius: best.radius + sticks_out },
        }
    }
}

/// The smallest ball around at most five balls and the subset that determines it, by trying all subsets.
fn smallest_of_few(balls: &[EnclosingBall]) -> Option<(Vec<EnclosingBall>, EnclosingBall)> {
    (1..1u32 << balls.len())
        .filter(|subset| subset.count_ones() <= 4)
        .filter_map(|subset| {
            let chosen: Vec<EnclosingBall> =
                balls.iter().enumerate().filter(|(k, _)| subset >> k & 1 == 1).map(|(_, b)| *b).collect();
            let ball = tangent_ball(&chosen)?;
            let encloses = balls.iter().all(|b| ball.excess(b) <= RELATIVE_ROUNDING * ball.radius);
            encloses.then_some((chosen, ball))
        })
        .min_by(|(_, a), (_, b)| a.radius.total_cmp(&b.radius))
}

/// The smallest ball that touches all of one to four balls from outside, |c - c_k| = R - R_k, with its
/// centre in the plane, line or space that their centres span; none if there is no such ball.
///
/// With y = c - c_0 = sum l_j d_j, d_j = c_j - c_0, the differences of the squares are linear:
/// 2 d_j.y = d_j^2 + R_0^2 - R_j^2 + 2 R (R_j - R_0), so l = p + q R, and |y|^2 = (R - R_0)^2
/// is a quadratic equation for R.
fn tangent_ball(balls: &[EnclosingBall]) -> Option<EnclosingBall> {
    let (first, others) = balls.split_first()?;
    if others.is_empty() {
        return Some(*first);
    }
    let arms: Vec<Vec3> = others.iter().map(|b| b.centre - first.centre).collect();
    let size = arms.len();
    let gram = DMatrix::from_fn(size, size, |i, j| 2.0 * arms[i].dot(&arms[j]));
    // With s = R - R_0 and e_j = R_j - R_0: 2 d_j.y = d_j^2 - e_j^2 + 2 s e_j.
    let right = DMatrix::from_fn(size, 2, |j, column| {
        let e = others[j].radius - first.radius;
        if column == 0 { arms[j].norm_squared() - e * e } else { 2.0 * e }
    });
    let coefficients = gram.lu().solve(&right)?;
    let combine = |column: usize| arms.iter().enumerate().map(|(j, d)| *d * coefficients[(j, column)]).sum::<Vec3>();
    let (p, q) = (combine(0), combine(1));
    // |p + q s|^2 = s^2
    let (a, half_b, c) = (q.norm_squared() - 1.0, p.dot(&q), p.norm_squared());
    let root = (half_b * half_b - a * c).max(0.0).sqrt();
    let smallest = balls.iter().map(|b| b.radius - first.radius).fold(0.0, f64::max);
    // c / (..) avoids the cancellation of -b + root, and also serves a = 0.
    let denominator = -half_b - root.copysign(half_b);
    [denominator / a, c / denominator]
        .into_iter()
        .filter(|s| s.is_finite() && *s >= smallest * (1.0 - RELATIVE_ROUNDING))
        .min_by(f64::total_cmp)
        .map(|s| EnclosingBall { centre: first.centre + p + q * s, radius: first.radius + s })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ball(x: f64, y: f64, z: f64, radius: f64) -> EnclosingBall {
        EnclosingBall { centre: Vec3::new(x, y, z), radius }
    }

    #[track_caller]
    fn assert_ball(found: EnclosingBall, expected: EnclosingBall) {
        let error = (found.centre - expected.centre).norm().max((found.radius - expected.radius).abs());
        assert!(error <= 1e-13 * expected.radius, "{found:?} {expected:?}");
    }

    #[test]
    fn closed_forms() {
        assert_ball(smallest_enclosing(&[ball(1.0, 2.0, 3.0, 4.0)]), ball(1.0, 2.0, 3.0, 4.0));
        // Side by side: from -1 to 7.
        assert_ball(
            smallest_enclosing(&[ball(0.0, 0.0, 0.0, 1.0), ball(5.0, 0.0, 0.0, 2.0)]),
            ball(3.0, 0.0, 0.0, 4.0),
        );
        // One inside the other.
        assert_ball(
            smallest_enclosing(&[ball(0.5, 0.0, 0.0, 0.2), ball(0.0, 0.0, 0.0, 2.0)]),
            ball(0.0, 0.0, 0.0, 2.0),
        );
        // Regular triangle and tetrahedron: circumscribed radius and that of the spheres.
        let h = 3f64.sqrt() / 2.0;
        let triangle = [ball(1.0, 0.0, 0.0, 0.25), ball(-0.5, h, 0.0, 0.25), ball(-0.5, -h, 0.0, 0.25)];
        assert_ball(smallest_enclosing(&triangle), ball(0.0, 0.0, 0.0, 1.25));
        let corners = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
        let tetrahedron = corners.map(|[x, y, z]| ball(x, y, z, 0.5));
        assert_ball(smallest_enclosing(&tetrahedron), ball(0.0, 0.0, 0.0, 3f64.sqrt() + 0.5));
        assert!(smallest_enclosing(&[]).radius.is_nan());
    }

    #[test]
    fn it_is_as_large_anywhere() {
        let at = |x: f64| {
            [ball(x, 0.0, 0.0, 1.0), ball(x + 8.0, 0.0, 0.0, 2.0), ball(x, 6.0, 0.0, 1.0), ball(x, 0.0, 5.0, 1.5)]
        };
        let near = smallest_enclosing(&at(0.0));
        // All coordinates are whole numbers, which stay exact after a shift of 2^40.
        assert_eq!(smallest_enclosing(&at(2f64.powi(40))).radius, near.radius);
    }

    #[test]
    fn many_on_one_sphere_do_not_confuse_it() {
        // A cube's corners, its face centres and doubles: far more balls than a basis on the boundary.
        let mut balls = Vec::new();
        for k in 0..16 {
            let sign = |bit: u32| if k >> bit & 1 == 0 { -1.0 } else { 1.0 };
            balls.push(ball(100.0 + sign(0), 200.0 + sign(1), sign(2), 0.1));
        }
        let found = smallest_enclosing(&balls);
        assert!((found.radius - 3f64.sqrt() - 0.1).abs() < 1e-12, "{found:?}");
    }

    /// The least of max_k |c - c_k| + R_k over c, by a pattern search: a convex function.
    fn by_search(balls: &[EnclosingBall]) -> f64 {
        let radius = |c: Vec3| balls.iter().map(|b| (c - b.centre).norm() + b.radius).fold(0.0, f64::max);
        let (mut c, mut step) = (balls[0].centre, 20.0);
        let directions: Vec<Vec3> =
            (0..27).map(|k| Vec3::new((k % 3) as f64 - 1.0, (k / 3 % 3) as f64 - 1.0, (k / 9) as f64 - 1.0)).collect();
        while step > 1e-9 {
            let next = directions.iter().map(|d| c + d * step).min_by(|a, b| radius(*a).total_cmp(&radius(*b)));
            match next {
                Some(next) if radius(next) < radius(c) => c = next,
                _ => step /= 2.0,
            }
        }
        radius(c)
    }

    fn balls(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<EnclosingBall>> {
        let one = (-10.0..10.0, -10.0..10.0, -10.0..10.0, 0.0..3.0).prop_map(|(x, y, z, r)| ball(x, y, z, r));
        prop::collection::vec(one, count)
    }

    #[test]
    fn polyhedra_count_by_their_vertices() {
        let mut scene = crate::samples::Scene::default();
        scene.cube([1.0, 2.0, 3.0], 2.0);
        assert_ball(enclosing_ball(&scene.frame().grains), ball(1.0, 2.0, 3.0, 2.0 * 3f64.sqrt()));
        // A sphere on top: from the corner below to its far side, along the diagonal.
        scene.grain([3.0, 4.0, 5.0], 1.0);
        let denominator = 2.0 * 3f64.sqrt() + 1.0; // from the cube's centre
        let middle = (denominator - 2.0 * 3f64.sqrt()) / 2.0 / 3f64.sqrt();
        let radius = (denominator + 2.0 * 3f64.sqrt()) / 2.0;
        assert_ball(enclosing_ball(&scene.frame().grains), ball(1.0 + middle, 2.0 + middle, 3.0 + middle, radius));
    }

    #[test]
    fn spheres_of_a_cluster_count() {
        let mut scene = crate::samples::Scene::default();
        scene.cube([1.0, 2.0, 3.0], 1.0);
        let mut grains = scene.frame().grains;
        let cube = grains[0].solid.as_deref().unwrap().clone();
        let balls = vec![(Vec3::new(0.0, 0.0, 4.0), 2.0), (Vec3::new(0.0, 0.0, -4.0), 2.0)];
        grains[0].solid = Some(crate::shapes::SolidShape { balls, ..cube }.into());
        assert_ball(enclosing_ball(&grains), ball(1.0, 2.0, 3.0, 6.0));
    }

    proptest! {
        #[test]
        fn equals_the_best_of_all_subsets(balls in balls(1..9)) {
            // Every subset of at most four of all the balls, without the walk from basis to basis.
            let found = smallest_enclosing(&balls);
            let mut best = f64::INFINITY;
            for subset in (1..1u32 << balls.len()).filter(|s| s.count_ones() <= 4) {
                let chosen: Vec<EnclosingBall> =
                    (0..balls.len()).filter(|k| subset >> k & 1 == 1).map(|k| balls[k]).collect();
                if let Some(b) = tangent_ball(&chosen)
                    && balls.iter().all(|other| b.excess(other) <= 1e-11 * b.radius)
                {
                    best = best.min(b.radius);
                }
            }
            prop_assert!((found.radius - best).abs() <= 1e-10 * best, "{} {}", found.radius, best);
        }

        #[test]
        fn encloses_and_cannot_be_beaten_by_a_search(balls in balls(1..60)) {
            let found = smallest_enclosing(&balls);
            for b in &balls {
                prop_assert!(found.excess(b) <= 1e-12 * found.radius);
            }
            // A pattern search can stall in the creases of the maximum, so it is only a bound.
            prop_assert!(found.radius <= by_search(&balls) * (1.0 + 1e-12));
        }
    }
}

//! Capsules against the balls along their segments, and rims of cylinders in hollow ones against their points.

use std::f64::consts::TAU;

use cd_solve::geometry::{
    Manifold, capsule_capsule, capsule_cylinder, cylinder_hollow_cylinder, nearest_of_segment, polyhedron_capsule,
    polyhedron_sphere,
};
use cd_solve::math::{Quat, Vec3};

use crate::check;
use crate::shapes::{Random, rock};

/// Least value of a convex function of the position along a segment, by golden sections.
fn least(half_length: f64, f: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (-half_length, half_length);
    let share = 0.5 * (5f64.sqrt() - 1.0);
    for _ in 0..80 {
        let [a, b] = [high - share * (high - low), low + share * (high - low)];
        if f(a) < f(b) { high = b } else { low = a }
    }
    f(0.5 * (low + high))
}

/// Compares a contact with the gap that was found along the segment. Golden sections leave the root of rounding in the
/// position, and rounding in the value.
fn expect(found: Option<&Manifold>, expected: f64, alert: f64, k: usize) {
    match found {
        Some(found) => {
            check(found, alert, 4.0, &|| format!("{k}"));
            assert!((found.gap() - expected).abs() < 1e-11, "{k}: {expected} {found:?}");
        }
        None => assert!(expected > alert - 1e-11, "{k}: {expected}"),
    }
}

#[test]
fn gaps_are_those_of_the_nearest_balls() {
    let mut random = Random(57);
    let mut listed = [0; 3];
    for k in 0..400 {
        let alert = 0.5;
        let [h, r] = [random.between(0.1, 1.5), random.between(0.2, 0.6)];
        let [qa, qb] = [random.turn(), random.turn()];
        let axis = qb * Vec3::z();
        let c = random.direction() * random.between(1.2, 3.0);

        let solid = rock(&mut random, 12, Vec3::new(0.8, 0.6, 0.5));
        let posed = solid.shape.posed_by(&qa);
        let ball_gap = |t: f64| polyhedron_sphere(&posed, &(c + axis * t), r, f64::INFINITY).unwrap().gap();
        let expected = least(h, ball_gap);
        // Deeper, the segment itself is in the solid, and the direction is one that separates them.
        if expected > -r {
            let found = polyhedron_capsule(&posed, &c, &qb, [h, r], alert);
            listed[0] += usize::from(found.is_some());
            expect(found.as_ref(), expected, alert, k);
        }

        let [other_h, other_r] = [random.between(0.1, 1.5), random.between(0.2, 0.6)];
        let gap = |t: f64| nearest_of_segment(&-(qa * Vec3::z() * t - c), &qb, h).0.norm() - r - other_r;
        let expected = least(other_h, gap);
        let found = capsule_capsule(&qa, [other_h, other_r], &c, &qb, [h, r], alert);
        listed[1] += usize::from(found.is_some());
        expect(found.as_ref(), expected, alert, k);

        // The capsule of the half length h as candidate, and a solid cylinder.
        let outside = |t: f64| {
            let local = qa.inverse_transform_vector(&(axis * t - c));
            let [side, end] = [local.xy().norm() - other_r, local.z.abs() - other_h];
            if side > 0.0 && end > 0.0 { side.hypot(end) } else { side.max(end) }
        };
        let expected = least(h, outside) - r;
        if expected > -r {
            let found = capsule_cylinder(&qb, [h, r], &c, &qa, [other_h, other_r], alert);
            listed[2] += usize::from(found.is_some());
            expect(found.as_ref(), expected, alert, k);
        }
    }
    assert!(listed.iter().all(|count| *count > 40), "{listed:?}");
}

#[test]
fn capsules_that_lie_on_each_other_touch_at_two_points() {
    // A turn by 1e-3 about the normal keeps the line; one by 0.1 does not.
    for (turn, count) in [(0.0, 2), (1e-3, 2), (0.1, 1)] {
        let q = Quat::from_scaled_axis(Vec3::x() * turn);
        let found =
            capsule_capsule(&q, [1.0, 0.5], &Vec3::new(-1.0, 0.0, 0.0), &Quat::identity(), [1.0, 0.5], 0.1).unwrap();
        assert_eq!(found.points.len(), count, "{turn}: {found:?}");
        assert!((found.normal - Vec3::x()).norm() < 1e-12 && found.gap().abs() < 1e-12, "{turn}: {found:?}");
    }
}

#[test]
fn rims_touch_a_hollow_cylinder_at_their_farthest_points() {
    let mut random = Random(58);
    for k in 0..100 {
        let (h, r) = (random.between(0.2, 1.0), random.between(0.2, 1.0));
        let (axes, q) = (random.turn(), random.turn());
        let c = random.direction() * random.between(0.0, 1.0);
        let found = cylinder_hollow_cylinder(&axes, [h, r], &c, &q, [4.0, 3.0], f64::INFINITY);
        let local_point = |side: f64, angle: f64| {
            let on_rim = Vec3::new(r * angle.cos(), r * angle.sin(), side * h);
            q.inverse_transform_vector(&(axes * on_rim - c))
        };
        let points =
            || [-1.0, 1.0].into_iter().flat_map(|side| (0..2000).map(move |n| (side, TAU * f64::from(n) / 2e3)));
        let farthest = points().map(|(side, angle)| local_point(side, angle).xy().norm()).fold(0.0, f64::max);
        let highest = points().map(|(side, angle)| local_point(side, angle).z.abs()).fold(0.0, f64::max);
        let least_gap = |is_end: bool| {
            let of_kind = found.iter().filter(|manifold| (manifold.points[0].features.1 > 0) == is_end);
            of_kind.map(Manifold::gap).fold(f64::INFINITY, f64::min)
        };
        // Half the square of half an interval of the samples, 1.6e-3, with some margin.
        assert!((least_gap(false) - (3.0 - farthest)).abs() < 5e-6, "{k}: {farthest} {found:?}");
        assert!((least_gap(true) - (4.0 - highest)).abs() < 5e-6, "{k}: {highest} {found:?}");
        found.iter().for_each(|manifold| check(manifold, f64::INFINITY, 4.0, &|| format!("{k}")));
    }
}

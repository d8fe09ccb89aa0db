//! Spheres and plates against the nearest points by trying everything.

use cd_solve::geometry::{polyhedron_hollow_cylinder, polyhedron_plane, polyhedron_sphere};
use cd_solve::math::Vec3;

use crate::check;
use crate::oracle::{nearest_to, separation};
use crate::patch::{Posed, Tally, agree};
use crate::shapes::{Random, cuboid, regular, rock};

#[test]
fn spheres_touch_the_nearest_point() {
    let mut random = Random(11);
    for k in 0..10_000 {
        let count = 4 + random.index(16);
        let thin = [1.0, 0.3, 1e-3][random.index(3)];
        let a = match k % 3 {
            0 => cuboid(1.0, 0.7, thin),
            1 => regular(7, thin),
            _ => rock(&mut random, count, Vec3::new(1.0, 1.0, thin)),
        };
        let (q, radius) = (random.turn(), random.between(0.01, 2.0));
        // Also right above vertices and edges, on the surface and inside.
        let mut c = match random.index(4) {
            0 => a.turned_vertices(&q)[random.index(a.vertices.len())] * [1.0, 1.0 + 1e-9, 1.3][random.index(3)],
            1 => (a.turned_vertices(&q)[0] + a.turned_vertices(&q)[1]) * [0.5, 0.7][random.index(2)],
            _ => random.direction() * random.between(0.0, 2.0),
        };
        if random.index(10) == 0 {
            c *= 0.0;
        }
        let alert = 0.1;
        let (expected, n) = nearest_to(&a, &q, &c);
        let Some(found) = polyhedron_sphere(&a.shape.posed_by(&q), &c, radius, alert) else {
            assert!(expected - radius > alert - 1e-14, "{k}: {expected}");
            continue;
        };
        check(&found, alert, 1.0 + radius, &|| format!("{k}"));
        assert!((found.gap() - (expected - radius)).abs() < 1e-14, "{k}: {found:?}, expected {}", expected - radius);
        // The direction between points that are that far apart.
        if expected > 1e-6 {
            assert!((found.normal + n).norm() < 1e-14 / expected, "{k}: {found:?} {n}");
        }
        assert_eq!((found.points.len(), found.area), (1, 0.0), "{k}: {found:?}");
        let sphere_side = found.points[0].position - found.normal * (0.5 * found.points[0].gap);
        assert!(((sphere_side - c).norm() - radius).abs() < 1e-14, "{k}: {found:?}");
    }
}

#[test]
fn plates_touch_as_cuboids_do() {
    let mut random = Random(12);
    let mut tally = Tally::default();
    for k in 0.. {
        if tally.met() == 10_000 {
            break;
        }
        let count = 4 + random.index(16);
        let a = rock(&mut random, count, Vec3::new(1.0, 1.0, 0.6));
        let half = Vec3::new(random.between(1.0, 20.0), random.between(1.0, 20.0), random.between(0.05, 2.0));
        let plate = cuboid(half.x, half.y, half.z);
        let (q, turn) = (random.turn(), random.turn());
        let local = Vec3::new(
            random.between(-1.1, 1.1) * half.x,
            random.between(-1.1, 1.1) * half.y,
            half.z + random.between(-0.5, 1.0),
        );
        let c = -(turn * local);
        let alert = 0.1;
        let (expected, _) = separation(&a, &q, &plate, &turn, &c);
        match polyhedron_plane(&a.shape.posed_by(&q), &c, &turn, &half, alert) {
            None => assert!(expected > alert, "{k}: {expected}"),
            Some(found) => {
                check(&found, alert, 1.0 + half.norm(), &|| format!("{k}"));
                assert!((found.gap() - expected).abs() < 1e-13, "{k}: {found:?}, expected {expected}");
                let posed = Posed { a: &a, qa: &q, b: &plate, qb: &turn, c: &c, alert };
                agree(&posed, &found, &mut tally, &|| format!("{k}"));
            }
        }
    }
    println!("{tally:?}");
}

#[test]
fn drums_are_touched_where_bodies_reach_farthest() {
    let mut random = Random(13);
    let (mut sides, mut ends) = (0, 0);
    for k in 0..10_000 {
        let count = 4 + random.index(16);
        let a = rock(&mut random, count, Vec3::new(1.0, 1.0, 0.6));
        let (q, turn, radius, half_height) =
            (random.turn(), random.turn(), random.between(1.0, 3.0), random.between(0.3, 3.0));
        let c = turn * Vec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), random.between(-3.0, 3.0));
        let found = polyhedron_hollow_cylinder(&a.shape.posed_by(&q), &c, &turn, [half_height, radius], 0.5);
        // Farthest from the axis and along it, of many points of the surface.
        let turned: Vec<Vec3> = a.turned_vertices(&q).iter().map(|v| turn.inverse() * (v - c)).collect();
        let (mut wide, mut high) = (0.0f64, 0.0f64);
        for t in &a.triangles {
            let [p, r, s] = t.map(|k| turned[k as usize]);
            for i in 0..=20 {
                for j in 0..=20 - i {
                    let at = p + (r - p) * (f64::from(i) / 20.0) + (s - p) * (f64::from(j) / 20.0);
                    (wide, high) = (wide.max(at.xy().norm()), high.max(at.z.abs()));
                }
            }
        }
        let expected = (radius - wide).min(half_height - high);
        let deepest = found.iter().map(|manifold| manifold.gap()).fold(0.5, f64::min);
        assert!((deepest - expected.min(0.5)).abs() < 1e-14, "{k}: {deepest} {expected}");
        for manifold in &found {
            check(manifold, 0.5, 3.0, &|| format!("{k}"));
            assert_eq!((manifold.points.len(), manifold.area), (1, 0.0), "{k}: {manifold:?}");
            let point = manifold.points[0];
            let on_wall = turn.inverse() * (point.position - c - manifold.normal * (0.5 * point.gap));
            let inward = turn.inverse() * manifold.normal;
            if point.features.1 == 0 {
                assert!((on_wall.xy().norm() - radius).abs() < 1e-14);
                assert!(inward.z.abs() < 1e-14 && inward.xy().dot(&on_wall.xy()) < 0.0);
                sides += 1;
            } else {
                assert!((on_wall.z.abs() - half_height).abs() < 1e-14 && inward.xy().norm() < 1e-14);
                assert!(inward.z * on_wall.z < 0.0 && (on_wall.z > 0.0) == (point.features.1 == 1));
                ends += 1;
            }
        }
    }
    assert!(sides > 100 && ends > 100);
}

//! Polyhedra against solid cylinders: closed forms, and bounds from both sides.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, SQRT_2};

use cd_solve::geometry::{ListingRange, Manifold, polyhedron_cylinder};
use cd_solve::math::{Quat, Vec3};

use crate::check;
use crate::degenerate::face_to;
use crate::oracle::Solid;
use crate::patch::agree_with_cylinder;
use crate::shapes::{Random, cuboid, regular, rock};

/// Roundings of sums of some numbers up to 10.
const ROUNDING: f64 = 1e-14;

/// The contact of a solid at `x` from the centre of a cylinder that stands along z.
fn manifold_at(a: &Solid, qa: &Quat, x: Vec3, size: [f64; 2], range: impl Into<ListingRange>) -> Option<Manifold> {
    turned_manifold(a, qa, x, &Quat::identity(), size, range)
}

/// The same, all turned.
fn turned_manifold(
    a: &Solid,
    qa: &Quat,
    x: Vec3,
    turn: &Quat,
    size: [f64; 2],
    range: impl Into<ListingRange>,
) -> Option<Manifold> {
    polyhedron_cylinder(&a.shape.posed_by(&(turn * qa)), &-(turn * x), turn, size, range)
}

/// s(m) for a unit m from the cylinder to vertices about its centre.
fn separation(vertices: &[Vec3], [half_height, radius]: [f64; 2], m: &Vec3) -> f64 {
    let low = vertices.iter().map(|v| m.dot(v)).fold(f64::INFINITY, f64::min);
    low - radius * m.x.hypot(m.y) - half_height * m.z.abs()
}

/// Largest separation, by ascent with ever smaller steps from the best of many directions.
fn brute(vertices: &[Vec3], size: [f64; 2], random: &mut Random) -> f64 {
    let mut starts: Vec<(f64, Vec3)> = (0..300)
        .map(|_| random.direction())
        .chain(vertices.iter().filter_map(|v| v.try_normalize(0.0)))
        .map(|m| (separation(vertices, size, &m), m))
        .collect();
    starts.sort_by(|p, q| q.0.total_cmp(&p.0));
    let uphill = |(mut s, mut m): (f64, Vec3), random: &mut Random| {
        let mut step = 0.1;
        while step > 1e-11 {
            let mut gained = false;
            for _ in 0..12 {
                let other = (m + random.direction() * step).normalize();
                let better = separation(vertices, size, &other);
                if better > s {
                    (s, m, gained) = (better, other, true);
                }
            }
            if !gained {
                step *= 0.5;
            }
        }
        s
    };
    starts.truncate(5);
    starts.into_iter().map(|start| uphill(start, random)).fold(f64::NEG_INFINITY, f64::max)
}

#[test]
fn directions_are_the_best_and_points_on_both() {
    let mut random = Random(31);
    let (mut apart, mut overlapping) = (0, 0);
    let mut flat = 0;
    for k in 0..11_200 {
        let count = 4 + random.index(16);
        let a = match k % 4 {
            0 => cuboid(1.0, 0.7, 0.4),
            1 => regular(6, 0.5),
            _ => rock(&mut random, count, Vec3::new(1.0, 0.8, 0.6)),
        };
        let size = [random.between(0.2, 2.0), random.between(0.2, 2.0)];
        // A face down in every fifth, flat on the end if it is there.
        let (face_down, turn) = (k % 5 == 4, random.turn());
        let q = if face_down { face_to(&mut random, &a, -1.0) } else { random.turn() };
        // At the side, above, or at the rim.
        let angle = random.between(0.0, 2.0 * PI);
        let (wide, high) = match k % 3 {
            0 => (size[1] + random.between(0.2, 1.0), size[0] * random.between(-1.0, 1.0)),
            1 => (size[1] * random.unit(), size[0] + random.between(0.2, 1.0)),
            _ => (size[1] + random.between(-0.2, 0.8), size[0] + random.between(-0.2, 0.8)),
        };
        let mut x = Vec3::new(wide * angle.cos(), wide * angle.sin(), high);
        if face_down && k % 3 == 1 {
            let low = a.turned_vertices(&q).iter().map(|v| v.z).fold(f64::INFINITY, f64::min);
            x.z = size[0] - low + [1e-3, 0.0, -1e-3][random.index(3)];
        }
        let vertices: Vec<Vec3> = a.turned_vertices(&q).iter().map(|v| v + x).collect();
        let expected = brute(&vertices, size, &mut random);
        let alert = 0.3;
        let Some(found) = turned_manifold(&a, &q, x, &turn, size, alert) else {
            assert!(expected > alert - 1e-9, "{k}: {expected}");
            continue;
        };
        let gap = found.gap();
        check(&found, alert, 1.0 + size[0] + size[1], &|| format!("{k}"));
        // Nothing is better, and the gap is that of its own direction.
        let m = turn.inverse() * found.normal;
        assert!((separation(&vertices, size, &m) - gap).abs() < ROUNDING, "{k}: {found:?}");
        assert!(expected <= gap + 1e-11, "{k}: {gap}, expected {expected}");
        let agrees = agree_with_cylinder(&a, &q, &x, size, &m, &found);
        flat += usize::from(agrees.unwrap_or_else(|fault| panic!("{k}: {fault}: {found:?}")));
        // Two points of A and B that are as far from each other: no direction can part them more.
        for point in &*found.points {
            let middle = turn.inverse() * point.position + x;
            let (on_a, on_b) = (middle + m * (0.5 * point.gap), middle - m * (0.5 * point.gap));
            let outside_b = (on_b.xy().norm() - size[1]).max(on_b.z.abs() - size[0]);
            let outside_a = a.triangles.iter().map(|t| {
                let [p, r, s] = t.map(|k| vertices[k as usize]);
                (r - p).cross(&(s - p)).normalize().dot(&(on_a - p))
            });
            let outside_a = outside_a.fold(f64::NEG_INFINITY, f64::max);
            assert!(outside_a < 1e-11 && outside_b < 1e-11, "{k}: {outside_a} {outside_b} {found:?}");
        }
        if gap > 0.0 { apart += 1 } else { overlapping += 1 }
    }
    println!("{apart} apart, {overlapping} overlapping, {flat} flat on an end");
    assert!(
        apart + overlapping >= 10_000 && apart > 2_000 && overlapping > 2_000 && flat > 500,
        "{apart} {overlapping} {flat}"
    );
}

/// All points at one gap, so many, with this area.
fn all_at(found: &Manifold, count: usize, gap: f64, area: f64) {
    assert_eq!(found.points.len(), count, "{found:?}");
    assert!(found.points.iter().all(|p| (p.gap - gap).abs() < ROUNDING), "{gap}: {found:?}");
    assert!((found.area - area).abs() < ROUNDING, "{area}: {found:?}");
}

const GAPS: [f64; 3] = [1e-3, 0.0, -1e-2];

#[test]
fn faces_on_ends() {
    let (cube, level) = (cuboid(1.0, 1.0, 1.0), Quat::identity());
    for g in GAPS {
        for side in [1.0, -1.0] {
            let on = |x: f64, y: f64, radius: f64| {
                let found = manifold_at(&cube, &level, Vec3::new(x, y, side * (3.0 + g)), [2.0, radius], 2e-3).unwrap();
                assert!((found.normal - Vec3::z() * side).norm() < ROUNDING, "{found:?}");
                found
            };
            // The face within the end, the end within the face, and half of each.
            all_at(&on(0.0, 0.0, 4.0), 4, g, 4.0);
            all_at(&on(0.25, 0.0, 0.5), 4, g, PI * 0.25);
            all_at(&on(1.0, 0.0, 0.5), 3, g, PI * 0.125);
            // A corner over a quarter, and a circular segment.
            all_at(&on(1.0, 1.0, 0.5), 3, g, PI * 0.0625);
            let half_angle = 0.8f64.acos();
            all_at(&on(1.4, 0.0, 0.5), 3, g, 0.25 * (half_angle - 0.8 * 0.6));
        }
    }
}

#[test]
fn lines_on_the_round_side() {
    let cube = cuboid(1.0, 1.0, 1.0);
    for g in GAPS {
        // A face on a side that is shorter, and longer, than it.
        for (half_height, reach) in [(0.5, 0.5), (3.0, 1.0)] {
            let found =
                manifold_at(&cube, &Quat::identity(), Vec3::new(3.0 + g, 0.2, 0.0), [half_height, 2.0], 2e-3).unwrap();
            all_at(&found, 2, g, 0.0);
            assert!((found.normal - Vec3::x()).norm() < ROUNDING);
            let mut z = [0, 1].map(|k| found.points[k].position.z);
            z.sort_by(f64::total_cmp);
            assert!((z[0] + reach).abs() < ROUNDING && (z[1] - reach).abs() < ROUNDING, "{found:?}");
            assert!(found.points.iter().all(|p| (p.position.y + 0.2).abs() < ROUNDING), "{found:?}");
        }
        // An upright edge, all along; a level one, in a point.
        let edge_on = Quat::from_scaled_axis(Vec3::z() * FRAC_PI_4);
        let found = manifold_at(&cube, &edge_on, Vec3::new(2.0 + SQRT_2 + g, 0.0, 0.3), [3.0, 2.0], 2e-3).unwrap();
        all_at(&found, 2, g, 0.0);
        let level = Quat::from_scaled_axis(Vec3::x() * FRAC_PI_2) * edge_on;
        let found = manifold_at(&cube, &level, Vec3::new(2.0 + SQRT_2 + g, 0.1, 0.3), [3.0, 2.0], 2e-3).unwrap();
        all_at(&found, 1, g, 0.0);
        assert!((found.points[0].position - Vec3::new(-SQRT_2 - 0.5 * g, -0.1, 0.0)).norm() < ROUNDING, "{found:?}");
    }
}

#[test]
fn vertices_and_edges_at_the_rim() {
    let cube = cuboid(1.0, 1.0, 1.0);
    // 3-4-5: the lower edge is 0.3 outside of and 0.4 above the rim.
    let found = manifold_at(&cube, &Quat::identity(), Vec3::new(3.3, 0.2, 3.4), [2.0, 2.0], 1.0).unwrap();
    all_at(&found, 1, 0.5, 0.0);
    assert!((found.normal - Vec3::new(0.6, 0.0, 0.8)).norm() < ROUNDING);
    // A vertex beyond the rim in the same way.
    let corner = Vec3::new(2.3 * 0.6, 2.3 * 0.8, 2.4) + Vec3::repeat(1.0);
    let found = manifold_at(&cube, &Quat::identity(), corner, [2.0, 2.0], 1.0).unwrap();
    all_at(&found, 1, 0.5, 0.0);
    assert!((found.normal - Vec3::new(0.36, 0.48, 0.8)).norm() < ROUNDING, "{found:?}");
}

#[test]
fn what_is_degenerate_stays_finite() {
    let mut random = Random(5);
    let cube = cuboid(1.0, 1.0, 1.0);
    for k in 0..3_000 {
        let a = match k % 3 {
            0 => &cube,
            1 => &cuboid(1.0, 1.0, 1e-3),
            _ => &cuboid(1e-3, 1e-3, 1.0),
        };
        let size = [[1.0, 1.0], [1e-3, 1.0], [1.0, 1e-3], [1e3, 1.0]][random.index(4)];
        let quarter = |random: &mut Random| FRAC_PI_4 * random.index(4) as f64 + [0.0, 1e-12][random.index(2)];
        let q = Quat::from_euler_angles(quarter(&mut random), quarter(&mut random), quarter(&mut random));
        let step = |random: &mut Random, size: f64| [0.0, 1.0, -1.0, 1.0 + size, SQRT_2][random.index(5)];
        let x = Vec3::new(step(&mut random, size[1]), step(&mut random, size[1]), step(&mut random, size[0]));
        let Some(found) = manifold_at(a, &q, x, size, 0.1) else { continue };
        check(&found, 0.1, 2.0 + size[0] + size[1], &|| format!("{k}"));
        let vertices: Vec<Vec3> = a.turned_vertices(&q).iter().map(|v| v + x).collect();
        // Of directions that are equal to 4e-12 of the smaller body any may come out; rounding at the size of the longest.
        let s = separation(&vertices, size, &found.normal);
        assert!((s - found.gap()).abs() < 8e-12 + ROUNDING * (1.0 + size[0]), "{k}: {s} {found:?}");
    }
}

#[test]
fn area_counts_as_far_as_it_is_near() {
    let cube = cuboid(1.0, 1.0, 1.0);
    // Tilted about y by a hundredth: gaps fall from one side of the face, two wide, to the other.
    let tilt: f64 = 0.01;
    let q = Quat::from_scaled_axis(Vec3::y() * tilt);
    let low = cube.turned_vertices(&q).iter().map(|v| v.z).fold(f64::INFINITY, f64::min);
    let within = 0.004;
    let range = ListingRange { area: within, ..ListingRange::from(1.0) };
    // On a wide end, seen along z: a strip of the face with gaps up to `within`, less what the tilt takes of it.
    let found = manifold_at(&cube, &q, Vec3::new(0.0, 0.0, 2.0 - low), [2.0, 40.0], range).unwrap();
    assert!((found.normal - Vec3::z()).norm() < ROUNDING, "{found:?}");
    let share = 1.0 - (tilt.tan() / 0.1).powi(2);
    assert!((found.area - share * 2.0 * within / tilt.tan()).abs() < 1e-12, "{found:?}");
    let all = manifold_at(&cube, &q, Vec3::new(0.0, 0.0, 2.0 - low), [2.0, 40.0], 1.0).unwrap();
    assert!((all.area - 4.0 * tilt.cos()).abs() < 1e-12, "{all:?}");
}

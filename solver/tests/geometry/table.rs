//! Expected contacts of cubes of half side 1 and similar bodies, at gaps above, at and below zero.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_4, SQRT_2};

use cd_solve::geometry::{CachedFeature, ListingRange, Manifold, NarrowPhaseMode, polyhedron_polyhedron};
use cd_solve::math::{Quat, Vec3};

use crate::oracle::{Solid, common_area, separation};
use crate::shapes::{Random, cuboid, on_vertex, prism, regular};
use crate::{check, contact};

const GAPS: [f64; 3] = [1e-3, 0.0, -1e-2];
const ALERT: f64 = 2e-3;
/// Roundings of sums of some numbers up to 4.
const ROUNDING: f64 = 1e-14;

/// The contact, after a check that all turned together gives the same turned.
fn manifold_of(a: &Solid, qa: Quat, b: &Solid, qb: Quat, c: Vec3) -> Manifold {
    let first = contact(a, &qa, b, &qb, &c, ALERT).unwrap();
    let size = a.radius + b.radius;
    check(&first, ALERT, size, &|| format!("{c}"));
    let (expected, _) = separation(a, &qa, b, &qb, &c);
    assert!((first.gap() - expected).abs() < ROUNDING * size, "{c}: {first:?}, expected {expected}");
    let mut random = Random(7);
    for _ in 0..20 {
        let turn = random.turn();
        let again = contact(a, &(turn * qa), b, &(turn * qb), &(turn * c), ALERT).unwrap();
        assert_eq!(again.points.len(), first.points.len(), "{first:?} {again:?}");
        assert!((again.gap() - first.gap()).abs() < ROUNDING * size);
    }
    first
}

fn all_at(found: &Manifold, count: usize, gap: f64, area: f64) {
    assert_eq!(found.points.len(), count, "{found:?}");
    assert!(found.points.iter().all(|p| (p.gap - gap).abs() < ROUNDING), "{gap}: {found:?}");
    assert!((found.area - area).abs() < ROUNDING, "{area}: {found:?}");
}

/// n points down to A, which lies below.
fn vertical(found: &Manifold) {
    vertical_within(found, ROUNDING);
}

fn vertical_within(found: &Manifold, allowed: f64) {
    assert!((found.normal + Vec3::z()).norm() < allowed, "{found:?}");
}

fn rotation_about(axis: Vec3, angle: f64) -> Quat {
    Quat::from_scaled_axis(axis * angle)
}

#[test]
fn faces_on_faces() {
    let (cube, level) = (cuboid(1.0, 1.0, 1.0), Quat::identity());
    let table = cuboid(1000.0, 1000.0, 1.0);
    for g in GAPS {
        let up = Vec3::z() * (2.0 + g);
        let aligned = manifold_of(&cube, level, &cube, level, up);
        vertical(&aligned);
        all_at(&aligned, 4, g, 4.0);
        // Corners keep their vertices: no crossings of sides.
        assert!(aligned.points.iter().all(|p| p.features.0 < 8 && p.features.1 < 8), "{aligned:?}");
        let shifted = manifold_of(&cube, level, &cube, level, up + Vec3::new(0.5, 0.3, 0.0));
        vertical(&shifted);
        all_at(&shifted, 4, g, 1.5 * 1.7);
        let turned = manifold_of(&cube, level, &cube, rotation_about(Vec3::z(), FRAC_PI_4), up);
        vertical(&turned);
        all_at(&turned, 8, g, 8.0 * (SQRT_2 - 1.0));
        // Sides that nearly coincide cross in the middle: what carries are the corners.
        for quarter in 0..4 {
            let turn = rotation_about(Vec3::z(), f64::from(quarter) * 2.0 * FRAC_PI_4 + 1e-3);
            let nearly = manifold_of(&cube, level, &cube, turn, Vec3::new(0.0, 0.0, 2.0 + g));
            assert_eq!(nearly.points.len(), 4, "{nearly:?}");
            assert!(nearly.points.iter().all(|p| p.position.x.abs().min(p.position.y.abs()) > 0.998), "{nearly:?}");
        }
        let on_table = manifold_of(&table, level, &cube, level, up + Vec3::new(300.0, 200.0, 0.0));
        vertical(&on_table);
        assert!(on_table.points.len() == 4 && (on_table.area - 4.0).abs() < 1e-12, "{on_table:?}");
    }
}

#[test]
fn edges_and_vertices_on_faces() {
    let (cube, level) = (cuboid(1.0, 1.0, 1.0), Quat::identity());
    for g in GAPS {
        let edge = manifold_of(
            &cube,
            level,
            &cube,
            rotation_about(Vec3::x(), FRAC_PI_4),
            Vec3::new(0.1, 0.2, 1.0 + SQRT_2 + g),
        );
        vertical(&edge);
        assert_eq!(edge.points.len(), 2);
        assert!(edge.points.iter().all(|p| (p.gap - g).abs() < ROUNDING));
        let vertex = manifold_of(&cube, level, &cube, on_vertex(), Vec3::new(0.1, 0.2, 1.0 + 3f64.sqrt() + g));
        vertical(&vertex);
        let deep: Vec<_> = vertex.points.iter().filter(|p| p.gap < g + 1e-9).collect();
        assert!(deep.len() == 1 && (deep[0].position.xy() - Vec3::new(0.1, 0.2, 0.0).xy()).norm() < ROUNDING);
        if g >= 0.0 {
            assert_eq!(vertex.points.len(), 1);
        }
        let (ridge_x, ridge_y) = (rotation_about(Vec3::x(), FRAC_PI_4), rotation_about(Vec3::y(), FRAC_PI_4));
        let crossed = manifold_of(&cube, ridge_x, &cube, ridge_y, Vec3::new(0.1, 0.2, 2.0 * SQRT_2 + g));
        vertical(&crossed);
        assert_eq!(crossed.points.iter().filter(|p| (p.gap - g).abs() < ROUNDING).count(), 1);
        if g >= 0.0 {
            assert_eq!(crossed.points.len(), 1);
        }
    }
}

#[test]
fn edges_and_vertices_on_each_other() {
    let cube = cuboid(1.0, 1.0, 1.0);
    let ridge = rotation_about(Vec3::x(), FRAC_PI_4);
    for g in GAPS {
        let ridges = manifold_of(&cube, ridge, &cube, ridge, Vec3::new(0.3, 0.0, 2.0 * SQRT_2 + g));
        let tips = manifold_of(&cube, on_vertex(), &cube, on_vertex(), Vec3::z() * (2.0 * 3f64.sqrt() + g));
        let tip_on_ridge = manifold_of(&cube, ridge, &cube, on_vertex(), Vec3::z() * (SQRT_2 + 3f64.sqrt() + g));
        if g > 0.0 {
            // The direction between two points g apart is known as far as they are.
            [&ridges, &tips, &tip_on_ridge].into_iter().for_each(|found| vertical_within(found, ROUNDING / g));
            all_at(&ridges, 2, g, 0.0);
            let mut ends: Vec<f64> = ridges.points.iter().map(|p| p.position.x).collect();
            ends.sort_by(f64::total_cmp);
            assert!((ends[0] + 0.7).abs() < ROUNDING && (ends[1] - 1.0).abs() < ROUNDING, "{ends:?}");
            all_at(&tips, 1, g, 0.0);
            all_at(&tip_on_ridge, 1, g, 0.0);
        } else {
            // A normal of a face, or of edges: the way out that is shortest.
            assert!((ridges.gap() - g * FRAC_1_SQRT_2).abs() < ROUNDING && ridges.points.len() >= 2);
            assert!((tips.gap() - g / 3f64.sqrt()).abs() < ROUNDING);
            assert!(tip_on_ridge.gap() <= ROUNDING && tip_on_ridge.gap() >= g);
        }
    }
    let strip = manifold_of(&cube, Quat::identity(), &cube, Quat::identity(), Vec3::new(2.0, 0.0, 2.0 - 1e-2));
    assert!((strip.normal + Vec3::x()).norm() < ROUNDING);
    all_at(&strip, 4, 0.0, 2e-2);
}

#[test]
fn polygons_on_plates_keep_their_corners() {
    let level = Quat::identity();
    let plate = cuboid(3.0, 3.0, 0.1);
    for (sides, area) in [(6, 1.5 * 3f64.sqrt()), (12, 3.0)] {
        let polygon = regular(sides, 0.5);
        for g in GAPS {
            let flat = manifold_of(&plate, level, &polygon, level, Vec3::z() * (0.6 + g));
            vertical(&flat);
            all_at(&flat, sides, g, area);
        }
        let corner = manifold_of(&plate, level, &polygon, level, Vec3::new(2.7, 2.8, 0.6));
        let outline: Vec<[f64; 2]> = polygon.vertices.iter().map(|v| [v.x + 2.7, v.y + 2.8]).collect();
        let cut = common_area(&outline, &[[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]]);
        all_at(&corner, corner.points.len(), 0.0, cut);
        // The corner of the plate, two crossings, and the polygon's vertices over the plate.
        let over = outline.iter().filter(|[x, y]| x.max(*y) < 3.0).count() / 2; // of both ends
        assert_eq!(corner.points.len(), 3 + over, "{corner:?}");
    }
}

#[test]
fn one_inside_the_other_is_definite() {
    let level = Quat::identity();
    let (cube, big) = (cuboid(1.0, 1.0, 1.0), cuboid(3.0, 3.0, 3.0));
    for (a, b, qb, c) in [
        (&cube, &cube, level, Vec3::zeros()),
        (&cube, &big, level, Vec3::zeros()),
        (&big, &cube, level, Vec3::new(1.5, 0.2, -0.3)),
        (&cuboid(2.0, 2.0, 0.05), &cuboid(2.0, 2.0, 0.05), rotation_about(Vec3::x(), 2.0 * FRAC_PI_4), Vec3::zeros()),
        (
            &cuboid(2.0, 2.0, 0.05),
            &cuboid(2.0, 2.0, 0.05),
            rotation_about(Vec3::new(0.3, 0.8, 0.1), 1.0),
            Vec3::zeros(),
        ),
    ] {
        let manifold = manifold_of(a, level, b, qb, c);
        assert!(manifold.gap() < 0.0);
    }
    let same = manifold_of(&cube, level, &cube, level, Vec3::zeros());
    assert!((same.gap() + 2.0).abs() < ROUNDING);
}

#[test]
fn slivers_of_a_thousandth_are_met() {
    let level = Quat::identity();
    // A right triangle of sides 1 and 1, a thousandth thick.
    let sliver = prism(&[[-0.3, -0.3], [0.7, -0.3], [-0.3, 0.7]], 5e-4);
    let cube = cuboid(1.0, 1.0, 1.0);
    for g in [1e-5, 0.0, -1e-4] {
        let on_cube = manifold_of(&cube, level, &sliver, level, Vec3::new(0.1, 0.1, 1.0005 + g));
        vertical(&on_cube);
        all_at(&on_cube, 3, g, 0.5);
        let on_sliver =
            manifold_of(&sliver, level, &sliver, rotation_about(Vec3::z(), 2.0), Vec3::new(0.1, 0.1, 1e-3 + g));
        vertical(&on_sliver);
        assert_eq!(on_sliver.points.len(), 5, "{on_sliver:?}");
    }
}

/// A tilted face: the part of the patch that is within the range of a stress.
#[test]
fn area_counts_as_far_as_it_is_near() {
    let (cube, table) = (cuboid(1.0, 1.0, 1.0), cuboid(10.0, 10.0, 1.0));
    let tilt: f64 = 0.01;
    let within = 0.004;
    // Along the table's normal, which is the direction of contact: a strip of the face.
    for turn in [rotation_about(Vec3::y(), tilt), rotation_about(Vec3::x(), -tilt)] {
        let low = cube.turned_vertices(&turn).iter().map(|v| v.z).fold(f64::INFINITY, f64::min);
        let c = Vec3::z() * (low - 1.0);
        let area = |range: ListingRange| {
            let (a, b) = (cube.shape.posed_by(&turn), table.shape.posed_by(&Quat::identity()));
            let found =
                polyhedron_polyhedron(&a, &b, &c, range, NarrowPhaseMode::Accurate, &mut CachedFeature::default())
                    .unwrap();
            assert!((found.normal - Vec3::z()).norm() < ROUNDING, "{found:?}");
            found.area
        };
        // Less what the tilt takes.
        let expected = 2.0 * within / tilt.tan() * (1.0 - (tilt.tan() / 0.1).powi(2));
        // The gap has lost two digits of what the tilt makes of it.
        assert!((area(ListingRange { area: within, ..ListingRange::from(1.0) }) - expected).abs() < 1e-12);
        assert!((area(1.0.into()) - 4.0 * tilt.cos()).abs() < 1e-12);
        assert_eq!(area(ListingRange { area: -1e-6, ..ListingRange::from(1.0) }), 0.0);
    }
}

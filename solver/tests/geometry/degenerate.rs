//! Constructed contacts, a thousand and more of each class: what touches what is known, and noise must not change it.

use cd_solve::geometry::{CachedFeature, Manifold, NarrowPhaseMode};
use cd_solve::math::{Quat, Vec3};
use nalgebra::{Matrix3, Rotation3};

use crate::oracle::{Solid, common_area, separation};
use crate::shapes::{Random, cuboid, prism, regular, rock};
use crate::{check, contact, remembered};

/// Number of pairs of each class.
const COUNT: usize = 1_000;
const NOISE: f64 = 1e-12;

/// Two bodies in touch along z, A below; all turned by a random rotation before the solver sees them.
struct Touch {
    a: Solid,
    qa: Quat,
    b: Solid,
    qb: Quat,
    c: Vec3,
    gap: f64,
}

/// A gap apart, none, or overlapping by little, next to the thinner body; and noise about none.
fn gap(random: &mut Random, a: &Solid, b: &Solid) -> f64 {
    let thin = a.shape.inradius().min(b.shape.inradius());
    [1e-3 * thin, 0.0, -1e-2 * thin, 1e-12, -1e-12, 1e-7 * thin][random.index(6)]
}

fn polygon_body(random: &mut Random) -> Solid {
    match random.index(5) {
        0 => cuboid(random.between(0.2, 1.0), random.between(0.2, 1.0), random.between(0.5, 1.0)),
        1 => prism(&[[-0.3, -0.3], [0.7, -0.3], [-0.3, 0.7]], random.between(0.3, 1.0)),
        // Plates and needles of a thousandth.
        2 => cuboid(1.0, random.between(0.5, 1.0), 1e-3),
        3 => cuboid(1.0, 1e-3, 1e-3),
        _ => regular(3 + random.index(10), random.between(0.3, 1.0)),
    }
}

fn height(solid: &Solid, q: &Quat) -> f64 {
    solid.turned_vertices(q).iter().map(|v| v.z).fold(f64::NEG_INFINITY, f64::max)
}

fn depth(solid: &Solid, q: &Quat) -> f64 {
    -solid.turned_vertices(q).iter().map(|v| v.z).fold(f64::INFINITY, f64::min)
}

/// On top of each other, moved sideways.
fn stacked(a: Solid, qa: Quat, b: Solid, qb: Quat, side: [f64; 2], gap: f64) -> Touch {
    let c = Vec3::new(side[0], side[1], height(&a, &qa) + depth(&b, &qb) + gap);
    Touch { a, qa, b, qb, c, gap }
}

/// A turn after which an edge looks along `to` (-z or z) and is level; its direction comes out along x.
pub fn edge_to(random: &mut Random, solid: &Solid, to: f64) -> Quat {
    let normals = normals(solid);
    let edges: Vec<([Vec3; 2], Vec3)> = edges(solid)
        .into_iter()
        .filter_map(|(ends, sides)| {
            let beside = sides.map(|t| normals[t]);
            let along = (solid.vertices[ends[1]] - solid.vertices[ends[0]]).normalize();
            (beside[0].dot(&beside[1]) < 0.99).then_some((beside, along))
        })
        .collect();
    let (beside, along) = edges[random.index(edges.len())];
    let share = random.between(0.2, 0.8);
    let down = (beside[0] * share + beside[1] * (1.0 - share)).normalize();
    to_axes(along, down * to)
}

/// A turn after which a face looks along `to`.
pub fn face_to(random: &mut Random, solid: &Solid, to: f64) -> Quat {
    let normals = normals(solid);
    to_axes(random.direction(), normals[random.index(normals.len())] * to)
}

/// A turn after which a vertex looks along `to`.
pub fn vertex_to(random: &mut Random, solid: &Solid, to: f64) -> Quat {
    let normals = normals(solid);
    let v = random.index(solid.vertices.len()) as u32;
    let around = solid.triangles.iter().zip(&normals).filter(|(t, _)| t.contains(&v));
    let down: Vec3 = around.map(|(_, n)| n * random.between(0.3, 0.7)).sum();
    to_axes(random.direction(), down.normalize() * to)
}

/// Turns `z` to z, and `x` into the plane of x and z.
fn to_axes(x: Vec3, z: Vec3) -> Quat {
    let y = z.cross(&x).normalize();
    let turn = Matrix3::from_rows(&[y.cross(&z).transpose(), y.transpose(), z.transpose()]);
    Quat::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn))
}

fn normals(solid: &Solid) -> Vec<Vec3> {
    let normal = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|k| solid.vertices[k as usize]);
        (b - a).cross(&(c - a)).normalize()
    };
    solid.triangles.iter().map(normal).collect()
}

/// Ends of each edge, and its two triangles.
fn edges(solid: &Solid) -> Vec<([usize; 2], [usize; 2])> {
    let mut edges = Vec::new();
    for (i, t) in solid.triangles.iter().enumerate() {
        for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
            let back = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]].contains(&[b, a]);
            if a < b {
                edges.push(([a as usize, b as usize], [i, solid.triangles.iter().position(back).unwrap()]));
            }
        }
    }
    edges
}

/// Where the points farthest along `sign` z are, on average, from the body's centre.
fn middle(solid: &Solid, q: &Quat, sign: f64) -> Vec3 {
    let turned = solid.turned_vertices(q);
    let far = turned.iter().map(|v| sign * v.z).fold(f64::NEG_INFINITY, f64::max);
    let of_feature: Vec<&Vec3> = turned.iter().filter(|v| sign * v.z > far - 1e-9 * solid.radius).collect();
    of_feature.iter().copied().sum::<Vec3>() / of_feature.len() as f64
}

/// The middles of what looks up in A and down in B above each other.
fn meeting(a: Solid, qa: Quat, b: Solid, qb: Quat, gap: f64) -> Touch {
    let c = middle(&a, &qa, 1.0) - middle(&b, &qb, -1.0) + Vec3::z() * gap;
    Touch { a, qa, b, qb, c, gap }
}

fn rotation_about(axis: Vec3, angle: f64) -> Quat {
    Quat::from_scaled_axis(axis * angle)
}

fn rotation_about_z(random: &mut Random) -> Quat {
    // Also aligned, and by a right angle.
    rotation_about(Vec3::z(), [0.0, 0.0, std::f64::consts::FRAC_PI_2, random.between(0.0, 6.3)][random.index(4)])
}

/// Runs a class: gap, what `expect` says, exchange of the bodies, and noise, in both narrow phases. `pointed`: the nearest
/// features are points and lines.
fn class(seed: u64, pointed: bool, make: impl Fn(&mut Random) -> Touch, expect: impl Fn(&Touch, &Manifold)) {
    let mut random = Random(seed);
    let mut stays = 0;
    for k in 0..COUNT {
        let touch = make(&mut random);
        let Touch { a, qa, b, qb, c, .. } = &touch;
        let size = a.radius + b.radius;
        let alert = touch.gap.max(0.0) + 1e-6 * a.radius.min(b.radius);
        let small = a.radius.min(b.radius);
        let level = contact(a, qa, b, qb, c, alert).unwrap_or_else(|| panic!("case {k}: nothing"));
        check(&level, alert, size, &|| format!("case {k}"));
        expect(&touch, &level);
        let turn = random.turn();
        let (qa, qb, c) = (turn * qa, turn * qb, turn * c);
        let mut memory = CachedFeature::default();
        let first = remembered(a, &qa, b, &qb, &c, alert, NarrowPhaseMode::Accurate, &mut memory).unwrap();
        check(&first, alert, size, &|| format!("case {k} turned"));
        let (expected, _) = separation(a, &qa, b, &qb, &c);
        let far = |found: &Manifold, expected: f64| (found.gap() - expected).abs() / size;
        assert!(far(&first, expected) < 1e-12, "case {k}: {first:?}, expected {expected}");
        let fast = |qa: &Quat, qb: &Quat, c: &Vec3, memory: &mut CachedFeature| {
            let found = remembered(a, qa, b, qb, c, alert, NarrowPhaseMode::Fast, memory);
            found.iter().for_each(|found| check(found, alert, size, &|| format!("case {k}, fast")));
            found
        };
        // With nothing remembered the fast search is the other.
        assert_eq!(fast(&qa, &qb, &c, &mut CachedFeature::default()), Some(first.clone()), "case {k}");
        // From the step before it may stay at another direction in which bodies overlap, and more than in the best; where
        // it finds them apart it has found what is nearest.
        let step = a.shape.inradius().min(b.shape.inradius()) * [1e-6, 1e-4, 1e-2][k % 3];
        let mut turned = |q: &Quat| Quat::from_scaled_axis(random.direction() * (step / size)) * q;
        let (before_a, before_b) = (turned(&qa), turned(&qb));
        let mut from_before = CachedFeature::default();
        fast(&before_a, &before_b, &(c + random.direction() * step), &mut from_before);
        let after = fast(&qa, &qb, &c, &mut from_before).unwrap_or_else(|| panic!("case {k}, fast: {first:?} lost"));
        assert!(after.gap() < expected + 1e-12 * size, "case {k}, fast: {after:?}, expected {expected}");
        if after.gap() > 0.0 {
            assert!(far(&after, expected) < 1e-12, "case {k}, fast: {after:?}, expected {expected}");
        }
        stays += usize::from(far(&after, expected) > 1e-11);
        // A for B.
        let other = contact(b, &qb, a, &qa, &-c, alert).unwrap();
        check(&other, alert, size, &|| format!("case {k} exchanged"));
        assert!((other.gap() - first.gap()).abs() < 2e-12 * size, "case {k}: {first:?} {other:?}");
        // Noise in place and turn, of the smaller size; a plane's tilt counts as far as the larger body reaches.
        let mut noise = |reach: f64| random.direction() * (NOISE * small / reach);
        let (dc, da, db) = (noise(1.0), noise(size), noise(size));
        let (qa, qb, c) = (Quat::from_scaled_axis(da) * qa, Quat::from_scaled_axis(db) * qb, c + dc);
        let mut fast_memory = memory;
        let again = remembered(a, &qa, b, &qb, &c, alert, NarrowPhaseMode::Accurate, &mut memory)
            .unwrap_or_else(|| panic!("case {k} lost: {first:?}, {:?}", separation(a, &qa, b, &qb, &c)));
        check(&again, alert, size, &|| format!("case {k} with noise"));
        let (expected, _) = separation(a, &qa, b, &qb, &c);
        assert!(far(&again, expected) < 1e-11, "case {k}: {again:?}, expected {expected}");
        let ids = |found: &Manifold| found.points.iter().map(|p| p.features).collect::<Vec<_>>();
        assert_eq!(ids(&again), ids(&first), "case {k}: {first:?} {again:?}");
        // The normal of edges turns by noise over their angle, between points a gap apart by noise over gap.
        let free = if pointed && touch.gap > 0.0 { 100.0 * NOISE * small / touch.gap } else { 100.0 * NOISE };
        assert!((again.normal - first.normal).norm() < free, "case {k}: {first:?} {again:?}");
        let again = fast(&qa, &qb, &c, &mut fast_memory).unwrap_or_else(|| panic!("case {k}, fast: {first:?} lost"));
        assert!(far(&again, expected) < 1e-11, "case {k}, fast: {again:?}, expected {expected}");
        assert_eq!(ids(&again), ids(&first), "case {k}, fast: {first:?} {again:?}");
        assert!((again.normal - first.normal).norm() < free, "case {k}, fast: {first:?} {again:?}");
    }
    println!("the fast search stays at another direction in {stays} of {COUNT}");
}

fn scaled_solid(solid: Solid, by: f64) -> Solid {
    Solid::new(solid.vertices.iter().map(|v| v * by).collect(), solid.triangles)
}

/// A body to meet, sometimes a thousand times as large.
fn large(random: &mut Random) -> Solid {
    let body = polygon_body(random);
    scaled_solid(body, [1.0, 1.0, 1000.0][random.index(3)])
}

fn vertical(found: &Manifold) {
    assert!((found.normal + Vec3::z()).norm() < 1e-12, "{found:?}");
}

#[test]
fn faces_on_faces() {
    let make = |random: &mut Random| {
        let (a, b) = (large(random), polygon_body(random));
        let most = 0.4 * a.shape.inradius().min(b.shape.inradius());
        let side = [[0.0, 0.0], [random.between(-most, most), random.between(-most, most)]][random.index(2)];
        let (qa, qb) = (rotation_about_z(random), rotation_about_z(random));
        let gap = gap(random, &a, &b);
        stacked(a, qa, b, qb, side, gap)
    };
    class(1, false, make, |touch, found| {
        vertical(found);
        let (top, bottom) = (height(&touch.a, &touch.qa), depth(&touch.b, &touch.qb));
        let of = |v: Vec<Vec3>, level: f64, sign: f64, by: Vec3| -> Vec<[f64; 2]> {
            let of_face = v.into_iter().filter(|v| sign * v.z > level - 1e-9);
            of_face.map(|v| [v.x + by.x, v.y + by.y]).collect()
        };
        let area = common_area(
            &of(touch.a.turned_vertices(&touch.qa), top, 1.0, Vec3::zeros()),
            &of(touch.b.turned_vertices(&touch.qb), bottom, -1.0, touch.c),
        );
        let size = touch.a.radius.min(touch.b.radius);
        assert!((found.area - area).abs() < 1e-9 * size * size, "{found:?}, area {area}");
        assert!(found.points.len() >= 3 || area < 1e-9, "{found:?}, area {area}");
    });
}

fn deepest(found: &Manifold, count: usize, gap: f64, size: f64) {
    let deep = found.points.iter().filter(|p| p.gap <= found.gap() + 1e-9 * size).count();
    assert!(deep == count && (found.gap() - gap).abs() < 1e-14 * size, "{count} at {gap}: {found:?}");
}

#[test]
fn edges_on_faces() {
    let make = |random: &mut Random| {
        let (a, b) = (large(random), polygon_body(random));
        let (qa, qb) = (rotation_about_z(random), rotation_about_z(random) * edge_to(random, &b, -1.0));
        let gap = gap(random, &a, &b);
        meeting(a, qa, b, qb, gap)
    };
    class(2, false, make, |touch, found| {
        vertical(found);
        deepest(found, 2, touch.gap, touch.a.radius + touch.b.radius);
    });
}

#[test]
fn vertices_on_faces() {
    let make = |random: &mut Random| {
        let (a, b) = (large(random), polygon_body(random));
        let (qa, qb) = (rotation_about_z(random), rotation_about_z(random) * vertex_to(random, &b, -1.0));
        let gap = gap(random, &a, &b);
        meeting(a, qa, b, qb, gap)
    };
    class(3, false, make, |touch, found| {
        vertical(found);
        deepest(found, 1, touch.gap, touch.a.radius + touch.b.radius);
    });
}

#[test]
fn crossed_edges() {
    let make = |random: &mut Random| {
        let (a, b) = (large(random), polygon_body(random));
        let (qa, qb) =
            (edge_to(random, &a, 1.0), rotation_about(Vec3::z(), random.between(0.1, 3.0)) * edge_to(random, &b, -1.0));
        let gap = gap(random, &a, &b);
        meeting(a, qa, b, qb, gap)
    };
    class(4, false, make, |touch, found| {
        vertical(found);
        deepest(found, 1, touch.gap, touch.a.radius + touch.b.radius);
    });
}

#[test]
fn parallel_edges() {
    let make = |random: &mut Random| {
        let (a, b) = (large(random), polygon_body(random));
        let (qa, qb) = (edge_to(random, &a, 1.0), edge_to(random, &b, -1.0));
        let gap = gap(random, &a, &b);
        meeting(a, qa, b, qb, gap)
    };
    class(5, true, make, |touch, found| {
        if touch.gap > 1e-8 * touch.b.radius {
            deepest(found, 2, touch.gap, touch.a.radius + touch.b.radius);
        }
    });
}

#[test]
fn vertices_on_vertices_and_edges() {
    let make = |random: &mut Random| {
        let (a, b) = (large(random), polygon_body(random));
        let qa = if random.unit() < 0.5 { vertex_to(random, &a, 1.0) } else { edge_to(random, &a, 1.0) };
        let qb = vertex_to(random, &b, -1.0);
        let gap = gap(random, &a, &b);
        meeting(a, qa, b, qb, gap)
    };
    class(6, true, make, |touch, found| {
        if touch.gap > 1e-8 * touch.b.radius {
            deepest(found, 1, touch.gap, touch.a.radius + touch.b.radius);
        }
    });
}

#[test]
fn rocks_that_just_touch() {
    let make = |random: &mut Random| {
        let thin = Vec3::new(1.0, [1.0, 1e-3][random.index(2)], [1.0, 1e-3][random.index(2)]);
        let (count, other) = (4 + random.index(16), 4 + random.index(16));
        let (a, b) = (rock(random, count, thin), rock(random, other, Vec3::repeat(1.0)));
        let (qa, qb) = (random.turn(), random.turn());
        let mut c = random.direction() * 2.5;
        for _ in 0..3 {
            let (s, n) = separation(&a, &qa, &b, &qb, &c);
            c -= n * s;
        }
        Touch { a, qa, b, qb, c, gap: 0.0 }
    };
    class(7, false, make, |touch, found| assert!(found.gap().abs() < 1e-12 * touch.b.radius, "{found:?}"));
}

#[test]
fn one_inside_the_other() {
    let make = |random: &mut Random| {
        let (a, b) = (large(random), polygon_body(random));
        let (qa, qb) = (rotation_about_z(random), [rotation_about_z(random), random.turn()][random.index(2)]);
        Touch { a, qa, b, qb, c: Vec3::zeros(), gap: 0.0 }
    };
    class(8, false, make, |_, found| assert!(found.gap() < 0.0));
}

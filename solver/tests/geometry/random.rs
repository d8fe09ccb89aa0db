//! Random hulls at depths from deep to apart, turned anyhow or with faces and edges pressed together.

use cd_solve::geometry::{CachedFeature, Manifold, NarrowPhaseMode};
use cd_solve::math::{Quat, Vec3};

use crate::degenerate::{edge_to, face_to, vertex_to};
use crate::oracle::{Solid, separation};
use crate::patch::{Posed, Tally, agree};
use crate::shapes::{Random, cuboid, regular, rock};
use crate::{check, contact, remembered};

struct Case {
    a: Solid,
    qa: Quat,
    b: Solid,
    qb: Quat,
    c: Vec3,
    alert: f64,
}

/// Rocks, needles and plates, of sizes up to 1000:1.
fn shapes(random: &mut Random) -> (Solid, Solid) {
    let shape = |random: &mut Random| {
        let (count, thin) = (4 + random.index(20), random.between(0.01, 0.3));
        let round = Vec3::new(1.0, random.between(0.5, 1.0), random.between(0.5, 1.0));
        match random.index(8) {
            0 => rock(random, count, Vec3::new(thin, thin, 1.0)),
            1 => rock(random, count, Vec3::new(1.0, 1.0, thin)),
            2 => cuboid(random.between(0.1, 1.0), random.between(0.1, 1.0), random.between(0.1, 1.0)),
            3 => regular(3 + random.index(9), random.between(0.2, 1.0)),
            _ => rock(random, count, round),
        }
    };
    let (a, mut b) = (shape(random), shape(random));
    let ratio = [1.0, 1.0, 30.0, 1000.0][random.index(4)];
    b = Solid::new(b.vertices.iter().map(|v| v * ratio).collect(), b.triangles);
    if random.unit() < 0.5 { (a, b) } else { (b, a) }
}

/// Turned anyhow, from 30 % of the smaller size deep to 10 % apart.
fn anyhow(random: &mut Random) -> Case {
    let (a, b) = shapes(random);
    let (qa, qb) = (random.turn(), random.turn());
    let small = a.radius.min(b.radius);
    // The separation along this direction is a bound of the depth.
    let (way, depth) = (random.direction(), small * random.between(-0.6, 0.05));
    let reach =
        |solid: &Solid, q: &Quat, n: Vec3| solid.turned_vertices(q).iter().map(|v| n.dot(v)).fold(0.0, f64::max);
    let c = way * (reach(&a, &qa, way) + reach(&b, &qb, -way) + depth);
    Case { a, qa, b, qb, c, alert: 0.05 * small }
}

/// Features pressed together, which chance hardly ever does: faces, edges and vertices, anywhere on them.
fn pressed(random: &mut Random) -> Case {
    let (a, b) = shapes(random);
    let small = a.radius.min(b.radius);
    type Turn = fn(&mut Random, &Solid, f64) -> Quat;
    let kinds: [[Turn; 2]; 8] = [
        [face_to, face_to],
        [face_to, face_to],
        [face_to, face_to],
        [face_to, edge_to],
        [edge_to, face_to],
        [face_to, vertex_to],
        [edge_to, edge_to],
        [edge_to, edge_to],
    ];
    let [of_a, of_b] = kinds[random.index(kinds.len())];
    let qa = of_a(random, &a, 1.0);
    let qb = Quat::from_scaled_axis(Vec3::z() * random.between(0.0, 6.3)) * of_b(random, &b, -1.0);
    // Somewhere between the vertices that are highest along `sign` z.
    let place = |random: &mut Random, solid: &Solid, q: &Quat, sign: f64| {
        let turned = solid.turned_vertices(q);
        let far = turned.iter().map(|v| sign * v.z).fold(f64::NEG_INFINITY, f64::max);
        let (mut sum, mut weights) = (Vec3::zeros(), 0.0);
        for v in turned.iter().filter(|v| sign * v.z > far - 1e-10 * solid.radius) {
            let weight = random.between(0.01, 1.0);
            (sum, weights) = (sum + v * weight, weights + weight);
        }
        sum / weights
    };
    let gap = small * [1e-3, 0.0, -1e-3, -1e-2, 1e-12, -1e-12, 1e-7][random.index(7)];
    let c = place(random, &a, &qa, 1.0) - place(random, &b, &qb, -1.0) + Vec3::z() * gap;
    let turn = random.turn();
    // Only what is as near as the nearest, or what is tilted, too.
    let alert = gap.max(0.0) + small * [1e-6, 0.05][random.index(2)];
    Case { a, qa: turn * qa, b, qb: turn * qb, c: turn * c, alert }
}

fn compare(seed: u64, make: fn(&mut Random) -> Case) -> Tally {
    let mut random = Random(seed);
    let (mut worst, mut beyond) = (0.0f64, 0);
    let mut tally = Tally::default();
    for k in 0.. {
        if tally.met() == 10_000 {
            break;
        }
        let Case { a, qa, b, qb, c, alert } = make(&mut random);
        let found = contact(&a, &qa, &b, &qb, &c, alert);
        if found.is_none() && k % 5 > 0 {
            continue; // most are of this kind, and trying everything takes longest for them
        }
        let (expected, n) = separation(&a, &qa, &b, &qb, &c);
        let size = a.radius + b.radius;
        if expected > alert {
            // The two may round differently at the border itself.
            assert!(found.is_none() || expected < alert + 1e-12 * size, "pair {k}: {found:?}, expected {expected}");
            beyond += 1;
            continue;
        }
        let found = found.unwrap_or_else(|| panic!("pair {k}: nothing, expected {expected} along {n}"));
        check(&found, alert, size, &|| format!("pair {k}"));
        let error = (found.gap() - expected).abs() / size;
        worst = worst.max(error);
        assert!(error < 1e-12, "pair {k}: {} expected {expected}: {found:?}, {n}", found.gap());
        let posed = Posed { a: &a, qa: &qa, b: &b, qb: &qb, c: &c, alert };
        agree(&posed, &found, &mut tally, &|| format!("pair {k}"));
    }
    println!("largest error of a gap over the size: {worst:e}; {beyond} beyond the alert distance; {tally:?}");
    tally
}

#[test]
fn gaps_points_and_areas_are_those_of_trying_everything() {
    let tally = compare(1, anyhow);
    assert!(tally.vertices_on_faces > 1_000 && tally.crossed_edges > 1_000 && tally.nearest > 10, "{tally:?}");
}

#[test]
fn what_is_pressed_together_has_the_points_and_the_area_of_it() {
    let tally = compare(4, pressed);
    assert!(tally.faces_on_faces > 2_000 && tally.edges_on_faces > 2_000, "{tally:?}");
}

/// The next pose: a little on, or far on.
fn moved_case(random: &mut Random, case: &Case) -> (Quat, Quat, Vec3) {
    let step = [1e-6, 1e-3, 0.1, 0.5][random.index(4)];
    let mut turn = || Quat::from_scaled_axis(random.direction() * step);
    let (da, db) = (turn(), turn());
    (da * case.qa, db * case.qb, case.c + random.direction() * (step * case.a.radius.min(case.b.radius)))
}

#[test]
fn memory_does_not_change_the_answer() {
    let mut random = Random(2);
    let (mut fast_differs, mut met, mut phantoms) = (0, 0, 0);
    for k in 0..10_000 {
        let case = if k % 2 == 0 { anyhow(&mut random) } else { pressed(&mut random) };
        let Case { a, b, alert, .. } = &case;
        let size = a.radius + b.radius;
        let mut memory = CachedFeature::default();
        remembered(a, &case.qa, b, &case.qb, &case.c, *alert, NarrowPhaseMode::Accurate, &mut memory);
        let (qa, qb, c) = moved_case(&mut random, &case);
        let mut before = memory;
        let warm = remembered(a, &qa, b, &qb, &c, *alert, NarrowPhaseMode::Accurate, &mut memory);
        let cold = contact(a, &qa, b, &qb, &c, *alert);
        let gap = |found: &Option<Manifold>| found.as_ref().map_or(*alert, |found| found.gap());
        assert!((gap(&warm) - gap(&cold)).abs() < 1e-12 * size, "pair {k}: {warm:?} {cold:?}");
        if let (Some(warm), Some(cold)) = (&warm, &cold) {
            // Two directions may be equally good; else all is the same.
            let same = (warm.normal - cold.normal).norm() < 1e-9;
            assert!(!same || warm.points.len() == cold.points.len(), "pair {k}: {warm:?} {cold:?}");
        }
        let fast = remembered(a, &qa, b, &qb, &c, *alert, NarrowPhaseMode::Fast, &mut before);
        if let (Some(fast), Some(cold)) = (&fast, &cold) {
            check(fast, *alert, size, &|| format!("pair {k}, fast"));
            // A local minimum of the overlap is never less than the least.
            assert!(fast.gap() < cold.gap() + 1e-12 * size, "pair {k}: {fast:?} {cold:?}");
            met += 1;
            fast_differs += usize::from(fast.gap() < cold.gap() - 1e-12 * size);
        }
        assert!(fast.is_some() || cold.is_none(), "pair {k}: {cold:?}");
        phantoms += usize::from(fast.is_some() && cold.is_none());
    }
    println!("{met} met; the fast search stays at another direction in {fast_differs}, after parting in {phantoms}");
    assert!(met > 3_000 && fast_differs < met / 10 && phantoms < met / 100);
}

#[test]
fn exchange_motion_and_scale_carry_over() {
    let mut random = Random(3);
    let mut tally = Tally::default();
    let mut kept = 0;
    for k in 0.. {
        if kept == 10_000 {
            break;
        }
        let Case { a, qa, b, qb, c, alert } = if k % 2 == 0 { anyhow(&mut random) } else { pressed(&mut random) };
        let Some(found) = contact(&a, &qa, &b, &qb, &c, alert) else { continue };
        kept += 1;
        let (size, small) = (a.radius + b.radius, a.radius.min(b.radius));
        let reduced = tally.reduced;
        agree(&Posed { a: &a, qa: &qa, b: &b, qb: &qb, c: &c, alert }, &found, &mut tally, &|| format!("{k}"));
        let reduced = tally.reduced > reduced;
        // Points on planes seen at a slope of a hundred and more, from bodies a thousand times as large.
        let near = 1e-9 * size;
        let same = |other: &Manifold, n: Vec3, places: Vec<Vec3>, by: f64, what: &str| {
            let what = || format!("{k} {what}: {found:?} {other:?}");
            assert!((other.gap() - by * found.gap()).abs() < 1e-12 * by * size, "{}", what());
            assert!((other.normal - n).norm() < 1e-9, "{}", what());
            assert!((other.area - by * by * found.area).abs() < 1e-9 * (by * small).powi(2), "{}", what());
            assert_eq!(other.points.len(), places.len(), "{}", what());
            for place in places {
                let nearest =
                    other.points.iter().map(|p| (p.position - place * by).norm()).fold(f64::INFINITY, f64::min);
                assert!(nearest < near * by, "{place} {}", what());
            }
        };
        let places = || found.points.iter().map(|p| p.position);
        // Of corners that hardly stand out those with the lesser numbers are left out: A's come before B's, and faces are
        // numbered by their size, which rounding decides where they are alike.
        let as_good = |posed: Posed, other: &Manifold, by: f64, what: &str| {
            agree(&posed, other, &mut Tally::default(), &|| format!("{k} {what}"));
            assert!(
                (other.area - by * by * found.area).abs() < 1e-9 * (by * small).powi(2),
                "{k} {what}: {found:?} {other:?}"
            );
        };
        let other = contact(&b, &qb, &a, &qa, &-c, alert).unwrap();
        if reduced {
            as_good(Posed { a: &b, qa: &qb, b: &a, qb: &qa, c: &-c, alert }, &other, 1.0, "exchanged");
            assert!((other.normal + found.normal).norm() < 1e-9, "{k} exchanged: {found:?} {other:?}");
        } else {
            same(&other, -found.normal, places().map(|p| p - c).collect(), 1.0, "exchanged");
        }
        let turn = random.turn();
        let other = contact(&a, &(turn * qa), &b, &(turn * qb), &(turn * c), alert).unwrap();
        same(&other, turn * found.normal, places().map(|p| turn * p).collect(), 1.0, "turned");
        let by = [1e-3, 1e4][k % 2];
        let scaled =
            |solid: &Solid| Solid::new(solid.vertices.iter().map(|v| v * by).collect(), solid.triangles.clone());
        let (a, b, c, alert) = (scaled(&a), scaled(&b), c * by, alert * by);
        let other = contact(&a, &qa, &b, &qb, &c, alert).unwrap();
        if reduced {
            as_good(Posed { a: &a, qa: &qa, b: &b, qb: &qb, c: &c, alert }, &other, by, "scaled");
            assert!((other.normal - found.normal).norm() < 1e-9, "{k} scaled: {found:?} {other:?}");
        } else {
            same(&other, found.normal, places().collect(), by, "scaled");
        }
    }
    println!("{tally:?}");
}

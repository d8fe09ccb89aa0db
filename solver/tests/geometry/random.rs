//! Random hulls at depths from deep to apart.

use cd_solve::geometry::{Manifold, Memory, Narrow};
use cd_solve::math::{Quat, Vec3};

use crate::oracle::{Solid, separation};
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

/// Rocks, needles and plates, of sizes up to 1000:1, from 30 % of the smaller size deep to 10 % apart.
fn case(random: &mut Random) -> Case {
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
    let (a, b) = if random.unit() < 0.5 { (a, b) } else { (b, a) };
    let (qa, qb) = (random.turn(), random.turn());
    let small = a.radius.min(b.radius);
    // The separation along this direction is a bound of the depth.
    let (way, depth) = (random.direction(), small * random.between(-0.6, 0.05));
    let reach = |solid: &Solid, q: &Quat, n: Vec3| solid.turned(q).iter().map(|v| n.dot(v)).fold(0.0, f64::max);
    let c = way * (reach(&a, &qa, way) + reach(&b, &qb, -way) + depth);
    Case { a, qa, b, qb, c, alert: 0.05 * small }
}

#[test]
fn gaps_are_those_of_trying_everything() {
    let mut random = Random(1);
    let mut worst = 0.0f64;
    let (mut apart, mut beyond) = (0, 0);
    for k in 0..12_000 {
        let Case { a, qa, b, qb, c, alert } = case(&mut random);
        let (expected, n) = separation(&a, &qa, &b, &qb, &c);
        let size = a.radius + b.radius;
        let found = contact(&a, &qa, &b, &qb, &c, alert);
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
        apart += usize::from(expected > 0.0);
    }
    println!("largest error of a gap over the size: {worst:e}; {apart} apart, {beyond} beyond the alert distance");
}

/// The next pose: a little on, or far on.
fn moved(random: &mut Random, case: &Case) -> (Quat, Quat, Vec3) {
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
        let case = case(&mut random);
        let Case { a, b, alert, .. } = &case;
        let size = a.radius + b.radius;
        let mut memory = Memory::default();
        remembered(a, &case.qa, b, &case.qb, &case.c, *alert, Narrow::Accurate, &mut memory);
        let (qa, qb, c) = moved(&mut random, &case);
        let mut before = memory;
        let warm = remembered(a, &qa, b, &qb, &c, *alert, Narrow::Accurate, &mut memory);
        let cold = contact(a, &qa, b, &qb, &c, *alert);
        let gap = |found: &Option<Manifold>| found.map_or(*alert, |found| found.gap());
        assert!((gap(&warm) - gap(&cold)).abs() < 1e-12 * size, "pair {k}: {warm:?} {cold:?}");
        if let (Some(warm), Some(cold)) = (&warm, &cold) {
            // Two directions may be equally good; else all is the same.
            let same = (warm.normal - cold.normal).norm() < 1e-9;
            assert!(!same || warm.points.len() == cold.points.len(), "pair {k}: {warm:?} {cold:?}");
        }
        let fast = remembered(a, &qa, b, &qb, &c, *alert, Narrow::Fast, &mut before);
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
    assert!(met > 3_000 && fast_differs < met / 10 && phantoms < 10);
}

#[test]
fn exchange_motion_and_scale_carry_over() {
    let mut random = Random(3);
    for k in 0..5_000 {
        let Case { a, qa, b, qb, c, alert } = case(&mut random);
        let Some(found) = contact(&a, &qa, &b, &qb, &c, alert) else { continue };
        let size = a.radius + b.radius;
        // Points on planes seen at a slope of a hundred and more, from bodies a thousand times as large.
        let near = 1e-9 * size;
        let same = |other: &Manifold, n: Vec3, places: Vec<Vec3>, by: f64, what: &str| {
            assert!((other.gap() - by * found.gap()).abs() < 1e-12 * by * size, "{k} {what}: {found:?} {other:?}");
            assert!((other.normal - n).norm() < 1e-9, "{k} {what}: {found:?} {other:?}");
            assert_eq!(other.points.len(), places.len(), "{k} {what}: {found:?} {other:?}");
            for place in places {
                let nearest =
                    other.points.iter().map(|p| (p.position - place * by).norm()).fold(f64::INFINITY, f64::min);
                assert!(nearest < near * by, "{k} {what}: {place} {found:?} {other:?}");
            }
        };
        let places = || found.points.iter().map(|p| p.position);
        let other = contact(&b, &qb, &a, &qa, &-c, alert).unwrap();
        same(&other, -found.normal, places().map(|p| p - c).collect(), 1.0, "exchanged");
        let turn = random.turn();
        let other = contact(&a, &(turn * qa), &b, &(turn * qb), &(turn * c), alert).unwrap();
        same(&other, turn * found.normal, places().map(|p| turn * p).collect(), 1.0, "turned");
        let by = [1e-3, 1e4][k % 2];
        let scaled =
            |solid: &Solid| Solid::new(solid.vertices.iter().map(|v| v * by).collect(), solid.triangles.clone());
        let other = contact(&scaled(&a), &qa, &scaled(&b), &qb, &(c * by), alert * by).unwrap();
        same(&other, found.normal, places().collect(), by, "scaled");
    }
}

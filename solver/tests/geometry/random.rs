//! Random hulls at depths from deep to apart.

use cd_solve::math::{Quat, Vec3};

use crate::oracle::{Solid, separation};
use crate::shapes::{Random, cuboid, regular, rock};
use crate::{check, contact};

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

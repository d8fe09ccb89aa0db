//! The spins at which two touching spheres part, in closed form.

use cd_tests::case::Case;

const GRAVITATION: f64 = 6.6743e-11;
const DENSITY: f64 = 3000.0;
const RADIUS: f64 = 1.0;
/// Steps from one spin to the next.
const SETTLE: usize = 8;

fn mass() -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3) * DENSITY
}

/// Spins from 0.9 of the limit to that share of it.
///
/// A pair that is given another spin is not yet in the motion in which the scheme turns it: contacts are looked for
/// half-way through a step, where the pair on its tangents is farther apart than at its ends by (h w)^2 r, and the
/// velocity of parting, of the order h w^2 r, needs the net pull to come to an end. Near the limit there is next to none:
/// a pair that is set to 0.999999 of it at once flies apart. So each spin takes a quarter of what is left, and what it adds to the
/// velocity of parting is less than the pull takes in a step.
fn approach(share: f64) -> Vec<f64> {
    let mut spins = vec![0.9];
    while 1.0 - spins[spins.len() - 1] > 1.2e-6 && spins[spins.len() - 1] < share {
        let last = spins[spins.len() - 1];
        spins.push((last + 0.25 * (1.0 - last)).min(share));
    }
    if spins[spins.len() - 1] < share {
        spins.push(share);
    }
    spins
}

/// Force on the candidate along the normal at the end, N, of two touching spheres that turn about their common centre
/// ever faster, to that share of the limit; none when they have parted.
fn force(share: f64, limit: f64, law: &str) -> Option<f64> {
    // A step turns the pair by 1e-4, and the scheme is right to its square, 1e-8.
    let dt = 1e-4 / limit;
    let (mut events, mut spin) = (String::new(), 0.0);
    let spins = approach(share);
    for (k, next) in spins.iter().enumerate() {
        let (time, added) = ((k * SETTLE) as f64 * dt, next * limit - spin);
        events += &format!("(time: {time:e}, action: AddSpin((0.0, 0.0, {added:e}))),");
        spin += added;
    }
    let steps = spins.len() * SETTLE;
    let case = Case::from_scene(&format!(
        r#"(
            materials: [(name: "ROCKx", density: {DENSITY:?})],
            laws: [(name: "law00", kind: {law})],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "law00")],
            grains: [(
                material: "ROCKx",
                colour: "BLUEx",
                sizes: Single({RADIUS:?}),
                placement: List(positions: [(-{RADIUS:?}, 0.0, 0.0), ({RADIUS:?}, 0.0, 0.0)]),
            )],
            compute: (
                dt: {dt:e}, steps: {steps}, output_every: {steps}, self_gravity: true, gravity: direct,
                tol: 1.0e-12, events: [{events}],
            ),
        )"#
    ))
    .solved(&[]);
    let last = case.last_snapshot();
    let carried = last.contacts.contact_impulse.iter().any(|r| *r != [0.0; 3]);
    carried.then(|| last.contacts.contact_force[0][0])
}

/// The force of the contact is G m^2 / 4 r^2 - m w^2 r, and what is left of it at the limit is minus the cohesion.
fn parts_at(limit: f64, law: &str, cohesion: f64) {
    let (m, attraction) = (mass(), GRAVITATION * mass().powi(2) / (4.0 * RADIUS * RADIUS));
    let scale = m * limit * limit * RADIUS;
    for share in [0.9, 0.99, 1.0 - 1e-6] {
        let found = force(share, limit, law).unwrap_or_else(|| panic!("parted at {share} of the limit"));
        let expected = attraction - m * (share * limit).powi(2) * RADIUS;
        // Of what is left before they part, 2e-6 of the scale for the last: 1e-7, ten times (h w)^2.
        assert!((found - expected).abs() < 1e-7 * scale, "{share}: {found} {expected}");
    }
    // Beyond it they part: the contact carries nothing, or no more than its attraction.
    let beyond = force(1.0 + 1e-6, limit, law);
    assert!(beyond.is_none_or(|f| (f + cohesion).abs() < 1e-12 * scale), "still pressed on each other: {beyond:?} N");
}

#[test]
fn two_spheres_part_at_half_the_critical_spin() {
    // w_c^2 = 4 pi G rho / 3; G m^2 / 4 r^2 = m w^2 r gives w = w_c / 2.
    let critical = (4.0 * std::f64::consts::PI * GRAVITATION * DENSITY / 3.0).sqrt();
    parts_at(critical / 2.0, "IQS_CLB(friction: 0.4)", 0.0);
}

#[test]
fn cohesion_raises_the_spin_at_which_they_part() {
    // m w^2 r = G m^2 / 4 r^2 + f_c
    for cohesion in [1e-4, 1e-2] {
        let limit = (GRAVITATION * mass() / (4.0 * RADIUS.powi(3)) + cohesion / (mass() * RADIUS)).sqrt();
        let law = format!(
            "IQS_WET_DS_CLB(cohesion: {cohesion:?}, range: 1.0e-3, dynamic_friction: 0.4, static_friction: 0.4)"
        );
        parts_at(limit, &law, cohesion);
    }
}

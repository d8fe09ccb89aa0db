//! The spins at which two touching spheres part, in closed form.

use cd_tests::case::Case;

const GRAVITATION: f64 = 6.6743e-11;
const DENSITY: f64 = 3000.0;
const RADIUS: f64 = 1.0;

fn mass() -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3) * DENSITY
}

/// Two touching spheres that turn about their common centre; gravity, the law, some steps.
fn pair(spin: f64, law: &str, dt: f64) -> Case {
    // The spin comes by an event: DOF.INI has seven digits.
    Case::of(&format!(
        r#"(
            materials: [(name: "ROCKx", density: {DENSITY:?})],
            laws: [(name: "law00", kind: {law})],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "law00")],
            grains: [(
                material: "ROCKx",
                colour: "BLUEx",
                sizes: Single({RADIUS:?}),
                place: List(positions: [(-{RADIUS:?}, 0.0, 0.0), ({RADIUS:?}, 0.0, 0.0)]),
            )],
            compute: (
                dt: {dt:?}, steps: 20, output_every: 20, self_gravity: true, gravity: direct, tol: 1.0e-12,
                events: [(time: 0.0, action: AddSpin((0.0, 0.0, {spin:?})))],
            ),
        )"#
    ))
    .solved(&[])
}

/// Force on the candidate along the normal after the last step, N; none when they have parted.
fn force(case: &Case) -> Option<f64> {
    let last = case.last_snapshot();
    let carried = last.contacts.contact_impulse.iter().any(|r| *r != [0.0; 3]);
    carried.then(|| last.contacts.contact_force[0][0])
}

/// The force of the contact is G m^2 / 4 r^2 - m w^2 r, and what is left of it at the limit is minus the cohesion.
///
/// A step turns the pair by h w = 1e-4, and the scheme is right to its square, 1e-8.
fn parts_at(limit: f64, law: &str) {
    let (m, attraction) = (mass(), GRAVITATION * mass().powi(2) / (4.0 * RADIUS * RADIUS));
    let dt = 1e-4 / limit;
    let scale = m * limit * limit * RADIUS;
    for share in [0.5, 0.9, 1.0 - 1e-6] {
        let spin = share * limit;
        let found = force(&pair(spin, law, dt)).unwrap_or_else(|| panic!("parted at {share} of the limit"));
        let expected = attraction - m * spin * spin * RADIUS;
        assert!((found - expected).abs() < 1e-6 * scale, "{share}: {found} {expected}");
    }
    // Beyond it they part: the contact carries nothing, or no more than its attraction.
    let case = pair(limit * (1.0 + 1e-6), law, dt);
    let held = force(&case).is_some_and(|f| f > attraction - scale);
    assert!(!held, "still pressed on each other beyond the limit: {:?} N", force(&case));
}

#[test]
fn two_spheres_part_at_half_the_critical_spin() {
    // w_c^2 = 4 pi G rho / 3; G m^2 / 4 r^2 = m w^2 r gives w = w_c / 2.
    let critical = (4.0 * std::f64::consts::PI * GRAVITATION * DENSITY / 3.0).sqrt();
    parts_at(critical / 2.0, "IQS_CLB(friction: 0.4)");
}

#[test]
fn cohesion_raises_the_spin_at_which_they_part() {
    // m w^2 r = G m^2 / 4 r^2 + f_c
    for cohesion in [1e-4, 1e-2] {
        let limit = (GRAVITATION * mass() / (4.0 * RADIUS.powi(3)) + cohesion / (mass() * RADIUS)).sqrt();
        let law = format!(
            "IQS_WET_DS_CLB(cohesion: {cohesion:?}, range: 1.0e-3, dynamic_friction: 0.4, static_friction: 0.4)"
        );
        parts_at(limit, &law);
    }
}

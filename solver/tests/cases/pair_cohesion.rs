//! Laws with cohesion per pair: the force of a pair of bodies, whatever the number of its contact points.

use std::f64::consts::PI;

use cd_formats::bodies::{Contactor, ShapeRecord};
use cd_formats::compute::EventAction;
use cd_formats::drv_dof::Evolution;
use cd_formats::law_table::{LawModel, SpherePacking};

use crate::case::{Case, Figures, equal, expect_same_bytes, near, uniform};

const AXES: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Laws and parameters in which two bodies attract each other with c π R² for c = 100 Pa, or with A R/(12 ζ²) = 100 N at R = 1/4 m,
/// up to a gap of 1/64 m, and less up to 1/16 m.
const STRESS: (&str, &[f64]) = ("IQS_COH_DS_CLB", &[100.0, 0.015625, 0.0625, 0.3, 0.4]);
const VAN_DER_WAALS: (&str, &[f64]) = ("IQS_VDW_DS_CLB", &[4800.0, 1.0, 0.015625, 0.0625, 0.3, 0.4]);
const STRESS_ROLL: (&str, &[f64]) = ("IQS_COH_DS_ROLL_CLB", &[100.0, 0.015625, 0.0625, 0.3, 0.4, 0.1, 0.1]);
const RESTITUTION: (&str, &[f64]) = ("RST_COH_DS_CLB", &[100.0, 0.5, 0.0, 0.015625, 0.0625, 0.3, 0.4]);

/// Body under a ceiling, in one or more contacts with it; returns whether it stays under `weight` (N) for 50 steps.
fn hangs((law, parameters): (&str, &[f64]), weight: f64, build: impl Fn(&mut Case) -> usize) -> bool {
    let mut case = Case::new();
    case.law_of_all(law, parameters);
    case.plate([5.0, 5.0, 0.5], [0.0, 0.0, 0.5], AXES);
    let body = build(&mut case);
    case.options.dt = 1.0 / 1024.0;
    case.options.tol = Some(1e-10);
    let start = &case.states(0, 1)[0];
    let (mass, first) = (start.mass(body), start.x(body).z);
    case.gravity = [0.0, 0.0, -weight / mass];
    let end = case.run(50);
    // A thousandth more than the force falls by twice this.
    let fall = 0.5 * 1e-3 * (weight / mass) * (50.0f64 / 1024.0).powi(2);
    end.x(body).z > first - 0.5 * fall
}

/// The radius of the ball of a cube's volume, m.
fn radius_of_cube(side: f64) -> f64 {
    side * (3.0 / (4.0 * PI)).cbrt()
}

#[test]
fn spheres_cubes_and_clumps_hang_by_the_force_of_one_pair() {
    let ball = |case: &mut Case| case.sphere(0.25, [0.0, 0.0, -0.25]);
    let cube = |case: &mut Case| case.block([0.25; 3], [0.0, 0.0, -0.25], AXES);
    // On an edge and on a corner there are fewer points than on a face, and the force is the same.
    let turned = |case: &mut Case| {
        let c = 0.5f64.sqrt();
        case.block([0.25; 3], [0.0, 0.0, -0.25 * 2.0f64.sqrt()], [[1.0, 0.0, 0.0], [0.0, c, c], [0.0, -c, c]])
    };
    // Four balls of one body touch the ceiling.
    let clump = |case: &mut Case| {
        let body = case.sphere(0.25, [0.0, 0.0, -0.25]);
        let part = |x: f64, y: f64| Contactor {
            colour: "GRAIN".into(),
            shape: ShapeRecord::OffsetSphere { radius: 0.25, offset: [x, y, 0.0] },
            local_frame: None,
        };
        case.bodies[body].contactors =
            [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(x, y)| part(x, y)).into();
        case.dof.retain(|dof| dof.body != body);
        body
    };
    let stress = |radius: f64| 100.0 * PI * radius * radius;
    for law in [STRESS, STRESS_ROLL, RESTITUTION] {
        for (share, holds) in [(0.999, true), (1.001, false)] {
            assert_eq!(hangs(law, share * stress(0.25), ball), holds, "{}: ball, {share}", law.0);
            assert_eq!(hangs(law, share * stress(radius_of_cube(0.5)), cube), holds, "{}: cube, {share}", law.0);
            assert_eq!(hangs(law, share * stress(radius_of_cube(0.5)), turned), holds, "{}: edge, {share}", law.0);
            assert_eq!(hangs(law, share * stress(0.25), clump), holds, "{}: clump, {share}", law.0);
        }
    }
    for (share, holds) in [(0.999, true), (1.001, false)] {
        assert_eq!(hangs(VAN_DER_WAALS, share * 100.0, ball), holds, "van der Waals, {share}");
    }
}

/// A simple cubic lattice of spheres has ν = π/6 and Z = 6, and Rumpf's strength along an axis: F/d², the force of a pair on the
/// area of a sphere's cell.
#[test]
fn a_cubic_lattice_has_the_strength_of_the_bulk() {
    let (strength, diameter) = (50.0, 1.0);
    let pair = |stress: f64| {
        LawModel::from_values("IQS_COH_DS_CLB", &[stress, 1e-3, 1e-3, 0.3, 0.3]).unwrap().pair_cohesion().unwrap()
    };
    let stress =
        strength / pair(1.0).bulk_strength(SpherePacking { solid_fraction: PI / 6.0, coordination: 6.0, diameter });
    for (share, holds) in [(0.999, true), (1.001, false)] {
        let mut case = Case::new();
        case.law("IQS_COH_DS_CLB", &[stress, 1e-3, 1e-3, 0.3, 0.3]);
        let side = 3;
        for k in 0..side * side * side {
            let [x, y, z] = [k % side, k / side % side, k / side / side];
            let body = case.sphere(0.5 * diameter, [x, y, z].map(f64::from));
            let end = if z == 0 { -1.0 } else { 1.0 };
            if z != 1 {
                case.pull(body, 2, end * share * strength * diameter * diameter);
            }
        }
        case.options.dt = 1.0 / 1024.0;
        case.options.tol = Some(1e-10);
        let end = case.run(40);
        let stretch = end.x(side as usize * side as usize * side as usize - 1).z - end.x(0).z - 2.0 * diameter;
        // An end of the lattice that parts moves by some a t²/2 = 0.05 N/0.52 kg (0.04 s)²/2.
        assert_eq!(stretch < 1e-6, holds, "{share}: {stretch}");
    }
}

/// Two balls of radius 1/2 at a distance, at rest.
fn spheres_apart((law, parameters): (&str, &[f64]), gap: f64) -> Case {
    let mut case = Case::new();
    case.law(law, parameters);
    case.sphere(0.5, [0.0; 3]);
    case.sphere(0.5, [1.0 + gap, 0.0, 0.0]);
    case
}

#[test]
fn the_force_falls_linearly_from_its_full_range_to_its_range() {
    let force = 100.0 * PI * 0.0625; // R = 1/4 m
    for (gap, share) in [(0.0, 1.0), (0.015, 1.0), (0.0390625, 0.5), (0.0625 - 0.046875 * 0.1, 0.1), (0.063, 0.0)] {
        let mut case = spheres_apart(STRESS, gap);
        case.options.dt = 1.0 / 65536.0; // gaps change by less than 1e-7 m
        for (body, sign) in [(0, -1.0), (1, 1.0)] {
            case.pull(body, 0, sign * 2.0 * force); // else balls in touch would not pull
        }
        let end = case.run(1);
        let found = end.force(0, 1).unwrap_or_default();
        near(found, [-share * force, 0.0, 0.0], 1e-4 * force);
        let attraction = end.attractions.map_or(0.0, |attractions| attractions.contact_attraction.iter().sum());
        equal(attraction, share * force, 1e-4 * force);
    }
}

#[test]
fn the_work_of_the_attraction_is_the_speed_of_the_impact() {
    // From rest just within the range: F (b - a)/2 over the fall from range b to full range a, then F a.
    let force = 100.0 * PI * 0.0625;
    let mut case = spheres_apart(STRESS, 0.0624);
    case.options.dt = 1.0 / 16384.0;
    let states = case.states(12_000, 12_000);
    let kinetic = case.column("kinetic_energy").into_iter().fold(0.0, f64::max);
    let share = |gap: f64| (0.0625 - gap) / 0.046875;
    let work = force * (0.015625 + 0.5 * 0.046875 * (1.0 - share(0.0624).powi(2)));
    // Up to one step of the fall is not counted, in which the speed grows by h F/m = 0.2 %.
    equal(kinetic, work, 5e-3 * work);
    let end = states.last().unwrap();
    near(end.x(1) - end.x(0), [1.0, 0.0, 0.0], 1e-12);
}

#[test]
fn an_attraction_forms_again_after_parting() {
    let mut case = Case::new();
    case.law(STRESS.0, STRESS.1);
    case.floor();
    let ball = case.sphere(0.25, [0.0, 0.0, 0.25]);
    case.options.dt = 1.0 / 1024.0;
    let force = 100.0 * PI * 0.0625; // R = 1/4 m next to a plate
    let mass = case.states(0, 1)[0].mass(ball);
    // Thrown up faster than the attraction holds, back after 1/4 s, then pulled with less than the force.
    case.gravity = [0.0, 0.0, -64.0];
    case.launch(ball, [0.0, 0.0, 8.0], [0.0; 3]);
    case.event(0.5, EventAction::SetGravity([0.0, 0.0, 0.99 * force / mass]));
    let states = case.states(768, 64);
    assert!(states.iter().any(|state| state.x(ball).z > 0.4));
    near(states.last().unwrap().x(ball), [0.0, 0.0, 0.25], 1e-12);
}

#[test]
fn an_event_sets_the_stress() {
    let mut case = spheres_apart(STRESS, 0.0);
    let force = 100.0 * PI * 0.0625;
    for (body, sign) in [(0, -1.0), (1, 1.0)] {
        case.pull(body, 0, sign * 0.5 * force);
    }
    case.options.dt = 1.0 / 1024.0;
    let law = case.tact.laws[0].nickname.clone();
    case.event(0.03125, EventAction::SetCohesion(law, 40.0));
    let states = case.states(64, 32);
    near(states[1].x(1), [1.0, 0.0, 0.0], 1e-12);
    let t: f64 = 0.03125;
    let a = 0.1 * force / states[0].mass(1);
    near(states[2].x(1), [1.0 + 0.5 * a * t * t, 0.0, 0.0], 0.1 * a * t * t);
}

/// Square root of 1/2.
const HALF_ROOT: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// A case of one law, also with surfaces.
fn surface_case((law, parameters): (&str, &[f64])) -> Case {
    let mut case = Case::new();
    case.law_of_all(law, parameters);
    case.law_with("MESHx", law, parameters);
    (case.options.dt, case.options.tol) = (1.0 / 1024.0, Some(1e-10));
    case
}

/// A groove along y of one surface, with slopes of 45 degrees, its bottom in the origin.
fn groove(case: &mut Case) {
    let vertices =
        [[-2.0, -2.0, 2.0], [0.0, -2.0, 0.0], [2.0, -2.0, 2.0], [-2.0, 2.0, 2.0], [0.0, 2.0, 0.0], [2.0, 2.0, 2.0]];
    case.mesh(&vertices, &[[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]], [0.0; 3], AXES);
}

/// A corner of one surface: parts of the planes x = 0, y = 0 and z = 0.
fn corner(case: &mut Case) {
    let vertices = [[0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]];
    case.mesh(&vertices, &[[0, 1, 2], [0, 2, 3], [0, 3, 1]], [0.0; 3], AXES);
}

/// A closed drum of radius and half height 1 m.
fn drum(case: &mut Case) {
    let wall = case.plate([1.0; 3], [0.0; 3], AXES);
    case.bodies[wall].contactors[0].shape = ShapeRecord::Cylinder { half_height: 1.0, radius: 1.0, hollow: true };
}

/// A fixed clump of two balls that touch.
fn fixed_clump(case: &mut Case) {
    let wall = case.sphere(0.25, [0.0; 3]);
    case.drive(wall, [0.0; 6].map(Evolution::constant));
    let part = |x: f64| Contactor {
        colour: "GRAIN".into(),
        shape: ShapeRecord::OffsetSphere { radius: 0.25, offset: [x, 0.0, 0.0] },
        local_frame: None,
    };
    case.bodies[wall].contactors = [-0.25, 0.25].map(part).into();
    case.dof.retain(|dof| dof.body != wall);
}

/// A sphere attracts one wall with the force of one pair in all its contact points, whatever other bodies the scene has.
#[test]
fn a_sphere_attracts_a_wall_of_several_points_once() {
    let force = |radius: f64| 100.0 * PI * radius * radius;
    let root = HALF_ROOT / 0.5;
    // Wall, position of the sphere, number of contact points, force of the pair in N.
    type Place = (fn(&mut Case), [f64; 3], usize, f64);
    let places: [Place; 4] = [
        (groove, [0.0, 0.1, 0.25 * root], 2, force(0.25)),
        (corner, [0.25; 3], 3, force(0.25)),
        (drum, [0.75, 0.0, -0.75], 2, force(0.25)),
        // 1/R = 1/r + 1/r.
        (fixed_clump, [0.0, 0.0, 0.25 * 3.0f64.sqrt()], 2, force(0.125)),
    ];
    for law in [STRESS, RESTITUTION] {
        for (place, (add_wall, x, points, force)) in places.into_iter().enumerate() {
            let [alone, with_cube] = [false, true].map(|has_cube| {
                let mut case = surface_case(law);
                case.sphere(0.25, x);
                add_wall(&mut case);
                if has_cube {
                    // Beyond the range of the ball, and in the drum.
                    case.block([0.05; 3], [x[0], x[1], x[2] + 0.75], AXES);
                }
                let attractions = case.run(1).attractions.unwrap().contact_attraction;
                assert_eq!(attractions.len(), points, "{}, {place}", law.0);
                attractions.iter().sum::<f64>()
            });
            // Sums of two or three rounded shares.
            equal(alone, force, 1e-12 * force);
            equal(with_cube, force, 1e-12 * force);
        }
    }
}

/// Each of two slopes of 45 degrees holds with half of the force: upwards F cos 45.
#[test]
fn a_sphere_leaves_a_groove_of_one_surface_at_the_force_of_one_pair() {
    let force = 100.0 * PI * 0.0625 * HALF_ROOT;
    for (share, holds) in [(0.999, true), (1.001, false)] {
        let mut case = surface_case(STRESS);
        let ball = case.sphere(0.25, [0.0, 0.1, 0.5 * HALF_ROOT]);
        groove(&mut case);
        case.pull(ball, 2, share * force);
        let states = case.states(50, 50);
        // Beyond the force it rises by a thousandth of force t²/(2 m).
        let rise = 0.5 * 1e-3 * force / states[0].mass(ball) * (50.0f64 / 1024.0).powi(2);
        assert_eq!(states[1].x(ball).z - states[0].x(ball).z < 0.5 * rise, holds, "{share}");
    }
}

#[test]
fn balls_in_a_groove_have_the_same_bytes() {
    expect_same_bytes(|| {
        let mut case = surface_case(STRESS_ROLL);
        groove(&mut case);
        case.gravity = [0.5, 0.0, -40.0];
        let mut random = uniform(4);
        for k in 0..12u8 {
            let [x, y] = [k % 3, k / 3].map(|k| 0.6 * f64::from(k));
            let body = case.sphere(0.25, [x - 0.6, y - 0.9, 1.2]);
            case.launch(body, [0; 3].map(|_| 2.0 * random() - 1.0), [0; 3].map(|_| 4.0 * random() - 2.0));
        }
        (case.options.dt, case.options.tol) = (1.0 / 256.0, Some(1e-5));
        case
    });
}

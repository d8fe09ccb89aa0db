//! Elastic bonds that carry moments: beams of balls against the closed forms of beams.

use std::f64::consts::PI;

use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::Snapshot;

use crate::case::{AXES, Case, Figures, Vec3, equal, near};
use crate::faces::{polygons, prism};
use crate::same_bits::{files, same};

/// Radius of the balls, m.
const RADIUS: f64 = 0.5;
/// Mass of a ball, kg.
const MASS: f64 = PI / 6.0;

/// Bonds of the radius of the balls; their centres are 1 m apart, so that E = k_n and G = k_t in numbers.
#[derive(Clone, Copy)]
struct Bonds {
    /// k_n and k_t, Pa/m.
    stiffness: [f64; 2],
    /// c_n and c_t, Pa.
    strength: [f64; 2],
    /// R_b, m.
    radius: f64,
}

/// Bonds that nothing here breaks: they open by 1 mm first.
const STRONG: Bonds = Bonds { stiffness: [1e6, 4e5], strength: [1e3, 1e3], radius: RADIUS };

impl Bonds {
    fn parameters(&self) -> [f64; 7] {
        let ([k_n, k_t], [c_n, c_t]) = (self.stiffness, self.strength);
        [k_n, k_t, c_n, c_t, self.radius / RADIUS, 0.125, 0.25]
    }

    /// S, m².
    fn area(&self) -> f64 {
        PI * self.radius.powi(2)
    }

    /// I, m⁴.
    fn second_moment(&self) -> f64 {
        PI / 4.0 * self.radius.powi(4)
    }

    /// k_n I, N m per rad.
    fn bending(&self) -> f64 {
        self.stiffness[0] * self.second_moment()
    }

    /// k_t J, N m per rad.
    fn torsion(&self) -> f64 {
        self.stiffness[1] * 2.0 * self.second_moment()
    }
}

/// A row of touching balls along x of which the first, in the origin, is fixed. Steps are long against all periods: loads are
/// static after some of them.
fn cantilever(free: usize, bonds: Bonds) -> Case {
    let mut case = Case::new();
    case.law_of_all("ELASTIC_BEAM_DS_CLB", &bonds.parameters());
    for k in 0..=free {
        case.sphere(RADIUS, [k as f64, 0.0, 0.0]);
    }
    case.drive(0, [0.0; 6].map(Evolution::constant));
    // Two over the lowest angular frequency of the beam: longer steps have larger errors of displacements.
    let line_density = MASS / (2.0 * RADIUS);
    let beam_frequency = 3.516 / (free as f64).powi(2) * (bonds.bending() / line_density).sqrt();
    case.options.dt = 2.0 / beam_frequency;
    case
}

fn bonded(state: &Snapshot) -> Vec<u8> {
    state.memory.clone().expect("a law that remembers").contact_bonded
}

/// Displacement of the last ball after the loads have become static, m.
fn tip_displacement(case: &mut Case, free: usize) -> Vec3 {
    let end = case.run(60);
    // Long steps list pairs that are farther apart, too.
    assert_eq!(bonded(&end).into_iter().filter(|bond| *bond == 1).count(), free);
    assert!(end.v(free).norm() < 1e-9, "at rest: {:?}", end.v(free));
    end.x(free) - Vec3::new(free as f64, 0.0, 0.0)
}

/// Timoshenko: w = P L³/(3 E I) + P L/(G S), where the sums over the bonds are L³/3 - L/12 and L.
#[test]
fn a_cantilever_bends_as_a_beam_of_timoshenko() {
    for (free, radius) in [(1, 1.0), (5, 1.0), (12, 0.5)] {
        let bonds = Bonds { radius: radius * RADIUS, ..STRONG };
        let (load, length) = (1e-2 * radius.powi(4), free as f64);
        let mut case = cantilever(free, bonds);
        case.pull(free, 2, load);
        let shear = load * length / (bonds.stiffness[1] * bonds.area());
        let bonds_deflection = load * (length.powi(3) / 3.0 - length / 12.0) / bonds.bending() + shear;
        let beam_deflection = load * length.powi(3) / (3.0 * bonds.bending()) + shear;
        let found = tip_displacement(&mut case, free).z;
        // Rotations of up to 1e-5 rad are squared, and positions have some 1e-15 m.
        equal(found / bonds_deflection, 1.0, 1e-5);
        if free > 3 {
            equal(found / beam_deflection, 1.0, 0.02);
        }
        assert!(case.column("sweeps").iter().sum::<f64>() < 1e4, "gradients, not sweeps");
    }
}

/// F = k_n S u for each bond, pulled or pressed.
#[test]
fn a_bar_stretches_and_shortens_by_its_load() {
    for load in [0.5, -0.5] {
        let mut case = cantilever(8, STRONG);
        case.pull(8, 0, load);
        let expected = 8.0 * load / (STRONG.stiffness[0] * STRONG.area());
        equal(tip_displacement(&mut case, 8).x / expected, 1.0, 1e-5);
    }
}

/// A ball on its bond: ω² = k_n S/m. The force of the end of the step damps as exp(-ω² h t/2).
#[test]
fn a_ball_oscillates_with_the_period_of_its_bond() {
    let omega = (STRONG.stiffness[0] * STRONG.area() / MASS).sqrt();
    let mut case = cantilever(1, STRONG);
    let steps_per_period = 200;
    case.options.dt = 2.0 * PI / omega / steps_per_period as f64;
    let speed = 1e-4 * omega;
    case.launch(1, [speed, 0.0, 0.0], [0.0; 3]);
    let states = case.states(5 * steps_per_period, 1);
    let x = |k: usize| states[k].x(1).x - 1.0;
    // Times of the passages to the right.
    let passages: Vec<f64> = (1..states.len())
        .filter(|&k| x(k - 1) < 0.0 && x(k) >= 0.0)
        .map(|k| k as f64 - x(k) / (x(k) - x(k - 1)))
        .collect();
    let period = (passages[3] - passages[0]) / 3.0 / steps_per_period as f64;
    // (ω h)²/8 by the damping, and as much by the step.
    equal(period, 1.0, 5e-4);
    let damping = PI / steps_per_period as f64; // ω h/2
    let peak = |from: usize| (from..from + steps_per_period as usize).map(&x).fold(0.0, f64::max);
    let ratio = peak(4 * steps_per_period as usize) / peak(0);
    equal(ratio, (-damping * 8.0 * PI).exp(), 0.02);
}

/// Within its limits nothing depends on how stiff a bond is against the step.
#[test]
fn stiff_bonds_are_stable() {
    for stiffness in [1e6, 1e9, 1e14] {
        let bonds = Bonds { stiffness: [stiffness; 2], strength: [stiffness * 5e-4; 2], ..STRONG };
        let mut case = cantilever(6, bonds);
        case.options.dt = 0.01;
        case.gravity = [0.0, 0.0, -1.0];
        let end = case.run(400);
        assert_eq!(bonded(&end), vec![1; 6]);
        equal(end.contacts.contact_force[0][1..].iter().map(|f| f * f).sum::<f64>().sqrt(), 6.0 * MASS, 0.5);
        assert!(end.v(6).norm() < 0.05, "{stiffness}: {:?}", end.v(6));
    }
}

/// σ = M R_b/I: the root breaks at 1.005 of its strength and not at 0.995.
#[test]
fn a_cantilever_breaks_at_its_root_at_the_strength_of_the_outermost_fibre() {
    for (free, radius) in [(1, RADIUS), (6, 0.5 * RADIUS)] {
        for (share, held) in [(0.995, true), (1.005, false)] {
            let bonds = Bonds { stiffness: [1e10; 2], strength: [1e3, 1e4], radius };
            let mut case = cantilever(free, bonds);
            let moment = bonds.strength[0] * bonds.second_moment() / radius;
            case.options.dt *= 100.0;
            case.pull(free, 2, share * moment / (free as f64 - 0.5));
            // Without its root the row leaves.
            let bonds_left: usize = bonded(&case.run(10)).into_iter().map(usize::from).sum();
            assert_eq!(bonds_left == free, held, "{free} {radius} {share}");
        }
    }
}

/// A broken bond leaves friction with the coefficients of the law, which are not c_t/c_n.
#[test]
fn a_broken_bond_leaves_friction_of_its_own() {
    let bonds = Bonds { stiffness: [1e7; 2], strength: [40.0, 80.0], radius: 0.8 * RADIUS };
    let mut case = cantilever(1, bonds);
    case.options.dt = 0.01;
    case.pull(1, 4, 2.0 * bonds.strength[0] * bonds.second_moment() / bonds.radius);
    case.pull(1, 0, -8.0 * MASS);
    let states = case.states(60, 20);
    assert_eq!(bonded(&states[2]), [0]);
    let force = states[3].force(0, 1).unwrap();
    equal(force.yz().norm() / force.x, 0.125, 1e-9);
}

/// Small rotation of a block from its orientation along the axes, world frame, rad.
fn turn(states: &[Snapshot], body: usize) -> Vec3 {
    let [start, end] = [&states[0], states.last().unwrap()].map(|state| {
        let [w, x, y, z] = state.bodies.body_q[body];
        nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z))
    });
    (end * start.inverse()).scaled_axis()
}

/// The disc of a ball on a block bends by M/(k_n I) and twists by T/(k_t J).
#[test]
fn a_block_on_a_ball_bends_and_twists() {
    let mut case = Case::new();
    case.law_of_all("ELASTIC_BEAM_DS_CLB", &STRONG.parameters());
    let ball = case.sphere(RADIUS, [0.0; 3]);
    let block = case.block([0.5; 3], [1.0, 0.0, 0.0], AXES);
    case.drive(ball, [0.0; 6].map(Evolution::constant));
    case.options.dt = 0.02;
    let (couple, torque) = (1.0, 0.5);
    case.pull(block, 4, couple);
    case.pull(block, 3, torque);
    let states = case.states(60, 60);
    assert_eq!(bonded(&states[1]), [1]);
    // Turns of 1e-5 rad.
    let turn = turn(&states, block);
    equal(turn.y / (couple / STRONG.bending()), 1.0, 1e-4);
    equal(turn.x / (torque / STRONG.torsion()), 1.0, 1e-4);
}

/// Two cubes on a face of side a: I = a⁴/12, whatever the number of its points.
#[test]
fn faces_stretch_and_bend_by_their_area() {
    let mut case = Case::new();
    case.law_of_all("ELASTIC_BEAM_DS_CLB", &STRONG.parameters());
    let root = case.block([0.5; 3], [0.0; 3], AXES);
    let block = case.block([0.5; 3], [1.0, 0.0, 0.0], AXES);
    case.drive(root, [0.0; 6].map(Evolution::constant));
    case.options.dt = 0.02;
    let (pull, couple) = (2.0, 1.0);
    case.pull(block, 0, pull);
    case.pull(block, 4, couple);
    let states = case.states(100, 100);
    let end = &states[1];
    assert_eq!(bonded(end), [1; 4]);
    let ([k_n, _], turn) = (STRONG.stiffness, turn(&states, block));
    equal((end.x(block).x - 1.0) / (pull / k_n), 1.0, 1e-4);
    equal(turn.y / (couple * 12.0 / k_n), 1.0, 1e-4);
}

/// Polar moment of a polygon about its centroid, which is in the origin, m⁴: the integral of x² + y².
fn polar_moment(corners: &[[f64; 2]]) -> f64 {
    let of_side = |k: usize| {
        let (p, q) = (corners[k], corners[(k + 1) % corners.len()]);
        let product = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
        (p[0] * q[1] - p[1] * q[0]) * (product(p, p) + product(p, q) + product(q, q)) / 12.0
    };
    (0..corners.len()).map(of_side).sum()
}

/// A prism twists on its face by T/(k_t J) with the polar moment J of the face, a⁴/6 for a square.
#[test]
fn faces_twist_by_their_polar_moment() {
    for (name, polygon) in polygons() {
        let mut case = Case::new();
        case.law_of_all("ELASTIC_BEAM_DS_CLB", &STRONG.parameters());
        case.floor();
        let body = prism(&mut case, &polygon);
        case.options.dt = 0.02;
        let (torque, stiffness) = (0.5, STRONG.stiffness[1] * polar_moment(&polygon.corners));
        case.pull(body, 5, torque);
        let states = case.states(60, 60);
        assert!(bonded(&states[1]).iter().all(|bond| *bond == 1), "{name}");
        let tolerance = match name {
            "pentagon" => 3e-3, // the mean of its corners is not its centroid
            "48-gon" => 1e-3,   // 16 points, of a polygon of the same area and another shape
            _ => 1e-6,          // areas have the digits of single precision
        };
        let found = torque / stiffness / turn(&states, body).z;
        assert!((found - 1.0).abs() < tolerance, "{name}: {found}");
    }
}

/// Sideways displacement (m) of the end of a column of `free` balls under a small load across, and `load` (N) along the axis.
fn column_deflection(free: usize, bonds: Bonds, load: f64) -> f64 {
    let mut case = cantilever(free, bonds);
    case.pull(free, 2, 1e-7 * bonds.bending());
    case.pull(free, 0, -load);
    tip_displacement(&mut case, free).z
}

/// Euler's load of a column that is clamped at one end, π² E I/(4 L²), by a plot of Southwell: with the deflection w_0 without
/// an axial load P, w - w_0 = w_0 P/(P_e - P), so that (w - w_0)/P against w - w_0 is a line of the slope 1/P_e.
///
/// A row of n free balls in the middles of which their bonds turn, with the angles φ_k = sin(k π/2n), has exactly
/// P_e = 4 k_n I/(2R) tan²(π/4n).
#[test]
fn a_column_buckles_at_the_load_of_euler() {
    // Bonds that hardly shear; the load shortens them by 2e-4.
    let bonds = Bonds { stiffness: [1e6, 1e8], strength: [1e3, 1e5], radius: 0.25 * RADIUS };
    let free = 6;
    let stiffness = bonds.bending() / (2.0 * RADIUS);
    let of_row = 4.0 * stiffness * (PI / (4 * free) as f64).tan().powi(2);
    let of_beam = PI.powi(2) * stiffness / (4 * free * free) as f64;
    let straight = column_deflection(free, bonds, 0.0);
    let points = [0.4, 0.8].map(|share| {
        let load = share * of_row;
        let bent = column_deflection(free, bonds, load) - straight;
        // The first mode of buckling has all but 1 % of the deflection, and is enlarged by 1/(1 - P/P_e).
        let enlarged = (bent + straight) / straight * (1.0 - share);
        equal(enlarged, 1.0, 0.015);
        [bent, bent / load]
    });
    let southwell = (points[1][0] - points[0][0]) / (points[1][1] - points[0][1]);
    // The other modes change the slope by 2e-4, the shortening by as much.
    equal(southwell / of_row, 1.0, 1e-3);
    equal(southwell / of_beam, 1.0, 0.02); // 1.2 % by the finite number of balls
}

/// A free bar that spins keeps momentum, angular momentum and, without a vibration, its energy; its bonds carry what keeps the
/// balls on their circles.
#[test]
fn a_spinning_bar_is_stretched() {
    let (balls, spin) = (3, 0.25);
    let mut case = Case::new();
    case.law_of_all("ELASTIC_BEAM_DS_CLB", &STRONG.parameters());
    for k in 0..balls {
        let ball = case.sphere(RADIUS, [k as f64, 0.0, 0.0]);
        case.launch(ball, [0.0, spin * (k as f64 - 1.0), 0.0], [0.0, 0.0, spin]);
    }
    case.options.dt = 0.01;
    let states = case.states(2000, 2000);
    let end = &states[1];
    let stretch = MASS * spin * spin / (STRONG.stiffness[0] * STRONG.area());
    equal((end.x(2) - end.x(0)).norm() - 2.0, 2.0 * stretch, 0.05 * stretch);
    near(end.angular_momentum(), states[0].angular_momentum(), 1e-9);
    near(end.momentum(), [0.0; 3], 1e-12);
    equal(end.kinetic() / states[0].kinetic(), 1.0, 1e-5);
}

/// A ball of bonded balls on a lattice that hits a floor.
fn projectile(speed: f64, height: f64) -> Case {
    let mut case = Case::new();
    let bonds = Bonds { stiffness: [1e7, 4e6], strength: [2e3, 2e3], radius: 0.5 * RADIUS };
    case.law_with("SPHER", "ELASTIC_BEAM_DS_CLB", &bonds.parameters());
    case.law_with("PLANx", "IQS_CLB", &[0.3]);
    case.floor();
    let q = nalgebra::Rotation3::from_euler_angles(0.6, 0.4, 0.2);
    let cells = (0..125).map(|k| [k % 5, k / 5 % 5, k / 25].map(|c| f64::from(c) - 2.0));
    let places: Vec<Vec3> = cells.map(|x| q * Vec3::from(x)).filter(|x| x.norm() < 1.8).collect();
    let lowest = places.iter().map(|x| x.z).fold(0.0, f64::min);
    for x in places {
        let ball = case.sphere(RADIUS, [x.x, x.y, x.z - lowest + RADIUS + height]);
        case.launch(ball, [0.0, 0.0, -speed], [0.0; 3]);
    }
    (case.options.dt, case.options.tol, case.options.max_sweeps) = (0.002, Some(1e-6), Some(2000));
    case
}

#[test]
fn a_faster_impact_breaks_more_bonds() {
    let mut broken = Vec::new();
    for speed in [0.1, 2.0, 8.0] {
        let mut case = projectile(speed, 0.01);
        let states = case.states(60, 6);
        let bonds: Vec<u32> = states[1..].iter().map(|state| bonded(state).into_iter().map(u32::from).sum()).collect();
        assert!(bonds.is_sorted_by(|a, b| a >= b), "no bond returns: {bonds:?}");
        assert!(case.column("momentum_drift").iter().all(|drift| *drift < 1e-11));
        let energy = |state: &Snapshot| state.kinetic();
        assert!(energy(states.last().unwrap()) <= energy(&states[0]));
        broken.push(54 - bonds.last().unwrap()); // a cube of 27 balls
    }
    assert!(broken[0] == 0 && broken[1] > 0 && broken[2] > broken[1], "{broken:?}");
}

/// A bond that would open beyond the alert distance before it breaks is rejected.
#[test]
fn bonds_that_open_beyond_alert_are_rejected() {
    // The alert distance of the cases is 1e-3 m.
    for (normal_cohesion, accepted) in [(1.0e3, true), (1.1e3, false)] {
        let bonds = Bonds { strength: [normal_cohesion, 1e3], ..STRONG };
        let mut case = cantilever(1, bonds);
        case.options.steps = Some(1);
        assert_eq!(case.attempt(1).is_some(), accepted, "{normal_cohesion}");
        // A larger alert distance, by the option, sees the bond until it breaks.
        case.options.alert = Some(1.2e-3);
        assert!(case.attempt(1).is_some());
    }
}

#[test]
fn threads_and_resume_change_nothing() {
    let case = || {
        let mut case = projectile(4.0, 0.072);
        (case.options.steps, case.options.output_every, case.options.text) = (Some(40), 10, true);
        case
    };
    let whole = case();
    let unbroken = files(&whole, &[&["--threads", "1"]]);
    let left: Vec<u32> =
        whole.written()[1..].iter().map(|state| bonded(state).into_iter().map(u32::from).sum()).collect();
    assert!(left[0] > left[1] && left[3] > 0, "{left:?}"); // a check of the check
    same(&unbroken, &files(&case(), &[&["--threads", "2", "--steps", "10"], &["--resume", "--threads", "3"]]));
}

/// A ball with rolling friction rests on a slope below its coefficient, and rolls beyond, next to two balls with a spring.
#[test]
fn moments_act_next_to_springs() {
    for (slope, rests) in [(0.25, true), (0.35, false)] {
        let mut case = Case::new();
        case.law_with("PLANx", "IQS_DS_ROLL_CLB", &[0.6, 0.6, 0.3, 0.1]);
        case.law_with("SPHER", "ELASTIC_REPELL_CLB", &[1e5, 0.3]);
        case.floor();
        case.gravity = [slope, 0.0, -1.0];
        let balls = [0.0, 4.0, 5.0].map(|y| case.sphere(RADIUS, [0.0, y, RADIUS]));
        let end = case.run(100);
        for ball in balls {
            assert_eq!(end.v(ball).norm() < 1e-9, rests, "{slope}");
        }
    }
}

/// Component of a load, and its size over c_n and over c_t, N or N m.
type LoadComponent = (usize, f64, f64);

/// Loads of a face of 1 m² at which its elastic bond breaks. The forces of its points act at 1/(2√3) m from the middle along both
/// sides.
const FACE_STRENGTHS: [(&str, &[LoadComponent]); 4] = [
    ("traction", &[(0, 1.0, 0.0)]),
    // With the couple that keeps it from bending.
    ("shear", &[(2, 0.0, 1.0), (4, 0.0, 0.5)]),
    ("bending", &[(4, 0.288_675_134_594_812_9, 0.0)]),
    ("torsion", &[(3, 0.0, 0.408_248_290_463_863)]),
];

/// The loads of the points that balance each other do not break a bond that is stiff against the step, and the tolerance is that
/// of the loads.
#[test]
fn faces_break_at_their_strength_in_steps_of_any_length() {
    for (stiffness_ratio, strength_ratio) in [(1.0, 1.0), (1.0, 1e3), (1e3, 1e3), (1e-3, 1e-3)] {
        for (dt, tol) in [(1.0, None), (1.0, Some(1e-8)), (0.1, None), (0.01, None)] {
            for (name, loads) in FACE_STRENGTHS {
                for share in [0.9, 0.99, 1.01, 1.1] {
                    // In the first step the block lags behind its load by m/(k S dt²), 1e-5 or more. Its inertia bends the face by
                    // 1.7 % of its strength under a shear of 1e3 times this strength, and shears it by more than the rest of its
                    // shear strength at 0.99 in bending where that is 1e-3 times the other.
                    if (share, dt) == (0.99, 0.01) && strength_ratio != 1.0 {
                        continue;
                    }
                    let (c_n, c_t) = (1e3, 1e3 * strength_ratio);
                    let mut case = Case::new();
                    let parameters = [1e9, 1e9 * stiffness_ratio, c_n, c_t, 1.0, 0.125, 0.25];
                    case.law_of_all("ELASTIC_BEAM_DS_CLB", &parameters);
                    let root = case.block([0.5; 3], [0.0; 3], AXES);
                    let block = case.block([0.5; 3], [1.0, 0.0, 0.0], AXES);
                    case.drive(root, [0.0; 6].map(Evolution::constant));
                    // A step that does not converge breaks bonds, and needs no more sweeps.
                    (case.options.dt, case.options.tol, case.options.max_sweeps) = (dt, tol, Some(1000));
                    for (component, of_normal, of_tangential) in loads {
                        case.pull(block, *component, share * (of_normal * c_n + of_tangential * c_t));
                    }
                    let bonds_left = bonded(&case.run(3)).into_iter().filter(|bond| *bond == 1).count();
                    let what = format!("{name} {share} dt {dt} {tol:?} {stiffness_ratio} {strength_ratio}");
                    assert_eq!(bonds_left == 4, share < 1.0, "{what}: {bonds_left}");
                    let residual = case.column("residual").into_iter().fold(0.0, f64::max);
                    assert!(share > 1.0 || residual <= tol.unwrap_or(1e-2), "{what}: {residual}");
                }
            }
        }
    }
}

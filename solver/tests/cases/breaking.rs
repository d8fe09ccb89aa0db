//! Bonds break in the step in which their load is more than their strength, whatever else is large or small.

use std::f64::consts::PI;

use cd_formats::snapshot::STATUS_SLIDE;

use crate::case::{Case, Figures, equal};

const AXES: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Tangential cohesion, Pa.
const SHEAR: f64 = 32.0;

/// Load on the bond of a body on a floor.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Load {
    Shear,
    Tension,
    /// Shear together with half of the normal cohesion, as pressure or as traction.
    Pressed,
    Drawn,
}

#[derive(Debug, Clone, Copy)]
struct Setting {
    /// A cube of edge 1, whose face is bonded, or a ball of radius 1/2.
    cube: bool,
    load: Load,
    /// c_n/c_t
    ratio: f64,
    dt: f64,
    tol: f64,
}

/// Bonds after each of some steps under a share of the strength.
fn bonds(Setting { cube, load, ratio, dt, tol }: Setting, share: f64, steps: u64) -> Vec<f64> {
    let mut case = Case::new();
    let normal = ratio * SHEAR;
    case.law_of_all("IQS_MOHR_DS_CLB", &[normal, SHEAR, 0.2, 0.3]);
    let (area, mass) = if cube { (1.0, 1.0) } else { (PI / 4.0, PI / 6.0) };
    // Of what draws a ball along its bond takes 2/7.
    let along = if cube { 1.0 } else { 3.5 };
    let traction = match load {
        Load::Shear => 0.0,
        Load::Tension => share * normal,
        Load::Pressed => -0.5 * normal,
        Load::Drawn => 0.5 * normal,
    };
    let shear = if load == Load::Tension { 0.0 } else { share * (SHEAR - traction / ratio) };
    case.gravity = [along * shear * area / mass, 0.0, traction * area / mass];
    let size = 1e9; // of the plate: in a second the body may be far
    case.plate([size, size, 0.5], [0.0, 0.0, -0.5], AXES);
    match cube {
        true => case.block([0.5; 3], [0.0, 0.0, 0.5], AXES),
        false => case.sphere(0.5, [0.0, 0.0, 0.5]),
    };
    (case.options.dt, case.options.tol) = (dt, Some(tol));
    case.run(steps);
    case.column("bonds")
}

/// Load of a bond on a patch of a cube.
#[derive(Debug, Clone, Copy)]
enum PatchLoad {
    Pull,
    Shear,
    Bend,
    Twist,
}

/// Smallest number of bonds in some steps of a cube of edge 1 at the default `tol`. A patch of its upper face, a square of edge
/// `size` (m) at the distance `off` (m) from the middle, carries a share of its strength.
fn patch_bonds(load: PatchLoad, size: f64, off: f64, ratio: f64, share: f64, steps: u64) -> f64 {
    const FORCE: f64 = 9.81;
    let mut case = Case::new();
    let area = size * size;
    // Bent, two corners pull with all of their strength against the two others.
    let bending = FORCE / (0.5 * size * area * share);
    // All of a square shears about its middle: the integral of the radius is size³ (√2 + asinh 1)/6.
    let twisting = ratio * FORCE / (size * area * (2f64.sqrt() + 1f64.asinh()) / 6.0 * share);
    let (normal, force, [bend, twist]) = match load {
        PatchLoad::Pull => (FORCE / (area * share), [0.0, 0.0, -FORCE], [0.0; 2]),
        PatchLoad::Shear => (ratio * FORCE / (area * share), [FORCE, 0.0, 0.0], [0.0; 2]),
        PatchLoad::Bend => (bending, [0.0; 3], [FORCE, 0.0]),
        PatchLoad::Twist => (twisting, [0.0; 3], [0.0, FORCE]),
    };
    case.law_of_all("IQS_MOHR_DS_CLB", &[normal, normal / ratio, 0.2, 0.3]);
    case.plate([0.5 * size, 0.5 * size, 0.5], [off, 0.0, 1.0], AXES);
    let cube = case.block([0.5; 3], [0.0; 3], AXES);
    // The force acts at the middle of the patch.
    let about_y = 0.5 * force[0] - off * force[2] + bend;
    for (component, value) in [(0, force[0]), (2, force[2]), (4, about_y), (5, twist)] {
        case.pull(cube, component, value);
    }
    (case.options.dt, case.options.tol) = (1e-3, None);
    case.run(steps);
    case.column("bonds").into_iter().fold(f64::INFINITY, f64::min)
}

/// Errors of the load are magnified by the arm of the cube's inertia over that of the area.
#[test]
fn a_bond_on_a_small_area_holds_its_strength() {
    for (size, off, ratio) in [(0.01, 0.3, 1.0), (0.03, 0.0, 1e3), (0.03, 0.3, 1.0), (0.3, 0.3, 10.0)] {
        // The torsion of four points is that of the square to 5 %.
        for (load, holds, breaks) in [
            (PatchLoad::Pull, 0.95, 1.05),
            (PatchLoad::Shear, 0.95, 1.05),
            (PatchLoad::Bend, 0.95, 1.05),
            (PatchLoad::Twist, 0.9, 1.11),
        ] {
            let bonds = |share, steps| patch_bonds(load, size, off, ratio, share, steps);
            let what = format!("{load:?} on {size} m at {off} m, c_n/c_t {ratio}");
            assert_eq!(bonds(holds, 8), 4.0, "{what}");
            assert!(bonds(breaks, 1) < 4.0, "{what}");
        }
    }
}

/// A cube that hangs from the middle of its face, at the default `tol` and below it, for many steps.
#[test]
fn a_cube_hangs_from_a_small_area_as_long_as_the_bond_holds() {
    for (a, b) in [(0.01, 0.01), (0.02, 0.02), (0.03, 0.03), (0.1, 1.0)] {
        for (share, steps) in [(0.33, 60), (0.5, 60), (0.83, 60), (1.05, 1)] {
            for tol in [None, Some(1e-4)] {
                let mut case = Case::new();
                let strength = 9.81 / (a * b * share);
                case.law_of_all("IQS_MOHR_DS_CLB", &[strength, 10.0 * strength, 0.2, 0.3]);
                case.gravity = [0.0, 0.0, -9.81];
                case.plate([0.5 * a, 0.5 * b, 0.5], [0.0, 0.0, 1.0], AXES);
                case.block([0.5; 3], [0.0; 3], AXES);
                (case.options.dt, case.options.tol) = (1e-3, tol);
                case.run(steps);
                let bonds = case.column("bonds");
                let holds = bonds.iter().all(|count| *count == 4.0);
                assert_eq!(holds, share < 1.0, "{a} x {b} m, {share} of the strength, tol {tol:?}: {bonds:?}");
            }
        }
    }
}

/// The last cubes of a chain turn about the first bond.
#[test]
fn a_chain_holds_its_strength() {
    for ratio in [1.0, 1e3] {
        let bonds = |share: f64, steps: u64| {
            let mut case = Case::new();
            let normal = 20.0 * 9.81 / share;
            case.law_of_all("IQS_MOHR_DS_CLB", &[normal, normal / ratio, 0.2, 0.3]);
            case.gravity = [0.0, 0.0, -9.81];
            case.plate([0.5; 3], [0.0, 0.0, 0.5], AXES);
            for k in 0..20 {
                case.block([0.5; 3], [0.0, 0.0, -0.5 - f64::from(k)], AXES);
            }
            (case.options.dt, case.options.tol) = (1e-2, None);
            case.run(steps);
            case.column("bonds").into_iter().fold(f64::INFINITY, f64::min)
        };
        assert_eq!(bonds(0.95, 5), 80.0, "c_n/c_t {ratio}");
        assert!(bonds(1.05, 1) < 80.0, "c_n/c_t {ratio}");
    }
}

/// Every combination of which no two differ in one thing alone would miss a scale that hides behind another.
fn settings(load: Load) -> impl Iterator<Item = Setting> {
    let ratios = [1.0, 10.0, 1e2, 1e3, 1e4];
    let times = [1e-4, 1e-2, 1.0];
    let tolerances = [1e-1, 1e-2, 1e-6];
    let all = move |cube: bool| {
        ratios.into_iter().flat_map(move |ratio| {
            times
                .into_iter()
                .flat_map(move |dt| tolerances.into_iter().map(move |tol| Setting { cube, load, ratio, dt, tol }))
        })
    };
    [false, true].into_iter().flat_map(all)
}

/// Steps that a bond must hold: at dt = 1 s the errors of ten to eighty of them add up to more than its range.
const STEPS: u64 = 100;

#[track_caller]
fn check(load: Load) {
    for setting in settings(load) {
        assert_eq!(bonds(setting, 1.11, 1), [0.0], "{setting:?}");
        let count = if setting.cube { 4.0 } else { 1.0 };
        assert_eq!(bonds(setting, 0.9, STEPS), vec![count; STEPS as usize], "{setting:?}");
    }
}

#[test]
fn in_shear() {
    check(Load::Shear);
}

#[test]
fn in_tension() {
    check(Load::Tension);
}

#[test]
fn in_shear_under_pressure() {
    check(Load::Pressed);
}

#[test]
fn in_shear_under_traction() {
    check(Load::Drawn);
}

/// Bonds of cubes under each other share the errors, and so the corrections of their positions.
#[test]
fn in_tension_in_a_row() {
    for (dt, tol) in [(1.0, 1e-1), (1.0, 1e-2), (1.0, 1e-6), (1e-2, 1e-1)] {
        let run = |share: f64, steps: u64| {
            let mut case = Case::new();
            // A larger ratio leaves so little shear that a tilt of 1e-5 rad of the load exceeds it.
            let normal = 10.0 * SHEAR;
            case.law_of_all("IQS_MOHR_DS_CLB", &[normal, SHEAR, 0.2, 0.3]);
            // The first bond carries all five.
            case.gravity = [0.0, 0.0, -share * normal / 5.0];
            case.plate([1e9, 1e9, 0.5], [0.0, 0.0, 0.5], AXES);
            for k in 0..5 {
                case.block([0.5; 3], [0.0, 0.0, -0.5 - f64::from(k)], AXES);
            }
            (case.options.dt, case.options.tol) = (dt, Some(tol));
            let end = case.run(steps);
            (case.column("bonds"), [0, 4].map(|k| end.x(end.free()[k]).z))
        };
        let (bonds, [first, last]) = run(0.9, 200);
        assert_eq!(bonds, [20.0; 200], "dt {dt}, tol {tol}");
        // The rest of each gap after a correction, and the opening of one step.
        equal(first, -0.5, 5e-4);
        equal(last, -4.5, 2e-3);
        assert!(run(1.11, 1).0 < vec![20.0], "dt {dt}, tol {tol}");
    }
}

/// Slid away from the start, the cube has moved by ½ g t² less what the bond took in the first step.
#[test]
fn a_cube_that_is_drawn_off_falls_freely_from_the_first_step_on() {
    const G: f64 = 9.81;
    for ratio in [10.0, 1e3] {
        let mut case = Case::new();
        let shear = G / 1.11;
        case.law_of_all("IQS_MOHR_DS_CLB", &[ratio * shear, shear, 0.5, 0.5]);
        case.gravity = [G, 0.0, 0.0];
        case.floor();
        let cube = case.block([0.5; 3], [0.0, 0.0, 0.5], AXES);
        let h = 1e-2;
        (case.options.dt, case.options.tol) = (h, None);
        let end = case.run(50);
        // Half a step of gravity with and 49.5 without the bond, as the theta-scheme sums them.
        let first = (G - shear) * h;
        let expected = first * 0.5 * h + (1..50).map(|k| (first + G * h * (f64::from(k) - 0.5)) * h).sum::<f64>();
        // Without gravity across the floor the corners push by what the solver leaves.
        equal(end.x(cube).x, expected, 2e-3 * expected);
    }
}

/// A plate on many balls is heavy against each of them: the bonds of the balls on the floor carry it together.
#[test]
fn under_what_is_heavy_against_the_bonded() {
    let bonds = |share: f64| {
        let mut case = Case::new();
        case.law_of_all("IQS_MOHR_DS_CLB", &[1e3 * SHEAR, SHEAR, 0.2, 0.3]);
        case.materials[0].density = 1e-3;
        case.floor();
        for k in 0..9 {
            case.sphere(0.5, [f64::from(k % 3) * 4.0, f64::from(k / 3) * 4.0, 0.5]);
        }
        let top = case.block([5.0, 5.0, 0.5], [4.0, 4.0, 1.5], AXES);
        // The block moves by a, the balls grip on both sides, move by a/2 and turn by a/2 over their radius: T1 + T2 = m a/2 and
        // T1 - T2 = 0.4 m a/2 with T1 at the block.
        let ball = 1e-3 * PI / 6.0;
        let (heavy, upper) = (1e-3 * 100.0, 0.35 * ball);
        let radius = 1.0 / (2.0 + (100.0 * 0.75 / PI).cbrt().recip());
        let a = share * SHEAR * PI * radius * radius / upper;
        case.pull(top, 0, a * (heavy + 9.0 * upper));
        (case.options.dt, case.options.tol) = (1e-6, None);
        case.run(1);
        case.column("bonds")[0]
    };
    assert_eq!(bonds(0.9), 18.0);
    assert!(bonds(1.11) < 18.0);
}

/// Little friction is reached, and left for the dynamic one, in the first step in which the load is more than it holds.
#[test]
fn static_friction_ends_in_the_step_in_which_it_is_too_little() {
    // A tenth of the limit must be more than ten times what a residual of a tenth of `tol`, 1e-3 at most, leaves of the weight.
    for (friction, tolerances) in [(1e-3, &[1e-6][..]), (0.05, &[1e-3, 1e-6]), (0.5, &[1e-1, 1e-2, 1e-6])] {
        for &tol in tolerances {
            for cube in [false, true] {
                let run = |share: f64| {
                    let mut case = Case::new();
                    case.law_of_all("IQS_DS_CLB", &[0.5 * friction, friction]);
                    let along = if cube { 1.0 } else { 3.5 };
                    case.gravity = [along * share * friction, 0.0, -1.0];
                    case.floor();
                    let body = match cube {
                        true => case.block([0.5; 3], [0.0, 0.0, 0.5], AXES),
                        false => case.sphere(0.5, [0.0, 0.0, 0.5]),
                    };
                    (case.options.dt, case.options.tol) = (1e-3, Some(tol));
                    let states = case.states(2, 1);
                    let slides = states[1].contacts.contact_status.iter().all(|status| *status == STATUS_SLIDE);
                    (slides, states[2].v(body).x / (friction * case.options.dt))
                };
                // Static friction in the first step, dynamic in the second.
                let (slides, v) = run(1.11);
                assert!(slides, "{friction} {tol} {cube}");
                let along = if cube { 1.0 } else { 3.5 };
                equal(v, 2.0 * along * 1.11 - 1.5, 0.05);
                let (slides, v) = run(0.9);
                assert!(!slides, "{friction} {tol} {cube}");
                equal(v, if cube { 0.0 } else { 2.0 * 2.5 * 0.9 }, 0.05);
            }
        }
    }
}

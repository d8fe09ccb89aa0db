//! Attraction by a homogeneous polyhedron whose surface is in DATBOX.

use std::f64::consts::PI;
use std::fs;

use cd_formats::compute::{Adaptive, ExternalField};
use cd_formats::geometry::polyhedron_gravity::PolyhedronGravity;
use cd_formats::obj::surface_text;
use cd_formats::orbit::OrbitSpec;
use cd_formats::snapshot::Snapshot;
use cd_formats::surface::Surface;
use nalgebra::Rotation3;

use crate::case::{Case, Figures, Vec3, expect_same_bytes, near};

/// An elongated block with one corner cut: no symmetry.
fn body() -> Surface {
    let vertices = [
        [-1.0, -0.5, -0.4],
        [1.0, -0.5, -0.4],
        [1.0, 0.5, -0.4],
        [-1.0, 0.5, -0.4],
        [-1.0, -0.5, 0.4],
        [0.6, -0.5, 0.4],
        [1.0, 0.5, 0.1],
        [-1.0, 0.5, 0.4],
    ];
    let sides = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
    let triangles: Vec<[u32; 3]> = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Surface::new(&vertices, &triangles).unwrap()
}

/// Field of the body with the density 1.
fn body_field(position: [f64; 3], rate: [f64; 3]) -> ExternalField {
    ExternalField::Polyhedron {
        surface: "body.obj".into(),
        scale: 1.0,
        density: 1.0,
        position,
        rate,
        orbit: None,
        response: false,
    }
}

/// Two specks near the body, in SI-like units with G M about 1.6.
fn specks(position: [f64; 3], rate: [f64; 3], frame: Option<[f64; 3]>, dt: f64) -> Case {
    let mut case = Case::new();
    (case.options.gravity_constant, case.options.dt) = (1.0, dt);
    case.options.fields = vec![body_field(position, rate)];
    case.options.fields.extend(frame.map(|rate| ExternalField::RotatingFrame { rate, centre: position }));
    let turning = Vec3::from(frame.unwrap_or_default());
    for (x, v) in [([1.7, 0.2, 0.1], [0.1, 0.9, 0.2]), ([0.0, -0.3, 1.1], [1.2, 0.0, 0.0])] {
        let (x, v) = (Vec3::from(x), Vec3::from(v));
        let speck = case.sphere(0.01, (x + Vec3::from(position)).into());
        case.launch(speck, (v - turning.cross(&x)).into(), (-turning).into());
    }
    case.write();
    fs::write(case.path().join("DATBOX/body.obj"), surface_text(&body())).unwrap();
    case
}

#[test]
fn energy_about_a_polyhedron_is_kept_to_second_order() {
    let drift = |steps: u64| {
        let position = [5.0, -3.0, 2.0];
        let last = specks(position, [0.0; 3], None, 4.0 / steps as f64).run(steps);
        let attraction = PolyhedronGravity::new(&body());
        let potential = |i: usize| attraction.attraction_and_potential(&(last.x(i) - Vec3::from(position))).1;
        let energy = last.kinetic() + (0..2).map(|i| last.mass(i) * potential(i)).sum::<f64>();
        (energy / last.meta.ledger.energy_start - 1.0).abs()
    };
    // With smaller steps the jumps of the field where its expansions begin and end, some 1e-7, are seen.
    let drifts = [200, 400].map(drift);
    assert!((3.5..4.5).contains(&(drifts[0] / drifts[1])), "{drifts:?}");
    assert!(drifts[1] < 1e-4, "{drifts:?}");
}

#[test]
fn a_turning_polyhedron_attracts_as_one_at_rest_in_its_own_axes() {
    let rate = [0.2, -0.3, 0.9];
    let (position, end) = ([0.5, 0.2, -0.1], 2.0);
    let away = |steps: u64| {
        let dt = end / steps as f64;
        let turning = specks(position, rate, None, dt).run(steps);
        let seen = specks(position, [0.0; 3], Some(rate), dt).run(steps);
        let back = Rotation3::new(Vec3::from(rate) * end);
        let centre = Vec3::from(position);
        (0..2).map(|i| (back * (seen.x(i) - centre) + centre - turning.x(i)).norm()).fold(0.0, f64::max)
    };
    let errors = [200, 400].map(away);
    assert!((3.5..4.5).contains(&(errors[0] / errors[1])), "{errors:?}"); // second order
    assert!(errors[1] < 1e-3, "{errors:?}");
}

#[test]
fn far_away_it_is_a_point_mass() {
    // A circular orbit at 400 m: the quadrupole is below 1e-5 of the attraction.
    let mass = body().volume();
    let radius = 400.0;
    let steps = 1000;
    let period = 2.0 * PI * (f64::powi(radius, 3) / mass).sqrt();
    let mut case = Case::new();
    (case.options.gravity_constant, case.options.dt) = (1.0, period / steps as f64);
    let properties = body().mass_properties();
    let position = properties.centre.map(|c| -2.0 * c);
    case.options.fields = vec![ExternalField::Polyhedron {
        surface: "body.obj".into(),
        scale: 2.0,
        density: 0.125,
        position,
        rate: [0.0; 3],
        orbit: None,
        response: false,
    }];
    let speck = case.sphere(0.01, [radius, 0.0, 0.0]);
    case.launch(speck, [0.0, (mass / radius).sqrt(), 0.0], [0.0; 3]);
    case.write();
    fs::write(case.path().join("DATBOX/body.obj"), surface_text(&body())).unwrap();
    let last = case.run(steps);
    // The second-order error of the step is 0.03 m, the quadrupole adds 0.05 m.
    near(last.x(0), [radius, 0.0, 0.0], 0.2);
}

/// In axes that fall about the body a speck at rest has the path that it has about the body at rest.
#[test]
fn a_polyhedron_on_an_orbit_moves_as_seen_by_the_one_that_falls() {
    let centre = Vec3::from(body().mass_properties().centre);
    let centred: Vec<[f64; 3]> = body().vertices().iter().map(|v| (Vec3::from(*v) - centre).into()).collect();
    let shape = Surface::new(&centred, body().triangles()).unwrap();
    let (r, v, end) = ([3.0, 0.5, -0.4], [0.1, 0.7, 0.2], 4.0);
    let run = |rate: [f64; 3], steps: u64, is_on_orbit: bool| {
        let mut case = Case::new();
        (case.options.gravity_constant, case.options.dt) = (1.0, end / steps as f64);
        let orbit = OrbitSpec::State { position: r, velocity: v, time: 0.0 };
        let motion = orbit.to_orbit(shape.volume()).position_and_velocity(end).0;
        let orbit = is_on_orbit.then_some(orbit);
        let surface = "body.obj".into();
        case.options.fields = vec![ExternalField::Polyhedron {
            surface,
            scale: 1.0,
            density: 1.0,
            position: [0.0; 3],
            rate,
            orbit,
            response: false,
        }];
        let speck = case.sphere(0.01, if is_on_orbit { [0.0; 3] } else { r });
        if !is_on_orbit {
            case.launch(speck, v, [0.0; 3]);
        }
        case.write();
        fs::write(case.path().join("DATBOX/body.obj"), surface_text(&shape)).unwrap();
        case.run(steps).x(0) + if is_on_orbit { motion } else { Vec3::zeros() }
    };
    for rate in [[0.0; 3], [0.3, -0.2, 0.5]] {
        let differences = [200, 400].map(|steps| (run(rate, steps, true) - run(rate, steps, false)).norm());
        // The path of the shape differs from that of a point mass by some 0.1 m; steps are of second order.
        assert!((3.5..4.5).contains(&(differences[0] / differences[1])), "{rate:?}: {differences:?}");
        assert!(differences[1] < 1e-4, "{rate:?}: {differences:?}");
    }
}

/// The attraction of a homogeneous body is continuous on its edges and corners, where its derivative is infinite by a logarithm.
#[test]
fn grains_on_edges_and_corners_move_as_those_next_to_them() {
    let shape = body();
    let corner = |k: usize| Vec3::from(shape.vertices()[k]);
    let mut starts: Vec<Vec3> = (0..shape.vertices().len()).map(corner).collect();
    for triangle in shape.triangles() {
        let [a, b, c] = triangle.map(|k| corner(k as usize));
        // Edges, the diagonals of the faces among them, at points that numbers can and cannot hold, and the face itself.
        starts.extend([(a + b) * 0.5, b + (c - b) * 0.3, (a + b + c) / 3.0]);
    }
    let (away, steps) = (1e-6, 40);
    let run = |rate: [f64; 3], offset: Vec3| {
        let mut case = Case::new();
        (case.options.gravity_constant, case.options.dt) = (1.0, 1.0 / 64.0);
        let surface = "body.obj".into();
        case.options.fields = vec![ExternalField::Polyhedron {
            surface,
            scale: 1.0,
            density: 1.0,
            position: [0.0; 3],
            rate,
            orbit: None,
            response: false,
        }];
        for x in &starts {
            case.sphere(1e-3, (x + offset).into());
        }
        case.write();
        fs::write(case.path().join("DATBOX/body.obj"), surface_text(&shape)).unwrap();
        case.run(steps)
    };
    for rate in [[0.0; 3], [0.2, -0.3, 0.9]] {
        let on = run(rate, Vec3::zeros());
        let ledger = &on.meta.ledger;
        assert!([ledger.energy_start, ledger.outside_work, ledger.momentum_scale].iter().all(|sum| sum.is_finite()));
        for direction in [Vec3::x(), -Vec3::y(), Vec3::new(0.6, 0.0, 0.8)] {
            let next = run(rate, direction * away);
            for (i, start) in starts.iter().enumerate() {
                assert!((on.x(i) - start).norm() > 0.01, "{start} is attracted");
                // The tide of G rho = 1 is some 2 pi ln(1/away) < 100 /s², over 0.6 s.
                near(on.x(i), next.x(i) - direction * away, 50.0 * away);
                near(on.v(i), next.v(i), 200.0 * away);
            }
        }
    }
}

#[test]
fn runs_about_a_polyhedron_resume_to_the_same_bytes() {
    expect_same_bytes(|| {
        let mut case = specks([0.0; 3], [0.1, 0.0, 0.3], None, 0.01);
        case.options.output_every = 10;
        case
    });
}

/// Steps of a speck at 20 m from a body of a few metres, where orbits are slow: the rotation of the body limits them.
#[test]
fn rotation_of_a_polyhedron_limits_adaptive_steps() {
    let longest_step = |rate: [f64; 3]| {
        let mut case = Case::new();
        (case.options.gravity_constant, case.options.dt) = (1.0, 0.01);
        case.options.fields = vec![body_field([0.0; 3], rate)];
        case.sphere(0.01, [20.0, 0.0, 0.0]);
        case.options.adaptive = Some(Adaptive { max_multiple: 1000, travel: 10.0, penetration: 1.0 });
        case.options.output_every = 4000;
        case.write();
        fs::write(case.path().join("DATBOX/body.obj"), surface_text(&body())).unwrap();
        assert_eq!(case.solve(&["--steps=4000", "--threads=1"]), 0);
        case.column("h").into_iter().fold(0.0, f64::max)
    };
    let [at_rest, turning, faster] = [0.0, 0.6, 0.8].map(|rate| longest_step([0.0, rate, 0.0]));
    // A fiftieth of 10.5 s and of 7.9 s.
    assert!(at_rest > 1.0, "{at_rest}");
    assert_eq!([turning, faster].map(|h| (h / 0.01).round()), [20.0, 15.0]);
}

/// Case of a speck of the mass `ratio` times that of a polyhedron about which it moves; the polyhedron responds, or is at rest
/// with the mass of both.
struct BoundSpeck {
    ratio: f64,
    rate: [f64; 3],
    responds: bool,
}

/// Start of the speck relative to the polyhedron, m and m/s, and the time for which it is followed, s.
const BOUND_START: ([f64; 3], [f64; 3]) = ([3.0, 0.5, -0.4], [0.1, 0.7, 0.2]);
const BOUND_TIME: f64 = 4.0;

impl BoundSpeck {
    /// The polyhedron, about its centre of mass.
    fn shape() -> Surface {
        let centre = Vec3::from(body().mass_properties().centre);
        let centred: Vec<[f64; 3]> = body().vertices().iter().map(|v| (Vec3::from(*v) - centre).into()).collect();
        Surface::new(&centred, body().triangles()).unwrap()
    }

    fn orbit() -> OrbitSpec {
        OrbitSpec::State { position: BOUND_START.0, velocity: BOUND_START.1, time: 0.0 }
    }

    /// Position and velocity of the polyhedron on its orbit at a time, s, in the axes of the computation.
    fn orbit_motion(&self, time: f64) -> (Vec3, Vec3) {
        let mu = Self::shape().volume() * (1.0 + self.ratio);
        let (x, v) = Self::orbit().to_orbit(mu).position_and_velocity(time);
        (-x, -v)
    }

    fn case(&self, steps: u64) -> Case {
        let mut case = Case::new();
        (case.options.gravity_constant, case.options.dt) = (1.0, BOUND_TIME / steps as f64);
        let radius = 0.01f64;
        // The density has eight digits in BULK_BEHAV.DAT.
        let density = (self.ratio * Self::shape().volume() / (4.0 / 3.0 * PI * radius.powi(3))).round();
        case.options.fields = vec![ExternalField::Polyhedron {
            surface: "body.obj".into(),
            scale: 1.0,
            density: if self.responds { 1.0 } else { 1.0 + self.ratio },
            position: [0.0; 3],
            rate: self.rate,
            orbit: self.responds.then(Self::orbit),
            response: self.responds,
        }];
        let speck = case.sphere_of(density, radius, if self.responds { [0.0; 3] } else { BOUND_START.0 });
        if !self.responds {
            case.launch(speck, BOUND_START.1, [0.0; 3]);
        }
        case.write();
        fs::write(case.path().join("DATBOX/body.obj"), surface_text(&Self::shape())).unwrap();
        case
    }
}

/// Relative to a polyhedron that responds, a speck is accelerated by it as by one at rest with the mass of both, whether it
/// turns or not, and what the speck gains of momentum the polyhedron loses.
#[test]
fn a_polyhedron_responds_to_the_speck() {
    let mass = BoundSpeck::shape().volume();
    for (ratio, rate) in [(0.5, [0.0; 3]), (3.0, [0.3, -0.2, 0.5])] {
        let responding = BoundSpeck { ratio, rate, responds: true };
        let difference = |steps: u64| {
            let after = responding.case(steps).run(steps);
            let response = after.meta.primary_response.unwrap();
            let momentum = after.v(0) * after.mass(0) + Vec3::from(response.velocity) * mass;
            near(momentum, Vec3::zeros(), 1e-13 * mass);
            let relative = after.x(0) - Vec3::from(response.displacement) - responding.orbit_motion(BOUND_TIME).0;
            let about_rest = BoundSpeck { ratio, rate, responds: false }.case(steps).run(steps).x(0);
            (relative - about_rest).norm()
        };
        let differences = [200, 400].map(difference);
        assert!((3.5..4.5).contains(&(differences[0] / differences[1])), "{ratio}: {differences:?}");
        assert!(differences[1] < 4e-4, "{ratio}: {differences:?}");
    }
}

/// The energy of the speck and of a polyhedron that responds and does not turn is kept, in axes about their centre of mass.
#[test]
fn energy_with_a_polyhedron_that_responds_is_kept() {
    let responding = BoundSpeck { ratio: 0.5, rate: [0.0; 3], responds: true };
    let mass = BoundSpeck::shape().volume();
    let attraction = PolyhedronGravity::new(&BoundSpeck::shape());
    let energy = |state: &Snapshot, response_share: f64| {
        let response = state.meta.primary_response.unwrap();
        let [displacement, velocity] =
            [response.displacement, response.velocity].map(|d| Vec3::from(d) * response_share);
        let (x, v) = responding.orbit_motion(state.meta.time);
        let origin_v = v * (mass / (mass + state.mass(0)));
        let kinetic =
            state.mass(0) * (state.v(0) - origin_v).norm_squared() + mass * (v + velocity - origin_v).norm_squared();
        let potential = attraction.attraction_and_potential(&(state.x(0) - x - displacement)).1;
        0.5 * kinetic + state.mass(0) * potential
    };
    let states = responding.case(200).states(200, 200);
    let start = energy(&states[0], 1.0);
    let [kept, without_deviation] = [1.0, 0.0].map(|share| (energy(&states[1], share) / start - 1.0).abs());
    // The square of 0.02 s over the time of an orbit, 2 pi 30 s, and jumps of the field where its expansions begin, some 1e-7.
    assert!(kept < 2e-7, "{kept:e}");
    // The deviation that the shape of the polyhedron causes has a part in it.
    assert!(without_deviation > 1e-5, "{without_deviation:e}");
}

#[test]
fn a_response_of_a_polyhedron_resumes_to_the_same_bytes() {
    expect_same_bytes(|| {
        let mut case = BoundSpeck { ratio: 0.5, rate: [0.3, -0.2, 0.5], responds: true }.case(200);
        case.options.output_every = 10;
        case
    });
}

#[test]
fn surfaces_that_cannot_be_read_are_refused() {
    let case = specks([0.0; 3], [0.0; 3], None, 0.01);
    let surface = case.path().join("DATBOX/body.obj");
    fs::write(&surface, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    assert_eq!(case.solve(&["--steps=1"]), 2);
    fs::remove_file(&surface).unwrap();
    assert_eq!(case.solve(&["--steps=1"]), 2);
    assert!(!case.path().join("OUTBOX/snapshot-000000.npz").exists());
}

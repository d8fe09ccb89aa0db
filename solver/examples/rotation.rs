//! Torque-free rotation for 150 minutes by the steps of cd-solve: how well energy, angular momentum and phase are kept.
//!
//! `cargo run --release -p cd-solve --example rotation` writes the tables of `docs/explanation/accuracy.md` and
//! `docs/images/rotation.svg` anew. The phase is compared with the exact solution by elliptic functions.

#[path = "../tests/cases/elliptic.rs"]
mod elliptic;
mod page;

use std::error::Error;
use std::fmt::Write;
use std::path::Path;

use cd_formats::bodies::{Bodies, Body, Contactor, ShapeRecord};
use cd_formats::bulk_behav::{BulkBehav, Material};
use cd_formats::compute::ComputeFlags;
use cd_formats::dof::{BodyDof, Dof};
use cd_formats::tact_behav::TactBehav;
use cd_solve::math::Vec3;
use cd_solve::scene::Scene;
use cd_solve::state::State;
use cd_solve::{integrate, read};
use elliptic::FreeRotation;
use plotters::prelude::*;

/// s
const TIME: f64 = 9000.0;
const STEPS: [f64; 4] = [0.01, 0.1, 1.0, 10.0];
const SPINS: [f64; 4] = [1e-4, 1e-3, 1e-2, 1e-1];
const DIRECTIONS: [(&str, [f64; 3]); 2] =
    [("(1, 1, 1)", [1.0, 1.0, 1.0]), ("the intermediate axis and 1 % of the others", [0.01, 1.0, 0.01])];
/// Principal moments, kg m².
const INERTIA: [f64; 3] = [1.0, 2.0, 2.7];

/// Largest relative change of energy and angular momentum over a run, and the error of the phase at its end, rad.
struct Errors {
    energy: f64,
    momentum: f64,
    phase: f64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::temp_dir().join(format!("rotation-{}", std::process::id()));
    let (scene, state) = body(&folder)?;
    std::fs::remove_dir_all(&folder)?;
    let mut text = String::new();
    let mut curves = Vec::new();
    for (name, direction) in DIRECTIONS {
        let _ = writeln!(text, "\nSpin about {name}:\n");
        text += "| h, s \\ spin, rad/s | 1e-4 | 1e-3 | 1e-2 | 1e-1 |\n|---|---|---|---|---|\n";
        let mut phases = vec![Vec::new(); SPINS.len()];
        for h in STEPS {
            let _ = write!(text, "| {h} |");
            for (spin, phases) in SPINS.into_iter().zip(&mut phases) {
                let Errors { energy, momentum, phase } = run(&scene, &state, direction, spin, h);
                let _ = write!(text, " {energy:.0e}, {momentum:.0e}, {phase:.1e} |");
                phases.push((h, phase));
            }
            text.push('\n');
        }
        curves.push((name, phases));
    }
    text.push('\n');
    draw(&page::docs().join("images/rotation.svg"), &curves)?;
    page::put("rotation", &text)?;
    print!("{text}");
    Ok(())
}

/// A tetrahedron with those moments, read as cd-solve reads it.
fn body(folder: &Path) -> Result<(Scene, State), Box<dyn Error>> {
    let datbox = folder.join("DATBOX");
    std::fs::create_dir_all(&datbox)?;
    let third = 1.0 / 3.0;
    let vertices = vec![[-third, -third, -third], [1.0, -third, -third], [-third, 1.0, -third], [-third, -third, 1.0]];
    let shape = ShapeRecord::Polyhedron { vertices, triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] };
    let body = Body {
        line: 0,
        material: "ROCKx".into(),
        equivalent_radius: 0.0,
        inertia: Some(INERTIA),
        position: [0.0; 3],
        contactors: vec![Contactor { colour: "BLUEx".into(), shape, local_frame: None }],
    };
    // Turned by some angle, so that no axis is special.
    let q = nalgebra::UnitQuaternion::from_scaled_axis(Vec3::new(0.3, -0.4, 0.9));
    let axes = [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| (q * axis).into());
    let dof = BodyDof { line: 0, body: 0, displacement: [0.0; 6], velocity: [0.0; 6], axes };
    std::fs::write(datbox.join("BODIES.DAT"), Bodies(vec![body]).to_text())?;
    let material = Material { name: "ROCKx".into(), density: 1.0 };
    std::fs::write(
        datbox.join("BULK_BEHAV.DAT"),
        BulkBehav { gravity: [0.0; 3], materials: vec![material] }.to_text(),
    )?;
    std::fs::write(datbox.join("TACT_BEHAV.DAT"), TactBehav::default().to_text())?;
    std::fs::write(datbox.join("DRV_DOF.DAT"), "")?;
    std::fs::write(datbox.join("DOF.INI"), Dof { step: 0, time: 0.0, bodies: vec![dof] }.to_text())?;
    read::read_case(folder, &ComputeFlags::default()).map_err(|faults| faults.format_report("rotation").into())
}

fn run(scene: &Scene, start: &State, direction: [f64; 3], spin: f64, h: f64) -> Errors {
    let mut scene = scene.clone();
    scene.options.dt = h;
    let mut state = start.clone();
    let body = &scene.bodies[0];
    let own = Vec3::from(direction).normalize() * spin;
    state.w[0] = state.q[0] * own;
    state.angular_momentum[0] = body.angular_momentum(&state.q[0], &state.w[0]);
    let figures = |state: &State| {
        let momentum = body.angular_momentum(&state.q[0], &state.w[0]);
        (momentum.dot(&state.w[0]), momentum)
    };
    let (energy, momentum) = figures(&state);
    let mut errors = Errors { energy: 0.0, momentum: 0.0, phase: 0.0 };
    for _ in 0..(TIME / h).round() as u64 {
        let q_c = integrate::predict_configuration(&scene, &state, 1);
        let (v, w) = (state.v.clone(), q_c.w.clone());
        integrate::advance_state(&scene, &mut state, &q_c, v, w);
        let (e, l) = figures(&state);
        errors.energy = errors.energy.max((e / energy - 1.0).abs());
        errors.momentum = errors.momentum.max((l - momentum).norm() / momentum.norm());
    }
    let inertia = Vec3::from(body.inertia);
    let exact = Vec3::from(FreeRotation::new(body.inertia, own.into()).at(TIME)).component_mul(&inertia);
    let found = state.q[0].inverse_transform_vector(&momentum);
    // Not by the arc cosine, which has half of the digits at small angles.
    errors.phase = exact.cross(&found).norm().atan2(exact.dot(&found));
    errors
}

/// Time step and error of the phase.
type Curve = Vec<(f64, f64)>;

fn draw(path: &Path, curves: &[(&str, Vec<Curve>)]) -> Result<(), Box<dyn Error>> {
    let root = SVGBackend::new(path, (900, 420)).into_drawing_area();
    root.fill(&WHITE)?;
    let font = |size: u32| ("sans-serif", size).into_font();
    for (area, (name, phases)) in root.split_evenly((1, 2)).iter().zip(curves) {
        let mut chart = ChartBuilder::on(area)
            .caption(format!("Spin about {name}"), font(14))
            .margin(12)
            .x_label_area_size(36)
            .y_label_area_size(56)
            .build_cartesian_2d((0.008..12.0).log_scale(), (1e-16..10.0).log_scale())?;
        let label = |x: &f64| format!("{x:.0e}");
        chart
            .configure_mesh()
            .x_desc("h, s")
            .y_desc("angle to the exact direction after 150 min, rad")
            .x_label_formatter(&label)
            .y_label_formatter(&label)
            .draw()?;
        for (k, (spin, points)) in SPINS.iter().zip(phases).enumerate() {
            let colour = Palette99::pick(k).to_rgba();
            let points: Vec<(f64, f64)> = points.iter().copied().filter(|&(_, e)| e > 0.0).collect();
            chart
                .draw_series(LineSeries::new(points.clone(), &colour))?
                .label(format!("{spin:e} rad/s"))
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], colour));
            chart.draw_series(points.into_iter().map(|at| Circle::new(at, 3, colour.filled())))?;
        }
        let slope = [0.01, 10.0].map(|h: f64| (h, 1e-6 * h * h));
        chart
            .draw_series(DashedLineSeries::new(slope, 4, 4, BLACK.into()))?
            .label("second order")
            .legend(|(x, y)| PathElement::new([(x, y), (x + 16, y)], BLACK));
        chart.configure_series_labels().position(SeriesLabelPosition::UpperLeft).background_style(WHITE).draw()?;
    }
    root.present()?;
    Ok(())
}

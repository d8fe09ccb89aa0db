//! When the shape of long rocks matters for their attraction: errors of point masses and of quadrupoles by distance.
//!
//! `cargo run --release -p cd-solve --example quadrupole` writes the table of `docs/explanation/accuracy.md` and
//! `docs/images/quadrupole.svg` anew.

mod page;
#[path = "../tests/quadrupole/points.rs"]
mod points;

use std::error::Error;
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;
use std::path::Path;

use cd_solve::math::Vec3;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use points::{Aggregate, aggregate, errors, rock};

/// Name, distance of the centres where they touch (half length 1 across), turns of the two about z.
const PLACES: [(&str, f64, [f64; 2]); 3] = [
    ("end to end", 4.0, [0.0, 0.0]),
    ("end to side", 3.0, [0.0, FRAC_PI_2]),
    ("side by side", 2.0, [FRAC_PI_2, FRAC_PI_2]),
];
/// Distances over that where they touch.
const DISTANCES: [f64; 9] = [1.0, 1.125, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0];
/// Distances in the table.
const TABLE_DISTANCES: [f64; 5] = [1.0, 1.25, 1.5, 2.0, 4.0];
fn main() -> Result<(), Box<dyn Error>> {
    let found = PLACES.map(|(_, touching, turns)| {
        let [one, two] = turns.map(|turn| rock([2.0, 1.0, 1.0], Vec3::z() * turn));
        DISTANCES.map(|k| errors(&(Vec3::x() * (touching * k)), &one, &two))
    });
    let mut text = String::from("| distance |");
    PLACES.iter().for_each(|(name, ..)| text += &format!(" {name} |"));
    text += "\n|---|---|---|---|\n";
    for (k, distance) in DISTANCES.iter().enumerate().filter(|(_, distance)| TABLE_DISTANCES.contains(distance)) {
        let _ = write!(text, "| {distance} |");
        for errors in &found {
            let [plain, corrected, _] = errors[k];
            let _ = write!(text, " {plain:.2}, {corrected:.3} |");
        }
        text.push('\n');
    }
    let Aggregate { force, virial } = aggregate(f64::INFINITY);
    let [plain, corrected] = force.map(|error| 100.0 * error);
    let [virial, virial_corrected] = virial.map(|error| 100.0 * error);
    let near = 100.0 * aggregate(6.0).force[1];
    let _ = write!(
        text,
        "\nIn an aggregate the neighbours on all sides cancel: of 125 such boxes on a lattice, turned anyhow, the force on a\n\
         box errs by {plain:.1} % (RMS) as point masses and by {corrected:.1} % with quadrupoles ({near:.1} % with those of near ones alone), and\n\
         the virial of all forces, which sets the pressure, by {virial:.2} % and {virial_corrected:.2} %.\n"
    );
    draw(&page::docs().join("images/quadrupole.svg"), &found)?;
    page::put("quadrupole", &text)?;
    print!("{text}");
    Ok(())
}

fn draw(path: &Path, found: &[[[f64; 3]; DISTANCES.len()]]) -> Result<(), Box<dyn Error>> {
    let root = SVGBackend::new(path, (640, 420)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(56)
        .build_cartesian_2d((0.97..4.1).log_scale(), (5e-4..1.0).log_scale())?;
    chart
        .configure_mesh()
        .x_desc("distance of the centres over that where they touch")
        .y_desc("error of the force")
        .y_label_formatter(&|y| format!("{y:.0e}"))
        .draw()?;
    for (k, ((name, ..), errors)) in PLACES.iter().zip(found).enumerate() {
        let colour = Palette99::pick([0, 1, 3][k]).to_rgba();
        let curve = |which: usize| DISTANCES.iter().zip(errors).map(move |(x, error)| (*x, error[which]));
        chart
            .draw_series(DashedLineSeries::new(curve(0), 5, 4, colour.into()))?
            .label(format!("{name}, points"))
            .legend(move |(x, y)| DashedPathElement::new([(x, y), (x + 16, y)], 5, 4, colour));
        chart
            .draw_series(LineSeries::new(curve(1), &colour))?
            .label(format!("{name}, quadrupoles"))
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], colour));
        chart.draw_series(curve(1).map(|at| Circle::new(at, 3, colour.filled())))?;
    }
    chart.configure_series_labels().position(SeriesLabelPosition::LowerLeft).background_style(WHITE).draw()?;
    root.present()?;
    Ok(())
}

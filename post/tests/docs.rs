//! `docs/reference/observables` lists what is written, no more and no less.

mod samples;

use std::fs;
use std::path::Path;

use cd_formats::{atomic, snapshot};
use cd_post::derive::Row;
use cd_post::derive::fragments::find_fragments;
use cd_post::frame::Frame;
use cd_post::shapes::ShapeCache;
use cd_post::write::vtp::vtp_text;
use cd_post::write::{display, plots};
use samples::Scene;

fn page_of(name: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/reference/observables").join(name)).unwrap()
}

/// The cells of the table rows under a heading of a page whose first cell is a `name`.
fn table(page: &str, heading: &str) -> Vec<Vec<String>> {
    let page = page_of(page);
    let lines = page.lines().skip_while(|line| *line != heading).skip(1).take_while(|line| !line.starts_with('#'));
    lines
        .filter(|line| line.starts_with("| `"))
        .map(|line| line.split('|').map(|cell| cell.trim().trim_matches('`').to_string()).skip(1).collect())
        .collect()
}

#[test]
fn columns_of_the_series() {
    let documented: Vec<(String, String)> =
        table("series.md", "# Columns of series.csv").into_iter().map(|row| (row[0].clone(), row[1].clone())).collect();
    let written: Vec<(String, String)> =
        Row::COLUMNS.iter().map(|(name, unit, _)| (name.to_string(), unit.to_string())).collect();
    assert_eq!(documented, written);
}

#[test]
fn columns_of_a_study() {
    let documented: Vec<(String, String)> = table("runs.md", "## Many runs")
        .into_iter()
        .filter(|row| !row[0].contains('.'))
        .map(|row| (row[0].clone(), row[1].clone()))
        .collect();
    let written: Vec<(String, String)> =
        cd_post::commands::study::COLUMNS.iter().map(|(name, unit, _)| (name.to_string(), unit.to_string())).collect();
    assert_eq!(documented, written);
}

#[test]
fn columns_of_means_and_differences() {
    use cd_post::commands::replicates::{DIFFERENCE_COLUMNS, MEAN_COLUMNS};
    for (heading, columns) in [("### means.csv", &MEAN_COLUMNS[..]), ("### differences.csv", &DIFFERENCE_COLUMNS)] {
        let documented: Vec<[String; 3]> =
            table("runs.md", heading).into_iter().map(|row| [row[0].clone(), row[1].clone(), row[2].clone()]).collect();
        let written: Vec<[String; 3]> =
            columns.iter().map(|&(name, unit, help)| [name, unit, help].map(str::to_string)).collect();
        assert_eq!(documented, written);
    }
}

#[test]
fn columns_of_an_accuracy_study() {
    let documented: Vec<[String; 3]> = table("runs.md", "## Error against run time")
        .into_iter()
        .filter(|row| !row[0].contains('.'))
        .map(|row| [row[0].clone(), row[1].clone(), row[2].clone()])
        .collect();
    let written =
        cd_post::commands::accuracy_study::COLUMNS.map(|(name, unit, help)| [name, unit, help].map(str::to_string));
    assert_eq!(documented, written);
}

#[test]
fn columns_of_biases() {
    use cd_post::commands::accuracy_study::{BIAS_COLUMNS, BIAS_ORDER_COLUMNS, RECOMMENDED_COLUMNS, SETTING_COLUMNS};
    for (heading, columns) in [
        ("### bias.csv", &BIAS_COLUMNS[..]),
        ("### bias_orders.csv", &BIAS_ORDER_COLUMNS),
        ("### settings.csv", &SETTING_COLUMNS),
        ("### recommended.csv", &RECOMMENDED_COLUMNS),
    ] {
        let documented: Vec<[String; 3]> = table("../accuracy-study.md", heading)
            .into_iter()
            .map(|row| [row[0].clone(), row[1].clone(), row[2].clone()])
            .collect();
        let written: Vec<[String; 3]> =
            columns.iter().map(|&(name, unit, help)| [name, unit, help].map(str::to_string)).collect();
        assert_eq!(documented, written);
    }
}

#[test]
fn arrays_of_the_paraview_files() {
    let mut scene = Scene::default();
    scene.grain([0.0; 3], 1.0);
    scene.plate([0.0, 0.0, -1.1], [1.0, 1.0, 0.1]);
    let cube = scene.cube([0.0, 0.0, 3.0], 1.0);
    let case = tempfile::tempdir().unwrap();
    let path = snapshot::snapshot_path(&case.path().join("OUTBOX"), 0);
    scene.snapshot.write(&path).unwrap();
    let bodies = scene.records().to_text();
    atomic::write(&case.path().join("DATBOX").join("BODIES.DAT"), bodies.as_bytes()).unwrap();
    let frame = Frame::read(&path, &ShapeCache::default()).unwrap();
    assert!(frame.grains[1].solid.is_some() && frame.grains[1].id == cube as u64 + 1);
    let types = [("Float64", "f64"), ("UInt64", "u64"), ("UInt32", "u32"), ("UInt16", "u16"), ("UInt8", "u8")];
    for kind in display::FILE_KINDS {
        let text = vtp_text(&display::display_piece(&frame, &find_fragments(&frame), kind).unwrap(), "");
        let attribute = |tag: &str, name: &str| -> Option<String> {
            Some(tag.split(&format!(" {name}=\"")).nth(1)?.split('"').next()?.to_string())
        };
        let geometry = ["Points", "connectivity", "offsets"];
        let written: Vec<(String, String)> = text
            .split("<DataArray")
            .skip(1)
            .map(|tag| tag.split('>').next().unwrap())
            .filter_map(|tag| {
                let name = attribute(tag, "Name").filter(|name| !geometry.contains(&name.as_str()))?;
                let short = types.iter().find(|(long, _)| attribute(tag, "type").as_deref() == Some(long)).unwrap().1;
                let components = attribute(tag, "NumberOfComponents").unwrap_or("1".into());
                Some((name, format!("{components}, {short}")))
            })
            .collect();
        let documented: Vec<(String, String)> = table("paraview.md", &format!("## {kind}-NNNNNN.vtp"))
            .into_iter()
            .filter(|row| !row.iter().any(|cell| cell.contains("only if there is a Mesh"))) // the scene has none
            .map(|row| (row[0].clone(), row[1].split(", of ").next().unwrap().to_string()))
            .collect();
        assert_eq!(documented, written, "{kind}");
    }
}

/// Names and unit of each row of the tables under a heading; a cell may have several names.
fn names_and_units(page: &str, heading: &str) -> Vec<(String, String)> {
    let names = |cell: &str| cell.split("`, `").map(str::to_string).collect::<Vec<_>>();
    let rows = table(page, heading).into_iter();
    rows.flat_map(|row| names(&row[0]).into_iter().map(move |name| (name, row[1].replace('³', "^3")))).collect()
}

#[test]
fn columns_of_an_impact() {
    let written = |tables: &[&[cd_post::write::series::Column]]| -> Vec<(String, String)> {
        let columns = tables.iter().flat_map(|columns| columns.iter());
        columns.map(|(name, unit, _)| (name.to_string(), unit.to_string())).collect()
    };
    use cd_post::commands::impact::{ANGLE_COLUMNS, BETA_COLUMNS, GRAIN_COLUMNS, SIZE_COLUMNS, SPEED_COLUMNS};
    for (heading, tables) in [
        ("## beta.csv", &[&BETA_COLUMNS[..]][..]),
        ("## Ejecta", &[&GRAIN_COLUMNS, &SPEED_COLUMNS, &ANGLE_COLUMNS]),
        ("## The crater", &[&SIZE_COLUMNS]),
    ] {
        assert_eq!(names_and_units("impact.md", heading), written(tables), "{heading}");
    }
}

#[test]
fn plots() {
    let page = page_of("README.md");
    for plot in plots::PLOTS {
        assert!(page.contains(plot.file), "{}", plot.file);
    }
}

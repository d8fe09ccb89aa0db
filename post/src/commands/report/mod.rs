//! `cd-post report`: a run on one page without external resources.

mod grains;

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::Faults;

use crate::commands::series::{measure_series, undefined_region_note};
use crate::commands::state;
use crate::derive::energy::self_gravity_constant;
use crate::derive::region_kind::RegionKind;
use crate::derive::{Row, free_surface, plane_fit};
use crate::frame::Frame;
use crate::options::{MeasurementFlags, SeriesOptions};
use crate::tables::{TIMED_STAGES, read_columns};
use crate::write;
use crate::write::colours::GrainQuantity;
use crate::write::plots::PLOTS;
use crate::write::scale::{format_digits, format_six_digits, unit_prefix};

/// Figures of the last state, with their captions, in which REACH is replaced by the reach of slopes.
const STATE_FIGURES: [(&str, &str); 12] = [
    ("layers_nu.svg", "Solid fraction of the bed by height, in layers parallel to the floor."),
    ("layers_Z.svg", "Neighbours per grain by height: bodies that it touches with force."),
    (
        "layers_stress.svg",
        "Stress by height: normal to the floor, mean of the two components parallel to it, shear, and the weight above divided by the area.",
    ),
    (
        "profile_nu.svg",
        "Solid fraction by distance from the centre of mass of the largest remnant; polyhedra count as spheres of equal volume.",
    ),
    (
        "profile_Z.svg",
        "Neighbours per grain by distance from the centre of mass of the largest remnant: bodies that it touches with force.",
    ),
    (
        "profile_stress.svg",
        "Stress by distance from the centre of mass of the largest remnant: pressure, radial component, mean tangential component.",
    ),
    ("forces.svg", "Probability density of the contact forces between grains, each normalised by its mean."),
    (
        "mobilisation.svg",
        "Mobilised friction: tangential force of a contact over the largest that friction allows; 1: sliding.",
    ),
    (
        "surface_height.svg",
        "Height of the surface, from planes fitted within REACH mean radii; polyhedra count as spheres of equal volume.",
    ),
    (
        "surface_slope.svg",
        "Slope of the surface against gravity and rotation, from planes fitted within REACH mean radii. The title gives its standard error due to single grains, whose variance is subtracted.",
    ),
    ("slopes.svg", "Cumulative distribution of the slope over the area of the surface."),
    ("ejecta.svg", "Speed of the grains outside the largest remnant."),
];

/// Columns of the series in groups, each with its title; every column is in one of them.
const COLUMN_GROUPS: [(&str, &[&str]); 11] = [
    ("State", &["step", "time", "interval", "n_grains", "mass"]),
    (
        "Contacts",
        &[
            "n_contacts",
            "n_pulling",
            "n_bonds",
            "Z",
            "Z_no_rattlers",
            "Z_all",
            "Z_interval",
            "Z_constraints",
            "rattler_fraction",
            "share_face",
            "share_edge",
            "share_point",
            "penetration",
            "anisotropy",
            "mobilised",
            "sliding_fraction",
        ],
    ),
    (
        "Deforming cell",
        &[
            "cell_x",
            "cell_y",
            "cell_z",
            "cell_xy",
            "cell_xz",
            "cell_yz",
            "strain_x",
            "strain_y",
            "strain_z",
            "strain_xy",
            "strain_xz",
            "strain_yz",
        ],
    ),
    ("Hollow cylinder whose radius changes", &["cylinder_radius", "cylinder_pressure"]),
    ("Packing", &["region", "region_volume", "nu", "nu_sphere", "R_enclosing"]),
    (
        "Pressure and stress",
        &[
            "pressure",
            "pressure_virial",
            "pressure_interval",
            "pressure_sphere",
            "pressure_kinetic",
            "sigma_xx",
            "sigma_yy",
            "sigma_zz",
            "sigma_xy",
            "sigma_xz",
            "sigma_yz",
            "kinetic_xx",
            "kinetic_yy",
            "kinetic_zz",
            "kinetic_xy",
            "kinetic_xz",
            "kinetic_yz",
            "sqrt_J2",
            "drucker_prager",
            "friction_angle",
            "tensile_fraction",
        ],
    ),
    (
        "Energy",
        &[
            "Ec_mean",
            "Ec_rot_mean",
            "Ec_rigid_mean",
            "E_grav",
            "E_uniform",
            "E_fields",
            "E_total",
            "E_contacts",
            "E_friction",
            "E_shocks",
            "E_outside",
        ],
    ),
    (
        "Motion of the whole",
        &["com_x", "com_y", "com_z", "P_x", "P_y", "P_z", "L_x", "L_y", "L_z", "spin_x", "spin_y", "spin_z"],
    ),
    ("Shape of the whole", &["a", "b", "c"]),
    (
        "Fragments",
        &[
            "n_fragments",
            "largest_fraction",
            "largest_mass",
            "largest_a",
            "largest_b",
            "largest_c",
            "largest_spin",
            "largest_period",
            "bound_fraction",
            "escaping_fraction",
        ],
    ),
    (
        "Bed and free surface",
        &[
            "bed_height",
            "bed_nu",
            "bed_pressure",
            "bed_pressure_interval",
            "bed_stress_ratio",
            "surface_slope",
            "surface_slope_error",
        ],
    ),
];

/// Largest size of the tables within the page, bytes together; the series comes first.
const MAX_TABLE_BYTES: usize = 10_000_000;

/// Measures the case like cd-post without ParaView files, and writes `POSTPRO/report.html`; returns its path and notes for
/// the user. With `reload` the page loads itself again after this time, s, while a run continues. Errors: no snapshot, or
/// faults of one.
pub fn write(
    dir: &Path,
    every: u32,
    measures: &MeasurementFlags,
    reload: Option<f64>,
) -> Result<(PathBuf, Vec<String>), Faults> {
    let measures = measures.clone();
    let options = SeriesOptions {
        dir: dir.to_path_buf(),
        every,
        no_plots: true,
        no_vtk: true,
        measures,
        ..SeriesOptions::default()
    };
    let (rows, kept) = measure_series(&options, |k, count, frame| {
        grains::PageState::from_frame(k, count, &frame).map(|state| (state, (k + 1 == count).then_some(frame)))
    })?;
    let (states, mut frames): (Vec<_>, Vec<_>) = kept.into_iter().unzip();
    let last = frames.pop().flatten().expect("the last snapshot is taken");
    let seconds = stage_seconds(&dir.join("TIMER.csv"))?;
    let reach = options.measures.slope.slope_reach;
    let state_files = match last.grains.is_empty() {
        true => Vec::new(),
        false => state::state_files(&last, &state::added_bodies(dir)?, reach),
    };
    let path = dir.join("POSTPRO/report.html");
    let content = PageContent { rows: &rows, states: &states, last: &last, reach, seconds: &seconds, reload };
    atomic::write(&path, page_html(dir, &content, state_files).as_bytes())?;
    Ok((path, undefined_region_note(&rows).into_iter().collect()))
}

fn escape_html(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// Measurements of a run for its page; `rows` and `states` contain at least the rows and states of `last`.
struct PageContent<'a> {
    rows: &'a [Row],
    states: &'a [grains::PageState],
    last: &'a Frame,
    /// Ratio of the reach of slopes to the mean radius, if it is not the default.
    reach: Option<f64>,
    /// Stages of cd-solve with their durations, s.
    seconds: &'a [(&'static str, f64)],
    /// Time after which the page loads itself again, s.
    reload: Option<f64>,
}

/// Text of the page. `state_files`: tables and figures of the last state.
fn page_html(dir: &Path, content: &PageContent, state_files: Vec<state::file::StateFile>) -> String {
    let &PageContent { rows, states, last, reach, seconds, reload } = content;
    let full_path = std::fs::canonicalize(dir).unwrap_or(dir.to_path_buf());
    let name = escape_html(&full_path.file_name().map_or("case".into(), |name| name.to_string_lossy().into_owned()));
    let meta = &last.meta;
    let body = reload.map_or("<body>".into(), |seconds| format!("<body data-reload=\"{seconds}\">"));
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><title>{name}</title>\n<style>\n{}</style></head>{body}\n\
         <h1>{name}</h1>\n<p>{} grains, {} walls, {} snapshots to t = {} s (step {}), by {}.</p>\n",
        include_str!("page.css"),
        last.grains.len(),
        last.walls.len(),
        rows.len(),
        format_six_digits(meta.time),
        meta.step,
        escape_html(&meta.program)
    );
    let mut add = |text: &str| page.push_str(text);
    if reload.is_some() {
        add(
            "<p>The run continues. <label><input type=\"checkbox\" id=\"reload\" checked> load new states</label></p>\n",
        );
    }
    let has_final_state = !last.grains.is_empty();
    let sections = SECTIONS.iter().filter(|(id, _)| has_final_state || *id != "final-state");
    let links: Vec<String> = sections.map(|(id, title)| format!("<a href=\"#{id}\">{title}</a>")).collect();
    add(&format!("<nav aria-label=\"contents\">{}</nav>\n", links.join(" · ")));
    let last_row = rows.last().expect("a row of the last state");
    add(&heading("summary"));
    add(&summary_html(last_row, rows[0].step, last, dir, seconds));
    add(&heading("grains"));
    add("<p><label>Colour by <select id=\"view-quantity\"></select></label>\
         <span id=\"view-legend\"><span class=\"low\"></span><span class=\"bar\"></span><span class=\"high\"></span></span>\
         <label><input type=\"checkbox\" id=\"view-same\"> same colour scale at all times</label></p>\n");
    add(
        "<canvas id=\"view\" tabindex=\"0\"></canvas>\n<p id=\"view-note\">A script of this page draws the grains.</p>\n",
    );
    add("<p id=\"view-player\"><button id=\"view-play\">Play</button> \
         <input type=\"range\" id=\"view-time\" min=\"0\" step=\"1\" aria-label=\"time\"> <output id=\"view-clock\"></output></p>\n<p id=\"view-exports\"></p>\n");
    add(
        "<p>Drag to rotate, wheel or + and - to zoom, shift and drag to pan, double-click to reset, space bar to play. z points up.</p>\n",
    );
    add(&format!("<script type=\"application/json\" id=\"grain-data\">{}</script>\n", grains::page_json(states, last)));
    add(&format!("<script>\n{}</script>\n", include_str!("viewer.js")));
    add(&heading("time-series"));
    add("<div class=\"figures\">\n");
    for plot in &PLOTS {
        add(&figure_html(plot.file, &plot.to_figure(rows).to_svg(), plot.caption));
    }
    add("</div>\n");
    let mut tables = vec![("series.csv".to_string(), write::series::series_text(rows))];
    if has_final_state {
        add(&heading("final-state"));
        add("<div class=\"figures\">\n");
        let default = if self_gravity_constant(last).is_none() {
            free_surface::DEFAULT_SLOPE_REACH
        } else {
            plane_fit::DEFAULT_FIT_REACH
        };
        let reach_text = format_six_digits(reach.unwrap_or(default));
        let files: BTreeMap<&str, Vec<u8>> = state_files.into_iter().collect();
        let texts = files.iter().filter(|(file, _)| file.ends_with(".csv"));
        tables.extend(texts.map(|(file, text)| (format!("state-{file}"), String::from_utf8_lossy(text).into_owned())));
        for (file, caption) in STATE_FIGURES {
            // If nothing has left, there is nothing to draw.
            let table = files.get(file.replace(".svg", ".csv").as_str());
            let empty = table.is_some_and(|csv| csv.iter().filter(|byte| **byte == b'\n').count() < 2);
            if let Some(svg) = files.get(file).filter(|_| !empty) {
                add(&figure_html(file, &String::from_utf8_lossy(svg), &caption.replace("REACH", &reach_text)));
            }
        }
        // The gradients of this picture have names that only one picture of a page may use.
        add(&figure_html(
            "aggregate.svg",
            &write::picture::svg(last, GrainQuantity::Neighbours),
            "Grains coloured by number of neighbours, seen from the front, slightly from the right and above.",
        ));
        add("</div>\n");
    }
    add(&heading("quantities"));
    add(&quantities_html(last_row));
    add(&heading("tables"));
    add(&tables_html(&tables));
    add(&heading("run"));
    add(&run_html(dir, rows[0].step, last, seconds));
    add(&format!("<script>\n{}</script>\n</body></html>\n", include_str!("exports.js")));
    page
}

/// Figure with its caption; without its ending, the name of `file` is part of the name under which the page saves it.
fn figure_html(file: &str, svg: &str, caption: &str) -> String {
    let name = file.trim_end_matches(".svg");
    format!("<figure data-name=\"{name}\">{svg}<figcaption>{caption}</figcaption></figure>\n")
}

/// Sections of the page: names for links, and titles.
const SECTIONS: [(&str, &str); 7] = [
    ("summary", "Summary"),
    ("grains", "The grains"),
    ("time-series", "Time series"),
    ("final-state", "Final state"),
    ("quantities", "All quantities"),
    ("tables", "Tables"),
    ("run", "The run"),
];

/// Heading of a section.
fn heading(id: &str) -> String {
    let title = SECTIONS.iter().find(|(known, _)| *known == id).map_or(id, |(_, title)| title);
    format!("<h2 id=\"{id}\">{title}</h2>\n")
}

/// Ten lines at most: the size of the run, its main observables at the end, its accuracy and cost; lines without a value are
/// left out.
fn summary_html(row: &Row, first: u64, last: &Frame, dir: &Path, seconds: &[(&str, f64)]) -> String {
    let mut lines: Vec<(&str, String)> = Vec::new();
    let number = |value: f64, unit: &str| {
        let (factor, unit) = unit_prefix(value.abs(), unit);
        let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
        format!("{}{unit}", format_digits(value / factor, 4))
    };
    let mut add = |name: &'static str, parts: &[(&str, f64, &str)]| {
        let defined = parts.iter().filter(|(_, value, _)| value.is_finite());
        let texts: Vec<String> =
            defined.map(|(label, value, unit)| format!("{label}{}", number(*value, unit))).collect();
        if !texts.is_empty() {
            lines.push((name, texts.join(", ")));
        }
    };
    let region = &RegionKind::ALL[row.region as usize];
    add("Mass of the grains", &[("", row.mass, "kg")]);
    add("Neighbours per grain", &[("Z = ", row.Z, "1"), ("without rattlers ", row.Z_no_rattlers, "1")]);
    add("Solid fraction", &[("ν = ", row.nu, "1")]);
    add("Mean pressure", &[("", row.pressure, "Pa"), ("by the virial ", row.pressure_virial, "Pa")]);
    add("Kinetic energy per grain", &[("", row.Ec_mean, "J"), ("of it rotation ", row.Ec_rot_mean, "J")]);
    if row.bed_height.is_finite() {
        let slope = row.surface_slope.to_degrees();
        add("Bed", &[("height ", row.bed_height, "m"), ("slope of the surface ", slope, "°")]);
    } else {
        add("Semi-axes", &[("a = ", row.a, "m"), ("b = ", row.b, "m"), ("c = ", row.c, "m")]);
    }
    add("Largest remnant", &[("share of the mass ", row.largest_fraction, "1"), ("period ", row.largest_period, "s")]);
    let ledger = &last.meta.ledger;
    if row.region != 0 {
        lines.insert(1.min(lines.len()), ("Region of the means", region.name().into()));
    }
    let steps = logged_steps(&dir.join("OUTBOX/steps.csv"), last.meta.step)
        .unwrap_or(last.meta.step - first.min(last.meta.step));
    lines.push((
        "Accuracy",
        format!(
            "{} of {steps} steps unconverged, largest penetration {} of the mean radius",
            ledger.steps_unconverged,
            format_digits(ledger.penetration_largest, 3)
        ),
    ));
    if !seconds.is_empty() {
        let total: f64 = seconds.iter().map(|(_, time)| time).sum();
        lines.push(("Computing time", format!("{} s", format_digits(total, 4))));
    }
    let mut text = String::from("<table>\n");
    for (name, value) in lines {
        let _ = writeln!(text, "<tr><td>{name}</td><td>{}</td></tr>", escape_html(&value));
    }
    text + "</table>\n"
}

/// Columns of the series at the end, by groups, with unit and meaning; those without a value are named below each group.
fn quantities_html(row: &Row) -> String {
    let (numbers, texts) = (row.numbers(), row.texts());
    let mut text = String::new();
    for (title, columns) in COLUMN_GROUPS {
        let mut undefined = Vec::new();
        let _ = writeln!(text, "<details open><summary>{title}</summary>\n<table>");
        for name in columns {
            let k = Row::COLUMNS.iter().position(|(known, _, _)| known == name).expect("a column");
            let ((_, unit, help), value, exact) = (Row::COLUMNS[k], numbers[k], &texts[k]);
            // Counts have all their digits.
            let value = match value.is_finite() {
                true if *name == "region" => format!("{exact}: {}", RegionKind::ALL[row.region as usize].name()),
                true if exact.parse::<u64>().is_ok() => exact.clone(),
                true => format_six_digits(value),
                false => {
                    undefined.push(*name);
                    continue;
                }
            };
            let unit = if unit == "1" { "" } else { unit };
            let _ = writeln!(
                text,
                "<tr><td>{name}</td><td class=\"number\">{value}</td><td>{unit}</td><td>{}</td></tr>",
                escape_html(help)
            );
        }
        text += "</table>\n";
        if !undefined.is_empty() {
            let _ = writeln!(text, "<p>Not defined: {}.</p>", undefined.join(", "));
        }
        text += "</details>\n";
    }
    text
}

/// Tables that the page saves, as CSV within it; those beyond [`MAX_TABLE_BYTES`] are named.
fn tables_html(tables: &[(String, String)]) -> String {
    let mut text = String::from("<p id=\"table-exports\">Save as CSV</p>\n");
    let (mut size, mut left_out) = (0, Vec::new());
    for (name, table) in tables {
        // Tables have numbers only; a text that would end the element is left out.
        if size + table.len() > MAX_TABLE_BYTES || table.contains("</") {
            left_out.push(name.as_str());
            continue;
        }
        size += table.len();
        let _ = writeln!(text, "<script type=\"text/csv\" data-table=\"{name}\">{table}</script>");
    }
    if !left_out.is_empty() {
        let _ = writeln!(
            text,
            "<p>Too large for this page: {}; <code>cd-post state</code> writes them.</p>",
            left_out.join(", ")
        );
    }
    text
}

/// Parameters, laws, cost and errors of the run; `first`: step of its first snapshot, above 0 if it continues the time of
/// another run.
fn run_html(dir: &Path, first: u64, last: &Frame, seconds: &[(&str, f64)]) -> String {
    let (meta, ledger) = (&last.meta, &last.meta.ledger);
    let mut rows: Vec<(String, String)> = Vec::new();
    let mut row = |name: &str, value: String| rows.push((name.to_string(), value));
    // With adaptive steps the number of a step counts dt; a row of steps.csv is a step, or as many as its column `steps` has. A
    // run that was cut off has rows after its last snapshot, which the ledger does not know.
    let adaptive = meta.parameters.adaptive.is_some();
    let steps = logged_steps(&dir.join("OUTBOX/steps.csv"), meta.step);
    let steps = steps.or((!adaptive).then_some(meta.step.saturating_sub(first)));
    row(if adaptive { "last time step" } else { "time step" }, format!("{} s", format_six_digits(meta.h)));
    let dt_count = steps.filter(|_| !adaptive).unwrap_or(meta.step.saturating_sub(first));
    row(if adaptive { "units of dt" } else { "steps" }, dt_count.to_string());
    if let Some(steps) = steps {
        row("sweeps of the contact solver per step", format_six_digits(ledger.sweeps as f64 / steps.max(1) as f64));
    }
    let unconverged = ledger.last_unconverged.map_or(String::new(), |step| format!(", last at step {step}"));
    row("unconverged steps", format!("{}{unconverged}", ledger.steps_unconverged));
    row("largest penetration", format!("{} of the mean radius", format_six_digits(ledger.penetration_largest)));
    for law in &meta.laws {
        let parameters: Vec<String> = law.parameters.iter().map(|p| format_six_digits(*p)).collect();
        row(&format!("law {}", law.nickname), format!("{} ({})", law.kind, parameters.join(", ")));
    }
    for material in &meta.materials {
        row(&format!("material {}", material.name), format!("{} kg/m³", format_six_digits(material.density)));
    }
    for (stage, time) in seconds {
        row(&format!("seconds, {stage}"), format_six_digits(*time));
    }
    let mut text = String::from("<table>\n");
    for (name, value) in rows {
        let _ = writeln!(text, "<tr><td>{}</td><td>{}</td></tr>", escape_html(&name), escape_html(&value));
    }
    text += "</table>\n";
    let parameters = serde_json::to_string_pretty(&meta.parameters).unwrap_or_default();
    text += &format!("<h3>Options in force</h3>\n<pre>{}</pre>\n", escape_html(&parameters));
    if let Ok(options) = atomic::read_text(&dir.join("DATBOX/COMPUTE.RON")) {
        text += &format!("<h3>COMPUTE.RON</h3>\n<pre>{}</pre>\n", escape_html(&options));
    }
    text
}

/// Number of steps in the rows of a log up to step `last`: one for each row, unless a column contains their number; None
/// without the log.
fn logged_steps(path: &Path, last: u64) -> Option<u64> {
    let text = atomic::read_text(path).ok()?;
    let mut lines = text[..text.rfind('\n').unwrap_or(0)].lines();
    let steps_column = lines.next()?.split(',').position(|name| name == "steps");
    let steps = |line: &str| {
        let number = line.split(',').next()?.parse::<u64>().ok()?;
        let steps = steps_column.and_then(|k| line.split(',').nth(k)?.parse().ok()).unwrap_or(1);
        (number <= last).then_some(steps)
    };
    Some(lines.filter_map(steps).sum())
}

/// Seconds spent in each stage, the sums of the columns of TIMER.csv; none if there is no such file.
fn stage_seconds(path: &Path) -> Result<Vec<(&'static str, f64)>, Faults> {
    if !atomic::path_exists(path) {
        return Ok(Vec::new());
    }
    let stages = [&TIMED_STAGES[..], &["writing"]].concat();
    let table = read_columns(path, &stages)?;
    Ok(stages.iter().map(|stage| (*stage, table[*stage].iter().sum())).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_is_in_one_group() {
        let grouped: Vec<&str> = COLUMN_GROUPS.iter().flat_map(|(_, columns)| columns.iter().copied()).collect();
        for (name, _, _) in Row::COLUMNS {
            assert_eq!(grouped.iter().filter(|known| *known == name).count(), 1, "{name}");
        }
        assert_eq!(grouped.len(), Row::COLUMNS.len());
    }

    #[test]
    fn tables_that_are_too_large_are_named() {
        let tables = [("a.csv".to_string(), "x\n".repeat(MAX_TABLE_BYTES / 2)), ("b.csv".into(), "y\n1\n".into())];
        let text = tables_html(&tables);
        assert!(text.contains("data-table=\"a.csv\"") && text.contains("Too large for this page: b.csv"));
    }
}

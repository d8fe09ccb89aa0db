//! Wires and rods between the points PT3Dx of BODIES.DAT, by the rows of TACT_BEHAV.DAT.

use std::path::Path;

use cd_formats::bodies::{Bodies, ShapeRecord};
use cd_formats::drv_dof::{DrivenKind, DrvDof};
use cd_formats::error::{Fault, Faults};
use cd_formats::law_table::is_law_of_points;
use cd_formats::names::number_text;
use cd_formats::tact_behav::{TactBehav, VisibilityRow};

use crate::math::Vec3;
use crate::read::contactors::POINT_NAME;
use crate::scene::{BodyId, LawId, PointLink, Scene};

/// Share of the alert distance by which two points may be farther apart: numbers in the files have eight digits.
const ALERT_ROUNDING: f64 = 1e-7;

/// A PT3Dx.
struct PointContactor<'a> {
    body: BodyId,
    /// Number among the contactors of its body, from 0.
    contactor: usize,
    colour: &'a str,
    /// Position in BODIES.DAT, m.
    position: Vec3,
}

/// Rows of wires and rods.
fn link_rows(tact: &TactBehav) -> impl Iterator<Item = &VisibilityRow> {
    let is_link = |row: &&VisibilityRow| {
        let joins_points = row.candidate.contactor == POINT_NAME && row.antagonist.contactor == POINT_NAME;
        joins_points && tact.laws.iter().any(|law| law.nickname == row.law && is_law_of_points(&law.kind))
    };
    tact.visibility.iter().filter(is_link)
}

/// Points of all bodies, in their order.
fn point_contactors(records: &Bodies) -> Vec<PointContactor<'_>> {
    let mut points = Vec::new();
    for (body, record) in records.0.iter().enumerate() {
        for (contactor, point) in record.contactors.iter().enumerate() {
            if let ShapeRecord::Point { offset } = &point.shape {
                let position = Vec3::from(record.position) + Vec3::from(*offset);
                points.push(PointContactor { body: BodyId::new(body), contactor, colour: &point.colour, position });
            }
        }
    }
    points
}

/// Whether wires or rods may join points of these bodies.
pub fn has_links(records: &Bodies, tact: &TactBehav) -> bool {
    link_rows(tact).next().is_some() && !point_contactors(records).is_empty()
}

/// Sets the wires and rods of the scene: as in LMGC90, one between each two points of different bodies that a row joins and whose
/// distance in BODIES.DAT is at most its alert distance, for the whole run.
pub fn set_links(
    datbox: &Path,
    records: &Bodies,
    tact: &TactBehav,
    driven: &DrvDof,
    scene: &mut Scene,
    faults: &mut Faults,
) {
    let points = point_contactors(records);
    let mut is_joined = vec![false; points.len()];
    let mut along_x: Vec<usize> = (0..points.len()).collect();
    along_x.sort_by(|&a, &b| points[a].position.x.total_cmp(&points[b].position.x));
    // Largest alert distance of a row that could join the point, m.
    let mut largest_alert: Vec<Option<f64>> = vec![None; points.len()];
    let mut links: Vec<(PointLink, &VisibilityRow)> = Vec::new();
    for row in link_rows(tact) {
        let Some(law) = scene.law_names.iter().position(|law| law.nickname == row.law) else { continue };
        let is_joined_pair = |a: &PointContactor, b: &PointContactor| {
            let colours = [a.colour, b.colour];
            let row_colours = [row.candidate.colour.as_str(), row.antagonist.colour.as_str()];
            a.body != b.body && (colours == row_colours || [colours[1], colours[0]] == row_colours)
        };
        let alert = row.alert * (1.0 + ALERT_ROUNDING);
        for (k, &first) in along_x.iter().enumerate() {
            let is_near = |second: &&usize| points[**second].position.x - points[first].position.x <= alert;
            for &second in along_x[k + 1..].iter().take_while(is_near) {
                let [a, b] = [first.min(second), first.max(second)].map(|k| &points[k]);
                let rest_length = (a.position - b.position).norm();
                if rest_length > alert || !is_joined_pair(a, b) {
                    continue;
                }
                (is_joined[first], is_joined[second]) = (true, true);
                if [a, b].iter().all(|point| scene.bodies[point.body.index()].is_imposed()) {
                    continue;
                }
                if rest_length == 0.0 {
                    let line = Some(records.0[b.body.index()].line);
                    let found = format!("PT3Dx at the same position as one of body {}", a.body.number());
                    let expected = "expected a distance, the length of the wire or rod without strain";
                    let object = format!("body {}", b.body.number());
                    faults.push(Fault::new(&datbox.join("BODIES.DAT"), line, object, found, expected));
                    continue;
                }
                let link = PointLink {
                    bodies: [a.body, b.body],
                    offsets: [a, b].map(|point| offset_in_body(scene, point)),
                    part_numbers: [point_number(scene, a), point_number(scene, b)].into(),
                    rest_length,
                    law: LawId::new(law),
                };
                links.push((link, row));
            }
        }
        for (k, point) in points.iter().enumerate().filter(|(k, _)| !is_joined[*k]) {
            if points.iter().any(|other| is_joined_pair(point, other)) {
                largest_alert[k] = Some(largest_alert[k].map_or(row.alert, |known| known.max(row.alert)));
            }
        }
    }
    let file = datbox.join("TACT_BEHAV.DAT");
    links.sort_by_key(|(link, _)| (link.bodies, link.part_numbers));
    for same_points in links
        .chunk_by(|a, b| (a.0.bodies, a.0.part_numbers) == (b.0.bodies, b.0.part_numbers))
        .filter(|same| same.len() > 1)
    {
        let [(first, earlier), (second, later)] = [&same_points[0], &same_points[1]];
        if (first.law, earlier.alert) != (second.law, later.alert) {
            let object = format!("PT3Dx {} and PT3Dx {}", later.candidate.colour, later.antagonist.colour);
            let found = format!("law '{}', alert {}", later.law, later.alert);
            let expected = format!("expected law '{}' and alert {}, as in the earlier row", earlier.law, earlier.alert);
            faults.push(Fault::new(&file, Some(later.line), object, found, expected));
            break;
        }
    }
    links.dedup_by_key(|(link, _)| (link.bodies, link.part_numbers));
    if let (Some((_, row)), true) = (links.first(), scene.periodic_cell().is_periodic()) {
        let expected = "expected no xperiode, yperiode or zperiode: wires and rods do not reach over them";
        faults.push(Fault::new(&file, Some(row.line), "PT3Dx", "in a periodic scene", expected));
    }
    scene.links = links.into_iter().map(|(link, _)| link).collect();
    for body in scene.links.iter().flat_map(|link| link.bodies) {
        scene.oriented[body.index()] = true;
    }
    let unjoined_lines = |has_matching_row: bool| {
        // The point of a hinged wall is there for its frame.
        let is_hinge = |k: usize| {
            let body = points[k].body.index();
            driven.0.iter().any(|row| row.body == body && row.kind == DrivenKind::Pivot)
        };
        let is_unjoined =
            |k: &usize| !is_joined[*k] && largest_alert[*k].is_some() == has_matching_row && !is_hinge(*k);
        let unjoined = (0..points.len()).filter(is_unjoined);
        unjoined.map(|k| records.0[points[k].body.index()].line).collect::<Vec<_>>()
    };
    scene.notes.extend(idle_points_note(&unjoined_lines(false), None));
    let alert = largest_alert.iter().zip(&is_joined).filter(|(_, joined)| !**joined).filter_map(|(alert, _)| *alert);
    let alert = alert.reduce(f64::max);
    scene.notes.extend(idle_points_note(&unjoined_lines(true), alert));
}

/// Note about points that nothing joins, from the lines of their bodies; `alert`: largest alert distance (m) of the rows that
/// could join them, if there are any.
fn idle_points_note(lines: &[usize], alert: Option<f64>) -> Option<String> {
    let (first, points) = (lines.first()?, lines.len());
    let (carry, them) = if points == 1 { ("carries", "it") } else { ("carry", "them") };
    let reason = match alert {
        None => format!("no row of TACT_BEHAV.DAT joins {them} by wires or rods"),
        Some(alert) => format!(
            "all points that a row of TACT_BEHAV.DAT could join with {them} are farther away than its alert, at most {} m",
            number_text(alert)
        ),
    };
    Some(format!("BODIES.DAT:{first}: {points} PT3Dx {carry} nothing: {reason}"))
}

/// Position of a point in the frame of its body, from its centre of mass, m.
fn offset_in_body(scene: &Scene, point: &PointContactor) -> Vec3 {
    let i = point.body.index();
    scene.axes[i].inverse_transform_vector(&(point.position - scene.reference[i]))
}

/// Number of a point, behind the numbers of all parts of its body.
fn point_number(scene: &Scene, point: &PointContactor) -> u16 {
    let parts = if scene.has_parts() { scene.parts_of(point.body).len() } else { 0 };
    u16::try_from(parts + point.contactor).unwrap_or(u16::MAX)
}

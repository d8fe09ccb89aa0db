//! Materials, laws and visibility table of a new DATBOX, merged from the cases that bodies come from and the changes.

use std::collections::BTreeSet;

use cd_formats::bodies::{Bodies, Body, ShapeRecord};
use cd_formats::bulk_behav::{BulkBehav, Material};
use cd_formats::compute::{ContactSolver, Event};
use cd_formats::law_table::LawModel;
use cd_formats::names::{known_names, number_text};
use cd_formats::report::FaultReport;
use cd_formats::snapshot::{DRIVEN_ALL, DRIVEN_TRANSLATION};
use cd_formats::tact_behav::{LawRecord, TactBehav, VisibilityRow, VisibilitySide};

use super::changes::Changes;
use super::source::SourcePart;
use crate::check;
use crate::grain::Grain;
use crate::rounding::round_8_digits;
use crate::scene;
use crate::write::alert_of_radii;

/// Materials, laws and visibility table of the next run.
pub struct BehaviourTables {
    pub bulk: BulkBehav,
    pub tact: TactBehav,
}

impl BehaviourTables {
    /// Laws that some row names, with their nicknames. All are laws of the table, since they come from a run or from the
    /// changes.
    fn used_models(&self) -> Vec<(&str, LawModel)> {
        let used = self.tact.laws.iter().filter(|law| self.tact.visibility.iter().any(|row| row.law == law.nickname));
        used.filter_map(|law| Some((law.nickname.as_str(), law.model().ok()?))).collect()
    }

    /// Reports events of laws that no contact has, or of the cohesion of a law without one.
    pub fn check_events(&self, events: &[Event], report: &mut FaultReport) {
        check::check_laws_of_events(report, events, &self.used_models());
    }

    /// Reports laws whose moments the solver does not support.
    pub fn check_solver(&self, solver: ContactSolver, report: &mut FaultReport) {
        check::check_moments(report, solver, &self.used_models());
    }

    /// Tables of all parts with the changes; contradictions and missing entries go into the report.
    pub fn from_parts(
        changes: &Changes,
        parts: &[SourcePart],
        grains: &[Grain],
        records: &Bodies,
        report: &mut FaultReport,
    ) -> BehaviourTables {
        let bulk = merge_materials(changes, parts, records, report);
        let laws = merge_laws(changes, parts, report);
        let visibility = merge_visibility(changes, parts, grains, records, &laws, report);
        BehaviourTables { bulk, tact: TactBehav { laws, visibility } }
    }
}

/// Materials of the cases with the densities of the changes, as far as bodies use them. Different densities of one name, and
/// names that are not defined, are faults.
fn merge_materials(changes: &Changes, parts: &[SourcePart], records: &Bodies, report: &mut FaultReport) -> BulkBehav {
    let is_changed = |name: &str| changes.materials.iter().any(|material| material.name == name);
    let mut merged: Vec<Material> = Vec::new();
    for (k, part) in parts.iter().enumerate() {
        for material in &part.source.bulk.materials {
            match merged.iter().find(|known| known.name == material.name) {
                None => merged.push(material.clone()),
                Some(known) if known.density != material.density && !is_changed(&known.name) => report.add_fault(
                    &format!("bodies.{k}"),
                    format!(
                        "material '{}' has the density {}, but {} in an earlier case",
                        known.name,
                        number_text(material.density),
                        number_text(known.density)
                    ),
                    "the same density in all cases (kg/m^3), or an entry for the material under materials",
                ),
                Some(_) => {}
            }
        }
    }
    for material in &changes.materials {
        match merged.iter_mut().find(|known| known.name == material.name) {
            Some(known) => known.density = material.density,
            None => merged.push(Material { name: material.name.clone(), density: material.density }),
        }
    }
    let names: Vec<&str> = merged.iter().map(|material| material.name.as_str()).collect();
    let grain_materials =
        changes.grains.iter().enumerate().map(|(k, grains)| (format!("grains.{k}"), grains.material.as_str()));
    let wall_materials = changes.walls.iter().enumerate().map(|(k, wall)| (format!("walls.{k}"), wall.material()));
    for (path, material) in grain_materials.chain(wall_materials).filter(|(_, material)| !names.contains(material)) {
        let found = format!("'{material}' is not defined");
        let known = check::KnownNames { noun: "a material", names: &names };
        known.report_unknown(report, &format!("{path}.material"), found, material);
    }
    merged.retain(|material| records.0.iter().any(|body| body.material == material.name));
    let used_names: Vec<&str> = merged.iter().map(|material| material.name.as_str()).collect();
    let is_unused = |(_, new): &(usize, &scene::Material)| !used_names.contains(&new.name.as_str());
    for (k, scene::Material { name, .. }) in (0..).zip(&changes.materials).filter(is_unused) {
        let found = format!("no body has the material '{name}', and it is left out");
        report.add_warning(&format!("materials.{k}.name"), found, &known_names(name, &used_names));
    }
    BulkBehav { gravity: parts[0].source.bulk.gravity, materials: merged }
}

/// Laws of the cases, replaced by laws of the changes. Different laws of one name are faults.
fn merge_laws(changes: &Changes, parts: &[SourcePart], report: &mut FaultReport) -> Vec<LawRecord> {
    let mut merged: Vec<LawRecord> = Vec::new();
    for (k, part) in parts.iter().enumerate() {
        for law in &part.source.tact.laws {
            let is_same = |known: &LawRecord| (&known.kind, &known.parameters) == (&law.kind, &law.parameters);
            match merged.iter().find(|known| known.nickname == law.nickname) {
                None => merged.push(law.clone()),
                Some(known) if !is_same(known) && changes.laws.iter().all(|new| new.name != law.nickname) => report
                    .add_fault(
                        &format!("bodies.{k}"),
                        format!("law '{}' differs from the one before", law.nickname),
                        "the same law under one name, or one under laws",
                    ),
                Some(_) => {}
            }
        }
    }
    for law in &changes.laws {
        let new = law.to_record();
        match merged.iter_mut().find(|known| known.nickname == new.nickname) {
            Some(known) => *known = new,
            None => merged.push(new),
        }
    }
    merged
}

/// Distance over which a law attracts, m.
fn attraction_range(law: &LawRecord) -> f64 {
    law.model().map_or(0.0, |law| law.attraction_range())
}

/// Order in which contactors are candidates, as in LMGC90: spheres, then polyhedra, then walls.
fn candidate_order(contactor: &str) -> usize {
    match contactor {
        "SPHER" => 0,
        "POLYR" => 1,
        _ => WALL_ORDER,
    }
}

/// Order of walls, which are always antagonists of grains.
const WALL_ORDER: usize = 2;

/// Pairs of colour and contactor in use.
type ColouredContactors<'a> = BTreeSet<(&'a str, &'a str)>;

/// Pairs of colour and contactor of some bodies.
fn coloured_contactors(records: &[Body]) -> ColouredContactors<'_> {
    records.iter().flat_map(|body| body.contactors.iter().map(|c| (c.colour.as_str(), c.shape.row_name()))).collect()
}

/// Candidate and antagonist of each pair of contactors that can touch, one of colour `a`, the other of `b`.
fn contact_pairs(used_contactors: &ColouredContactors, (a, b): (&str, &str)) -> Vec<[VisibilitySide; 2]> {
    let sides_of_colour = |colour: &str| -> Vec<VisibilitySide> {
        used_contactors.iter().filter(|(known, _)| *known == colour).map(visibility_side).collect()
    };
    let mut pairs = Vec::new();
    for first in sides_of_colour(a) {
        for second in sides_of_colour(b) {
            // Within one colour each two contactors occur in both orders.
            let is_repeated = a == b && first.contactor > second.contactor;
            let mut sides = [first.clone(), second];
            sides.sort_by_key(|side| candidate_order(&side.contactor));
            if !is_repeated && candidate_order(&sides[0].contactor) < WALL_ORDER {
                pairs.push(sides);
            }
        }
    }
    pairs
}

/// Side of a row for a colour and contactor.
fn visibility_side(&(colour, contactor): &(&str, &str)) -> VisibilitySide {
    VisibilitySide { body: "RBDY3".into(), contactor: contactor.into(), colour: colour.into() }
}

/// Pairs like [`contact_pairs`] of walls, whose contacts are computed if one of them moves by forces.
fn wall_pairs(used_contactors: &ColouredContactors, (a, b): (&str, &str)) -> Vec<[VisibilitySide; 2]> {
    let mut pairs: Vec<[VisibilitySide; 2]> = Vec::new();
    for first in used_contactors.iter().filter(|(colour, _)| *colour == a) {
        for second in used_contactors.iter().filter(|(colour, _)| *colour == b) {
            let contactors = [first.1, second.1];
            // LMGC90 has a cylinder before a plate.
            let in_order = if contactors[0] == "PLANx" { [second, first] } else { [first, second] };
            let sides = in_order.map(visibility_side);
            if check::is_computed_wall_pair(contactors) && !pairs.contains(&sides) {
                pairs.push(sides);
            }
        }
    }
    pairs
}

/// Row of the visibility table.
fn visibility_row([candidate, antagonist]: [VisibilitySide; 2], law: &str, alert: f64) -> VisibilityRow {
    VisibilityRow { line: 0, candidate, law: law.into(), antagonist, alert }
}

/// Pair of colours in alphabetical order.
fn ordered_pair<'a>(a: &'a str, b: &'a str) -> (&'a str, &'a str) {
    (a.min(b), a.max(b))
}

/// Colours of a row in alphabetical order.
fn row_colours(row: &VisibilityRow) -> (&str, &str) {
    ordered_pair(&row.candidate.colour, &row.antagonist.colour)
}

/// Rows of the cases, replaced by those of the changes for their pairs of colours, as far as bodies use them. Different laws for
/// one pair, pairs without a law, and laws without effect are faults.
fn merge_visibility(
    changes: &Changes,
    parts: &[SourcePart],
    grains: &[Grain],
    records: &Bodies,
    laws: &[LawRecord],
    report: &mut FaultReport,
) -> Vec<VisibilityRow> {
    let used_contactors = coloured_contactors(&records.0);
    // Colours of each row of the changes.
    let changed_pairs: Vec<(&str, &str)> =
        changes.contacts.iter().map(|c| ordered_pair(&c.between.0, &c.between.1)).collect();
    let new_records = &records.0[parts.iter().map(|part| part.records.len()).sum()..];
    let new_colours: BTreeSet<&str> = coloured_contactors(new_records).into_iter().map(|(colour, _)| colour).collect();
    let mut rows: Vec<VisibilityRow> = Vec::new();
    for (k, part) in parts.iter().enumerate() {
        for mut row in part.rows_of_table(&new_colours) {
            row.alert = row.alert.max(laws.iter().find(|law| law.nickname == row.law).map_or(0.0, attraction_range));
            let sides = |row: &VisibilityRow| (row.candidate.clone(), row.antagonist.clone());
            let known = rows.iter_mut().find(|known| {
                let (a, b) = sides(known);
                sides(&row) == (a.clone(), b.clone()) || sides(&row) == (b, a)
            });
            match known {
                None => rows.push(row),
                Some(known) if known.law == row.law => known.alert = known.alert.max(row.alert),
                Some(known) if !changed_pairs.contains(&row_colours(known)) => {
                    let (a, b) = row_colours(known);
                    let found =
                        format!("law '{}' between '{a}' and '{b}', but '{}' in an earlier case", row.law, known.law);
                    report.add_fault(
                        &format!("bodies.{k}"),
                        found,
                        "the same law in all cases, or an entry for the pair under contacts",
                    );
                }
                Some(_) => {}
            }
        }
    }
    rows.retain(|row| !changed_pairs.contains(&row_colours(row)));
    rows.extend(rows_of_new_shapes(parts, &used_contactors, &rows, report));
    let is_used = |side: &VisibilitySide| used_contactors.contains(&(&side.colour[..], &side.contactor[..]));
    rows.retain(|row| is_used(&row.candidate) && is_used(&row.antagonist));
    let groups = GroupColours::from_changes_and_parts(changes, parts);
    for (k, contact) in changes.contacts.iter().enumerate() {
        let path = format!("contacts.{k}");
        let (a, b) = changed_pairs[k];
        let mut colours: Vec<&str> = used_contactors.iter().map(|(known, _)| *known).collect();
        colours.dedup();
        for (side, colour) in [&contact.between.0, &contact.between.1].into_iter().enumerate() {
            if !colours.contains(&colour.as_str()) {
                let path = format!("{path}.between.{side}");
                let known = check::KnownNames { noun: "a body", names: &colours };
                known.report_unknown(report, &path, format!("no body has the colour '{colour}'"), colour);
            }
        }
        if changed_pairs[..k].contains(&changed_pairs[k]) {
            report.add_fault(&format!("{path}.between"), format!("'{a}' and '{b}' are listed twice"), "each pair once");
        }
        let Some(name) = &contact.law else {
            let found = "alert without a law";
            report.require(contact.alert.is_none(), &format!("{path}.alert"), found, "no alert, or a law");
            continue;
        };
        let alert_path = format!("{path}.alert");
        if let Some(alert) = contact.alert {
            check::check_positive(report, &alert_path, alert, "a distance > 0 m");
        }
        let Some(law) = laws.iter().find(|law| law.nickname == *name) else {
            let names: Vec<&str> = laws.iter().map(|law| law.nickname.as_str()).collect();
            let found = format!("'{name}' is not defined");
            let known = check::KnownNames { noun: "a law", names: &names };
            known.report_unknown(report, &format!("{path}.law"), found, name);
            continue;
        };
        let alert = contact.alert.unwrap_or_else(|| default_alert(parts, grains).max(attraction_range(law)));
        let is_short = check::is_positive(alert) && alert < attraction_range(law);
        let expected = format!("at least the range of the law, {} m", number_text(attraction_range(law)));
        report.require(!is_short, &alert_path, report.number_text(&alert_path, alert), &expected);
        let can_be_pushed = |colour: &str| groups.iter().any(|group| group.free_colours.contains(colour));
        let mut pairs = contact_pairs(&used_contactors, (a, b));
        if can_be_pushed(a) || can_be_pushed(b) {
            pairs.extend(wall_pairs(&used_contactors, (a, b)));
        }
        let is_wall_law = pairs.is_empty() && [a, b].iter().all(|colour| colours.contains(colour));
        report.require(!is_wall_law, &path, format!("a law between the walls '{a}' and '{b}'"), check::NO_WALL_LAW);
        let is_idle = !pairs.is_empty() && !can_be_pushed(a) && !can_be_pushed(b);
        report.require(!is_idle, &path, format!("a law between '{a}' and '{b}'"), check::NO_IMPOSED_LAW);
        rows.extend(pairs.into_iter().map(|sides| visibility_row(sides, name, alert)));
    }
    let known_pairs: BTreeSet<(&str, &str)> = changed_pairs.into_iter().chain(rows.iter().map(row_colours)).collect();
    expect_all_pairs(&groups, parts.len(), &used_contactors, &known_pairs, report);
    rows
}

/// Rows for contactors that were never together in one case, with the law that their colours have.
fn rows_of_new_shapes(
    parts: &[SourcePart],
    used_contactors: &ColouredContactors,
    rows: &[VisibilityRow],
    report: &mut FaultReport,
) -> Vec<VisibilityRow> {
    let part_contactors: Vec<ColouredContactors> =
        parts.iter().map(|part| coloured_contactors(&part.records)).collect();
    let were_together = |sides: &[VisibilitySide; 2]| {
        let has_both = |contactors: &ColouredContactors| {
            sides.iter().all(|side| contactors.contains(&(&side.colour[..], &side.contactor[..])))
        };
        part_contactors.iter().any(has_both)
    };
    let mut new_rows = Vec::new();
    for pair in rows.iter().map(row_colours).collect::<BTreeSet<_>>() {
        let mut rows_of_pair = rows.iter().filter(|row| row_colours(row) == pair);
        let Some(first) = rows_of_pair.next() else { continue };
        let sides: Vec<[VisibilitySide; 2]> =
            contact_pairs(used_contactors, pair).into_iter().filter(|sides| !were_together(sides)).collect();
        if let (false, Some(other)) = (sides.is_empty(), rows_of_pair.clone().find(|row| row.law != first.law)) {
            let found = format!("laws '{}' and '{}' between '{}' and '{}'", first.law, other.law, pair.0, pair.1);
            report.add_fault(
                "contacts",
                found,
                "one law for this pair under contacts: these shapes meet for the first time",
            );
        }
        let alert = rows_of_pair.map(|row| row.alert).fold(first.alert, f64::max);
        new_rows.extend(sides.into_iter().map(|sides| visibility_row(sides, &first.law, alert)));
    }
    new_rows
}

/// Colours of the bodies of one part, of new grains or of new walls.
#[derive(Default)]
struct GroupColours<'a> {
    /// Colours of bodies that contacts can push.
    free_colours: BTreeSet<&'a str>,
    /// Colours of bodies that contacts cannot push.
    held_colours: BTreeSet<&'a str>,
}

impl<'a> GroupColours<'a> {
    /// Adds the colour of a body.
    fn insert(&mut self, colour: &'a str, can_be_pushed: bool) {
        if can_be_pushed {
            self.free_colours.insert(colour)
        } else {
            self.held_colours.insert(colour)
        };
    }

    /// Colours of each part, then of the new grains of each group and of the new walls.
    fn from_changes_and_parts(changes: &'a Changes, parts: &'a [SourcePart]) -> Vec<Self> {
        let mut groups = Vec::new();
        for part in parts {
            let mut group = GroupColours::default();
            for (body, driven) in part.records.iter().zip(&part.state.bodies.body_driven) {
                // Normals of a sphere pass through its centre and do not turn it.
                let is_sphere =
                    matches!(&body.contactors[..], [only] if matches!(only.shape, ShapeRecord::Sphere { .. }));
                let imposed = if is_sphere { DRIVEN_TRANSLATION } else { DRIVEN_ALL };
                let can_be_pushed = driven & imposed != imposed;
                body.contactors.iter().for_each(|contactor| group.insert(&contactor.colour, can_be_pushed));
            }
            groups.push(group);
        }
        for grains in &changes.grains {
            let mut group = GroupColours::default();
            group.insert(&grains.colour, grains.can_be_pushed());
            groups.push(group);
        }
        let mut wall_colours = GroupColours::default();
        changes.walls.iter().for_each(|wall| wall_colours.insert(wall.colour(), wall.is_pushed()));
        groups.push(wall_colours);
        groups
    }
}

/// Requires a law or a `None` for colours that were never together in one case, so that no bodies pass through each other
/// by mistake. The first `part_count` of the groups belong to the cases; `known_pairs`: colours, in alphabetical order, for
/// which there is a law or a `None`.
fn expect_all_pairs(
    groups: &[GroupColours],
    part_count: usize,
    used_contactors: &ColouredContactors,
    known_pairs: &BTreeSet<(&str, &str)>,
    report: &mut FaultReport,
) {
    let mut reported_pairs: BTreeSet<(&str, &str)> = BTreeSet::new();
    for (i, group) in groups.iter().enumerate() {
        for a in &group.free_colours {
            for (j, other) in groups.iter().enumerate() {
                for b in other.free_colours.iter().chain(&other.held_colours) {
                    let pair = ordered_pair(a, b);
                    let is_checked = i == j && i < part_count
                        || known_pairs.contains(&pair)
                        || contact_pairs(used_contactors, pair).is_empty();
                    if !is_checked && reported_pairs.insert(pair) {
                        let found = format!("no law between '{}' and '{}'", pair.0, pair.1);
                        report.add_fault("contacts", found, "one for each pair that can meet (law: None for none)");
                    }
                }
            }
        }
    }
}

/// Alert distance as for a scene, m, to eight digits.
fn default_alert(parts: &[SourcePart], grains: &[Grain]) -> f64 {
    let part_radii = parts.iter().flat_map(|part| {
        let bodies = &part.state.bodies;
        bodies.body_radius.iter().zip(&bodies.body_driven).filter(|(_, d)| **d == 0).map(|(r, _)| *r)
    });
    round_8_digits(alert_of_radii(part_radii.chain(grains.iter().map(|grain| grain.radius)).collect()))
}

impl SourcePart<'_> {
    /// Rows of the source's table between colours of this part, under their new names, or of new bodies.
    fn rows_of_table(&self, new_colours: &BTreeSet<&str>) -> Vec<VisibilityRow> {
        let source_contactors = |k: usize| &self.source.bodies.0[self.source_bodies[k].index()].contactors;
        // Colour in the source, new colour and contactor of the bodies of this part.
        let renamed: BTreeSet<(&str, &str, &str)> = (0..self.source_bodies.len())
            .flat_map(|k| {
                let pairs = source_contactors(k).iter().zip(&self.records[k].contactors);
                pairs.map(|(old, new)| (old.colour.as_str(), new.colour.as_str(), old.shape.row_name()))
            })
            .collect();
        let mut rows = Vec::new();
        for row in &self.source.tact.visibility {
            let colours_of_side = |side: &VisibilitySide| -> BTreeSet<String> {
                let of_part =
                    renamed.iter().filter(|(old, _, contactor)| *old == side.colour && *contactor == side.contactor);
                let of_new_bodies = new_colours.get(side.colour.as_str());
                of_part.map(|(_, new, _)| new).chain(of_new_bodies).map(|colour| colour.to_string()).collect()
            };
            for a in &colours_of_side(&row.candidate) {
                for b in &colours_of_side(&row.antagonist) {
                    let mut row = row.clone();
                    row.line = 0;
                    row.candidate.colour = a.clone();
                    row.antagonist.colour = b.clone();
                    rows.push(row);
                }
            }
        }
        rows
    }
}

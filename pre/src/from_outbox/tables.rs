//! Merged materials, laws and visibility of several cases.

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

fn merge_materials(changes: &Changes, parts: &[SourcePart], records: &Bodies, report: &mut FaultReport) -> BulkBehav {
    let changed = |name: &str| changes.materials.iter().any(|material| material.name == name);
    let mut all: Vec<Material> = Vec::new();
    for (k, part) in parts.iter().enumerate() {
        for material in &part.source.bulk.materials {
            match all.iter().find(|known| known.name == material.name) {
                None => all.push(material.clone()),
                Some(known) if known.density != material.density && !changed(&known.name) => report.add_fault(
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
        match all.iter_mut().find(|known| known.name == material.name) {
            Some(known) => known.density = material.density,
            None => all.push(Material { name: material.name.clone(), density: material.density }),
        }
    }
    let names: Vec<&str> = all.iter().map(|material| material.name.as_str()).collect();
    let grain_materials =
        changes.grains.iter().enumerate().map(|(k, grains)| (format!("grains.{k}"), grains.material.as_str()));
    let wall_materials = changes.walls.iter().enumerate().map(|(k, wall)| (format!("walls.{k}"), wall.material()));
    for (path, material) in grain_materials.chain(wall_materials).filter(|(_, material)| !names.contains(material)) {
        let found = format!("'{material}' is not defined");
        let known = check::KnownNames { noun: "a material", names: &names };
        known.report_unknown(report, &format!("{path}.material"), found, material);
    }
    all.retain(|material| records.0.iter().any(|body| body.material == material.name));
    let used: Vec<&str> = all.iter().map(|material| material.name.as_str()).collect();
    let unused = |(_, new): &(usize, &scene::Material)| !used.contains(&new.name.as_str());
    for (k, scene::Material { name, .. }) in (0..).zip(&changes.materials).filter(unused) {
        let found = format!("no body has the material '{name}', and it is left out");
        report.add_warning(&format!("materials.{k}.name"), found, &known_names(name, &used));
    }
    BulkBehav { gravity: parts[0].source.bulk.gravity, materials: all }
}

fn merge_laws(changes: &Changes, parts: &[SourcePart], report: &mut FaultReport) -> Vec<LawRecord> {
    let mut all: Vec<LawRecord> = Vec::new();
    for (k, part) in parts.iter().enumerate() {
        for law in &part.source.tact.laws {
            let same = |known: &LawRecord| (&known.kind, &known.parameters) == (&law.kind, &law.parameters);
            match all.iter().find(|known| known.nickname == law.nickname) {
                None => all.push(law.clone()),
                Some(known) if !same(known) && changes.laws.iter().all(|new| new.name != law.nickname) => report
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
        match all.iter_mut().find(|known| known.nickname == new.nickname) {
            Some(known) => *known = new,
            None => all.push(new),
        }
    }
    all
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

fn coloured_contactors(records: &[Body]) -> ColouredContactors<'_> {
    records.iter().flat_map(|body| body.contactors.iter().map(|c| (c.colour.as_str(), c.shape.row_name()))).collect()
}

/// Candidate and antagonist of each pair of contactors that can touch, one of colour `a`, the other of `b`.
fn contact_pairs(used_contactors: &ColouredContactors, (a, b): (&str, &str)) -> Vec<[VisibilitySide; 2]> {
    let of = |colour: &str| -> Vec<VisibilitySide> {
        let side = |&(colour, contactor): &(&str, &str)| VisibilitySide {
            body: "RBDY3".into(),
            contactor: contactor.into(),
            colour: colour.into(),
        };
        used_contactors.iter().filter(|(known, _)| *known == colour).map(side).collect()
    };
    let mut all = Vec::new();
    for x in of(a) {
        for y in of(b) {
            let twice = a == b && x.contactor > y.contactor;
            let mut sides = [x.clone(), y];
            sides.sort_by_key(|side| candidate_order(&side.contactor));
            if !twice && candidate_order(&sides[0].contactor) < WALL_ORDER {
                all.push(sides);
            }
        }
    }
    all
}

/// Pairs like [`contact_pairs`] of walls, whose contacts are computed if one of them moves by forces.
fn wall_pairs(used_contactors: &ColouredContactors, (a, b): (&str, &str)) -> Vec<[VisibilitySide; 2]> {
    let side = |&(colour, contactor): &(&str, &str)| VisibilitySide {
        body: "RBDY3".into(),
        contactor: contactor.into(),
        colour: colour.into(),
    };
    let mut all: Vec<[VisibilitySide; 2]> = Vec::new();
    for x in used_contactors.iter().filter(|(colour, _)| *colour == a) {
        for y in used_contactors.iter().filter(|(colour, _)| *colour == b) {
            // LMGC90 has a cylinder before a plate.
            let sides = if x.1 == "PLANx" { [side(y), side(x)] } else { [side(x), side(y)] };
            if check::is_computed_wall_pair([x.1, y.1]) && !all.contains(&sides) {
                all.push(sides);
            }
        }
    }
    all
}

fn visibility_row([candidate, antagonist]: [VisibilitySide; 2], law: &str, alert: f64) -> VisibilityRow {
    VisibilityRow { line: 0, candidate, law: law.into(), antagonist, alert }
}

fn ordered_pair<'a>(a: &'a str, b: &'a str) -> (&'a str, &'a str) {
    (a.min(b), a.max(b))
}

fn row_colours(row: &VisibilityRow) -> (&str, &str) {
    ordered_pair(&row.candidate.colour, &row.antagonist.colour)
}

fn merge_visibility(
    changes: &Changes,
    parts: &[SourcePart],
    grains: &[Grain],
    records: &Bodies,
    laws: &[LawRecord],
    report: &mut FaultReport,
) -> Vec<VisibilityRow> {
    let all = coloured_contactors(&records.0);
    let named: Vec<(&str, &str)> = changes.contacts.iter().map(|c| ordered_pair(&c.between.0, &c.between.1)).collect();
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
                Some(known) if !named.contains(&row_colours(known)) => {
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
    rows.retain(|row| !named.contains(&row_colours(row)));
    rows.extend(rows_of_new_shapes(parts, &all, &rows, report));
    let is_used = |side: &VisibilitySide| all.contains(&(&side.colour[..], &side.contactor[..]));
    rows.retain(|row| is_used(&row.candidate) && is_used(&row.antagonist));
    let groups = GroupColours::from_changes_and_parts(changes, parts);
    for (k, contact) in changes.contacts.iter().enumerate() {
        let path = format!("contacts.{k}");
        let (a, b) = named[k];
        let mut colours: Vec<&str> = all.iter().map(|(known, _)| *known).collect();
        colours.dedup();
        for (side, colour) in [&contact.between.0, &contact.between.1].into_iter().enumerate() {
            if !colours.contains(&colour.as_str()) {
                let path = format!("{path}.between.{side}");
                let known = check::KnownNames { noun: "a body", names: &colours };
                known.report_unknown(report, &path, format!("no body has the colour '{colour}'"), colour);
            }
        }
        if named[..k].contains(&named[k]) {
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
        let moves = |colour: &str| groups.iter().any(|group| group.moving.contains(colour));
        let mut met = contact_pairs(&all, named[k]);
        if moves(a) || moves(b) {
            met.extend(wall_pairs(&all, named[k]));
        }
        let walls = met.is_empty() && [a, b].iter().all(|colour| all.iter().any(|(known, _)| known == colour));
        report.require(!walls, &path, format!("a law between the walls '{a}' and '{b}'"), check::NO_WALL_LAW);
        let idle = !met.is_empty() && !moves(a) && !moves(b);
        report.require(!idle, &path, format!("a law between '{a}' and '{b}'"), check::NO_IMPOSED_LAW);
        rows.extend(met.into_iter().map(|sides| visibility_row(sides, name, alert)));
    }
    expect_all_pairs(&groups, parts.len(), &all, &rows, &named, report);
    rows
}

/// Rows for contactors that were never together in one case, with the law that their colours have.
fn rows_of_new_shapes(
    parts: &[SourcePart],
    all: &ColouredContactors,
    rows: &[VisibilityRow],
    report: &mut FaultReport,
) -> Vec<VisibilityRow> {
    let known: Vec<ColouredContactors> = parts.iter().map(|part| coloured_contactors(&part.records)).collect();
    let have_met = |sides: &[VisibilitySide; 2]| {
        let is_in = |known: &ColouredContactors| {
            sides.iter().all(|side| known.contains(&(&side.colour[..], &side.contactor[..])))
        };
        known.iter().any(is_in)
    };
    let mut new = Vec::new();
    for pair in rows.iter().map(row_colours).collect::<BTreeSet<_>>() {
        let mut theirs = rows.iter().filter(|row| row_colours(row) == pair);
        let Some(first) = theirs.next() else { continue };
        let sides: Vec<[VisibilitySide; 2]> =
            contact_pairs(all, pair).into_iter().filter(|sides| !have_met(sides)).collect();
        if let (false, Some(other)) = (sides.is_empty(), theirs.clone().find(|row| row.law != first.law)) {
            let found = format!("laws '{}' and '{}' between '{}' and '{}'", first.law, other.law, pair.0, pair.1);
            report.add_fault(
                "contacts",
                found,
                "one law for this pair under contacts: these shapes meet for the first time",
            );
        }
        let alert = theirs.map(|row| row.alert).fold(first.alert, f64::max);
        new.extend(sides.into_iter().map(|sides| visibility_row(sides, &first.law, alert)));
    }
    new
}

/// Colours of the bodies of one part, of new grains or of new walls.
#[derive(Default)]
struct GroupColours<'a> {
    /// Colours of bodies that contacts can push.
    moving: BTreeSet<&'a str>,
    imposed: BTreeSet<&'a str>,
}

impl<'a> GroupColours<'a> {
    fn insert(&mut self, colour: &'a str, can_be_pushed: bool) {
        if can_be_pushed {
            self.moving.insert(colour)
        } else {
            self.imposed.insert(colour)
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
/// by mistake. The first `parts` of the groups are those of the cases.
fn expect_all_pairs(
    groups: &[GroupColours],
    parts: usize,
    all: &ColouredContactors,
    rows: &[VisibilityRow],
    named: &[(&str, &str)],
    report: &mut FaultReport,
) {
    let mut reported_pairs: BTreeSet<(&str, &str)> = BTreeSet::new();
    for (i, mine) in groups.iter().enumerate() {
        for a in &mine.moving {
            for (j, theirs) in groups.iter().enumerate() {
                for b in theirs.moving.iter().chain(&theirs.imposed) {
                    let pair = ordered_pair(a, b);
                    let is_checked = i == j && i < parts
                        || named.contains(&pair)
                        || rows.iter().any(|row| row_colours(row) == pair)
                        || contact_pairs(all, pair).is_empty();
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
        let old = |k: usize| &self.source.bodies.0[self.source_bodies[k].index()].contactors;
        let renamed: BTreeSet<(&str, &str, &str)> = (0..self.source_bodies.len())
            .flat_map(|k| {
                let pairs = old(k).iter().zip(&self.records[k].contactors);
                pairs.map(|(old, new)| (old.colour.as_str(), new.colour.as_str(), old.shape.row_name()))
            })
            .collect();
        let mut rows = Vec::new();
        for row in &self.source.tact.visibility {
            let news = |side: &VisibilitySide| -> BTreeSet<String> {
                let mine = renamed.iter().filter(|(old, _, shape)| *old == side.colour && *shape == side.contactor);
                let own = new_colours.get(side.colour.as_str());
                mine.map(|(_, new, _)| new).chain(own).map(|colour| colour.to_string()).collect()
            };
            for a in &news(&row.candidate) {
                for b in &news(&row.antagonist) {
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

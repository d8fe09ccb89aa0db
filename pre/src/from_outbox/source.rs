//! A case with one of its snapshots, from which bodies of the next run are selected, moved and renumbered.

use std::path::{Path, PathBuf};

use cd_formats::atomic::path_exists;
use cd_formats::bodies::{Bodies, Body, Contactor, ShapeRecord};
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::case::{CaseFolder, case_fault};
use cd_formats::compute::{Compute, Event, EventAction};
use cd_formats::deforming_cell::{CellControl, CellState};
use cd_formats::dof::{BodyDof, Dof};
use cd_formats::drv_dof::DrvDof;
use cd_formats::error::{Fault, Faults, RecordFault};
use cd_formats::groups::{DisjointSets, FragmentSize, largest_remnant};
use cd_formats::hollow_radius::RadiusState;
use cd_formats::ids::BodyId;
use cd_formats::law_table::is_law_of_points;
use cd_formats::names::{count_text, vector_text};
use cd_formats::probe::ProbeQuantity;
use cd_formats::snapshot::{
    self, AttractionArrays, BodyArrays, ContactPartArrays, LawArrays, LawName, MemoryArrays, PRESENCE_WAITING,
    PairArrays, START_FILE, ShapeArrays, Snapshot, TurningArrays, WallCircle,
};
use cd_formats::surface::MassProperties;
use cd_formats::tact_behav::TactBehav;
use cd_formats::unchanged::ComputedSnapshot;
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

use super::changes::{BodyFilter, MotionRemoval, Selection, WallSelector};
use super::options::{past_events, run_options};
use crate::grain::Population;
use crate::rotation::rotation_matrix;
use crate::scene::Material;

type Vec3 = Vector3<f64>;

/// Largest gap of touching bodies without contact force, divided by the smaller radius.
const TOUCHING_GAP: f64 = 1e-3;

/// DATBOX of a case and one of its snapshots.
#[derive(Debug, Clone)]
pub struct SourceCase {
    pub case: PathBuf,
    pub bodies: Bodies,
    /// Vector, by body, from its position in BODIES.DAT to its centre of mass, m.
    pub shifts: Vec<Vec3>,
    pub bulk: BulkBehav,
    pub tact: TactBehav,
    pub driven: DrvDof,
    /// Options of the run, see [`run_options`].
    pub options: Compute,
    pub snapshot: Snapshot,
    /// Deforming cell of the run at the snapshot, which `snapshot` is without.
    pub cell: Option<CellState>,
    /// Step and time (s) from which the run counts its steps, each `dt` long.
    pub counted_from: (u64, f64),
    /// Whether all bodies have the masses that they had in the run.
    pub has_masses_of_run: bool,
    /// Whether the snapshot is the first of the run, before its first step.
    pub is_first: bool,
    /// Facts of the run that are not in the files, by name, in words.
    notes: Vec<(&'static str, String)>,
}

/// Bodies selected from a source, at their new positions; row k is body `source_bodies[k]` of the source.
pub struct SourcePart<'a> {
    pub source: &'a SourceCase,
    /// Bodies of the source, ascending.
    pub source_bodies: Vec<BodyId>,
    /// Records of BODIES.DAT.
    pub records: Vec<Body>,
    /// State of these bodies; contacts hold rows of this part.
    pub state: Snapshot,
}

impl SourcePart<'_> {
    /// Whether the `body_count` bodies of the next run are all bodies of this run, with their masses.
    pub fn is_whole_run(&self, body_count: usize) -> bool {
        let source_count = self.source.snapshot.bodies.body_x.len();
        self.source_bodies.len() == source_count && body_count == source_count && self.source.has_masses_of_run
    }

    /// Radii of the free bodies at contacts, m: a clump has those of its balls, another body that of equal volume.
    pub fn contact_radii(&self) -> impl Iterator<Item = f64> {
        let ball_radius = |contactor: &Contactor| match contactor.shape {
            ShapeRecord::Sphere { radius } | ShapeRecord::OffsetSphere { radius, .. } => Some(radius),
            _ => None,
        };
        let bodies = &self.state.bodies;
        let rows = self.records.iter().zip(&bodies.body_radius).zip(&bodies.body_driven);
        rows.filter(|(_, imposed)| **imposed == 0).flat_map(move |((record, radius), _)| {
            let balls: Option<Vec<f64>> = record.contactors.iter().map(ball_radius).collect();
            balls.unwrap_or_else(|| vec![*radius])
        })
    }
}

/// Path of the value of the changes that a body of the new DATBOX comes from.
pub fn scene_path(parts: &[SourcePart], new: &Population, body: usize) -> String {
    let mut end = 0;
    for (k, part) in parts.iter().enumerate() {
        end += part.source_bodies.len();
        if body < end {
            return format!("bodies.{k}");
        }
    }
    new.scene_path(body - end)
}

/// Orientation of a snapshot's row.
pub fn unit_quaternion([w, i, j, k]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k))
}

/// Step and time (s) with which a run begins whose DATBOX is this folder. Errors: faults of its START.npz, or of DOF.INI.
fn first_step(datbox: &Path) -> Result<(u64, f64), Faults> {
    let start = datbox.join(START_FILE);
    if path_exists(&start) {
        let meta = Snapshot::read(&start)?.meta;
        return Ok((meta.step, meta.time));
    }
    let dof = Dof::read(&datbox.join("DOF.INI"))?;
    Ok((dof.step, dof.time))
}

/// Gives hollow cylinders whose radius changes the radius of the snapshot.
fn set_current_radii(bodies: &mut Bodies, radii: &[RadiusState]) {
    for current in radii {
        let records = bodies.0.iter_mut().skip(current.body.wrapping_sub(1)).take(1);
        for contactor in records.flat_map(|record| &mut record.contactors) {
            if let ShapeRecord::Cylinder { radius, hollow: true, .. } = &mut contactor.shape {
                *radius = current.radius;
            }
        }
    }
}

impl SourceCase {
    /// Reads DATBOX and the snapshot of step `step`, or the last, of a case. Errors: a folder, file or snapshot that is
    /// missing, all faults of the files, and differences between them and the snapshot.
    pub fn read(case: &Path, step: Option<u64>) -> Result<SourceCase, Faults> {
        let missing = [CaseFolder::Outbox, CaseFolder::Datbox]
            .into_iter()
            .find_map(|part| case_fault(case, part, "cd-pre from-outbox"));
        if let Some(fault) = missing {
            return Err(fault.into());
        }
        let (datbox, outbox) = (case.join("DATBOX"), case.join("OUTBOX"));
        let mut faults = Faults::default();
        let snapshots = snapshot::list_snapshots(&outbox)?;
        let snapshot_path = match step {
            Some(step) => snapshots.iter().find(|(number, _)| *number == step),
            None => snapshots.last(),
        };
        let snapshot_path = snapshot_path.map(|(_, path)| path);
        if snapshot_path.is_none() {
            let found = step.map_or("has no snapshot".into(), |step| format!("has no snapshot of step {step}"));
            let expected = match snapshots.as_slice() {
                [] => "expected the results of cd-solve".into(),
                [first, .., last] => format!("expected one of {}, steps {} to {}", snapshots.len(), first.0, last.0),
                [only] => format!("expected step {}", only.0),
            };
            faults.push(Fault::new(&outbox, None, "folder", found, expected));
        }
        let snapshot = snapshot_path.and_then(|path| Some((path, faults.gather_result(Snapshot::read(path))?)));
        let [bodies_path, bulk_path, tact_path, driven_path] =
            ["BODIES.DAT", "BULK_BEHAV.DAT", "TACT_BEHAV.DAT", "DRV_DOF.DAT"].map(|name| datbox.join(name));
        let bodies = faults.gather_result(Bodies::read(&bodies_path));
        let bulk = faults.gather_result(BulkBehav::read(&bulk_path));
        let tact = faults.gather_result(TactBehav::read(&tact_path));
        let driven = faults.gather_result(DrvDof::read(&driven_path));
        let compute_path = datbox.join("COMPUTE.RON");
        let file_options = if path_exists(&compute_path) {
            faults.gather_result(Compute::read(&compute_path))
        } else {
            Some(Compute::default())
        };
        let (
            Some((path, mut snapshot)),
            Some(mut bodies),
            Some(mut bulk),
            Some(tact),
            Some(driven),
            Some(file_options),
        ) = (snapshot, bodies, bulk, tact, driven, file_options)
        else {
            return Err(faults);
        };
        let computed = ComputedSnapshot { path, snapshot: &snapshot };
        let mass_properties = faults.gather_result(computed.expect_bodies(&bodies_path, &bodies)).unwrap_or_default();
        faults.gather_result(computed.expect_materials(&bulk_path, &bulk));
        faults.gather_result(computed.expect_laws(&tact_path, &tact));
        faults.gather_result(computed.expect_driven(&driven_path, &driven));
        faults.0.extend(wire_fault(&snapshot, &bodies, &tact, &tact_path));
        faults.into_result(())?;
        let shift = |(body, own): (&Body, &MassProperties)| body.centre_of_mass_offset(own).into();
        let shifts = bodies.0.iter().zip(&mass_properties).map(shift).collect();
        let is_first = snapshots.first().is_some_and(|(_, first)| first == path);
        let has_start = path_exists(&datbox.join(START_FILE));
        let (mut options, mut notes) = run_options(&file_options, &snapshot.meta, is_first, has_start);
        let origin = if path_exists(&compute_path) { "COMPUTE.RON has" } else { "the default is" };
        let changed =
            options.option_values().into_iter().zip(file_options.option_values()).filter(|(run, file)| run != file);
        notes.extend(changed.map(|((name, run), (_, file))| (name, format!("{run} as in the run; {origin} {file}"))));
        if !options.sources.is_empty() {
            // Bodies that have entered would wait again.
            options.sources.clear();
            options.probes.retain(|probe| !matches!(probe.quantity, ProbeQuantity::Entered { .. }));
            let is_waiting = |row: &usize| {
                snapshot.presence.as_ref().is_some_and(|presence| presence.body_presence[*row] == PRESENCE_WAITING)
            };
            let waiting = (0..snapshot.bodies.body_id.len()).filter(is_waiting).count();
            let text = match waiting {
                0 => "none from here on: all bodies have entered".into(),
                _ => format!("none from here on, without the {} still to enter", count_text(waiting, "body")),
            };
            notes.push(("sources", text));
        }
        let counted_from = snapshot.meta.counted_from.map_or_else(|| first_step(&datbox), Ok)?;
        let gravity = snapshot.meta.parameters.uniform_gravity;
        let sets_gravity = |event: &Event| matches!(event.action, EventAction::SetGravity(_));
        if bulk.gravity != gravity && !past_events(&file_options.events, &snapshot.meta).iter().any(sets_gravity) {
            let [run, file] = [&gravity, &bulk.gravity].map(|gravity| vector_text(gravity));
            let text = format!("{run} m/s^2 as in the run; BULK_BEHAV.DAT has {file}");
            notes.push(("uniform gravity", text));
            bulk.gravity = gravity;
        }
        let cell = snapshot.meta.cell.take();
        set_current_radii(&mut bodies, &snapshot.meta.radii);
        let case = case.to_path_buf();
        let has_masses_of_run = true;
        Ok(SourceCase {
            case,
            bodies,
            shifts,
            bulk,
            tact,
            driven,
            options,
            snapshot,
            cell,
            counted_from,
            has_masses_of_run,
            is_first,
            notes,
        })
    }

    /// Replaces the velocities of the bodies by those about the affine field of the deforming cell of the run, if it has one:
    /// cd-solve adds the velocities of the cell of the next run. Errors: a cell that is sheared, as the periods of a scene have
    /// right angles.
    pub fn leave_cell(&mut self) -> Result<(), Faults> {
        let Some(cell) = self.cell else { return Ok(()) };
        if cell.shears != [0.0; 3] {
            let path = snapshot::snapshot_path(&self.case.join("OUTBOX"), self.snapshot.meta.step);
            let found = format!("a cell with the shears {} m", vector_text(&cell.shears));
            let expected = "expected one with right angles, or changes that keep the cell: options with cell, all bodies of \
                            one case with their positions and motion, and no others";
            return Err(Fault::new(&path, None, "snapshot", found, expected).into());
        }
        let BodyArrays { body_x, body_v, .. } = &mut self.snapshot.bodies;
        for (x, v) in body_x.iter().zip(body_v) {
            *v = cell.fluctuation(&(*x).into(), &(*v).into()).into();
        }
        Ok(())
    }

    /// Returns the deforming cell of the run as the next run starts with it, whose option `cell` is `control`, and gives the bodies
    /// the velocities of its affine field; `None` if the run has none. `keeps_time`: whether strains continue.
    ///
    /// Under the same control the cell and all velocities stay as they are.
    pub fn continue_cell(&mut self, control: &CellControl, keeps_time: bool) -> Option<CellState> {
        let cell = self.cell?;
        let mut next = cell;
        if !keeps_time {
            (next.start_periods, next.shear_strains) = (cell.periods, [0.0; 3]);
        }
        if self.options.cell.as_ref() != Some(control) {
            next = next.with_gradient(&control.velocity_gradient(&cell.mean_stress));
            let change = next.gradient() - cell.gradient();
            let BodyArrays { body_x, body_v, .. } = &mut self.snapshot.bodies;
            for (x, v) in body_x.iter().zip(body_v) {
                *v = (Vector3::from(*v) + change * Vector3::from(*x)).into();
            }
        }
        Some(next)
    }

    /// Differences between the run and the files of its DATBOX, a line each; of options, only those whose value the
    /// next run keeps. `next_options` are the options of the next run, if they follow from the options of this run.
    pub fn run_notes(&self, next_options: Option<&Compute>) -> String {
        let values = self.options.option_values();
        let next_values = next_options.map(Compute::option_values).unwrap_or_default();
        let is_continued =
            |name| values.iter().find(|(known, _)| *known == name).is_none_or(|value| next_values.contains(value));
        let notes = self.notes.iter().filter(|(name, _)| is_continued(*name));
        notes.map(|(name, text)| format!("{}: {name}: {text}\n", self.case.display())).collect()
    }

    /// Makes the values that events set before the snapshot hold from the start. A torque that an event has set stays, as an
    /// event at time 0; all other events are removed.
    pub fn end_events(&mut self) {
        let meta = &self.snapshot.meta;
        for law in &mut self.tact.laws {
            if let Some(law_in_force) = meta.laws.iter().find(|known| known.nickname == law.nickname) {
                law.parameters.clone_from(&law_in_force.parameters);
            }
        }
        self.bulk.gravity = meta.parameters.uniform_gravity;
        for event in past_events(&std::mem::take(&mut self.options.events), meta) {
            match event.action {
                EventAction::SetQuench(quench) => self.options.quench = quench,
                EventAction::SetTorque(_) => self.options.events = vec![Event::at_time(0.0, event.action)],
                _ => {}
            }
        }
    }

    /// Scales masses and moments of inertia to these densities, kg/m^3; drops stored angular momenta of bodies that change,
    /// which keep their angular velocity.
    pub fn set_densities(&mut self, materials: &[Material]) {
        let density = |name: &str| self.bulk.materials.iter().find(|material| material.name == name).map(|m| m.density);
        let factor = |body: &Body| {
            let new = materials.iter().find(|material| material.name == body.material);
            new.zip(density(&body.material)).map_or(1.0, |(new, old)| new.density / old)
        };
        let factors: Vec<f64> = self.bodies.0.iter().map(factor).collect();
        self.has_masses_of_run = factors.iter().all(|factor| *factor == 1.0);
        let bodies = &mut self.snapshot.bodies;
        for (factor, (mass, inertia)) in factors.iter().zip(bodies.body_mass.iter_mut().zip(&mut bodies.body_inertia)) {
            *mass *= factor;
            inertia.iter_mut().for_each(|moment| *moment *= factor);
        }
        // Angular velocity is kept, not angular momentum.
        if let Some(shapes) = &mut self.snapshot.shapes {
            let if_unchanged = |body: u32| Some(body).filter(|&body| factors[BodyId(body).index()] == 1.0);
            let (unchanged_rows, turning_body) = renumbered_rows(&shapes.turning.turning_body, if_unchanged);
            shapes.turning = TurningArrays { turning_body, ..shapes.turning.select_rows(&unchanged_rows) };
        }
    }

    /// Selects bodies and moves them.
    ///
    /// Errors: a selection without a free body, of walls that do not exist, or of walls that would be moved. Each fault has
    /// the path of its value in the selection, which may be empty.
    pub fn select_bodies(&self, selection: &Selection) -> Result<SourcePart<'_>, Vec<(String, RecordFault)>> {
        let bodies = &self.snapshot.bodies;
        let is_driven = |body: BodyId| bodies.body_driven[body.index()] != 0;
        // Whether each row is selected, if it is free.
        let passes_filter = match selection.select {
            BodyFilter::All => None,
            BodyFilter::Largest => Some(self.largest_group()),
            BodyFilter::Below(height) => Some(self.rows_below(height)),
        };
        let excepted = self.excepted_rows(&selection.walls_except)?;
        let is_selected = |body: &BodyId| {
            if is_driven(*body) {
                selection.walls != excepted[body.index()]
            } else {
                self.snapshot.is_present(body.index())
                    && passes_filter.as_ref().is_none_or(|passes| passes[body.index()])
            }
        };
        let source_bodies: Vec<BodyId> =
            (0..bodies.body_id.len()).map(BodyId::new).filter(|body| is_selected(body)).collect();
        let free: Vec<usize> = (0..source_bodies.len()).filter(|&k| !is_driven(source_bodies[k])).collect();
        if free.is_empty() {
            return Err(vec![(String::new(), RecordFault::new("no body is free to move", "expected at least one"))]);
        }
        let is_moved = selection.rotate.angle != 0.0 || selection.centre.is_some();
        if is_moved && free.len() < source_bodies.len() {
            let expected = "expected walls: false, or neither rotate nor centre";
            let fault = RecordFault::new("bodies with imposed motion are to be moved", expected);
            return Err(vec![(String::new(), fault)]);
        }
        let mut state = Snapshot { meta: self.snapshot.meta.clone(), ..Snapshot::default() };
        state.bodies = bodies.select_rows(&source_bodies.iter().map(|body| body.index()).collect::<Vec<_>>());
        let new_row = |body: u32| source_bodies.binary_search(&BodyId(body)).ok().map(|k| k as u32);
        let new_row_pair = |[a, b]: [u32; 2]| Some([new_row(a)?, new_row(b)?]);
        let (contact_rows, contact_body) = renumbered_rows(&self.snapshot.contacts.contact_body, new_row_pair);
        state.contacts = self.snapshot.contacts.select_rows(&contact_rows);
        state.contacts.contact_body = contact_body;
        state.memory = self.snapshot.memory.as_ref().map(|memory| memory.select_rows(&contact_rows));
        state.laws = self.snapshot.laws.as_ref().map(|laws| laws.select_rows(&contact_rows));
        let attractions = self.snapshot.attractions.as_ref();
        state.attractions = attractions.map(|attractions| attractions.select_rows(&contact_rows));
        move_rows(&mut state, &free, selection);
        state.shapes = self.snapshot.shapes.as_ref().map(|shapes| {
            // If a body's rotation has changed, its angular momentum is computed from its angular velocity.
            let rotates_as_before = |body: u32, row: u32| {
                let rotation = |arrays: &BodyArrays, body: BodyId| {
                    (arrays.body_q[body.index()], arrays.body_w_world[body.index()])
                };
                rotation(&state.bodies, BodyId(row)) == rotation(bodies, BodyId(body))
            };
            let (turning_rows, turning_body) = renumbered_rows(&shapes.turning.turning_body, |body| {
                new_row(body).filter(|&row| rotates_as_before(body, row))
            });
            let (pair_rows, pair_body) = renumbered_rows(&shapes.pairs.pair_body, new_row_pair);
            ShapeArrays {
                turning: TurningArrays { turning_body, ..shapes.turning.select_rows(&turning_rows) },
                contacts: shapes.contacts.select_rows(&contact_rows),
                // Stored directions in fixed axes are kept: each is only the start of a search.
                pairs: PairArrays { pair_body, ..shapes.pairs.select_rows(&pair_rows) },
            }
        });
        let record = |(&body, x): (&BodyId, &[f64; 3])| {
            let mut record = self.bodies.0[body.index()].clone();
            // Coordinates of contactors are relative to `position` and stay valid, whether it is the centre of mass or not.
            record.position = (Vec3::from(*x) - self.shifts[body.index()]).into();
            if let (Some(colour), false) = (&selection.colour, is_driven(body)) {
                record.contactors.iter_mut().for_each(|contactor| contactor.colour.clone_from(colour));
            }
            record
        };
        let records = source_bodies.iter().zip(&state.bodies.body_x).map(record).collect();
        Ok(SourcePart { source: self, source_bodies, records, state })
    }

    /// Whether each row is one of the bodies with imposed motion that `selectors` name. Errors: a selector that matches no
    /// body.
    fn excepted_rows(&self, selectors: &[WallSelector]) -> Result<Vec<bool>, Vec<(String, RecordFault)>> {
        let driven = &self.snapshot.bodies.body_driven;
        let walls: Vec<usize> = (0..driven.len()).filter(|&row| driven[row] != 0).collect();
        let colours = |row: usize| self.bodies.0[row].contactors.iter().map(|contactor| contactor.colour.as_str());
        let mut excepted = vec![false; driven.len()];
        let mut faults = Vec::new();
        for (k, selector) in selectors.iter().enumerate() {
            let (found, chosen): (String, Vec<usize>) = match selector {
                WallSelector::Wall(n) => {
                    (format!("Wall({n})"), n.checked_sub(1).and_then(|n| walls.get(n)).copied().into_iter().collect())
                }
                WallSelector::Body(n) => {
                    (format!("Body({n})"), walls.iter().copied().filter(|row| row + 1 == *n).collect())
                }
                WallSelector::Colour(name) => {
                    let has_colour = |row: &usize| colours(*row).any(|colour| colour == name);
                    (format!("Colour(\"{name}\")"), walls.iter().copied().filter(has_colour).collect())
                }
            };
            if chosen.is_empty() {
                let mut wall_colours: Vec<&str> = walls.iter().flat_map(|&row| colours(row)).collect();
                wall_colours.sort_unstable();
                wall_colours.dedup();
                let wall_colours = wall_colours.join(", ");
                let expected = match (walls.first(), walls.last()) {
                    (Some(first), Some(last)) if first < last => format!(
                        "expected one of {} bodies with imposed motion, numbers {} to {}, colours {wall_colours}",
                        walls.len(),
                        first + 1,
                        last + 1
                    ),
                    (Some(one), _) => format!(
                        "expected Wall(1), the only body with imposed motion: number {}, colour {wall_colours}",
                        one + 1
                    ),
                    _ => "expected none: the run has no bodies with imposed motion".into(),
                };
                faults.push((format!("walls_except.{k}"), RecordFault::new(found, expected)));
            }
            chosen.into_iter().for_each(|row| excepted[row] = true);
        }
        if faults.is_empty() { Ok(excepted) } else { Err(faults) }
    }

    /// Whether each row is a body whose sphere of equal volume lies below a height along z.
    fn rows_below(&self, height: f64) -> Vec<bool> {
        let bodies = &self.snapshot.bodies;
        bodies.body_x.iter().zip(&bodies.body_radius).map(|(x, radius)| x[2] + radius <= height).collect()
    }

    /// Whether each row is a body of the largest remnant of touching free bodies, the first of equals.
    fn largest_group(&self) -> Vec<bool> {
        let Snapshot { bodies, contacts, .. } = &self.snapshot;
        let count = bodies.body_id.len();
        let mut connected = DisjointSets::new(count);
        for (row, pair) in contacts.contact_body.iter().enumerate() {
            let [a, b] = pair.map(|body| BodyId(body).index());
            let max_gap = TOUCHING_GAP * bodies.body_radius[a].min(bodies.body_radius[b]);
            let is_touching = contacts.contact_impulse[row] != [0.0; 3] || contacts.contact_gap[row] <= max_gap;
            if is_touching && bodies.body_driven[a] == 0 && bodies.body_driven[b] == 0 {
                connected.union(a, b);
            }
        }
        let mut sizes = vec![FragmentSize::default(); count];
        for row in (0..count).filter(|&row| bodies.body_driven[row] == 0 && self.snapshot.is_present(row)) {
            let size = &mut sizes[connected.find(row)];
            size.mass += bodies.body_mass[row];
            size.members += 1;
        }
        let largest = largest_remnant(&sizes);
        (0..count).map(|row| Some(connected.find(row)) == largest).collect()
    }
}

/// Fault of a run with wires or rods between points, which no other run can continue.
fn wire_fault(snapshot: &Snapshot, bodies: &Bodies, tact: &TactBehav, tact_path: &Path) -> Option<Fault> {
    let is_point = |contactor: &Contactor| matches!(contactor.shape, ShapeRecord::Point { .. });
    let law = snapshot.meta.laws.iter().find(|law| is_law_of_points(&law.kind))?;
    if !bodies.0.iter().any(|body| body.contactors.iter().any(is_point)) {
        return None;
    }
    let line = tact.laws.iter().find(|known| known.nickname == law.nickname).map(|known| known.line);
    let (object, found) = (format!("law '{}'", law.nickname), format!("{} between PT3Dx", law.kind));
    let expected = "expected a run without wires and rods: their length at rest is that of the positions in \
                    BODIES.DAT, which would change; cd-solve --resume continues the run";
    Some(Fault::new(tact_path, line, object, found, expected))
}

/// Numbers of the rows whose values `new_value` maps to another, with these values; the other rows are dropped.
fn renumbered_rows<T: Copy>(values: &[T], new_value: impl Fn(T) -> Option<T>) -> (Vec<usize>, Vec<T>) {
    values.iter().enumerate().filter_map(|(row, &value)| Some((row, new_value(value)?))).unzip()
}

/// Changes position and motion of the `free` rows; unchanged values keep every bit.
fn move_rows(state: &mut Snapshot, free: &[usize], selection: &Selection) {
    let bodies = &mut state.bodies;
    let mass: f64 = free.iter().map(|&k| bodies.body_mass[k]).sum();
    let mass_mean =
        |vectors: &[[f64; 3]]| free.iter().map(|&k| bodies.body_mass[k] * Vec3::from(vectors[k])).sum::<Vec3>() / mass;
    let (com, mean_velocity) = (mass_mean(&bodies.body_x), mass_mean(&bodies.body_v));
    // Velocity and angular velocity in fixed axes of each free row.
    let row_motion = |k: usize| (Vec3::from(bodies.body_v[k]), Vec3::from(bodies.body_w_world[k]));
    let mut motion: Vec<(Vec3, Vec3)> = free.iter().map(|&k| row_motion(k)).collect();
    if selection.remove_motion == MotionRemoval::Translation || selection.remove_motion == MotionRemoval::RigidMotion {
        motion.iter_mut().for_each(|(v, _)| *v -= mean_velocity);
    }
    if selection.remove_motion == MotionRemoval::RigidMotion {
        let spin = rigid_spin(state, free, &com, &motion);
        for (&k, (v, w)) in free.iter().zip(&mut motion) {
            *v -= spin.cross(&(Vec3::from(state.bodies.body_x[k]) - com));
            *w -= spin;
        }
    }
    if selection.remove_motion == MotionRemoval::All {
        motion.fill((Vec3::zeros(), Vec3::zeros()));
    }
    let bodies = &mut state.bodies;
    if selection.rotate.angle != 0.0 {
        let rotation = rotation_matrix(&selection.rotate);
        let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        let rotated_about_com = |x: [f64; 3]| (com + rotation * (Vec3::from(x) - com)).into();
        for (&k, (v, w)) in free.iter().zip(&mut motion) {
            bodies.body_x[k] = rotated_about_com(bodies.body_x[k]);
            let new_q = q * unit_quaternion(bodies.body_q[k]);
            bodies.body_q[k] = [new_q.w, new_q.i, new_q.j, new_q.k];
            (*v, *w) = (rotation * *v, rotation * *w);
        }
        for point in &mut state.contacts.contact_point {
            *point = rotated_about_com(*point);
        }
        for frame in &mut state.contacts.contact_frame {
            *frame = frame.map(|axis| (rotation * Vec3::from(axis)).into());
        }
        for sliding in state.laws.iter_mut().flat_map(|laws| &mut laws.contact_sliding) {
            *sliding = (rotation * Vec3::from(*sliding)).into();
        }
    }
    if let Some(centre) = selection.centre {
        let shift = Vec3::from(centre) - com;
        let shifted_position = |x: [f64; 3]| (Vec3::from(x) + shift).into();
        free.iter().for_each(|&k| bodies.body_x[k] = shifted_position(bodies.body_x[k]));
        state.contacts.contact_point.iter_mut().for_each(|point| *point = shifted_position(*point));
    }
    let centre = selection.centre.map_or(com, Vec3::from);
    let (velocity, spin) = (Vec3::from(selection.velocity), Vec3::from(selection.spin));
    for (&k, (v, w)) in free.iter().zip(&mut motion) {
        if selection.spin != [0.0; 3] {
            *v += spin.cross(&(Vec3::from(bodies.body_x[k]) - centre));
            *w += spin;
        }
        if selection.velocity != [0.0; 3] {
            *v += velocity;
        }
        bodies.body_v[k] = (*v).into();
        if Vec3::from(bodies.body_w_world[k]) != *w {
            bodies.body_w_world[k] = (*w).into();
            bodies.body_w[k] = unit_quaternion(bodies.body_q[k]).inverse_transform_vector(w).into();
        }
    }
}

/// Angular velocity of the rigid body with the inertia and the angular momentum of the `free` rows about `com`, rad/s.
/// `motion`: their velocities and angular velocities in fixed axes.
fn rigid_spin(state: &Snapshot, free: &[usize], com: &Vec3, motion: &[(Vec3, Vec3)]) -> Vec3 {
    let (mut inertia, mut angular_momentum) = (Matrix3::zeros(), Vec3::zeros());
    for (&k, (v, w)) in free.iter().zip(motion) {
        let (mass, arm) = (state.bodies.body_mass[k], Vec3::from(state.bodies.body_x[k]) - com);
        let axes = unit_quaternion(state.bodies.body_q[k]).to_rotation_matrix();
        let own_inertia = axes * Matrix3::from_diagonal(&state.bodies.body_inertia[k].into()) * axes.inverse();
        inertia += own_inertia + mass * (Matrix3::from_diagonal_element(arm.norm_squared()) - arm * arm.transpose());
        angular_momentum += own_inertia * w + mass * arm.cross(v);
    }
    inertia.try_inverse().map_or(Vec3::zeros(), |inverse| inverse * angular_momentum)
}

/// Index of the law with this name and kind in a list; a new law is appended.
fn law_index(law: &LawName, laws: &mut Vec<LawName>) -> u8 {
    let is_same = |known: &LawName| (&known.nickname, &known.kind) == (&law.nickname, &law.kind);
    let index = laws.iter().position(is_same).unwrap_or_else(|| {
        laws.push(law.clone());
        laws.len() - 1
    });
    index as u8
}

impl SourcePart<'_> {
    /// Appends the state to `start`, the state of the parts before. The first body becomes the body `first_body` (from 0);
    /// impulses are converted to the step length of the whole.
    pub fn append_to(&self, start: &mut Snapshot, first_body: usize) {
        let mut bodies = self.state.bodies.clone();
        bodies.body_id = (first_body as u64 + 1..).take(self.source_bodies.len()).collect();
        // Names are in DATBOX; START.npz has motion and contacts.
        bodies.body_colour.fill(0);
        bodies.body_material.fill(0);
        let new_circle = |circle: &WallCircle| {
            let row = self.source_bodies.iter().position(|body| body.number() as u64 == circle.body)?;
            Some(WallCircle { body: bodies.body_id[row], ..*circle })
        };
        start.meta.revolutions.extend(self.state.meta.revolutions.iter().filter_map(new_circle));
        let mut contacts = self.state.contacts.clone();
        contacts.contact_body.iter_mut().flatten().for_each(|body| *body += first_body as u32);
        let laws = &self.state.meta.laws;
        let new_law_indices: Vec<u8> = laws.iter().map(|law| law_index(law, &mut start.meta.laws)).collect();
        contacts.contact_law.iter_mut().for_each(|law| *law = new_law_indices[*law as usize]);
        let scale = start.meta.h / self.state.meta.h;
        if scale != 1.0 && scale.is_finite() {
            contacts.contact_impulse.iter_mut().flatten().for_each(|r| *r *= scale);
        }
        // A group of arrays that only some parts have is filled for the contacts of the others.
        let (contacts_before, count) = (start.contacts.contact_body.len(), contacts.contact_body.len());
        start.bodies.append(bodies);
        start.contacts.append(contacts);
        let empty_memory = |count| MemoryArrays {
            contact_bonded: vec![0; count],
            contact_bond_gap: vec![0.0; count],
            contact_moment: vec![[0.0; 3]; count],
        };
        if start.memory.is_some() || self.state.memory.is_some() {
            let mut memory = self.state.memory.clone().unwrap_or_else(|| empty_memory(count));
            if scale != 1.0 && scale.is_finite() {
                memory.contact_moment.iter_mut().flatten().for_each(|m| *m *= scale);
            }
            start.memory.get_or_insert_with(|| empty_memory(contacts_before)).append(memory);
        }
        let without_interface = |count| LawArrays {
            contact_reference_gap: vec![0.0; count],
            contact_soundness: vec![0.0; count],
            contact_sliding: vec![[0.0; 3]; count],
        };
        if start.laws.is_some() || self.state.laws.is_some() {
            let laws = self.state.laws.clone().unwrap_or_else(|| without_interface(count));
            start.laws.get_or_insert_with(|| without_interface(contacts_before)).append(laws);
        }
        let empty_attraction = |count| AttractionArrays { contact_attraction: vec![0.0; count] };
        if start.attractions.is_some() || self.state.attractions.is_some() {
            let attractions = self.state.attractions.clone().unwrap_or_else(|| empty_attraction(count));
            start.attractions.get_or_insert_with(|| empty_attraction(contacts_before)).append(attractions);
        }
        // Parts with spheres and plates only have contacts of first contactors, with area 0.
        let sphere_shapes = |count| ShapeArrays {
            contacts: ContactPartArrays { contact_rank: vec![[0; 2]; count], contact_area: vec![0.0; count] },
            ..ShapeArrays::default()
        };
        if start.shapes.is_some() || self.state.shapes.is_some() {
            let mut shapes = self.state.shapes.clone().unwrap_or_else(|| sphere_shapes(count));
            let body_indices = [&mut shapes.turning.turning_body[..], shapes.pairs.pair_body.as_flattened_mut()];
            body_indices.into_iter().flatten().for_each(|body| *body += first_body as u32);
            start.shapes.get_or_insert_with(|| sphere_shapes(contacts_before)).append(shapes);
        }
    }

    /// Motion of row `k` for DOF.INI, as body `body` (from 0); its position is in BODIES.DAT.
    pub fn dof_record(&self, k: usize, body: usize) -> BodyDof {
        let bodies = &self.state.bodies;
        let ([vx, vy, vz], [w1, w2, w3]) = (bodies.body_v[k], bodies.body_w[k]);
        let q = unit_quaternion(bodies.body_q[k]);
        let axes = [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| (q * axis).into());
        BodyDof { line: 0, body, displacement: [0.0; 6], velocity: [vx, vy, vz, w1, w2, w3], axes }
    }
}

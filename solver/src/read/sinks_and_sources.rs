//! Sinks and sources: the lists of all bodies, and those that are not in the run from its start.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use cd_formats::atomic::{path_exists, read_text};
use cd_formats::compute::ComputeFlags;
use cd_formats::error::Faults;
use cd_formats::probe::unknown_bodies;
use cd_formats::report::FaultReport;
use cd_formats::sinks_and_sources::{EntryOrder, source_bodies};

use crate::math::random::splitmix64;
use crate::math::{Twist, Vec3};
use crate::scene::{BodyId, BodyPresence, BodyRoster, Scene};
use crate::state::State;

/// Prepares a run with sinks or sources; bodies of sources wait from the start. Rejects combinations that are not
/// computed, and sources of bodies that cannot enter. `file`: COMPUTE.RON.
pub fn prepare_sinks_and_sources(
    file: &Path,
    flags: &ComputeFlags,
    scene: &mut Scene,
    state: &mut State,
) -> Result<(), Faults> {
    if scene.options.sinks.is_empty() && scene.options.sources.is_empty() {
        return Ok(());
    }
    let is_in_file = flags.sinks.is_none() && flags.sources.is_none() && path_exists(file);
    let (source, text) =
        if is_in_file { (file.to_path_buf(), read_text(file)?) } else { (PathBuf::from("options"), String::new()) };
    let mut report = FaultReport::new(&source, &text);
    reject_combinations(scene, &mut report);
    let selections = selected_sources(scene, state, &mut report);
    report.faults.into_result(())?;

    let entry = |&body: &BodyId| {
        let i = body.index();
        (body, Twist { v: state.v[i], w: state.w[i] })
    };
    let orders = scene.options.sources.iter().map(|source| source.order);
    let entries =
        selections.iter().zip(orders).map(|(bodies, order)| ordered_bodies(bodies, order).iter().map(entry).collect());
    let entries = entries.collect();
    scene.roster = Some(Arc::new(BodyRoster {
        free: scene.free.clone(),
        spheres: scene.spheres.clone(),
        free_rotors: scene.free_rotors.clone(),
        parts: scene.parts.clone(),
        part_starts: scene.part_starts.clone(),
        bounding_radii: (0..scene.bodies.len()).map(|i| scene.bounding_radius(BodyId::new(i))).collect(),
        entries,
    }));
    state.presence = vec![BodyPresence::Present; scene.bodies.len()];
    if !scene.options.sinks.is_empty() {
        state.exit_velocities = vec![Vec3::zeros(); scene.bodies.len()];
    }
    for &body in selections.iter().flatten() {
        let i = body.index();
        state.presence[i] = BodyPresence::Waiting;
        (state.v[i], state.w[i]) = (Vec3::zeros(), Vec3::zeros());
    }
    state.apply_presence(scene);
    Ok(())
}

/// Bodies, by rising numbers, in the order in which they enter.
fn ordered_bodies(bodies: &[BodyId], order: Option<EntryOrder>) -> Vec<BodyId> {
    let mut ordered = bodies.to_vec();
    if let Some(EntryOrder::Random(seed)) = order {
        let stream = splitmix64(seed);
        ordered.sort_by_cached_key(|body| (splitmix64(stream ^ body.number() as u64), *body));
    }
    ordered
}

/// Reports what is not computed together with sinks and sources.
fn reject_combinations(scene: &Scene, report: &mut FaultReport) {
    let option = if scene.options.sinks.is_empty() { "sources" } else { "sinks" };
    let combinations = [
        (
            !scene.links.is_empty(),
            "wires and rods",
            "no wires and rods: the bodies that they join would stay in the run",
        ),
        (!scene.postpro.is_empty(), "POSTPRO.DAT", "no POSTPRO.DAT: its files have bodies by number; use probes"),
        (scene.options.text, "text", "no text: LMGC90 expects all bodies"),
    ];
    for (_, what, expected) in combinations.into_iter().filter(|(is_used, ..)| *is_used) {
        report.add_fault(option, format!("with {what}"), expected);
    }
}

/// Bodies of each source. Reports bodies that the scene does not have, that are driven or of two sources, and those that a
/// sink would remove where they enter.
fn selected_sources(scene: &Scene, state: &State, report: &mut FaultReport) -> Vec<Vec<BodyId>> {
    let colours: Vec<&str> = scene.colours.iter().map(String::as_str).collect();
    let mut sources: Vec<Vec<BodyId>> = Vec::new();
    for (path, selection) in source_bodies(&scene.options.sources) {
        if let Some((found, expected)) = unknown_bodies(selection, scene.bodies.len(), &colours) {
            report.add_fault(&path, found, expected);
            continue;
        }
        let bodies = scene.selected_bodies(selection);
        if let Some(body) = bodies.iter().find(|body| scene.bodies[body.index()].driven) {
            let found = format!("body {} with imposed motion", body.number());
            report.add_fault(&path, found, "bodies that move freely");
        }
        if let Some(body) = bodies.iter().find(|body| sources.iter().any(|other| other.contains(body))) {
            report.add_fault(&path, format!("body {} of another source", body.number()), "each body in one source");
        }
        let sink_of = |body: &BodyId| {
            let x = state.x[body.index()].into();
            Some((*body, scene.options.sinks.iter().find(|sink| sink.region.contains(&x))?))
        };
        if let Some((body, sink)) = bodies.iter().find_map(sink_of) {
            let found = format!("body {} enters in the region of the sink '{}'", body.number(), sink.name);
            report.add_fault(&path, found, "positions outside of all sinks");
        }
        sources.push(bodies);
    }
    sources
}

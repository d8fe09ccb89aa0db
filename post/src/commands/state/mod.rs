//! `cd-post state`: profiles, forces, fabric and surface of one snapshot, each table with a figure.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};

pub mod ejecta;
pub mod file;
pub mod forces;
pub mod profiles;
pub mod surfaces;

use crate::axes::OutputAxes;
use crate::commands::state::ejecta::ejecta_files;
use crate::commands::state::file::StateFile;
use crate::commands::state::forces::{fabric_table, force_files};
use crate::commands::state::profiles::{SHELL_COUNT, layer_files, mean_layers, profile_files};
use crate::commands::state::surfaces::{free_surface_files, surface_files};
use crate::derive::bed::Bed;
use crate::derive::energy::self_gravity_constant;
use crate::derive::fragments::find_fragments;
use crate::derive::free_surface::{self, FreeSurface};
use crate::derive::plane_fit;
use crate::frame::Frame;
use crate::shapes::ShapeCache;
use crate::snapshots::list_snapshots;

/// Names of all possible files of a state.
const STATE_FILES: [&str; 22] = [
    "ejecta.csv",
    "ejecta.svg",
    "fabric.csv",
    "forces.csv",
    "forces.svg",
    "fragments.csv",
    "layers.csv",
    "layers_Z.svg",
    "layers_nu.svg",
    "layers_stress.svg",
    "mobilisation.csv",
    "mobilisation.svg",
    "profile.csv",
    "profile_Z.svg",
    "profile_nu.svg",
    "profile_stress.svg",
    "slopes.csv",
    "slopes.svg",
    "surface.csv",
    "surface.vtp",
    "surface_height.svg",
    "surface_slope.svg",
];

/// Reads a snapshot, the last without `step`; writes `POSTPRO/state-NNNNNN/` and returns its path and messages for the
/// user. Layers of a bed are means over `mean` snapshots up to that one. Errors: no snapshot of this step, fewer than `mean`
/// up to it, those of [`Frame::read_for_axes`].
pub fn write(
    dir: &Path,
    step: Option<u64>,
    mean: u32,
    slope_reach: Option<f64>,
    axes: OutputAxes,
) -> Result<(PathBuf, Vec<String>), Faults> {
    let outbox = dir.join("OUTBOX");
    let snapshots = list_snapshots(&outbox)?;
    let (last, _) = snapshots[snapshots.len() - 1];
    let requested = step.unwrap_or(last);
    let position = snapshots.iter().position(|(step, _)| *step == requested).ok_or_else(|| {
        let found = format!("has no snapshot of step {requested}");
        let before = snapshots.iter().rev().find(|(step, _)| *step < requested);
        let after = snapshots.iter().find(|(step, _)| *step > requested);
        let nearest: Vec<String> = before.into_iter().chain(after).map(|(step, _)| step.to_string()).collect();
        let expected = format!("expected one of steps {} to {last}, such as {}", snapshots[0].0, nearest.join(" or "));
        Fault::new(&outbox, None, "folder", found, expected)
    })?;
    let (step, path) = &snapshots[position];
    let first = (position + 1).checked_sub(mean as usize).ok_or_else(|| {
        let found = format!("a mean over {mean} snapshots, of which {} are not later than step {step}", position + 1);
        Fault::new(&outbox, None, "--mean", found, format!("expected at most {}", position + 1))
    })?;
    let shapes = ShapeCache::default();
    let frame = Frame::read_for_axes(path, &shapes, axes)?;
    let folder = dir.join("POSTPRO").join(format!("state-{step:06}"));
    if frame.grains.is_empty() {
        remove_stale_files(&folder, &[])?;
        return Ok((folder, vec![format!("the snapshot of step {step} has no grains: nothing is written")]));
    }
    let mut files = state_files(&frame, &added_bodies(dir)?, slope_reach);
    let mut notes = Vec::new();
    if mean > 1 {
        let mut frames = Vec::new();
        for (_, path) in &snapshots[first..position] {
            frames.push(Frame::read(path, &shapes)?);
        }
        frames.push(frame.clone());
        files.retain(|(name, _)| !name.starts_with("layers"));
        let (layers, count) = mean_layers(&frames);
        files.extend(layers);
        if count == 0 {
            notes.push(format!("none of {mean} snapshots has a bed: no layers are written"));
        } else if count < frames.len() {
            notes.push(format!("{count} of {mean} snapshots have a bed: the layers are means over these"));
        }
    }
    for (name, bytes) in &files {
        atomic::write(&folder.join(name), bytes)?;
    }
    remove_stale_files(&folder, &files)?;
    axes.record(&folder)?;
    if frame.cell().is_periodic() {
        notes.push("a periodic scene has no centre: no profile by radius is written".into());
    }
    Ok((folder, notes))
}

/// Removes files of an earlier state from the folder that this state does not have, such as the layers of a bed.
fn remove_stale_files(folder: &Path, files: &[StateFile]) -> Result<(), Faults> {
    for name in STATE_FILES.into_iter().filter(|name| files.iter().all(|(written, _)| written != name)) {
        let path = folder.join(name);
        if atomic::path_exists(&path) {
            fs::remove_file(&path).map_err(|error| Fault::from_io(&path, "removed", &error))?;
        }
    }
    Ok(())
}

/// Numbers of the bodies that `cd-pre from-outbox` added to those of another run, such as a lander: the bodies without a
/// case in DATBOX/ORIGIN.csv. Empty if there is no such file. Errors: all rows of another form.
pub fn added_bodies(dir: &Path) -> Result<HashSet<u64>, Faults> {
    let path = dir.join("DATBOX/ORIGIN.csv");
    if !atomic::path_exists(&path) {
        return Ok(HashSet::new());
    }
    let text = atomic::read_text(&path)?;
    let (mut numbers, mut faults) = (HashSet::new(), Faults::default());
    for (number, line) in (1..).zip(text.lines()).skip(1) {
        // The name of a case may have commas.
        match line.split_once(',').map(|(body, origin)| (body.parse::<u64>(), origin)) {
            // No case, step and number of origin.
            Some((Ok(body), ",,")) => drop(numbers.insert(body)),
            Some((Ok(_), _)) => {}
            _ => faults.push(Fault::new(&path, Some(number), "row", line, "expected body,case,step,number")),
        }
    }
    faults.into_result(numbers)
}

/// Files of a frame with grains; `added_bodies`: bodies of another origin, which never count as ejecta; `slope_reach`: mean
/// radii over which planes are fitted to a surface.
pub fn state_files(frame: &Frame, added_bodies: &HashSet<u64>, slope_reach: Option<f64>) -> Vec<StateFile> {
    let fragments = find_fragments(frame);
    let mut files = force_files(frame);
    files.push(("fabric.csv", fabric_table(frame).into_bytes()));
    files.extend(ejecta_files(frame, &fragments, added_bodies));
    if let Some(bed) = Bed::from_frame(frame, &fragments) {
        files.extend(layer_files(&bed.layers(frame, SHELL_COUNT, bed.top_height(frame))));
    }
    if !frame.cell().is_periodic() {
        files.extend(profile_files(frame, &fragments[0]));
    }
    match FreeSurface::from_frame(frame, &fragments, slope_reach.unwrap_or(free_surface::DEFAULT_SLOPE_REACH)) {
        // Under self-gravity verticals have no common direction.
        Some(surface) if self_gravity_constant(frame).is_none() => files.extend(free_surface_files(frame, &surface)),
        _ if !frame.cell().is_periodic() => {
            files.extend(surface_files(frame, &fragments[0], slope_reach.unwrap_or(plane_fit::DEFAULT_FIT_REACH)));
        }
        _ => {}
    }
    files
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    #[test]
    fn without_gravity_there_are_heights_distances_and_speeds() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        let other = scene.grain([0.0, 0.0, 5.0], 0.5);
        scene.snapshot.bodies.body_v[other] = [0.0, 2.0, 0.0];
        let file = |scene: &Scene, name: &str| -> Option<String> {
            let found =
                state_files(&scene.frame(), &HashSet::new(), Some(3.0)).into_iter().find(|file| file.0 == name)?;
            Some(String::from_utf8(found.1).unwrap())
        };
        let surface = file(&scene, "surface.vtp").unwrap();
        assert!(surface.contains("height") && !surface.contains("slope") && !surface.contains("NumberOfPoints=\"0\""));
        let fields = |scene: &Scene| -> Vec<String> {
            let table = file(scene, "fragments.csv").unwrap();
            table.lines().nth(2).unwrap().split(',').map(str::to_string).collect()
        };
        // Distance and speed, the rest of the orbit has no meaning.
        assert_eq!(fields(&scene)[16..], ["5.0", "2.0", "", "", "", "", "", "", ""]);
        scene.snapshot.meta.parameters.xperiode = Some(8.0);
        assert_eq!(fields(&scene)[3..6], ["", "0.0", "5.0"]);
        assert_eq!(fields(&scene)[9..18], ["", "", "", "", "", "", "", "", "2.0"]);
        // There is no centre, from which a profile or a surface could be measured.
        assert!(["surface.csv", "slopes.csv", "profile.csv"].iter().all(|name| file(&scene, name).is_none()));
    }

    #[test]
    fn a_lander_is_no_ejecta() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("DATBOX/ORIGIN.csv");
        assert!(added_bodies(folder.path()).unwrap().is_empty());
        atomic::write(&path, b"body,case,step,number\n1,a, b,7,1\n2,a, b,7,3\n3,,,\n").unwrap();
        let lander = added_bodies(folder.path()).unwrap();
        assert_eq!(lander, HashSet::from([3]));
        let mut scene = Scene::default();
        for (k, radius) in [2.0, 1.0, 1.5].into_iter().enumerate() {
            scene.grain([10.0 * k as f64, 0.0, 0.0], radius);
        }
        let found = state_files(&scene.frame(), &lander, Some(3.0));
        let table = String::from_utf8(found.iter().find(|file| file.0 == "ejecta.csv").unwrap().1.clone()).unwrap();
        let share: f64 = table.lines().nth(1).unwrap().split(',').nth(2).unwrap().parse().unwrap();
        assert!(table.lines().count() == 2 && (share - 1.0 / 9.0).abs() < 1e-15, "{table}"); // of 8 + 1
        atomic::write(&path, b"body,case,step,number\nfirst,,,\n\n").unwrap();
        let faults = added_bodies(folder.path()).unwrap_err().to_string();
        assert!(faults.lines().count() == 2 && faults.contains("ORIGIN.csv:2: row: first,,,; expected"), "{faults}");
    }

    #[test]
    fn every_file_of_a_state_is_known_by_its_name() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        let made = state_files(&scene.frame(), &HashSet::new(), Some(3.0)).into_iter().chain(layer_files(&[]));
        let made: HashSet<&str> = made.map(|(name, _)| name).collect();
        assert_eq!(made, STATE_FILES.into_iter().collect());
    }

    #[test]
    fn equal_speeds_have_equal_shares() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 2.0);
        for (k, speed) in [1.0, 2.0, 1.0].into_iter().enumerate() {
            let grain = scene.grain([10.0 * (k + 1) as f64, 0.0, 0.0], 1.0);
            scene.snapshot.bodies.body_v[grain] = [speed, 0.0, 0.0];
        }
        let found = state_files(&scene.frame(), &HashSet::new(), Some(3.0));
        let table = String::from_utf8(found.iter().find(|file| file.0 == "ejecta.csv").unwrap().1.clone()).unwrap();
        let share = |line: &str| line.split(',').nth(2).unwrap().parse::<f64>().unwrap();
        let shares: Vec<f64> = table.lines().skip(1).map(share).collect();
        // The total mass is 8 + 3; rounding of a few sums.
        assert!(shares[0] == shares[1] && (shares[0] - 3.0 / 11.0).abs() < 1e-15, "{table}");
        assert!((shares[2] - 1.0 / 11.0).abs() < 1e-15, "{table}");
    }
}

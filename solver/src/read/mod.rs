//! Room: files to [`Scene`] and [`State`]. Refuses, with file and line, what the scene cannot mean
//! or this program does not compute.

mod behaviour;
mod bodies;
mod parts;
pub mod resume;

use std::path::Path;

use cd_formats::bodies::Bodies;
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::compute::{Compute, Flags, schedule};
use cd_formats::dof::Dof;
use cd_formats::drv_dof::DrvDof;
use cd_formats::error::Faults;
use cd_formats::snapshot::{Fallback, Ledger, START};
use cd_formats::tact_behav::TactBehav;
use cd_formats::vloc_rloc::VlocRloc;

use crate::math::Vec3;
use crate::scene::Scene;
use crate::state::{Bonding, State};

/// Name of the options' file in DATBOX.
pub const COMPUTE: &str = "COMPUTE.RON";

/// Reads `case/DATBOX` with `flags` winning over COMPUTE.RON. All faults of all files at once.
pub fn case(case: &Path, flags: &Flags) -> Result<(Scene, State), Faults> {
    let datbox = case.join("DATBOX");
    let mut faults = Faults::default();
    let options = faults.gather(options(&datbox, flags));
    let bulk = faults.gather(BulkBehav::read(&datbox.join("BULK_BEHAV.DAT")));
    let tact = faults.gather(TactBehav::read(&datbox.join("TACT_BEHAV.DAT")));
    let bodies = faults.gather(Bodies::read(&datbox.join("BODIES.DAT")));
    let driven = faults.gather(DrvDof::read(&datbox.join("DRV_DOF.DAT")));
    let dof = faults.gather(Dof::read(&datbox.join("DOF.INI")));
    let history = datbox.join("Vloc_Rloc.INI");
    let history = if history.exists() { faults.gather(VlocRloc::read(&history)) } else { Some(VlocRloc::default()) };
    let (Some(options), Some(bulk), Some(tact), Some(bodies), Some(driven), Some(dof), Some(history)) =
        (options, bulk, tact, bodies, driven, dof, history)
    else {
        return Err(faults);
    };

    let mut scene = bodies::scene(&datbox, &bodies, &bulk, &driven, options, &mut faults);
    scene.start = (dof.step, dof.time);
    behaviour::laws(&datbox, &tact, &mut scene, &mut faults);
    behaviour::check_events(&scene, &mut faults);
    behaviour::check_text(&mut scene);
    let (x, q, v, w) = bodies::motion(&datbox, &bodies, &dof, &scene, &mut faults);
    scene.notes.extend(bodies::gaps(&scene, &q));
    bodies::check_within(&datbox, &bodies, &scene, &x, &q, &mut faults);
    let contacts = behaviour::history(&datbox, &history, &mut scene, &q, &mut faults);
    let spin =
        (scene.turning.iter().map(|&i| i as usize)).map(|i| scene.bodies[i].angular_momentum(&q[i], &w[i])).collect();
    let mut state = State {
        step: dof.step,
        time: dof.time,
        h: scene.options.dt,
        x,
        q,
        v,
        w,
        spin,
        order: Vec::new(),
        pairs: Vec::new(),
        contacts,
        gravity: Vec3::from(bulk.gravity),
        quench: scene.options.quench,
        torque: Vec3::zeros(),
        laws: scene.laws.clone(),
        bonding: Bonding::New,
        events_done: 0,
        attraction: None,
        fallback: Fallback::default(),
        ledger: Ledger::default(),
    };
    let start = datbox.join(START);
    let started = start.exists() && faults.0.is_empty();
    if started {
        faults.gather(resume::start(&start, &scene, &mut state));
        scene.start = (state.step, state.time);
    }
    behaviour::check_happenings(&scene, &mut faults);
    if !faults.0.is_empty() {
        return Err(faults);
    }
    scene.notes.extend(behaviour::without_effect(&scene));
    scene.events = schedule(&scene.options.events, scene.end_time());
    if started {
        resume::pass_events(&scene, &mut state);
    }
    faults.into_result((scene, state))
}

fn options(datbox: &Path, flags: &Flags) -> Result<Compute, Faults> {
    let path = datbox.join(COMPUTE);
    let options = if path.exists() { Compute::read(&path)? } else { Compute::default() };
    let options = options.with(flags);
    options.check(Path::new("options"))?;
    Ok(options)
}

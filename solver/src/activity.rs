//! What the step in progress is doing, and whether it is to be given up: a long step is watched from outside of it.
//!
//! Nothing here decides a result: a step that is given up leaves no trace.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// Stage of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StepStage {
    Forces,
    Detection,
    Solve,
}

static STOP_FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
static CURRENT_STAGE: AtomicU8 = AtomicU8::new(0);
static CURRENT_CONTACTS: AtomicU64 = AtomicU64::new(0);
static CURRENT_SWEEPS: AtomicU64 = AtomicU64::new(0);

/// The flag that a request to stop sets.
pub fn stop_flag() -> &'static Arc<AtomicBool> {
    STOP_FLAG.get_or_init(|| Arc::new(AtomicBool::new(false)))
}

/// Whether the program was requested to stop: loops that may take long end, and the step is given up.
pub fn is_stopped() -> bool {
    STOP_FLAG.get().is_some_and(|stop| stop.load(Ordering::Relaxed))
}

/// Reports the stage that begins, with the number of contacts where they are known.
pub fn begin_stage(stage: StepStage, contacts: usize) {
    CURRENT_STAGE.store(stage as u8, Ordering::Relaxed);
    CURRENT_CONTACTS.store(contacts as u64, Ordering::Relaxed);
    CURRENT_SWEEPS.store(0, Ordering::Relaxed);
}

/// Reports a sweep over the contacts, or an iteration of another solver.
pub fn count_sweep() {
    CURRENT_SWEEPS.fetch_add(1, Ordering::Relaxed);
}

/// The activity in words.
pub fn current_activity() -> String {
    let contacts = CURRENT_CONTACTS.load(Ordering::Relaxed);
    match CURRENT_STAGE.load(Ordering::Relaxed) {
        stage if stage == StepStage::Forces as u8 => "forces".into(),
        stage if stage == StepStage::Detection as u8 => "detection of contacts".into(),
        _ => format!("{contacts} contacts listed, {} sweeps so far", CURRENT_SWEEPS.load(Ordering::Relaxed)),
    }
}

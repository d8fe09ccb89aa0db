//! Activity of the step in progress, and the request to stop it: a long step is monitored from another thread.
//!
//! Nothing here changes a result: an abandoned step leaves no trace.

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

/// Whether the program was requested to stop: long loops then end, and the step is abandoned.
pub fn is_stopped() -> bool {
    STOP_FLAG.get().is_some_and(|stop| stop.load(Ordering::Relaxed))
}

/// Reports the start of a stage, with the number of contacts if known.
pub fn begin_stage(stage: StepStage, contacts: usize) {
    CURRENT_STAGE.store(stage as u8, Ordering::Relaxed);
    CURRENT_CONTACTS.store(contacts as u64, Ordering::Relaxed);
    CURRENT_SWEEPS.store(0, Ordering::Relaxed);
}

/// Reports a sweep over the contacts, or an iteration of another solver.
pub fn count_sweep() {
    CURRENT_SWEEPS.fetch_add(1, Ordering::Relaxed);
}

/// Describes the activity in words.
pub fn current_activity() -> String {
    let contacts = CURRENT_CONTACTS.load(Ordering::Relaxed);
    match CURRENT_STAGE.load(Ordering::Relaxed) {
        stage if stage == StepStage::Forces as u8 => "forces".into(),
        stage if stage == StepStage::Detection as u8 => "detection of contacts".into(),
        _ => format!("{contacts} contacts listed, {} sweeps so far", CURRENT_SWEEPS.load(Ordering::Relaxed)),
    }
}

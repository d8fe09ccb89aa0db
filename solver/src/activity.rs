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

/// Flag that signals and [`request_stop`] set.
static STOP_FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
/// Whether the processes of a run on several ranks stop together, and whether they have agreed to.
static STOPS_BY_AGREEMENT: AtomicBool = AtomicBool::new(false);
static STOP_AGREED: AtomicBool = AtomicBool::new(false);
/// Number of the [`StepStage`].
static CURRENT_STAGE: AtomicU8 = AtomicU8::new(0);
static CURRENT_CONTACTS: AtomicU64 = AtomicU64::new(0);
static CURRENT_SWEEPS: AtomicU64 = AtomicU64::new(0);

/// Flag that a request to stop sets, for the handlers of signals.
pub fn stop_flag() -> &'static Arc<AtomicBool> {
    STOP_FLAG.get_or_init(|| Arc::new(AtomicBool::new(false)))
}

/// Whether the program was requested to stop: long loops then end, and the step is abandoned. On several ranks, whether all
/// have agreed to stop, so that none of them waits for one that has ended its loop.
pub fn is_stopped() -> bool {
    if STOPS_BY_AGREEMENT.load(Ordering::Relaxed) { STOP_AGREED.load(Ordering::Relaxed) } else { is_stop_requested() }
}

/// Whether this process was requested to stop.
pub fn is_stop_requested() -> bool {
    STOP_FLAG.get().is_some_and(|stop| stop.load(Ordering::Relaxed)) || is_stopped_by_test()
}

/// Whether a test stops this thread.
#[cfg(not(test))]
fn is_stopped_by_test() -> bool {
    false
}

/// Requests this process to stop, as a signal does.
pub fn request_stop() {
    stop_flag().store(true, Ordering::Relaxed);
}

/// Makes [`is_stopped`] wait for the agreement of the ranks, from now on.
pub fn stop_by_agreement() {
    STOPS_BY_AGREEMENT.store(true, Ordering::Relaxed);
}

/// Stops all ranks: called on each of them between the same two exchanges, if any of them was requested to stop.
pub fn agree_to_stop() {
    STOP_AGREED.store(true, Ordering::Relaxed);
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

#[cfg(test)]
thread_local! {
    /// Number of the query of this thread from which on it counts as stopped.
    pub static QUERIES_UNTIL_STOP: std::cell::Cell<u64> = const { std::cell::Cell::new(u64::MAX) };
}

/// Whether a test stops this thread at this query.
#[cfg(test)]
fn is_stopped_by_test() -> bool {
    QUERIES_UNTIL_STOP.set(QUERIES_UNTIL_STOP.get().saturating_sub(1));
    QUERIES_UNTIL_STOP.get() == 0
}

//! Threads that remain awake between the stages of a step.

use std::num::NonZero;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{available_parallelism, yield_now};

use rayon::Yield;

/// Number of bodies from which on busy waiting saves at least a tenth of the time of a step, which is more than it costs
/// other programs.
pub const MIN_BODIES_TO_BUSY_WAIT: usize = 1024;

/// Runs `work`, and returns its result, while the other threads of the pool search for its tasks without sleeping, if each
/// has a processor of its own.
///
/// A thread without a task falls asleep, and waking it takes longer than many stages of a step. These threads yield to
/// other programs while they wait.
pub fn with_busy_waiting_workers<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let processors = available_parallelism().map_or(1, NonZero::get);
    if rayon::current_num_threads() > processors {
        return work();
    }
    let work_ended = &AtomicBool::new(false);
    rayon::scope(|scope| {
        let worker = rayon::current_thread_index();
        scope.spawn_broadcast(move |_, context| {
            while Some(context.index()) != worker && !work_ended.load(Ordering::Relaxed) {
                if rayon::yield_now() != Some(Yield::Executed) {
                    yield_now();
                }
            }
        });
        let _end = BusyWaitGuard(work_ended);
        work()
    })
}

/// Sets the flag that ends the wait of the other threads when it is dropped, also if the work panics.
struct BusyWaitGuard<'a>(&'a AtomicBool);

impl Drop for BusyWaitGuard<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};

    use super::with_busy_waiting_workers;

    #[test]
    fn the_wait_ends_with_the_work_also_where_it_panics() {
        for threads in 1..=3 {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert_eq!(pool.install(|| with_busy_waiting_workers(|| rayon::join(|| 1, || 2))), (1, 2));
            let panicked =
                catch_unwind(AssertUnwindSafe(|| pool.install(|| with_busy_waiting_workers(|| panic!("as meant")))));
            assert!(panicked.is_err());
        }
    }
}

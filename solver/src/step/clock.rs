//! Time spent in the stages of a step.

use std::time::{Duration, Instant};

/// Time spent in each stage.
#[derive(Debug, Clone, Copy, Default)]
pub struct StageTimes {
    pub gravity: Duration,
    pub detection: Duration,
    pub assembly: Duration,
    pub solve: Duration,
    pub integration: Duration,
    pub writing: Duration,
}

impl StageTimes {
    /// Adds the times of another step.
    pub fn accumulate(&mut self, lap: &StageTimes) {
        self.gravity += lap.gravity;
        self.detection += lap.detection;
        self.assembly += lap.assembly;
        self.solve += lap.solve;
        self.integration += lap.integration;
        self.writing += lap.writing;
    }
}

/// Stopwatch over consecutive stages.
pub struct StageClock<'a> {
    times: &'a mut StageTimes,
    lap_start: Instant,
}

impl<'a> StageClock<'a> {
    /// Starts a stopwatch that adds to `times`.
    pub fn start(times: &'a mut StageTimes) -> Self {
        StageClock { times, lap_start: Instant::now() }
    }

    /// Adds the time since the last lap, or the start, to the time of a stage.
    pub fn add_lap(&mut self, stage: fn(&mut StageTimes) -> &mut Duration) {
        let now = Instant::now();
        *stage(self.times) += now - self.lap_start;
        self.lap_start = now;
    }
}

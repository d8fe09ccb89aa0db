//! Momentum of the sweeps and its restarts.
//!
//! A sweep starts from y = r + beta (r - r_before). beta grows as Nesterov's up to a cap, and restarts from 0 when the last
//! change points uphill.
//!
//! Sources: Y. Nesterov, Soviet Math. Dokl. 27 (1983) 372-376; B. O'Donoghue, E. Candes, Found. Comput. Math. 15 (2015)
//! 715-732 (restart); H. Mazhar et al., ACM Trans. Graph. 34 (2015) (in contact dynamics).

/// Largest share of the last change that is carried on with friction, by the index of the sweep in a round of
/// [`MOMENTUM_CYCLE`]. Uncapped momentum bounces on dense frictional packings; caps of 0.7 to 0.85 perform alike. A few
/// problems cycle with any momentum, others converge with it alone. Therefore, if sweeps cycle, or after a while, the
/// momentum is reduced, then set to 0, and then restored. Without friction the problem is convex and needs no cap; with
/// friction no cap is needed as long as no contact slides and E falls.
const FRICTIONAL_CAPS: [(u64, f64); 3] = [(600, 0.8), (800, 0.5), (MOMENTUM_CYCLE, 0.0)];
/// Number of sweeps in a round of caps.
pub const MOMENTUM_CYCLE: u64 = 1000;

/// Sweeps of the first two windows for the detection of cycling; each next window is half as long as all before: where the
/// change falls slowly, short windows show only its noise. Sweeps cycle if the mean change in a window is not below that in
/// the window before it under the same cap.
const STAGNATION_WINDOW: u64 = 16;

/// Momentum: share of the last sweep's change with which the next one starts.
pub(super) struct SweepMomentum {
    /// Nesterov's sequence t_0 = 1, t_k+1 = (1 + sqrt(1 + 4 t_k²))/2.
    t: f64,
    /// Momentum beta = (t_k - 1)/t_k+1, at most the cap.
    pub(super) beta: f64,
    /// Whether the momentum is capped.
    pub(super) frictional: bool,
    /// Whether any contact slides. Without sliding the sweeps do not cycle, however slow they are.
    pub(super) sliding: bool,
    /// Index of the sweep in the round.
    position: u64,
    /// Index of the sweep in the present part of the round.
    part_position: u64,
    /// Begin and end of this window in its part of the round.
    window: [u64; 2],
    /// Sum of the changes in this window, N s.
    window_change: f64,
    /// Mean change in the window before it under the same cap, N s.
    previous_mean: Option<f64>,
}

impl SweepMomentum {
    pub(super) fn new(frictional: bool) -> Self {
        let window = [0, STAGNATION_WINDOW];
        SweepMomentum {
            t: 1.0,
            beta: 0.0,
            frictional,
            sliding: frictional,
            position: 0,
            part_position: 0,
            window,
            window_change: 0.0,
            previous_mean: None,
        }
    }

    /// Updates the momentum after a sweep whose changes of the impulses have the norm `change`, N s; restarts it if `uphill`.
    pub(super) fn update_after_sweep(&mut self, uphill: bool, change: f64) {
        if uphill {
            (self.t, self.beta) = (1.0, 0.0);
        } else {
            let t = 0.5 * (1.0 + (1.0 + 4.0 * self.t * self.t).sqrt());
            self.beta = ((self.t - 1.0) / t).min(self.momentum_cap());
            self.t = t;
        }
        let (end, _) = self.cycle_part();
        self.position += 1;
        self.part_position += 1;
        self.window_change += change;
        let [start, window_end] = self.window;
        if self.part_position == window_end {
            let mean = std::mem::take(&mut self.window_change) / (window_end - start) as f64;
            let cycles = self.sliding && self.previous_mean.is_some_and(|previous_mean| mean >= previous_mean);
            self.position = if cycles { end } else { self.position };
            (self.window, self.previous_mean) =
                ([window_end, window_end + STAGNATION_WINDOW.max(window_end / 2)], Some(mean));
        }
        if self.position == end {
            (self.position, self.part_position, self.window, self.window_change, self.previous_mean) =
                (end % MOMENTUM_CYCLE, 0, [0, STAGNATION_WINDOW], 0.0, None);
        }
    }

    /// End of this part of the round, and its cap.
    fn cycle_part(&self) -> (u64, f64) {
        FRICTIONAL_CAPS.into_iter().find(|(end, _)| self.position < *end).unwrap_or((MOMENTUM_CYCLE, 0.0))
    }

    /// Largest momentum of the next sweep.
    fn momentum_cap(&self) -> f64 {
        if self.frictional { self.cycle_part().1 } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Momentum of each of `sweeps` sweeps with the given changes.
    fn carried(frictional: bool, sweeps: u64, change: impl Fn(u64) -> f64) -> Vec<f64> {
        let mut momentum = SweepMomentum::new(frictional);
        (0..sweeps)
            .map(|k| {
                momentum.update_after_sweep(false, change(k));
                momentum.beta
            })
            .collect()
    }

    #[test]
    fn sweeps_that_cycle_lose_their_momentum_and_others_keep_it() {
        let falls = carried(true, 2000, |k| 0.999f64.powi(k as i32));
        let cycles = carried(true, 200, |k| 1.0 + (k % 4) as f64);
        // An oscillation with a period of two windows of 16 sweeps is larger than the decrease from one window to the next.
        let slow = carried(true, 601, |k| 0.999f64.powi(k as i32) * (1.0 + 0.05 * (k as f64 * 0.2).cos()));
        let ends: Vec<usize> = (1..200).filter(|&k| cycles[k] != cycles[k - 1] && k > 20).collect();
        assert_eq!(falls[599..=600], [0.8, 0.5]);
        assert_eq!(falls[799..=800], [0.5, 0.0]);
        assert_eq!(slow[599..=600], [0.8, 0.5]);
        assert_eq!(falls[999..=1000], [0.0, 0.8]);
        // Two windows detect a cycle; the momentum is then reduced.
        assert_eq!(ends, [32, 64, 96, 128, 160, 192]);
        assert_eq!([32, 64, 96].map(|k| cycles[k]), [0.5, 0.0, 0.8]);
        // Without friction there is no cap that could change the momentum.
        assert!(carried(false, 200, |_| 1.0)[199] > 0.98);
    }
}

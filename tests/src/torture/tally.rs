//! Counts of trials by kind, and failures.

use std::collections::BTreeMap;

/// Counts of one kind of trials.
#[derive(Debug, Default)]
struct TallyRow {
    trials: u64,
    failed: u64,
    /// Number of broken runs by what happened, such as `cd-solve 137`.
    events: BTreeMap<String, u64>,
}

/// Counts of trials by kind, and failures.
#[derive(Debug, Default)]
pub struct Tally {
    rows: Vec<(&'static str, TallyRow)>,
    /// Descriptions of the trials that failed.
    pub failures: Vec<String>,
}

impl Tally {
    /// Begins a kind of trials.
    pub fn begin(&mut self, kind: &'static str) {
        self.rows.push((kind, TallyRow::default()));
    }

    fn row(&mut self) -> &mut TallyRow {
        &mut self.rows.last_mut().expect("a kind").1
    }

    /// Number of trials of the present kind.
    pub fn trials(&mut self) -> u64 {
        self.row().trials
    }

    /// Counts an event of the present kind.
    pub fn add_event(&mut self, event: String) {
        *self.row().events.entry(event).or_default() += 1;
    }

    /// Counts trials that have ended, and prints those that failed; `faults` is empty if they have passed.
    pub fn add_trials(&mut self, number: u64, description: &str, faults: &[String]) {
        let row = self.row();
        row.trials += number;
        if !faults.is_empty() {
            row.failed += number;
            let kind = self.rows.last().expect("a kind").0;
            self.failures.push(format!("{kind}: {description}: {}", faults.join("; ")));
            println!("failed: {}", self.failures.last().expect("one").trim_end());
        }
    }

    /// Counts of the present kind, in words.
    pub fn last_row(&self) -> String {
        let Some((kind, row)) = self.rows.last() else { return String::new() };
        let events: Vec<String> = row.events.iter().map(|(event, number)| format!("{event}: {number}")).collect();
        format!("{kind}: {} of {} passed ({})", row.trials - row.failed, row.trials, events.join(", "))
    }
}

//! Kills, faults of files and signals: each broken run is checked, and continued to its end.

use super::Torture;
use super::contents::Contents;
use super::program_case::{Program, ProgramCase};
use super::shim::{FILE_ERRORS, INTERRUPTED_CALL, OPERATION_KINDS, Operations, Sabotage};
use super::workplace::{Outcome, Workplace};
use crate::draws::Draws;

/// Exit code of a program that SIGKILL has ended.
const KILLED: i32 = 128 + 9;

/// List of the checksums of snapshots.
const SNAPSHOT_CHECKSUMS: &str = "OUTBOX/SHA256SUMS";

/// A broken run and the run after it: faults that were found.
pub(super) struct Trial<'a> {
    pub workplace: &'a Workplace,
    pub program_case: &'a ProgramCase,
    /// Whether the program has begun before in this folder.
    again: bool,
    pub faults: Vec<String>,
}

impl<'a> Trial<'a> {
    /// Prepares the folder of the case before the program.
    pub fn new(workplace: &'a Workplace, program_case: &'a ProgramCase) -> Trial<'a> {
        program_case.before.write(&workplace.case());
        Trial { workplace, program_case, again: false, faults: Vec::new() }
    }

    /// Next command line of the program.
    pub fn words(&mut self, draws: &mut Draws) -> Vec<String> {
        let words = self.program_case.words(&self.workplace.case(), 1 + draws.below(3), self.again);
        self.again = true;
        words
    }

    /// Adds a fault unless `holds`.
    pub fn check(&mut self, holds: bool, fault: impl FnOnce() -> String) {
        if !holds {
            self.faults.push(fault());
        }
    }

    /// Checks the folder after a run that was broken; returns its contents.
    pub fn check_folder(&mut self, outcome: &Outcome) -> Contents {
        let case = self.workplace.case();
        let contents = Contents::read(&case);
        let half = contents.half_written_files(&case, &self.program_case.before, &self.program_case.after);
        self.check(half.is_empty(), || format!("half-written after exit code {}: {half:?}", outcome.code));
        contents
    }

    /// Checks the exit code and messages of a run that could not write all files. A run that has ended well has lost nothing.
    pub fn check_failed_write(&mut self, outcome: &Outcome) {
        let codes: &[i32] = if self.program_case.program == Program::Solve { &[0, 2, 4] } else { &[0, 2] };
        self.check(codes.contains(&outcome.code), || format!("exit code {}: {}", outcome.code, outcome.stderr));
        let contents = self.check_folder(outcome);
        if outcome.code == 0 {
            self.check_results("exit code 0");
            return;
        }
        let lines = outcome.stderr.lines().filter(|line| !line.contains("warning")).count();
        self.check((1..=2).contains(&lines), || format!("{lines} messages: {}", outcome.stderr));
        if outcome.code == 2 {
            let snapshots = self.new_snapshots(&contents);
            self.check(snapshots == 0, || format!("exit code 2 after {snapshots} snapshots: {}", outcome.stderr));
        }
    }

    /// Number of complete snapshots that the folder did not have before the program.
    fn new_snapshots(&self, contents: &Contents) -> usize {
        let is_new = |name: &&String| {
            name.starts_with("OUTBOX/snapshot")
                && !name.contains("-part-")
                && !self.program_case.before.0.contains_key(*name)
        };
        contents.0.keys().filter(is_new).count()
    }

    /// Runs the program to its end without disturbance, and compares all files. If OUTBOX was removed, files in other folders
    /// remain, which only `--force` replaces.
    pub fn finish(&mut self, draws: &mut Draws) {
        let has_log = Contents::read(&self.workplace.case()).0.contains_key("OUTBOX/steps.csv");
        let mut words = self.words(draws);
        let mut outcome = self.workplace.run(&words, None);
        if !has_log && outcome.code == 2 && outcome.stderr.contains("use --force") {
            words.retain(|word| word != "--resume");
            words.push("--force".into());
            outcome = self.workplace.run(&words, None);
        }
        let message = || format!("the run after it: exit code {}: {}", outcome.code, outcome.stderr);
        self.check(outcome.code == 0, message);
        self.check_results("the run after it");
    }

    /// Compares all files with those of the unbroken run. A snapshot of a run that was requested to stop may remain, with its
    /// lines in the list of checksums.
    pub fn check_results(&mut self, occasion: &str) {
        let mut contents = Contents::read(&self.workplace.case());
        let mut different = contents.differences(&self.program_case.after);
        if !different.is_empty() && contents.remove_further_snapshots(&self.program_case.after) > 0 {
            different = contents.differences(&self.program_case.after);
            different.retain(|name| name != SNAPSHOT_CHECKSUMS);
            if contents.0.contains_key(SNAPSHOT_CHECKSUMS) {
                let words = ["cd-solve".into(), self.workplace.case().display().to_string(), "--verify".into()];
                let outcome = self.workplace.run(&words, None);
                self.check(outcome.code == 0, || format!("{occasion}: --verify: {}", outcome.code));
            }
        }
        self.check(different.is_empty(), || format!("{occasion}: files differ: {different:?}"));
    }
}

/// Kinds of operations that count, as letters: one kind or all.
fn draw_kinds(draws: &mut Draws) -> String {
    let (one, _) = draws.choice(&OPERATION_KINDS);
    if draws.below(3) == 0 { OPERATION_KINDS.iter().map(|(letter, _)| letter).collect() } else { one.to_string() }
}

impl Torture {
    /// Kills a program once or several times, half of them at a file operation, and continues it after each kill.
    pub(super) fn kill(&mut self, draws: &mut Draws) {
        let program_case = self.draw_program_case(draws);
        let mut trial = Trial::new(&self.workplace, program_case);
        let (mut kills, mut events, mut history) = (0, Vec::new(), Vec::new());
        for _ in 0..draws.choice(&[1, 1, 2, 4]) {
            let words = trial.words(draws);
            let outcome = if draws.below(4) > 0 {
                let kinds = draw_kinds(draws);
                // There are far fewer operations of one kind than writes.
                let number =
                    if kinds.contains('w') { program_case.operations } else { 1 + program_case.operations / 20 };
                let operation = 1 + draws.below(number);
                history.push(format!("operation {operation} of {kinds}"));
                self.workplace.run(&words, Some(&Sabotage::Kill { kinds, operation }))
            } else {
                let running = self.workplace.start(&words, None, "");
                let moment = program_case.duration.mul_f64(draws.share());
                std::thread::sleep(moment);
                running.send(&["KILL"]);
                history.push(format!("after {moment:?}"));
                running.outcome()
            };
            events.push(format!("{} {}", program_case.program.name(), outcome.code));
            trial.check([0, KILLED].contains(&outcome.code), || format!("{}: {}", outcome.code, outcome.stderr));
            kills += u64::from(outcome.code == KILLED);
            trial.check_folder(&outcome);
            if outcome.code != KILLED {
                break;
            }
        }
        trial.check_mixture(&mut events);
        trial.finish(draws);
        let faults = trial.faults;
        let description = format!("{}: {}", program_case.name(), history.join(", "));
        events.into_iter().for_each(|event| self.tally.add_event(event));
        self.tally.add_trials(kills, &description, &faults);
    }

    /// Lets file operations fail: one, all from one on, or some at random.
    pub(super) fn let_operations_fail(&mut self, draws: &mut Draws) {
        let program_case = self.draw_program_case(draws);
        let mut trial = Trial::new(&self.workplace, program_case);
        let kinds = draw_kinds(draws);
        let (name, error) = draws.choice(&FILE_ERRORS);
        let number = if kinds.contains('w') { program_case.operations } else { 1 + program_case.operations / 20 };
        let first = 1 + draws.below(number);
        let operations = draws.choice(&[
            Operations::Range(first, first),
            Operations::Range(first, u64::MAX >> 1),
            Operations::Range(first, first + 20),
            Operations::Share(20_000, first),
        ]);
        let sabotage = Sabotage::Fail { kinds: kinds.clone(), error, operations, half: draws.below(2) == 0 };
        let words = trial.words(draws);
        let outcome = self.workplace.run(&words, Some(&sabotage));
        trial.check_failed_write(&outcome);
        let mut events = vec![format!("{} {}", program_case.program.name(), outcome.code)];
        trial.check_mixture(&mut events);
        trial.finish(draws);
        let faults = trial.faults;
        let description = format!("{}: {name} of {kinds}, {operations:?}", program_case.name());
        events.into_iter().for_each(|event| self.tally.add_event(event));
        self.tally.add_trials(1, &description, &faults);
    }

    /// Sends one or two signals at a random moment. Of the runs that continue after it half are killed at an early operation.
    pub(super) fn send_signals(&mut self, draws: &mut Draws) {
        let program_case = self.draw_program_case(draws);
        let mut trial = Trial::new(&self.workplace, program_case);
        let signals: &[&str] = draws.choice(&[
            &["TERM"][..],
            &["INT"],
            &["TERM", "TERM"],
            &["INT", "INT"],
            &["INT", "TERM"],
            &["HUP"],
            &["STOP", "CONT"],
            &["STOP", "TERM", "CONT"],
        ]);
        let words = trial.words(draws);
        let running = self.workplace.start(&words, None, "");
        std::thread::sleep(program_case.duration.mul_f64(draws.share()));
        running.send(signals);
        let outcome = running.outcome();
        trial.check_signalled(&outcome, signals);
        let event = format!("{} {} {}", program_case.program.name(), signals.join("+"), outcome.code);
        trial.check_folder(&outcome);
        let mut description = format!("{}: {}", program_case.name(), signals.join(", "));
        if draws.below(2) == 0 {
            let operation = 1 + draws.below(1 + program_case.operations / 8);
            let kinds = OPERATION_KINDS.iter().map(|(letter, _)| letter).collect();
            let words = trial.words(draws);
            let outcome = self.workplace.run(&words, Some(&Sabotage::Kill { kinds, operation }));
            trial.check([0, KILLED].contains(&outcome.code), || format!("{}: {}", outcome.code, outcome.stderr));
            trial.check_folder(&outcome);
            description += &format!(", then killed at operation {operation}");
        }
        trial.finish(draws);
        let faults = trial.faults;
        self.tally.add_event(event);
        self.tally.add_trials(1, &description, &faults);
    }

    /// Shortens writes, or lets calls be interrupted: neither is an error.
    pub(super) fn shorten_writes(&mut self, draws: &mut Draws) {
        let program_case = self.draw_program_case(draws);
        let mut trial = Trial::new(&self.workplace, program_case);
        let operations = Operations::Share(300_000, draws.below(1 << 32));
        let (name, sabotage) = match draws.below(2) {
            0 => ("shortened", Sabotage::Shorten(operations)),
            _ => {
                let kinds = "wos".to_string();
                ("interrupted", Sabotage::Fail { kinds, error: INTERRUPTED_CALL, operations, half: false })
            }
        };
        let words = trial.words(draws);
        let outcome = self.workplace.run(&words, Some(&sabotage));
        trial.check(outcome.code == 0, || format!("exit code {}: {}", outcome.code, outcome.stderr));
        trial.check_results("after it");
        let faults = trial.faults;
        let description = format!("{}: {name}, {operations:?}", program_case.name());
        self.tally.add_event(format!("{} {name} {}", program_case.program.name(), outcome.code));
        self.tally.add_trials(1, &description, &faults);
    }
}

impl Trial<'_> {
    /// Checks that cd-solve rejects a DATBOX some of whose files are new and others old.
    fn check_mixture(&mut self, events: &mut Vec<String>) {
        if self.program_case.program != Program::Pre {
            return;
        }
        let case = self.workplace.case();
        let contents = Contents::read(&case).0;
        let (before, after) = (&self.program_case.before, &self.program_case.after);
        let changed = after.differences(before);
        let count = |folder: &Contents| {
            let same = |name: &&String| folder.0.contains_key(*name) && folder.0.get(*name) == contents.get(*name);
            changed.iter().filter(same).count()
        };
        if count(before) == 0 || count(after) == 0 {
            return;
        }
        events.push("mixed DATBOX".into());
        let outcome = self.workplace.run(&["cd-solve".into(), case.display().to_string()], None);
        self.check(outcome.code == 2, || format!("a mixed DATBOX: cd-solve ends with {}", outcome.code));
        let outbox = case.join("OUTBOX");
        self.check(!outbox.exists(), || "a mixed DATBOX is run".into());
        let _ = std::fs::remove_dir_all(outbox);
    }

    /// Checks the exit code of a program that got signals.
    fn check_signalled(&mut self, outcome: &Outcome, signals: &[&str]) {
        let number = |signal: &&str| match *signal {
            "HUP" => Some(1),
            "INT" => Some(2),
            "TERM" => Some(15),
            _ => None,
        };
        let numbers: Vec<i32> = signals.iter().filter_map(number).collect();
        let mut codes: Vec<i32> = [0].into_iter().chain(numbers.iter().map(|number| 128 + number)).collect();
        let stops = numbers.iter().filter(|&&number| number != 1).count();
        if self.program_case.program == Program::Solve && stops > 0 {
            codes.push(4);
        }
        self.check(codes.contains(&outcome.code), || format!("exit code {}: {}", outcome.code, outcome.stderr));
        if stops == 1 && self.program_case.program == Program::Solve && outcome.code > 128 {
            // A single request ends cd-solve at once only before it has begun.
            let snapshots = self.new_snapshots(&Contents::read(&self.workplace.case()));
            self.check(snapshots == 0, || format!("ended at once after {snapshots} snapshots"));
        }
    }
}

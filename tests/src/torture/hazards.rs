//! Second writers, folders that vanish, clocks that are wrong, disks that are full.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use super::Torture;
use super::contents::Contents;
use super::interruptions::Trial;
use super::program_case::{Program, ProgramCase};
use super::shim::Sabotage;
use crate::draws::Draws;

impl Torture {
    /// Starts a program twice in one folder: cd-solve on one case, cd-post, or cd-pre on two scenes.
    pub(super) fn let_two_write(&mut self, draws: &mut Draws) {
        let program = draws.choice(&[Program::Pre, Program::Solve, Program::Post]);
        let program_case = self.draw_program_case_of(program, draws);
        let other = self.draw_program_case_of(program, draws);
        let mut trial = Trial::new(&self.workplace, program_case);
        let case = self.workplace.case();
        let mut second = trial.words(draws);
        if program == Program::Pre {
            let scene = self.workplace.folder().join("other.ron");
            fs::write(&scene, other.scene.text).unwrap();
            second =
                [second[0].as_str(), scene.to_str().unwrap(), "-o", case.to_str().unwrap()].map(String::from).into();
        }
        let first = self.workplace.start(&program_case.words(&case, 2, false), None, "");
        std::thread::sleep(program_case.duration.mul_f64(0.3 * draws.share()));
        let second = self.workplace.start(&second, None, "");
        let outcomes = [first, second].map(|running| running.outcome());
        let codes = [outcomes[0].code, outcomes[1].code];
        let is_expected = codes.iter().all(|code| [0, 2].contains(code)) && codes.contains(&0);
        trial.check(is_expected, || format!("exit codes {codes:?}: {}{}", outcomes[0].stderr, outcomes[1].stderr));
        if program == Program::Pre {
            trial.check_datbox_of_one(program_case, other, codes);
        } else {
            trial.check_results("after both");
        }
        let faults = trial.faults;
        let description = format!("{} and {}", program_case.name(), other.name());
        self.tally.add_event(format!("{} {codes:?}", program.name()));
        self.tally.add_trials(1, &description, &faults);
    }

    /// Renames or removes a folder of the case while a program uses it: OUTBOX, which must be noticed unless all is read or
    /// written, or DATBOX, which cd-solve has read. The run after it finds the folder where it was.
    pub(super) fn move_folder_away(&mut self, draws: &mut Draws) {
        let program_case =
            self.draw_program_case_of(draws.choice(&[Program::Solve, Program::Solve, Program::Post]), draws);
        let mut trial = Trial::new(&self.workplace, program_case);
        let case = self.workplace.case();
        let name = if program_case.program == Program::Solve {
            draws.choice(&["OUTBOX", "OUTBOX", "DATBOX"])
        } else {
            "OUTBOX"
        };
        let [folder, elsewhere] = [case.join(name), self.workplace.folder().join("elsewhere")];
        let _ = fs::remove_dir_all(&elsewhere);
        let is_removed = program_case.program == Program::Solve && name == "OUTBOX" && draws.below(2) == 0;
        let words = trial.words(draws);
        let running = self.workplace.start(&words, None, "");
        std::thread::sleep(program_case.duration.mul_f64(0.2 + 0.6 * draws.share()));
        let is_moved = fs::rename(&folder, &elsewhere).is_ok();
        let files = Contents::read(&elsewhere).0;
        let is_done = program_case
            .after
            .0
            .keys()
            .filter_map(|path| path.strip_prefix("OUTBOX/"))
            .all(|path| files.contains_key(path));
        if is_moved && is_removed {
            // The program may write to it at this moment.
            while elsewhere.exists() {
                let _ = fs::remove_dir_all(&elsewhere);
            }
        }
        let outcome = running.outcome();
        let event = format!(
            "{} {name} {} {}",
            program_case.program.name(),
            if is_removed { "removed" } else { "renamed" },
            outcome.code
        );
        trial.check([0, 2, 4].contains(&outcome.code), || format!("exit code {}: {}", outcome.code, outcome.stderr));
        trial.check(outcome.code == 0 || !outcome.stderr.is_empty(), || "no message".into());
        if elsewhere.exists() {
            trial.check(!folder.exists(), || format!("{name} is in two places after exit code {}", outcome.code));
            let _ = fs::remove_dir_all(&folder);
            fs::rename(&elsewhere, &folder).unwrap();
        }
        trial.check_folder(&outcome);
        if outcome.code == 0 && !(is_moved && is_removed) {
            trial.check_results("exit code 0");
        } else if outcome.code == 0 {
            trial.check(is_done, || "results were removed without a word".into());
        }
        trial.finish(draws);
        let faults = trial.faults;
        let description = format!("{}: {event}", program_case.name());
        self.tally.add_event(event);
        self.tally.add_trials(1, &description, &faults);
    }

    /// Shifts the clocks, or lets them jump.
    pub(super) fn falsify_clocks(&mut self, draws: &mut Draws) {
        let program_case = self.draw_program_case(draws);
        let mut trial = Trial::new(&self.workplace, program_case);
        let (name, sabotage) = match draws.below(3) {
            // A century back: before 1970, and forwards.
            0 => ("a century back", Sabotage::ShiftClocks(-3_155_760_000)),
            1 => ("four centuries forwards", Sabotage::ShiftClocks(12_623_040_000)),
            _ => ("jumps", Sabotage::ShakeClocks(100_000)),
        };
        let words = trial.words(draws);
        let outcome = self.workplace.run(&words, Some(&sabotage));
        trial.check(outcome.code == 0, || format!("exit code {}: {}", outcome.code, outcome.stderr));
        trial.check_results("after it");
        let faults = trial.faults;
        let description = format!("{}: {name}", program_case.name());
        self.tally.add_event(format!("{} {name} {}", program_case.program.name(), outcome.code));
        self.tally.add_trials(1, &description, &faults);
    }

    /// Limits the size of files, as `ulimit -f` does.
    pub(super) fn limit_file_sizes(&mut self, draws: &mut Draws) {
        let program_case = self.draw_program_case(draws);
        let mut trial = Trial::new(&self.workplace, program_case);
        let largest = program_case.after.0.values().map(Vec::len).max().unwrap_or(0) as u64;
        // Blocks of 512 bytes.
        let blocks = draws.below(largest / 512 + 2);
        let words = trial.words(draws);
        let outcome = self.workplace.start(&words, None, &format!("ulimit -f {blocks}")).outcome();
        trial.check_failed_write(&outcome);
        trial.finish(draws);
        let faults = trial.faults;
        let description = format!("{}: {blocks} blocks", program_case.name());
        self.tally.add_event(format!("{} {}", program_case.program.name(), outcome.code));
        self.tally.add_trials(1, &description, &faults);
    }

    /// Runs a program on a disk that is too small, and again when it has been enlarged. Counts a trial without any if file
    /// systems cannot be mounted here.
    pub(super) fn fill_disk(&mut self, draws: &mut Draws) {
        let program_case = self.draw_program_case(draws);
        let case = self.workplace.case();
        let _ = fs::remove_dir_all(&case);
        fs::create_dir_all(&case).unwrap();
        let size = |contents: &Contents| {
            contents.0.values().map(|bytes| bytes.len().div_ceil(4096) as u64 + 1).sum::<u64>() * 4
        };
        let [before, after] = [size(&program_case.before), size(&program_case.after)];
        let kilobytes = before + 40 + draws.below(after.saturating_sub(before).max(8) + 8);
        let Some(_mount) = MountedDisk::mount(&case, kilobytes) else {
            self.tally.add_event("not tested: no file system can be mounted".into());
            return self.tally.add_trials(1, "", &[]);
        };
        let mut trial = Trial::new(&self.workplace, program_case);
        let words = trial.words(draws);
        let outcome = self.workplace.run(&words, None);
        trial.check_failed_write(&outcome);
        mount(&["-o", &format!("remount,size={}k", 4 * after + 10_000)], &case);
        trial.finish(draws);
        let faults = trial.faults;
        let description = format!("{}: {kilobytes} kB", program_case.name());
        self.tally.add_event(format!("{} {}", program_case.program.name(), outcome.code));
        self.tally.add_trials(1, &description, &faults);
    }
}

impl Trial<'_> {
    /// Checks that DATBOX is that of one of two cd-pre that ran at once, of one that has ended with 0.
    fn check_datbox_of_one(&mut self, first: &ProgramCase, second: &ProgramCase, codes: [i32; 2]) {
        let contents = Contents::read(&self.workplace.case());
        let is_of = |program_case: &ProgramCase| {
            // The line with the name of the scene differs.
            let names = program_case.after.0.iter().filter(|(name, _)| {
                name.starts_with("DATBOX/") && !name.ends_with("COMPUTE.RON") && !name.ends_with("SHA256SUMS")
            });
            names.into_iter().all(|(name, bytes)| contents.0.get(name) == Some(bytes))
        };
        let is_of_one = (codes[0] == 0 && is_of(first)) || (codes[1] == 0 && is_of(second));
        self.check(is_of_one, || "DATBOX is of none of the two alone".into());
        let temporary = contents.temporary_files();
        self.check(temporary.is_empty(), || format!("left: {temporary:?}"));
    }
}

/// File system in memory, which is unmounted when this is dropped.
struct MountedDisk<'a>(&'a Path);

impl MountedDisk<'_> {
    /// Mounts a disk of a size; `None` if that is not permitted.
    fn mount(folder: &Path, kilobytes: u64) -> Option<MountedDisk<'_>> {
        let is_mounted = mount(&["-t", "tmpfs", "-o", &format!("size={kilobytes}k"), "tmpfs"], folder);
        is_mounted.then_some(MountedDisk(folder))
    }
}

impl Drop for MountedDisk<'_> {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0).status();
    }
}

/// Runs `mount`; returns whether it has done so.
fn mount(words: &[&str], folder: &Path) -> bool {
    let mut command = Command::new("mount");
    command.args(words).arg(folder).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

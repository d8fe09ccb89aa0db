//! Torture of the three programs: they are killed in the middle of their file operations, disks are full, folders vanish. After
//! each such run its exit code and messages must be those of `docs/reference/running.md`, no file may stand half-written under
//! its final name, and a run after it must end with the bytes of the unbroken run.
//!
//! | module | |
//! |---|---|
//! | [`scenes`] | small scenes |
//! | [`program_case`] | a program on a scene, without disturbance |
//! | [`workplace`] | the folder in which programs run, their processes |
//! | [`shim`] | the library in C that lets file operations fail |
//! | [`contents`] | comparison of folders |
//! | [`interruptions`] | kills, faults of files, signals |
//! | [`hazards`] | second writers, folders that vanish, clocks, full disks |
//! | [`tally`] | counts |

pub mod contents;
pub mod hazards;
pub mod interruptions;
pub mod program_case;
pub mod scenes;
pub mod shim;
pub mod tally;
pub mod workplace;

use crate::draws::Draws;
use crate::process::Executables;
use program_case::{Program, ProgramCase, unbroken_program_cases};
use scenes::TortureScene;
use shim::Shim;
use tally::Tally;
use workplace::Workplace;

/// Numbers of trials of each kind, and the seed from which all choices are drawn.
#[derive(Debug, Clone, Copy)]
pub struct TorturePlan {
    pub seed: u64,
    /// Kills, at a file operation or at a moment.
    pub kills: u64,
    /// Runs in which file operations fail.
    pub faults: u64,
    /// Runs that get signals.
    pub signals: u64,
    /// Number of trials of each other kind.
    pub others: u64,
}

/// Makes one trial and counts it, or several if it kills several times.
type TrialFunction = fn(&mut Torture, &mut Draws);

/// Programs, scenes and results of torture.
pub struct Torture {
    workplace: Workplace,
    program_cases: Vec<ProgramCase>,
    /// Results so far.
    pub tally: Tally,
}

impl Torture {
    /// Runs the programs on the scenes without disturbance. Errors: one of them fails.
    pub fn new(executables: Executables, shim: Shim, scenes: &[TortureScene]) -> Result<Torture, String> {
        let workplace = Workplace::new(executables, shim);
        let program_cases = unbroken_program_cases(&workplace, scenes)?;
        Ok(Torture { workplace, program_cases, tally: Tally::default() })
    }

    /// Makes all trials of a plan. Prints the counts of each kind when it is done.
    pub fn run(&mut self, plan: &TorturePlan) {
        let kinds: [(&str, u64, TrialFunction); 9] = [
            ("kills", plan.kills, Torture::kill),
            ("faults of files", plan.faults, Torture::let_operations_fail),
            ("signals", plan.signals, Torture::send_signals),
            ("two writers", plan.others, Torture::let_two_write),
            ("folders that vanish", plan.others, Torture::move_folder_away),
            ("clocks", plan.others, Torture::falsify_clocks),
            ("short writes, interrupted calls", plan.others, Torture::shorten_writes),
            ("limits of file sizes", plan.others, Torture::limit_file_sizes),
            ("full disks", plan.others, Torture::fill_disk),
        ];
        for (k, (kind, number, trial)) in kinds.into_iter().enumerate() {
            let mut draws = Draws::new(plan.seed, k as u64);
            self.tally.begin(kind);
            while self.tally.trials() < number {
                trial(self, &mut draws);
            }
            println!("{}", self.tally.last_row());
        }
    }

    /// One of the programs on one of the scenes: in half of the cases cd-solve, whose files matter most.
    fn draw_program_case(&self, draws: &mut Draws) -> &ProgramCase {
        let program = draws.choice(&[Program::Pre, Program::Solve, Program::Solve, Program::Post]);
        self.draw_program_case_of(program, draws)
    }

    /// A program on one of the scenes.
    fn draw_program_case_of(&self, program: Program, draws: &mut Draws) -> &ProgramCase {
        let program_cases: Vec<&ProgramCase> =
            self.program_cases.iter().filter(|program_case| program_case.program == program).collect();
        draws.choice(&program_cases)
    }
}

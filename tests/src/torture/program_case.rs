//! A program on a small case: the folder before it, the folder after it, and its command lines.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use super::contents::Contents;
use super::scenes::TortureScene;
use super::shim::Sabotage;
use super::workplace::Workplace;

/// One of the three programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Program {
    Pre,
    Solve,
    Post,
}

impl Program {
    /// Name of the program.
    pub fn name(self) -> &'static str {
        match self {
            Program::Pre => "cd-pre",
            Program::Solve => "cd-solve",
            Program::Post => "cd-post",
        }
    }
}

/// A program with the case on which it runs, and the unbroken run of it.
pub struct ProgramCase {
    pub program: Program,
    pub scene: TortureScene,
    /// Whether the folder before the program has results of an earlier run, which it replaces.
    pub has_results: bool,
    /// Folder before the program.
    pub before: Contents,
    /// Folder after the unbroken program.
    pub after: Contents,
    /// Number of file operations of the unbroken program.
    pub operations: u64,
    /// Duration of the unbroken program.
    pub duration: Duration,
}

impl ProgramCase {
    /// Command line; `again`: after a run that was broken.
    pub fn words(&self, case: &Path, threads: u64, again: bool) -> Vec<String> {
        let folder = case.display().to_string();
        let name = self.program.name().to_string();
        match self.program {
            Program::Pre => vec![name, format!("{folder}/scene.ron")],
            Program::Post => vec![name, folder],
            Program::Solve => {
                let mut words = vec![name, folder, "--threads".into(), threads.to_string()];
                words.extend(self.scene.flags.iter().map(|flag| flag.to_string()));
                let further = if self.has_results { "--force" } else { "--resume" };
                words.extend((again || self.has_results).then(|| further.to_string()));
                words
            }
        }
    }

    /// Name in reports.
    pub fn name(&self) -> String {
        let occasion = if self.has_results { " over earlier files" } else { "" };
        format!("{} {}{occasion}", self.program.name(), self.scene.name)
    }
}

/// Runs the programs on the scenes without any disturbance: each in a new folder, and over files of an earlier run. Errors: one
/// of them does not end with 0.
pub fn unbroken_program_cases(workplace: &Workplace, scenes: &[TortureScene]) -> Result<Vec<ProgramCase>, String> {
    let mut program_cases = Vec::new();
    for scene in scenes {
        let mut before = Contents::default();
        before.0.insert("scene.ron".into(), scene.text.as_bytes().to_vec());
        for program in [Program::Pre, Program::Solve, Program::Post] {
            if program == Program::Solve && !scene.commands.is_empty() {
                before.0.insert("DATBOX/POSTPRO.DAT".into(), scene.commands.as_bytes().to_vec());
            }
            let program_case = unbroken_program_case(workplace, program, *scene, before)?;
            before = program_case.after.clone();
            program_cases.push(program_case);
        }
    }
    let of_pre: Vec<Contents> =
        program_cases.iter().step_by(3).map(|program_case: &ProgramCase| program_case.after.clone()).collect();
    let again = program_cases.iter().enumerate().map(|(k, program_case)| {
        let mut before = program_case.after.clone();
        if program_case.program == Program::Pre {
            // The DATBOX of another scene.
            before = of_pre[(k / 3 + 1) % of_pre.len()].clone();
            before.0.insert("scene.ron".into(), program_case.scene.text.as_bytes().to_vec());
        }
        ProgramCase { has_results: true, before, after: program_case.after.clone(), ..*program_case }
    });
    let again: Vec<ProgramCase> = again.collect();
    program_cases.extend(again);
    Ok(program_cases)
}

/// Runs a program without any disturbance.
fn unbroken_program_case(
    workplace: &Workplace,
    program: Program,
    scene: TortureScene,
    before: Contents,
) -> Result<ProgramCase, String> {
    let case = workplace.case();
    before.write(&case);
    let (after, duration) = (Contents::default(), Duration::ZERO);
    let mut program_case = ProgramCase { program, scene, has_results: false, before, after, operations: 0, duration };
    let count = workplace.folder().join("count");
    let start = Instant::now();
    let outcome = workplace.run(&program_case.words(&case, 1, false), Some(&Sabotage::Count(count.clone())));
    if outcome.code != 0 {
        return Err(format!("{}: exit code {}\n{}", program_case.name(), outcome.code, outcome.stderr));
    }
    program_case.duration = start.elapsed();
    program_case.after = Contents::read(&case);
    let text =
        fs::read_to_string(&count).map_err(|error| format!("{}: no operations: {error}", program_case.name()))?;
    program_case.operations = text.parse().map_err(|_| format!("number of operations: {text}"))?;
    Ok(program_case)
}

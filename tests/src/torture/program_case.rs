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

/// A program on a case.
pub struct Stage {
    pub program: Program,
    pub scene: TortureScene,
    /// Whether the folder has results of an earlier run, which are replaced.
    pub replaces: bool,
    /// Folder before the program.
    pub before: Contents,
    /// Folder after the unbroken program.
    pub after: Contents,
    /// Number of file operations of the unbroken program.
    pub operations: u64,
    /// Duration of the unbroken program.
    pub duration: Duration,
}

impl Stage {
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
                let further = if self.replaces { "--force" } else { "--resume" };
                words.extend((again || self.replaces).then(|| further.to_string()));
                words
            }
        }
    }

    /// Name in reports.
    pub fn name(&self) -> String {
        let replaces = if self.replaces { " over earlier files" } else { "" };
        format!("{} {}{replaces}", self.program.name(), self.scene.name)
    }
}

/// Runs the programs on the scenes without any disturbance: each in a new folder, and over files of an earlier run. Errors: one
/// of them does not end with 0.
pub fn unbroken_stages(workplace: &Workplace, scenes: &[TortureScene]) -> Result<Vec<Stage>, String> {
    let mut stages = Vec::new();
    for scene in scenes {
        let mut before = Contents::default();
        before.0.insert("scene.ron".into(), scene.text.as_bytes().to_vec());
        for program in [Program::Pre, Program::Solve, Program::Post] {
            if program == Program::Solve && !scene.commands.is_empty() {
                before.0.insert("DATBOX/POSTPRO.DAT".into(), scene.commands.as_bytes().to_vec());
            }
            let stage = unbroken_stage(workplace, program, *scene, before)?;
            before = stage.after.clone();
            stages.push(stage);
        }
    }
    let of_pre: Vec<Contents> = stages.iter().step_by(3).map(|stage: &Stage| stage.after.clone()).collect();
    let again = stages.iter().enumerate().map(|(k, stage)| {
        let mut before = stage.after.clone();
        if stage.program == Program::Pre {
            // The DATBOX of another scene.
            before = of_pre[(k / 3 + 1) % of_pre.len()].clone();
            before.0.insert("scene.ron".into(), stage.scene.text.as_bytes().to_vec());
        }
        Stage { replaces: true, before, after: stage.after.clone(), ..*stage }
    });
    let again: Vec<Stage> = again.collect();
    stages.extend(again);
    Ok(stages)
}

/// Runs a program without any disturbance.
fn unbroken_stage(
    workplace: &Workplace,
    program: Program,
    scene: TortureScene,
    before: Contents,
) -> Result<Stage, String> {
    let case = workplace.case();
    before.write(&case);
    let (after, duration) = (Contents::default(), Duration::ZERO);
    let mut stage = Stage { program, scene, replaces: false, before, after, operations: 0, duration };
    let count = workplace.folder().join("count");
    let start = Instant::now();
    let outcome = workplace.run(&stage.words(&case, 1, false), Some(&Sabotage::Count(count.clone())));
    if outcome.code != 0 {
        return Err(format!("{}: exit code {}\n{}", stage.name(), outcome.code, outcome.stderr));
    }
    stage.duration = start.elapsed();
    stage.after = Contents::read(&case);
    let text = fs::read_to_string(&count).map_err(|error| format!("{}: no operations: {error}", stage.name()))?;
    stage.operations = text.parse().map_err(|_| format!("number of operations: {text}"))?;
    Ok(stage)
}

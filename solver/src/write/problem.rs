//! The contact problem of one step as a document.

use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::Faults;
use cd_formats::fc3d::{Block, Fc3d};

use crate::assemble::StoredProblem;

/// Writes `CASE/problem-NNNNNN.fc3d`, the problem that leads to step NNNNNN; returns its path.
pub fn write(case: &Path, step: u64, problem: StoredProblem) -> Result<PathBuf, Faults> {
    let path = case.join(format!("problem-{step:06}.fc3d"));
    let blocks = problem.blocks.into_iter().map(|(row, column, w)| Block { row, column, w }).collect();
    let document = Fc3d {
        comments: vec![format!(
            "cd-solve {}: step {step}; u and r of the standard problem, SI units",
            env!("CARGO_PKG_VERSION")
        )],
        name: format!("step-{step:06}"),
        mu: problem.mu,
        q: problem.q,
        blocks,
    };
    atomic::write(&path, document.to_text().as_bytes())?;
    Ok(path)
}

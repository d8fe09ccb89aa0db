//! `cd-post accuracy-study`: errors of the runs of one scene relative to the finest of them, and their cost.

use std::path::{Path, PathBuf};

use cd_formats::error::{Fault, Faults};

mod bias;
mod comparison;
mod recommendation;
mod replicated;

use crate::commands::study::is_study_table;
pub use comparison::{AccuracyStudyOptions, COLUMNS};
use comparison::{compare_folders, summary_text, write_errors};
pub use replicated::{BIAS_COLUMNS, BIAS_ORDER_COLUMNS, RECOMMENDED_COLUMNS, SETTING_COLUMNS};

/// Compares cases, or outputs of this command for several realisations of a scene, and writes accuracy.csv, orders.csv
/// and accuracy.svg with this title. The cases of a table of `cd-pre study` are compared for each seed, and their biases
/// are written, too. Returns the table as text, and messages for the user.
///
/// Errors: tables or snapshots that are missing or cannot be compared.
pub fn write(
    folders: &[PathBuf],
    selection: &AccuracyStudyOptions,
    title: &str,
    output: &Path,
) -> Result<(String, Vec<String>), Faults> {
    if selection.parameters.is_some() || folders.iter().any(|folder| is_study_table(folder)) {
        return replicated::write(folders, selection, title, output);
    }
    check_unreplicated(folders, selection)?;
    let (compared, errors) = compare_folders(folders, selection)?;
    let messages = write_errors(&compared, title, output)?;
    let runs = format!("{} runs in {}\n", folders.len(), output.display());
    Ok((runs + &summary_text(&compared, &errors), messages))
}

/// Errors if folders without the parameters of a study are given options of replicates, or if there is one folder.
fn check_unreplicated(folders: &[PathBuf], selection: &AccuracyStudyOptions) -> Result<(), Faults> {
    let mut faults = Faults::default();
    let mut add_fault = |object: &str, found: &str, expected: &str| {
        faults.push(Fault::new(Path::new("options"), None, object, found, expected));
    };
    for (name, is_given) in
        [("--error", !selection.errors.is_empty()), ("--observables", !selection.observables.is_empty())]
    {
        if is_given {
            add_fault(name, "is given with folders", "expected study.csv of cd-pre study, or --parameters study.csv");
        }
    }
    if folders.len() < 2 {
        add_fault("accuracy-study", "one folder", "expected two or more, or study.csv of cd-pre study");
    }
    faults.into_result(())
}

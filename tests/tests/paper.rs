//! docs/paper/paper.awk judges numbers by their interval over the seeds.

use std::fs;
use std::path::Path;
use std::process::Command;

/// Page that paper.awk makes of `text` in a folder with the tables of three seeds, or its error.
fn page(folder: &Path, text: &str) -> Result<String, String> {
    for (seed, value) in (1..).zip([1.0, 2.0, 3.0]) {
        fs::write(folder.join(format!("s{seed}.csv")), format!("time,Z,hole\n0,4,\n1,{value},\n")).unwrap();
    }
    fs::write(folder.join("page.in"), text).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/paper/paper.awk");
    let awk = |command: &mut Command| command.current_dir(folder).env("LC_ALL", "C").output().unwrap();
    let output = awk(Command::new("awk").args(["-v", "SEEDS=3", "-f"]).arg(script).arg("page.in"));
    let text = |bytes| String::from_utf8(bytes).unwrap();
    if output.status.success() { Ok(text(output.stdout)) } else { Err(text(output.stderr)) }
}

/// Cells of the only row: measured, expected and verdict.
fn row(claim: &str) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let page = page(folder.path(), &format!("@claim {claim} | a | b | c | d\n")).unwrap();
    page.split(" | ").skip(2).take(3).map(str::to_string).collect()
}

/// The mean of 1, 2 and 3 is 2, its 95 % interval by Student's t with two degrees of freedom 2 ± 4.303 / √3 = 2 ± 2.484.
#[test]
fn verdicts_are_those_of_the_whole_interval() {
    let number = "last sSEED.csv Z";
    assert_eq!(row(&format!("-1 5 {number}")), ["2.0 ± 2.5", "c; -1 to 5", "agrees"]);
    assert_eq!(row(&format!("- 4 {number}")), ["2.0 ± 2.5", "c; at most 4", "open"]);
    assert_eq!(row(&format!("5 - {number}")), ["2.0 ± 2.5", "c; at least 5", "**differs**"]);
    // Several numbers agree if all do; the first is 4 without an error.
    let several = "cell sSEED.csv Z time={0,1}";
    assert_eq!(row(&format!("-1 5 {several}")), ["2.0 to 4.0 ± 2.5", "c; -1 to 5", "agrees"]);
    assert_eq!(row(&format!("5 - {several}"))[2], "**differs**");
    assert_eq!(row(&format!("- 4.1 {several}"))[2], "open");
}

#[test]
fn lines_are_fitted_for_each_seed() {
    // Through two points there is no line to judge; through (0, 4), (1, Z) and no more it is a fault.
    let folder = tempfile::tempdir().unwrap();
    let error = page(folder.path(), "@claim - 0 slope sSEED.csv Z time | a | b | c | d\n").unwrap_err();
    assert!(error.contains("s1.csv: a line through 2 rows"), "{error}");
}

#[test]
fn a_missing_number_is_a_fault() {
    let folder = tempfile::tempdir().unwrap();
    let error = page(folder.path(), "@claim - 0 last sSEED.csv hole | a | b | c | d\n").unwrap_err();
    assert!(error.contains("page.in:1: s1.csv: no hole in row 2"), "{error}");
    let error = page(folder.path(), "@claim - 0 last other-sSEED.csv Z | a | b | c | d\n").unwrap_err();
    assert!(error.contains("other-s1.csv: no table"), "{error}");
}

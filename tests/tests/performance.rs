//! docs/explanation/performance.md shows what the files of bench/results hold.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const COLUMNS: &str = "scene,size,quantity,value,unit,threads,program,commit";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The page as `make performance-page` draws it, with further arguments of awk, or the error of awk.
fn drawn(page: &Path, arguments: &[&str]) -> Result<String, String> {
    let output = Command::new("awk")
        .current_dir(root())
        .env("LC_ALL", "C")
        .args(arguments)
        .args(["-f", "bench/performance.awk"])
        .arg(page)
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    if output.status.success() { Ok(text(output.stdout)) } else { Err(text(output.stderr)) }
}

#[test]
fn the_page_is_drawn_from_the_results() {
    let page = fs::read_to_string(root().join("docs/explanation/performance.md")).unwrap();
    let again = drawn(Path::new("docs/explanation/performance.md"), &[]).unwrap();
    let line = page.lines().zip(again.lines()).position(|(a, b)| a != b);
    assert!(
        page == again,
        "docs/explanation/performance.md:{}: run `make performance-page`",
        line.unwrap_or_default() + 1
    );
    assert!(page.matches("\n<!-- table ").count() > 10);
}

/// Folders of bench/results.
fn machines() -> Vec<PathBuf> {
    let entries = fs::read_dir(root().join("bench/results")).unwrap();
    entries.map(|entry| entry.unwrap().path()).filter(|path| path.is_dir()).collect()
}

#[test]
fn results_have_the_columns_of_the_readme() {
    let readme = fs::read_to_string(root().join("bench/README.md")).unwrap();
    for column in COLUMNS.split(',') {
        assert!(readme.contains(&format!("`{column}`")), "bench/README.md: {column} is not described");
    }
    let mut count = 0;
    for machine in machines() {
        assert!(machine.join("machine.txt").is_file(), "{}: no machine.txt", machine.display());
        for entry in fs::read_dir(&machine).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|ending| ending != "csv") {
                continue;
            }
            let text = fs::read_to_string(&path).unwrap();
            assert_eq!(text.lines().next(), Some(COLUMNS), "{}", path.display());
            for line in text.lines().skip(1) {
                let fields: Vec<&str> = line.split(',').collect();
                let is_number = |text: &str| text.parse::<f64>().is_ok();
                let holds = fields.len() == COLUMNS.split(',').count()
                    && !fields[0].is_empty()
                    && !fields[2].is_empty()
                    && is_number(fields[3])
                    && (fields[1].is_empty() || is_number(fields[1]))
                    && is_number(fields[5]);
                assert!(holds, "{}: {line}", path.display());
                count += 1;
            }
        }
    }
    assert!(count > 100, "{count} measurements");
}

/// Pages that the script cannot draw.
#[test]
fn faults_of_the_page_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("page.md");
    let machine = machines()[0].file_name().unwrap().to_str().unwrap().to_string();
    for (text, expected) in [
        ("<!-- table step | rows scene | columns quantity -->\n<!-- end -->\n", ":1: a table before"),
        ("<!-- machine none -->\n<!-- end -->\n", "none/machine.txt: absent"),
        ("text\n<!-- end -->\n", ":2: `<!-- end -->` without a beginning"),
        (&format!("<!-- machine {machine} -->\n"), "no `<!-- end -->`"),
    ] {
        fs::write(&page, text).unwrap();
        let error = drawn(&page, &[]).unwrap_err();
        assert!(error.contains(expected), "{text}: {error}");
    }
}

/// A file that is absent for a machine does not end the drawing: the page says that it was not measured.
#[test]
fn a_machine_without_measurements_has_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("page.md");
    let machine = machines()[0].file_name().unwrap().to_str().unwrap().to_string();
    let text = "<!-- machine none -->\nold\n<!-- end -->\n<!-- table absent | rows scene | columns quantity -->\nold\n<!-- end -->\nnew\n";
    fs::write(&page, text).unwrap();
    let again = drawn(&page, &["-v", &format!("machine={machine}")]).unwrap();
    assert!(again.starts_with(&format!("<!-- machine {machine} -->\n")), "{again}");
    assert!(
        again.contains("Not measured") && again.ends_with("<!-- end -->\nnew\n") && !again.contains("old"),
        "{again}"
    );
}

//! Pages of the manual are short, narrow and all within its table of contents.

use std::fs;

use cd_tests::pages::{files_below, links, project_folder, prose};

/// Largest number of lines of a page: some ten screens.
const MAX_LINES: usize = 400;

/// Largest number of columns of a line, as in the code.
const MAX_COLUMNS: usize = 120;

/// Largest number of words in the cell of a table; more belong in a paragraph.
const MAX_CELL_WORDS: usize = 40;

/// Words by which a page would report its past.
const WORDS_OF_HISTORY: [&str; 5] = ["no longer", "formerly", "was changed", "in earlier versions", "it used to"];

/// Pages of the manual with their paths within docs; the draft of an article has a form of its own.
fn manual_pages() -> Vec<(String, String)> {
    let docs = project_folder().join("docs");
    let mut pages = Vec::new();
    for path in files_below(&docs, &[".md"]) {
        let name = path.strip_prefix(&docs).unwrap().to_string_lossy().replace('\\', "/");
        if !name.starts_with("joss/") {
            pages.push((name, fs::read_to_string(&path).unwrap()));
        }
    }
    assert!(pages.len() > 40, "{} pages", pages.len());
    pages
}

#[test]
fn pages_and_cells_are_short() {
    let mut faults = Vec::new();
    for (name, text) in manual_pages() {
        let lines = text.lines().count();
        if lines > MAX_LINES {
            faults.push(format!("{name}: {lines} lines"));
        }
        for (number, line) in prose(&text).filter(|(_, line)| line.starts_with('|')) {
            let row = line.replace("\\|", "/");
            let words = row.split('|').map(|cell| cell.split_whitespace().count()).max().unwrap();
            if words > MAX_CELL_WORDS {
                faults.push(format!("{name}:{number}: a cell of {words} words"));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Rows of tables, figures and addresses cannot be broken; quoted code has the width of the code.
#[test]
fn lines_are_narrow() {
    let mut faults = Vec::new();
    for (name, text) in manual_pages() {
        let mut in_quoted_code = false;
        for (number, line) in (1..).zip(text.lines()) {
            if line.starts_with("```") {
                in_quoted_code = line == "```rust";
            }
            let unbreakable = in_quoted_code || line.starts_with(['|', '!']) || line.contains("://");
            let columns = line.chars().count();
            if columns > MAX_COLUMNS && !unbreakable {
                faults.push(format!("{name}:{number}: {columns} columns"));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Lists begin with `- ` or a number, so a line that begins with another mark is a formula that would become a list.
#[test]
fn no_line_becomes_a_list_by_accident() {
    for (name, text) in manual_pages() {
        for (number, line) in prose(&text) {
            let mark = ["+ ", "* ", "> "].iter().find(|mark| line.trim_start().starts_with(**mark));
            assert!(mark.is_none(), "{name}:{number}: {line}");
        }
    }
}

#[test]
fn users_pages_describe_the_present() {
    for (name, text) in manual_pages().into_iter().filter(|(name, _)| !name.starts_with("development/")) {
        for (number, line) in prose(&text) {
            let found = WORDS_OF_HISTORY.iter().find(|words| line.to_lowercase().contains(**words));
            assert!(found.is_none(), "{name}:{number}: {line}");
        }
    }
}

/// Pages that say which test holds a result name it `file::function`.
#[test]
fn tests_named_in_pages_exist() {
    let root = project_folder();
    let mut count = 0;
    for (page, text) in manual_pages() {
        let named = text.split('`').skip(1).step_by(2).filter_map(|code| code.split_once("::"));
        const PAGES: [&str; 3] = ["explanation/validation.md", "explanation/limits.md", "reliability.md"];
        for (file, function) in named.filter(|_| PAGES.contains(&&*page)) {
            let in_folder = |folder: &str| fs::read_to_string(root.join(folder).join(format!("{file}.rs"))).ok();
            let source = in_folder("solver/tests/cases").or_else(|| in_folder("tests/tests"));
            let defined = source.is_some_and(|source| source.contains(&format!("fn {function}()")));
            assert!(defined, "{page}: {file}::{function}");
            count += 1;
        }
    }
    assert!(count > 40, "{count} names of tests");
}

#[test]
fn every_page_is_in_the_summary() {
    let pages = manual_pages();
    let (_, summary) = pages.iter().find(|(name, _)| name == "SUMMARY.md").unwrap();
    let listed: Vec<&str> = summary.lines().flat_map(links).collect();
    for (name, _) in pages.iter().filter(|(name, _)| name != "SUMMARY.md") {
        assert_eq!(listed.iter().filter(|link| *link == name).count(), 1, "{name} in SUMMARY.md");
    }
}

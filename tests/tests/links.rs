//! Links within the documentation lead to files and headings that exist, and so do names of pages in the sources.

use std::fs;

use cd_tests::pages::{anchors, files_below, links, project_folder, prose};

#[test]
fn links_lead_to_files_and_headings() {
    let root = project_folder();
    let (mut faults, mut count) = (Vec::new(), 0);
    for page in files_below(root, &[".md"]) {
        let text = fs::read_to_string(&page).unwrap();
        for (number, line) in prose(&text) {
            for link in links(line) {
                if link.contains("://") || link.starts_with("mailto:") || link.contains(' ') {
                    continue;
                }
                count += 1;
                let (file, heading) = link.split_once('#').unwrap_or((link, ""));
                let target = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
                let is_page = target.extension().is_some_and(|ending| ending == "md");
                let misses = |text: String| !heading.is_empty() && is_page && !anchors(&text).contains(heading);
                if !target.exists() || (is_page && fs::read_to_string(&target).map_or(true, misses)) {
                    faults.push(format!("{}:{number}: {link}", page.strip_prefix(root).unwrap().display()));
                }
            }
        }
    }
    assert!(count > 200, "{count} links were found");
    assert!(faults.is_empty(), "links to nowhere:\n{}", faults.join("\n"));
}

/// Messages, help texts, comments and build files name pages by their path from the top folder.
#[test]
fn pages_named_in_sources_exist() {
    let root = project_folder();
    let endings = [".rs", ".awk", ".in", ".py", ".sh", ".mk", ".yml", ".toml", ".md", "Makefile"];
    let mut files = files_below(root, &endings);
    files.extend(files_below(&root.join(".github"), &endings));
    let (mut faults, mut count) = (Vec::new(), 0);
    for file in files {
        for (number, line) in (1..).zip(fs::read_to_string(&file).unwrap().lines()) {
            for rest in line.split("docs/").skip(1) {
                let path = rest.split(|c: char| !(c.is_ascii_alphanumeric() || "_-./".contains(c))).next().unwrap();
                let path = path.trim_end_matches('.');
                if !path.ends_with(".md") || path.contains("NAME") {
                    continue;
                }
                count += 1;
                if !root.join("docs").join(path).exists() {
                    faults.push(format!("{}:{number}: docs/{path}", file.strip_prefix(root).unwrap().display()));
                }
            }
        }
    }
    assert!(count > 20, "{count} names of pages were found");
    assert!(faults.is_empty(), "pages that do not exist:\n{}", faults.join("\n"));
}

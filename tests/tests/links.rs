//! Links within the documentation lead to files and headings that exist.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Markdown files below a folder, without build outputs and hidden folders.
fn pages(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && !name.starts_with('.') && name != "target" {
            pages(&path, found);
        } else if name.ends_with(".md") {
            found.push(path);
        }
    }
}

/// Lines of a page outside of blocks of code, with their numbers.
fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut in_code = false;
    (1..).zip(text.lines()).filter(move |(_, line)| {
        let fence = line.trim_start().starts_with("```");
        in_code ^= fence;
        !in_code && !fence
    })
}

/// Anchors of the headings of a page, as forges build them.
fn anchors(text: &str) -> HashSet<String> {
    let headings = prose(text)
        .filter_map(|(_, line)| line.trim_start_matches('#').strip_prefix(' ').filter(|_| line.starts_with('#')));
    let anchor = |heading: &str| {
        let kept =
            heading.to_lowercase().chars().filter(|&c| c.is_alphanumeric() || "-_ ".contains(c)).collect::<String>();
        kept.trim().replace(' ', "-")
    };
    headings.map(anchor).collect()
}

#[test]
fn links_lead_to_files_and_headings() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let (mut found, mut faults, mut links) = (Vec::new(), Vec::new(), 0);
    pages(root, &mut found);
    for page in &found {
        let text = fs::read_to_string(page).unwrap();
        for (number, line) in prose(&text) {
            for link in line.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(link, _)| link) {
                if link.contains("://") || link.starts_with("mailto:") || link.contains(' ') {
                    continue;
                }
                links += 1;
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
    assert!(links > 200, "{links} links were found");
    assert!(faults.is_empty(), "links to nowhere:\n{}", faults.join("\n"));
}

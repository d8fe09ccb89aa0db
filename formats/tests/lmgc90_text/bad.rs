//! Each file of `tests/bad` holds the messages of its reader, each in a line `!^ object: found; expected`
//! below the line that is at fault, or first in the file if the fault is of the file as a whole. There must be no others.

use std::fs;

use crate::{files, folder, rewrite};

#[test]
fn each_bad_file_gives_its_messages() {
    let files = files(&folder("bad"));
    assert!(files.len() > 60, "{} files", files.len());
    let mut wrong = String::new();
    for path in files {
        let bytes = fs::read(&path).unwrap();
        let text = String::from_utf8_lossy(&bytes);
        let mut expected = Vec::new();
        let mut blamed = 0;
        for (number, line) in (1..).zip(text.lines()) {
            match line.strip_prefix("!^ ") {
                Some(message) if blamed == 0 => expected.push(message.to_string()),
                Some(message) => expected.push(format!("{blamed}: {message}")),
                None => blamed = number,
            }
        }
        let faults = rewrite(&path, &bytes).err().unwrap_or_default();
        let shown = path.display().to_string();
        let folder = path.parent().unwrap().display().to_string();
        let mut found: Vec<_> = faults
            .to_string()
            .lines()
            .map(|message| match message.strip_prefix(&format!("{shown}:")) {
                Some(rest) => rest.trim_start().to_string(),
                None => message.strip_prefix(&format!("{folder}/")).unwrap_or(message).to_string(), // of a table
            })
            .collect();
        found.sort();
        expected.sort();
        if found != expected || expected.is_empty() {
            wrong += &format!("{shown}\n  expected\n    {}\n", expected.join("\n    "));
            wrong += &format!("  found\n    {}\n", found.join("\n    "));
        }
    }
    assert!(wrong.is_empty(), "\n{wrong}");
}

//! Folders of cases that command lines name, and messages about paths that are not case folders.

use std::path::{Path, PathBuf};

use crate::atomic;
use crate::error::Fault;

/// Folder of a case that a program reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CaseFolder {
    /// DATBOX, the input of cd-solve.
    Datbox,
    /// OUTBOX, the results of cd-solve.
    Outbox,
    /// Any folder: no subfolder is required.
    Any,
}

impl CaseFolder {
    fn name(self) -> &'static str {
        match self {
            CaseFolder::Datbox => "DATBOX",
            CaseFolder::Outbox => "OUTBOX",
            CaseFolder::Any => "",
        }
    }
}

/// Fault of a path that is not a case with the folder `part`; `None` if it is such a case. `program` is the program that reads it.
pub fn case_fault(path: &Path, part: CaseFolder, program: &str) -> Option<Fault> {
    let own_part = part_name(path);
    if path.join(part.name()).is_dir() && (part != CaseFolder::Any || own_part.is_none()) {
        return None;
    }
    if path.is_file() {
        return Some(file_fault(path, part, program));
    }
    // "scene.ron/" is no file, but means one.
    let without_slash: PathBuf = path.components().collect();
    if without_slash.is_file() {
        return case_fault(&without_slash, part, program);
    }
    let scene = path.join("scene.ron");
    let fault = |object: &str, found: String, expected: String| Some(Fault::new(path, None, object, found, expected));
    if !path.exists() {
        return fault("folder", "there is no such folder".into(), expected_case(part));
    }
    if let Some(name) = own_part {
        let article = if name == "OUTBOX" { "an" } else { "a" };
        return fault("folder", format!("is {article} {name}"), "expected the case folder, which contains it".into());
    }
    match part {
        CaseFolder::Datbox if scene.is_file() => {
            fault("folder", "has a scene but no DATBOX".into(), format!("run cd-pre {} first", scene.display()))
        }
        CaseFolder::Datbox => {
            fault("folder", "has no DATBOX".into(), "expected the files of cd-pre or LMGC90 in it".into())
        }
        _ if path.join("DATBOX").is_dir() => {
            fault("folder", "has no OUTBOX".into(), format!("run cd-solve {} first", path.display()))
        }
        _ if scene.is_file() => {
            let run = format!("run cd-pre {} and cd-solve {} first", scene.display(), path.display());
            fault("folder", "has a scene but no OUTBOX".into(), run)
        }
        _ => {
            let expected = "expected snapshot-*.npz, the results of cd-solve";
            Some(Fault::new(&path.join("OUTBOX"), None, "folder", "is missing", expected))
        }
    }
}

/// Fault of a file in place of a case with the folder `part`.
fn file_fault(path: &Path, part: CaseFolder, program: &str) -> Fault {
    let parent_text = |path: &Path| match path.parent() {
        Some(parent) if parent != Path::new("") => parent.display().to_string(),
        _ => ".".into(),
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let folder = parent_text(path);
    let (found, expected) = if name.ends_with(".ron") {
        let expected = match part {
            CaseFolder::Datbox => format!("run cd-pre {} first, then {program} {folder}", path.display()),
            _ if Path::new(&folder).join("OUTBOX").is_dir() => format!("did you mean {folder}?"),
            _ if Path::new(&folder).join("DATBOX").is_dir() => format!("run cd-solve {folder} first"),
            _ => format!("run cd-pre {} and cd-solve {folder} first", path.display()),
        };
        ("is a scene, not a case", expected)
    } else if name.starts_with("snapshot-") && name.ends_with(".npz") {
        let folder = Path::new(&folder);
        let is_outbox = folder.file_name().is_some_and(|name| name == "OUTBOX");
        let expected = if is_outbox { format!("did you mean {}?", parent_text(folder)) } else { expected_case(part) };
        ("is a snapshot, not a case", expected)
    } else {
        ("is not a folder", expected_case(part))
    };
    Fault::new(path, None, "file", found, expected)
}

/// Expectation of a case with the folder `part`, in words.
fn expected_case(part: CaseFolder) -> String {
    match part {
        CaseFolder::Any => "expected the folder of a case".into(),
        part => format!("expected the folder of a case, with {} in it", part.name()),
    }
}

/// Name of the subfolder of a case (DATBOX, OUTBOX, POSTPRO or DISPLAY) that `path` itself is; `None` for other paths.
fn part_name(path: &Path) -> Option<&'static str> {
    let holds_snapshots = || {
        let entries = atomic::folder_entries(path).unwrap_or_default();
        let names = entries.iter().filter_map(|entry| entry.file_name()?.to_str());
        names.into_iter().any(|name| name.starts_with("snapshot-") && name.ends_with(".npz"))
    };
    let is_folder_named = |name: &str| path.file_name().is_some_and(|own| own == name) && path.is_dir();
    if path.join("BODIES.DAT").is_file() {
        Some("DATBOX")
    } else if is_folder_named("OUTBOX") || holds_snapshots() {
        Some("OUTBOX")
    } else {
        ["POSTPRO", "DISPLAY"].into_iter().find(|name| is_folder_named(name))
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn what_is_no_case_says_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let case = folder.path();
        let messages = |name: &str, part: CaseFolder| {
            let text = case_fault(&case.join(name), part, "cd-x").map_or(String::new(), |fault| fault.to_string());
            text.replace(&case.display().to_string(), "CASE")
        };
        let outbox = |name: &str| messages(name, CaseFolder::Outbox);
        assert_eq!(outbox(""), "CASE/OUTBOX: folder: is missing; expected snapshot-*.npz, the results of cd-solve");
        let absent = "CASE/absent: folder: there is no such folder; expected the folder of a case, with OUTBOX in it";
        assert_eq!(outbox("absent"), absent);
        fs::write(case.join("scene.ron"), "()").unwrap();
        let steps = "run cd-pre CASE/scene.ron and cd-solve CASE first";
        assert_eq!(outbox("scene.ron"), format!("CASE/scene.ron: file: is a scene, not a case; {steps}"));
        fs::create_dir(case.join("DATBOX")).unwrap();
        fs::write(case.join("DATBOX/BODIES.DAT"), "").unwrap();
        assert_eq!(outbox("scene.ron"), "CASE/scene.ron: file: is a scene, not a case; run cd-solve CASE first");
        assert_eq!(outbox("DATBOX"), "CASE/DATBOX: folder: is a DATBOX; expected the case folder, which contains it");
        fs::create_dir(case.join("OUTBOX")).unwrap();
        assert_eq!(outbox("OUTBOX"), "CASE/OUTBOX: folder: is an OUTBOX; expected the case folder, which contains it");
        fs::write(case.join("OUTBOX/snapshot-000001.npz"), "").unwrap();
        assert_eq!(outbox("scene.ron"), "CASE/scene.ron: file: is a scene, not a case; did you mean CASE?");
        let snapshot = "CASE/OUTBOX/snapshot-000001.npz: file: is a snapshot, not a case; did you mean CASE?";
        assert_eq!(outbox("OUTBOX/snapshot-000001.npz"), snapshot);
        for part in [CaseFolder::Datbox, CaseFolder::Outbox, CaseFolder::Any] {
            assert_eq!(case_fault(case, part, "cd-x"), None);
            assert!(
                messages("OUTBOX", part).contains("is an OUTBOX") && messages("DATBOX", part).contains("is a DATBOX")
            );
        }
    }
}

//! Files that a DATBOX is made from, which cd-pre records with checksums in comments of COMPUTE.RON, so that cd-solve can
//! warn if one has changed since.

use std::fs;
use std::path::Path;

use crate::atomic;

/// Origin of a DATBOX.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneOrigin {
    pub command: Command,
    /// The scene first, then the models that it names; or the file of changes, then the snapshots.
    pub inputs: Vec<Input>,
    /// `PATH=VALUE` of each value that overrides the file.
    pub settings: Vec<String>,
}

/// File that DATBOX is made from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Input {
    /// Path relative to the folder that contains DATBOX.
    pub path: String,
    /// [`checksum`] of the file.
    pub checksum: u64,
}

/// Command of cd-pre that makes DATBOX.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Command {
    /// `cd-pre scene.ron`, the first input.
    Scene,
    /// `cd-pre from-outbox`, with the case, empty if it lies elsewhere, and the file of changes; paths as in [`Input`].
    FromOutbox { case: String, changes: Option<String> },
}

/// Folders, relative to the folder of DATBOX, in which a scene is tracked, and below which other files are. Files elsewhere are
/// not tracked, since they may be moved separately.
const SCENE_FOLDERS: [&str; 3] = ["", "..", "../.."];

/// Start of the comment that names the scene.
const SCENE_PREFIX: &str = "// Made from ";
/// Start of a comment that names another input.
const INPUT_PREFIX: &str = "// Made with ";
/// Start of the comment that names the case of `cd-pre from-outbox`.
const FROM_OUTBOX_PREFIX: &str = "// Made by from-outbox ";
/// Text before the checksum of an input.
const CHECKSUM_PREFIX: &str = ", checksum ";
/// Text before the file of changes.
const CHANGES_PREFIX: &str = ", --changes ";
/// Text before each setting.
const SETTING_PREFIX: &str = ", --set ";

/// Path of a file or folder relative to the folder `case`; `None` if it lies elsewhere, see [`SCENE_FOLDERS`].
fn tracked_path(path: &Path, case: &Path) -> Option<String> {
    let absolute = |path: &Path| fs::canonicalize(if path == Path::new("") { Path::new(".") } else { path }).ok();
    // A link to a file counts as the file of its own name.
    let target = match path.file_name() {
        Some(name) => absolute(path.parent()?)?.join(name),
        None => absolute(path)?,
    };
    let path_below = |folder: &str| {
        let base = absolute(&case.join(folder)).filter(|base| base.parent().is_some())?;
        Some(Path::new(folder).join(target.strip_prefix(base).ok()?).to_str()?.to_string())
    };
    SCENE_FOLDERS.into_iter().find_map(path_below).filter(|path| !path.contains(['\n', '\r']))
}

/// Settings without line breaks, so that each fits into a comment.
fn one_line_settings(settings: &[String]) -> Vec<String> {
    settings.iter().map(|setting| setting.replace(['\n', '\r'], " ")).collect()
}

/// Splits the settings off the rest of a comment.
fn split_settings(comment: &str) -> (&str, Vec<String>) {
    let mut parts = comment.split(SETTING_PREFIX);
    (parts.next().unwrap_or_default(), parts.map(str::to_string).collect())
}

impl Input {
    /// Input in a comment, behind its prefix, and the settings there.
    fn from_comment(comment: &str) -> Option<(Input, Vec<String>)> {
        let (path, rest) = comment.split_once(CHECKSUM_PREFIX)?;
        let (checksum, settings) = split_settings(rest);
        let checksum = u64::from_str_radix(checksum.trim(), 16).ok()?;
        Some((Input { path: path.to_string(), checksum }, settings))
    }
}

impl SceneOrigin {
    /// Origin of a DATBOX in the folder `case` made from a scene; none if the scene lies elsewhere.
    pub fn from_scene(scene: &Path, text: &[u8], settings: &[String], case: &Path) -> Option<SceneOrigin> {
        let path = tracked_path(scene, case)?;
        let folder = Path::new(&path).parent()?.to_str()?;
        let input = Input { path: SCENE_FOLDERS.contains(&folder).then_some(path)?, checksum: checksum(text) };
        Some(SceneOrigin { command: Command::Scene, inputs: vec![input], settings: one_line_settings(settings) })
    }

    /// Origin of a DATBOX in the folder `case` made from the results of the case `source`.
    pub fn from_outbox(source: &Path, changes: Option<&Path>, settings: &[String], case: &Path) -> SceneOrigin {
        let changes = changes.and_then(|changes| tracked_path(changes, case));
        let command = Command::FromOutbox { case: tracked_path(source, case).unwrap_or_default(), changes };
        SceneOrigin { command, inputs: Vec::new(), settings: one_line_settings(settings) }
    }

    /// Adds a file, unless it is already listed, lies elsewhere or cannot be read; `case` as in
    /// [`SceneOrigin::from_scene`].
    pub fn add(&mut self, file: &Path, case: &Path) {
        if let (Some(path), Ok(bytes)) = (tracked_path(file, case), atomic::read_bytes(file))
            && self.inputs.iter().all(|known| known.path != path)
        {
            self.inputs.push(Input { path, checksum: checksum(&bytes) });
        }
    }

    /// Lines of COMPUTE.RON, with their ends.
    pub fn lines(&self) -> String {
        let settings: String = self.settings.iter().map(|setting| format!("{SETTING_PREFIX}{setting}")).collect();
        let mut lines = String::new();
        if let Command::FromOutbox { case, changes } = &self.command {
            let changes = changes.as_ref().map_or(String::new(), |changes| format!("{CHANGES_PREFIX}{changes}"));
            lines += &format!("{FROM_OUTBOX_PREFIX}{case}{changes}{settings}\n");
        }
        for (k, Input { path, checksum }) in self.inputs.iter().enumerate() {
            let is_scene = k == 0 && self.command == Command::Scene;
            let (prefix, settings) = if is_scene { (SCENE_PREFIX, settings.as_str()) } else { (INPUT_PREFIX, "") };
            lines += &format!("{prefix}{path}{CHECKSUM_PREFIX}{checksum:016x}{settings}\n");
        }
        lines
    }

    /// Origin that a COMPUTE.RON names, if any.
    pub fn from_compute_text(text: &str) -> Option<SceneOrigin> {
        let mut lines = text.lines();
        let mut origin = lines.find_map(|line| {
            if let Some(comment) = line.strip_prefix(FROM_OUTBOX_PREFIX) {
                let (paths, settings) = split_settings(comment);
                let (case, changes) = match paths.split_once(CHANGES_PREFIX) {
                    Some((case, changes)) => (case, Some(changes.to_string())),
                    None => (paths, None),
                };
                let command = Command::FromOutbox { case: case.to_string(), changes };
                return Some(SceneOrigin { command, inputs: Vec::new(), settings });
            }
            let (scene, settings) = Input::from_comment(line.strip_prefix(SCENE_PREFIX)?)?;
            Some(SceneOrigin { command: Command::Scene, inputs: vec![scene], settings })
        })?;
        let further = lines.map_while(|line| Input::from_comment(line.strip_prefix(INPUT_PREFIX)?));
        origin.inputs.extend(further.map(|(input, _)| input));
        Some(origin)
    }

    /// Warning about files that a DATBOX in the folder `case` is made from, if they exist and have changed.
    pub fn change_warning(&self, case: &Path) -> Option<String> {
        let has_changed = |input: &&Input| {
            atomic::read_bytes(&case.join(&input.path)).is_ok_and(|bytes| checksum(&bytes) != input.checksum)
        };
        let changed = self.inputs.iter().filter(has_changed).map(|input| case.join(&input.path).display().to_string());
        let changed: Vec<String> = changed.collect();
        let (have, them) = match changed.len() {
            0 => return None,
            1 => ("has", "it"),
            _ => ("have", "them"),
        };
        let settings: String = self.settings.iter().map(|setting| format!(" --set '{setting}'")).collect();
        let command = match &self.command {
            Command::Scene => {
                let scene = &self.inputs[0].path;
                let output = if scene.starts_with("..") { format!(" -o {}", case.display()) } else { String::new() };
                format!("{}{output}", case.join(scene).display())
            }
            Command::FromOutbox { case: source, changes } => {
                let source = if source.is_empty() { "CASE".into() } else { case.join(source).display().to_string() };
                let changes = changes.as_ref().map(|changes| format!(" --changes {}", case.join(changes).display()));
                format!("from-outbox {source} {}{}", case.display(), changes.unwrap_or_default())
            }
        };
        let changed = changed.join(", ");
        Some(format!(
            "{changed} {have} changed since DATBOX was made from {them}; to use {them}, run cd-pre {command}{settings}"
        ))
    }
}

/// FNV-1a hash of 64 bits.
///
/// ```
/// assert_eq!(cd_formats::origin::checksum(b"a"), 0xaf63_dc4c_8601_ec8c);
/// ```
pub fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_that_has_changed_is_known_by_its_checksum() {
        let folder = tempfile::tempdir().unwrap();
        let (scene, case) = (folder.path().join("scene.ron"), folder.path().join("run"));
        fs::create_dir(&case).unwrap();
        fs::write(&scene, "(a: 1)").unwrap();
        let origin = SceneOrigin::from_scene(&scene, b"(a: 1)", &["b=2".into(), "c=(1, 2)".into()], &case).unwrap();
        assert_eq!(origin.inputs[0].path, "../scene.ron");
        let text = format!("// Options of cd-solve\n{}(\n)\n", origin.lines());
        assert_eq!(SceneOrigin::from_compute_text(&text).as_ref(), Some(&origin));
        assert_eq!(SceneOrigin::from_compute_text("(\n)\n"), None);
        assert_eq!(origin.change_warning(&case), None);
        fs::write(&scene, "(a: 2)").unwrap();
        let said = origin.change_warning(&case).unwrap();
        assert!(said.ends_with(&format!("-o {} --set 'b=2' --set 'c=(1, 2)'", case.display())), "{said}");
        fs::remove_file(&scene).unwrap();
        assert_eq!(origin.change_warning(&case), None);
        let far = folder.path().join("a/b/c");
        fs::create_dir_all(&far).unwrap();
        assert_eq!(SceneOrigin::from_scene(&scene, b"", &[], &far), None);
    }
    #[test]
    fn every_file_that_has_changed_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let case = at("new");
        for name in ["run/OUTBOX", "new", "models"] {
            fs::create_dir_all(at(name)).unwrap();
        }
        for name in ["changes.ron", "models/stone.stl", "run/OUTBOX/a.npz"] {
            fs::write(at(name), name).unwrap();
        }
        let mut origin =
            SceneOrigin::from_outbox(&at("run"), Some(&at("changes.ron")), &["compute.dt=1".into()], &case);
        for name in ["changes.ron", "models/stone.stl", "models/stone.stl", "run/OUTBOX/a.npz", "absent"] {
            origin.add(&at(name), &case);
        }
        assert_eq!(origin.inputs.len(), 3);
        assert_eq!(SceneOrigin::from_compute_text(&(origin.lines() + "(\n)\n")), Some(origin.clone()));
        assert_eq!(origin.change_warning(&case), None);
        fs::write(at("models/stone.stl"), "other").unwrap();
        let said = origin.change_warning(&case).unwrap();
        assert!(said.contains("new/../models/stone.stl has changed since DATBOX was made from it; "), "{said}");
        assert!(
            said.contains("run cd-pre from-outbox ") && said.ends_with("changes.ron --set 'compute.dt=1'"),
            "{said}"
        );
        fs::write(at("run/OUTBOX/a.npz"), "other").unwrap();
        assert!(origin.change_warning(&case).unwrap().contains("a.npz have changed since DATBOX was made from them; "));
        let alone = SceneOrigin::from_outbox(&at("run"), None, &[], &case);
        assert_eq!(SceneOrigin::from_compute_text(&alone.lines()), Some(alone));
    }
}

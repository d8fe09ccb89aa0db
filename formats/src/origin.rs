//! The scene that a DATBOX is made from: a comment in COMPUTE.RON, from which cd-solve knows that the scene has changed since.

use std::fs;
use std::path::Path;

/// Where a DATBOX is from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Origin {
    /// The scene's file, from the folder that DATBOX is in.
    pub scene: String,
    /// [`checksum`] of the file.
    pub checksum: u64,
    /// `PATH=VALUE` of each value that was set beyond the file.
    pub settings: Vec<String>,
}

/// Folders above that of DATBOX in which a scene is still its own; what lies elsewhere may be moved apart.
const ABOVE: [&str; 3] = ["", "..", "../.."];

const BEGIN: &str = "// Made from ";
const CHECKSUM: &str = ", checksum ";
const SET: &str = ", --set ";

impl Origin {
    /// Origin of a DATBOX in the folder `case`; none if the scene is neither in this folder nor just above it.
    pub fn of(scene: &Path, text: &[u8], settings: &[String], case: &Path) -> Option<Origin> {
        let folder = |path: &Path| fs::canonicalize(if path == Path::new("") { Path::new(".") } else { path }).ok();
        let home = folder(scene.parent()?)?;
        let above = ABOVE.into_iter().find(|above| folder(&case.join(above)).as_ref() == Some(&home))?;
        let scene = Path::new(above).join(scene.file_name()?).to_str()?.to_string();
        let settings = settings.iter().map(|setting| setting.replace(['\n', '\r'], " ")).collect();
        Some(Origin { scene, checksum: checksum(text), settings })
    }

    /// The line of COMPUTE.RON, with its end.
    pub fn line(&self) -> String {
        let settings: String = self.settings.iter().map(|setting| format!("{SET}{setting}")).collect();
        format!("{BEGIN}{}{CHECKSUM}{:016x}{settings}\n", self.scene, self.checksum)
    }

    /// The origin that a COMPUTE.RON names, if it does.
    pub fn find(text: &str) -> Option<Origin> {
        let line = text.lines().find_map(|line| line.strip_prefix(BEGIN))?;
        let (scene, rest) = line.split_once(CHECKSUM)?;
        let mut rest = rest.split(SET);
        let checksum = u64::from_str_radix(rest.next()?.trim(), 16).ok()?;
        Some(Origin { scene: scene.to_string(), checksum, settings: rest.map(str::to_string).collect() })
    }

    /// Warning if the scene of a DATBOX in the folder `case` exists and has changed.
    pub fn changed(&self, case: &Path) -> Option<String> {
        let scene = case.join(&self.scene);
        let text = fs::read(&scene).ok()?;
        (checksum(&text) != self.checksum).then(|| {
            let settings: String = self.settings.iter().map(|setting| format!(" --set '{setting}'")).collect();
            let output = if self.scene.starts_with("..") { format!(" -o {}", case.display()) } else { String::new() };
            let scene = scene.display();
            format!(
                "{scene} has changed since DATBOX was made from it; to use it, run cd-pre {scene}{output}{settings}"
            )
        })
    }
}

/// FNV-1a of 64 bits.
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
        let origin = Origin::of(&scene, b"(a: 1)", &["b=2".into(), "c=(1, 2)".into()], &case).unwrap();
        assert_eq!(origin.scene, "../scene.ron");
        let text = format!("// Options of cd-solve\n{}(\n)\n", origin.line());
        assert_eq!(Origin::find(&text).as_ref(), Some(&origin));
        assert_eq!(Origin::find("(\n)\n"), None);
        assert_eq!(origin.changed(&case), None);
        fs::write(&scene, "(a: 2)").unwrap();
        let said = origin.changed(&case).unwrap();
        assert!(said.ends_with(&format!("-o {} --set 'b=2' --set 'c=(1, 2)'", case.display())), "{said}");
        fs::remove_file(&scene).unwrap();
        assert_eq!(origin.changed(&case), None);
        let far = folder.path().join("a/b/c");
        fs::create_dir_all(&far).unwrap();
        assert_eq!(Origin::of(&scene, b"", &[], &far), None);
    }
}

//! Version of a program with the commit from which it is compiled.
//!
//! A build script would run for a whole package, and each commit would compile the library of the program again. A macro
//! is evaluated in the file that uses it: after a commit only `main.rs` is compiled, and the program linked.

use std::path::{Path, PathBuf};
use std::process::Command;

use proc_macro::TokenStream;

/// Expands to the version of the package that is compiled as a string literal: `"0.1.0 (666a78b)"`, with `-dirty` if files
/// differ from the commit; `"0.1.0"` if the package is not part of a git repository, or there is no git.
#[proc_macro]
pub fn version(_: TokenStream) -> TokenStream {
    let [folder, number] =
        ["CARGO_MANIFEST_DIR", "CARGO_PKG_VERSION"].map(|name| std::env::var(name).unwrap_or_default());
    let commit = Commit::of_package(Path::new(&folder));
    let text = commit.as_ref().map_or(number.clone(), |commit| format!("{number} ({})", commit.name));
    // The compiler records the files that it includes, so that cargo compiles again when they change.
    let includes: String = commit
        .into_iter()
        .flat_map(|commit| commit.files)
        .map(|file| format!("const _: &[u8] = ::core::include_bytes!({:?});", file.display().to_string()))
        .collect();
    format!("{{ {includes} {text:?} }}").parse().expect("constants and a string literal")
}

/// Current commit of a repository.
struct Commit {
    /// Abbreviated hash.
    name: String,
    /// Files of the repository that change with the commit.
    files: Vec<PathBuf>,
}

impl Commit {
    /// Returns `None` if the package in `folder` is not tracked, as a package unpacked inside of another project's repository.
    fn of_package(folder: &Path) -> Option<Commit> {
        git(folder, &["ls-files", "--error-unmatch", "Cargo.toml"])?;
        let name = git(folder, &["describe", "--always", "--exclude=*", "--abbrev=7", "--dirty"])?;
        // HEAD names a branch; only its log changes with every commit.
        let paths = git(folder, &["rev-parse", "--git-path", "HEAD", "--git-path", "logs/HEAD"])?;
        let files = paths.lines().map(|path| folder.join(path)).filter(|file| file.is_file()).collect();
        Some(Commit { name, files })
    }
}

/// Output of a command of git in `folder`, without the last end of line; `None` if it fails.
fn git(folder: &Path, words: &[&str]) -> Option<String> {
    let output = Command::new("git").arg("-C").arg(folder).args(words).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim_end().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn commit_all(folder: &Path) {
        let identity = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"];
        for words in [&["init", "--quiet"][..], &["add", "Cargo.toml"], &["commit", "--quiet", "--message", "a"]] {
            git(folder, &[&identity, words].concat()).expect("git");
        }
    }

    #[test]
    fn a_package_outside_of_a_repository_has_no_commit() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("Cargo.toml"), "").unwrap();
        assert!(Commit::of_package(folder.path()).is_none());
    }

    #[test]
    fn a_tracked_package_has_the_commit_and_an_untracked_one_has_none() {
        let folder = tempfile::tempdir().unwrap();
        let manifest = folder.path().join("Cargo.toml");
        std::fs::write(&manifest, "").unwrap();
        commit_all(folder.path());
        let commit = Commit::of_package(folder.path()).unwrap();
        assert!(commit.name.len() >= 7 && commit.name.bytes().all(|b| b.is_ascii_hexdigit()), "{}", commit.name);
        assert!(commit.files.iter().any(|file| file.ends_with("logs/HEAD")), "{:?}", commit.files);

        std::fs::write(&manifest, "[package]").unwrap();
        assert_eq!(Commit::of_package(folder.path()).unwrap().name, format!("{}-dirty", commit.name));

        let inside = folder.path().join("unpacked");
        std::fs::create_dir(&inside).unwrap();
        std::fs::write(inside.join("Cargo.toml"), "").unwrap();
        assert!(Commit::of_package(&inside).is_none());
    }
}

//! Messages of cd-post about its command line and its files.

use std::fs;
use std::path::Path;
use std::process::Command;

fn said(arguments: &[&str], folder: &Path) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_cd-post")).args(arguments).current_dir(folder).output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn a_misspelt_command_gets_the_nearest() {
    let folder = tempfile::tempdir().unwrap();
    let nearest = |word: &str, near: &str| {
        let expected = format!("cd-post: {word}: is no folder and no command; did you mean {near}?\n");
        assert_eq!(said(&[word, "b"], folder.path()), (2, expected.clone()));
        assert_eq!(said(&[word], folder.path()), (2, expected));
    };
    nearest("stat", "state");
    nearest("tack", "track");
    nearest("comapre", "compare");
    // A folder is a folder.
    fs::create_dir(folder.path().join("stat")).unwrap();
    let (code, text) = said(&["stat"], folder.path());
    assert!(code == 2 && !text.contains("did you mean"), "{text}");
}

#[test]
fn a_truncated_snapshot_is_named() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("OUTBOX")).unwrap();
    fs::write(folder.path().join("OUTBOX/snapshot-000003.npz"), b"PK\x03\x04 and no more").unwrap();
    let (code, text) = said(&["."], folder.path());
    assert_eq!(code, 2);
    assert!(
        text.ends_with("snapshot-000003.npz: snapshot: the file is truncated; expected an .npz file of cd-solve\n"),
        "{text}"
    );
}

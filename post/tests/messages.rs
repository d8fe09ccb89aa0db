//! Messages of cd-post about its command line and its files.

use std::fs;
use std::path::Path;
use std::process::Command;

fn messages(arguments: &[&str], folder: &Path) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_cd-post")).args(arguments).current_dir(folder).output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn a_misspelt_command_gets_the_nearest() {
    let folder = tempfile::tempdir().unwrap();
    let nearest = |word: &str, near: &str| {
        let expected = format!("cd-post: {word}: is neither a folder nor a command; did you mean {near}?\n");
        assert_eq!(messages(&[word, "b"], folder.path()), (2, expected.clone()));
        assert_eq!(messages(&[word], folder.path()), (2, expected));
    };
    nearest("stat", "state");
    nearest("tack", "track");
    nearest("comapre", "compare");
    // A folder is a folder.
    fs::create_dir(folder.path().join("stat")).unwrap();
    let (code, text) = messages(&["stat"], folder.path());
    assert!(code == 2 && !text.contains("did you mean"), "{text}");
}

#[test]
fn a_truncated_snapshot_is_named() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("OUTBOX")).unwrap();
    fs::write(folder.path().join("OUTBOX/snapshot-000003.npz"), b"PK\x03\x04 and no more").unwrap();
    let (code, text) = messages(&["."], folder.path());
    assert_eq!(code, 2);
    assert!(
        text.ends_with("snapshot-000003.npz: snapshot: the file is truncated; expected an .npz file of cd-solve\n"),
        "{text}"
    );
}

#[test]
fn what_is_no_case_says_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let messages = |line: &str| {
        let (code, text) = messages(&line.split(' ').collect::<Vec<_>>(), folder.path());
        assert_eq!(code, 2, "{text}");
        text
    };
    fs::write(folder.path().join("scene.ron"), "()").unwrap();
    for command in ["", "state ", "report ", "track --body 1 "] {
        let expected = "is a scene, not a case; run cd-pre scene.ron and cd-solve . first";
        assert_eq!(messages(&format!("{command}scene.ron")), format!("cd-post: scene.ron: file: {expected}\n"));
    }
    fs::create_dir(folder.path().join("OUTBOX")).unwrap();
    fs::write(folder.path().join("OUTBOX/snapshot-000003.npz"), "").unwrap();
    assert_eq!(messages("scene.ron"), "cd-post: scene.ron: file: is a scene, not a case; did you mean .?\n");
    assert_eq!(
        messages("OUTBOX"),
        "cd-post: OUTBOX: folder: is an OUTBOX; expected the case folder, which contains it\n"
    );
    let snapshot = "OUTBOX/snapshot-000003.npz";
    assert_eq!(messages(snapshot), format!("cd-post: {snapshot}: file: is a snapshot, not a case; did you mean .?\n"));
    let absent = "folder: there is no such folder; expected the folder of a case";
    assert_eq!(messages("absent"), format!("cd-post: absent: {absent}, with OUTBOX in it\n"));
    assert_eq!(messages("compare absent other"), format!("cd-post: absent: {absent}\ncd-post: other: {absent}\n"));
    for command in ["study", "accuracy-study"] {
        let expected = "cd-post: absent.csv: file: cannot be read: there is no such file\n";
        assert_eq!(messages(&format!("{command} absent.csv")), expected);
    }
    assert_eq!(messages(". state"), "cd-post: state: a command comes first; did you mean cd-post state .?\n");
    assert_eq!(messages(". no-vtk"), "cd-post: no-vtk: is not expected here; did you mean --no-vtk?\n");
}

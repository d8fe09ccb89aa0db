//! The path of docs/reference/lmgc90.md: its files are written, its commands run, and what it shows is printed.

use std::ffi::OsString;
use std::fs;

use cd_formats::compute::ComputeFlags;
use cd_tests::pages::project_folder;

/// Kind and text of each block of code of the page.
fn blocks(page: &str) -> Vec<(&str, &str)> {
    let blocks = page.split("```").skip(1).step_by(2);
    blocks.map(|block| block.split_once('\n').unwrap()).collect()
}

#[test]
fn the_commands_of_the_page_lead_to_a_picture() {
    let page = fs::read_to_string(project_folder().join("docs/reference/lmgc90.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    // The only test of this program: no other uses the current folder.
    std::env::set_current_dir(folder.path()).unwrap();
    let mut commands = 0;
    for (kind, text) in blocks(&page) {
        if let Some(file) = kind.split_once(' ').map(|(_, file)| file) {
            fs::write(file, text).unwrap();
        } else if kind == "sh" {
            for line in text.lines() {
                let words: Vec<&str> = line.split(' ').collect();
                let arguments = words.iter().map(OsString::from);
                match words[0] {
                    "cd-pre" => assert_eq!(cd_pre::run(arguments), 0, "{line}"),
                    "cd-solve" => assert_eq!(cd_solve::run(arguments), 0, "{line}"),
                    "cd-post" => assert_eq!(cd_post::run(arguments), 0, "{line}"),
                    "rm" => fs::remove_file(words[1]).unwrap(),
                    _ => panic!("{line}"),
                }
                commands += 1;
            }
        } else if kind == "text" {
            let script = "pyramid/command.py".as_ref();
            let read =
                cd_solve::read::driver::read_driver(script, "pyramid".as_ref(), &ComputeFlags::default()).unwrap();
            let printed: Vec<String> = read.notes.iter().map(|note| format!("cd-solve: {note}")).collect();
            assert!(text.lines().all(|line| printed.iter().any(|note| note == line)), "{printed:#?}");
        }
    }
    assert_eq!(commands, 5);
    for file in ["OUTBOX/DOF.OUT.4", "OUTBOX/Vloc_Rloc.OUT.4", "POSTPRO/snapshots.svg", "DISPLAY/view.py"] {
        assert!(folder.path().join("pyramid").join(file).exists(), "{file}");
    }
    // The blocks are at rest, as in LMGC90.
    let last = cd_formats::snapshot::Snapshot::read("pyramid/OUTBOX/snapshot-000200.npz".as_ref()).unwrap();
    let speeds = last.bodies.body_v.iter().flatten().map(|v| v.abs());
    assert!(speeds.fold(0.0, f64::max) < 1e-12); // m/s; roundings of g dt
}

//! The examples: their scenes are accepted, and their rules make again what follows from a change and nothing else.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use cd_formats::compute::ComputeFlags;
use cd_solve::limits;
use cd_solve::read::read_case;
use cd_tests::case::{Case, pre};
use tempfile::TempDir;

fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples")
}

/// Folder of each example.
fn folders() -> Vec<PathBuf> {
    fs::read_dir(examples()).unwrap().flatten().map(|entry| entry.path()).filter(|path| path.is_dir()).collect()
}

/// Folder of each example, with the surfaces that its scenes name and that are not in the repository: its Makefile writes them
/// before each target but `clean`.
fn folders_with_surfaces() -> &'static [PathBuf] {
    static FOLDERS: OnceLock<Vec<PathBuf>> = OnceLock::new();
    FOLDERS.get_or_init(|| {
        let folders = folders();
        for folder in &folders {
            assert!(Command::new("make").arg("-C").arg(folder).arg("help").output().unwrap().status.success());
        }
        folders
    })
}

#[test]
fn scenes_are_accepted_and_begin_to_run() {
    let mut count = 0;
    for folder in folders_with_surfaces() {
        for name in ["scene.ron", "Makefile", "README.md"] {
            assert!(folder.join(name).is_file(), "no {name} in {}", folder.display());
        }
        let case = Case::empty();
        assert_eq!(pre(&folder.join("scene.ron"), case.path()), 0, "cd-pre rejected the scene of {}", folder.display());
        let case = case.solved(&["--steps", "2"]);
        let (scene, state) = read_case(case.path(), &ComputeFlags::default()).unwrap();
        let warnings = limits::scene_warnings(&scene, &state, &[]);
        assert!(warnings.is_empty(), "{}: {warnings:?}", folder.display());
        count += 1;
    }
    assert!(count >= 5);
}

#[test]
fn studies_are_accepted() {
    let mut count = 0;
    let names = ["study.ron", "fluid.ron", "presets.ron", "targets.ron"];
    for study in folders_with_surfaces().iter().flat_map(|folder| names.map(|name| folder.join(name))) {
        if study.is_file() {
            // One of many seeds.
            let text = fs::read_to_string(&study).unwrap();
            let has_many = ["seeds: [1, 2, 3, 4, 5]", "seeds: [201,", "seeds: [301,", "seeds: [\n"]
                .iter()
                .any(|seeds| text.contains(seeds));
            let flags: &[&str] = if has_many { &["--replicates", "1"] } else { &[] };
            let output = tempfile::tempdir().unwrap();
            let words =
                ["cd-pre".as_ref(), "study".as_ref(), study.as_os_str(), "-o".as_ref(), output.path().as_os_str()];
            let words = words.into_iter().chain(flags.iter().map(|flag| flag.as_ref()));
            assert_eq!(cd_pre::run(words.map(Into::into)), 0, "{}", study.display());
            count += 1;
        }
    }
    assert!(count >= 5);
}

/// Makefiles are read by physicists: examples have no functions of make that generate rules and commands, and a comment on
/// all that can be set.
#[test]
fn makefiles_are_plain_and_say_what_can_be_set() {
    for makefile in folders().iter().map(|folder| folder.join("Makefile")) {
        let text = fs::read_to_string(&makefile).unwrap();
        for function in ["$(foreach", "$(call"] {
            assert!(!text.contains(function), "{}: {function}", makefile.display());
        }
    }
    let rules = ["rules.mk", "help.mk"].map(|name| examples().join(name));
    for path in folders().into_iter().map(|folder| folder.join("Makefile")).chain(rules) {
        let text = fs::read_to_string(&path).unwrap();
        assert!(!text.contains("eval"), "{}", path.display());
        let lines: Vec<&str> = text.lines().collect();
        for pair in lines.windows(2).filter(|pair| {
            pair[1].contains(" ?= ") && !pair[1].starts_with(['#', ' ']) && !pair[1].starts_with("FIGURES")
        }) {
            assert!(pair[0].starts_with("## "), "{}: no comment on {}", path.display(), pair[1]);
        }
    }
}

/// The first comment of a script names the files that it reads and the files that it writes.
#[test]
fn scripts_say_what_they_read_and_write() {
    let files = folders().into_iter().chain([examples()]).flat_map(|folder| fs::read_dir(folder).unwrap().flatten());
    // Not the functions that scripts share.
    let is_script = |path: &PathBuf| {
        path.extension().is_some_and(|ending| ending == "awk" || ending == "sh") && !path.ends_with("cases.sh")
    };
    let scripts = files.map(|file| file.path()).filter(is_script);
    for path in scripts {
        let text = fs::read_to_string(&path).unwrap();
        let head: Vec<&str> = text.lines().take_while(|line| line.starts_with('#')).collect();
        for start in ["# Reads: ", "# Writes: "] {
            assert!(head.iter().any(|line| line.starts_with(start)), "{}: no line '{start}'", path.display());
        }
        let is_command = |line: &&str| line.contains("awk -") || line.contains(".sh ");
        assert!(head.iter().any(is_command), "{}: no command", path.display());
    }
}

/// The rules of the examples around programs that only say that they ran.
struct Rules(TempDir);

impl Rules {
    fn new() -> Rules {
        let rules = Rules(tempfile::tempdir().unwrap());
        rules.write("scene.ron", "");
        rules.write("Makefile", &format!("STAGES := pre solve post\ninclude {}/rules.mk\n", examples().display()));
        for (program, file) in [("cd-pre", "DATBOX/BODIES.DAT"), ("cd-solve", "OUTBOX/snapshot-000001.npz")] {
            rules.program(program, &format!("mkdir -p {} && touch {file}", &file[..6]));
        }
        rules.program("cd-post", "mkdir -p POSTPRO && touch POSTPRO/series.csv");
        rules
    }

    /// Rules of a study; each test writes its cd-pre and cd-post.
    fn with_study() -> Rules {
        let rules = Rules::new();
        let rest = format!("STAGES := pre solve post\ninclude {}/rules.mk\n", examples().display());
        rules.write("Makefile", &format!("STUDY := study.ron\n{rest}"));
        rules.write("study.ron", "");
        rules.program("cd-solve", "mkdir -p $2/OUTBOX && touch $2/OUTBOX/snapshot-000001.npz");
        rules
    }

    fn write(&self, name: &str, text: &str) {
        fs::create_dir_all(self.0.path().join(name).parent().unwrap()).unwrap();
        fs::write(self.0.path().join(name), text).unwrap();
    }

    /// A program that notes its name and flags and then does `action`.
    fn program(&self, name: &str, action: &str) {
        self.write(&format!("bin/{name}"), &format!("#!/bin/sh\necho {name} $* >> ran\n{action}\n"));
        fs::set_permissions(self.0.path().join("bin").join(name), fs::Permissions::from_mode(0o755)).unwrap();
    }

    /// Whether make ended well, and the programs that ran, each with its first flag.
    fn make(&self, arguments: &[&str]) -> (bool, String) {
        let ran = self.0.path().join("ran");
        let _ = fs::remove_file(&ran);
        // File times go in ticks of some milliseconds: what is written before and after must not have the same.
        let tick = || std::thread::sleep(std::time::Duration::from_millis(25));
        tick();
        let output = Command::new("make")
            .current_dir(&self.0)
            .args(arguments)
            .arg("CD_BIN=bin")
            // What a make that runs these tests hands down.
            .env_remove("MAKEFLAGS")
            .env_remove("MAKELEVEL")
            .env_remove("MFLAGS")
            .output()
            .expect("make, which these tests need");
        tick();
        let ran = fs::read_to_string(ran).unwrap_or_default();
        let short = |line: &str| {
            line.split(' ').take(2).filter(|word| *word != "." && *word != "./scene.ron").collect::<Vec<_>>().join(" ")
        };
        (output.status.success(), ran.lines().map(short).collect::<Vec<_>>().join(", "))
    }

    fn runs(&self, arguments: &[&str], expected: &str) {
        assert_eq!(self.make(arguments), (true, expected.to_string()), "make {arguments:?}");
    }
}

#[test]
fn a_stage_is_made_again_when_its_input_or_program_changed() {
    let rules = Rules::new();
    let all = "cd-pre, cd-solve --force, cd-post";
    rules.runs(&[], all);
    rules.runs(&[], "");
    for (touched, follows) in [
        ("scene.ron", all),
        ("bin/cd-pre", all),
        ("DATBOX/BODIES.DAT", "cd-solve --force, cd-post"),
        ("bin/cd-solve", "cd-solve --force, cd-post"),
        ("OUTBOX/snapshot-000001.npz", "cd-post"),
        ("bin/cd-post", "cd-post"),
        ("POSTPRO/series.csv", ""),
    ] {
        let path = rules.0.path().join(touched);
        fs::File::options().append(true).open(&path).unwrap().set_modified(std::time::SystemTime::now()).unwrap();
        rules.runs(&["-n"], "");
        rules.runs(&[], follows);
        rules.runs(&[], "");
    }
    rules.runs(&["clean"], "");
    rules.runs(&["pre"], "cd-pre");
    rules.runs(&["solve"], "cd-solve --force");
    rules.runs(&["clean", "all"], all);
}

#[test]
fn a_case_is_made_again_when_a_variable_of_the_example_changed() {
    let rules = Rules::new();
    let all = "cd-pre, cd-solve --force, cd-post";
    for flags in [
        "PRE_FLAGS=",
        "PRE_FLAGS=--set 'laws.1.kind=IQS_CLB(friction: 0)'",
        "PRE_FLAGS=--set 'grains.1.colour=\"REDxx\"'",
    ] {
        rules.runs(&[flags], all);
        rules.runs(&[flags], "");
    }
    // Not with these, which may be about threads or plots.
    rules.runs(&["PRE_FLAGS=--set 'grains.1.colour=\"REDxx\"'", "SOLVE_FLAGS=--threads 1", "POST_FLAGS=--no-vtk"], "");

    let example = format!(
        "SPEED ?= 1\nSTAGES := pre solve post\noverride PRE_FLAGS += --set 'speed=$(SPEED)'\ninclude {}/rules.mk\n",
        examples().display()
    );
    rules.write("Makefile", &example);
    rules.runs(&[], all);
    rules.runs(&["SPEED=2"], all);
    rules.runs(&["SPEED=2"], "");
    rules.runs(&["SPEED=2", "PRE_FLAGS=--quiet"], all);
}

#[test]
fn cases_of_a_study_are_made_again_when_they_changed() {
    let rules = Rules::with_study();
    // As cd-pre study: `b` continues from `a`; what is there is left alone.
    rules.program(
        "cd-pre",
        "case $1 in\n\
         study)\n\
             mkdir -p a b; test -e a/scene.ron || touch a/scene.ron; test -e b/changes.ron || touch b/changes.ron\n\
             printf 'CASES := b a\\nstudy.mk: study.ron\\na/DATBOX/.done: a/scene.ron\\n\\\n\
                 b/DATBOX/.done: b/changes.ron a/OUTBOX/.done\\n' | sed 's/^ *//' > study.mk;;\n\
         from-outbox) mkdir -p $3/DATBOX; touch $3/DATBOX/BODIES.DAT;;\n\
         *) mkdir -p $3/DATBOX; touch $3/DATBOX/BODIES.DAT;;\n\
         esac",
    );
    rules.program("cd-post", "mkdir -p $1/POSTPRO && touch $1/POSTPRO/series.csv");
    rules.runs(
        &[],
        "cd-pre study, cd-pre a/scene.ron, cd-solve --force, cd-pre from-outbox, cd-solve --force, cd-post b, cd-post a",
    );
    rules.runs(&["-j2"], "");
    let on = "cd-pre from-outbox, cd-solve --force, cd-post b";
    for (written, follows) in [
        ("study.ron", "cd-pre study".to_string()),
        ("b/changes.ron", on.to_string()),
        ("a/scene.ron", format!("cd-pre a/scene.ron, cd-solve --force, {on}, cd-post a")),
    ] {
        rules.write(written, "");
        rules.runs(&[], &follows);
        rules.runs(&[], "");
    }
    rules.runs(&["CASES=a", "PRE_FLAGS=--quiet"], "cd-pre a/scene.ron, cd-solve --force, cd-post a");
    // Neither needs the study.
    rules.write("study.ron", "");
    rules.runs(&["help"], "");
    rules.runs(&["clean"], "");
}

/// `make until` repeats the study with more seeds until no parameter set needs more, and keeps the runs that are there.
#[test]
fn seeds_are_added_until_a_mean_is_known() {
    let rules = Rules::with_study();
    // As cd-pre study --replicates N: cases s1 to sN.
    rules.program(
        "cd-pre",
        "case $1 in\n\
         study)\n\
             all=\n\
             for k in $(seq $3); do\n\
                 all=\"$all s$k\"; mkdir -p s$k; test -e s$k/scene.ron || touch s$k/scene.ron\n\
             done\n\
             echo CASES := $all > study.mk; echo study.mk: study.ron >> study.mk\n\
             for k in $(seq $3); do echo s$k/DATBOX/.done: s$k/scene.ron >> study.mk; done;;\n\
         *) mkdir -p $3/DATBOX; touch $3/DATBOX/BODIES.DAT;;\n\
         esac",
    );
    // As cd-post study: two parameter sets, of which the second needs more runs.
    let post = |needed: &str| {
        format!(
            "case $1 in\n\
             study) mkdir -p replicates; printf 'mu,quantity,runs,mean,needed\\n0.2,Z,3,4.5,2\\n0.4,Z,3,4.6,{needed}\\n\
                 0.4,nu,3,0.6,900\\n' > replicates/means.csv;;\n\
             *) mkdir -p $1/POSTPRO && touch $1/POSTPRO/series.csv;;\n\
             esac"
        )
    };
    rules.program("cd-post", &post("5"));
    let case = |k: usize| format!("cd-pre s{k}/scene.ron, cd-solve --force, cd-post s{k}");
    let round = |seeds: [usize; 2]| {
        let cases: Vec<String> = (seeds[0]..=seeds[1]).map(case).collect();
        format!("cd-pre study, {}, cd-post study", cases.join(", "))
    };
    rules.runs(&["until"], &format!("{}, {}", round([1, 3]), round([4, 5])));
    // All runs are there, but not known: the means are made again.
    rules.program("cd-post", &post("40"));
    let (well, ran) = rules.make(&["until", "MAX_SEEDS=6"]);
    assert!(!well && ran.ends_with("cd-post s6, cd-post study"), "{ran}");
    assert!(!rules.make(&["until", "QUANTITY=zeta"]).0);
    // Wrong values are rejected before the first run.
    let wrong_errors = ["ERROR=-0.1", "ERROR=1%", "ERROR=0", "ERROR=.", "ERROR="];
    let wrong_seeds = ["MAX_SEEDS=1", "MAX_SEEDS=many", "MAX_SEEDS=-3", "MAX_SEEDS=", "MAX_SEEDS=99999999999999999999"];
    for wrong in [&wrong_errors[..], &wrong_seeds, &["QUANTITY=", "QUANTITY=Z nu"]].concat() {
        assert_eq!(rules.make(&["until", wrong]), (false, String::new()), "{wrong}");
    }
    assert_eq!(Rules::new().make(&["until"]), (false, String::new()), "without a study");
}

#[test]
fn what_was_interrupted_continues() {
    let rules = Rules::new();
    rules.runs(&["pre"], "cd-pre");
    rules.runs(&["-j2", "resume"], "cd-solve --resume, cd-post");
    rules.runs(&["resume"], "");
    // As for a later end.
    rules.runs(&["-j2", "resume", "SOLVE_FLAGS=--steps 9"], "cd-solve --resume, cd-post");
    rules.runs(&[], "");
}

#[test]
fn a_stage_that_failed_is_not_done() {
    let rules = Rules::new();
    rules.runs(&[], "cd-pre, cd-solve --force, cd-post");
    // It has written something when it is killed.
    rules.program("cd-solve", "touch OUTBOX/snapshot-000002.npz; kill -9 $$");
    for _ in 0..2 {
        assert_eq!(rules.make(&[]), (false, "cd-solve --force".to_string()));
    }
    rules.program("cd-solve", "touch OUTBOX/snapshot-000003.npz");
    rules.runs(&["resume"], "cd-solve --resume, cd-post");
    rules.runs(&[], "");

    for (status, well) in [(1, true), (2, false), (3, false)] {
        rules.program("cd-post", &format!("mkdir -p POSTPRO; touch POSTPRO/series.csv; exit {status}"));
        assert_eq!(rules.make(&[]), (well, "cd-post".to_string()), "status {status}");
    }
}

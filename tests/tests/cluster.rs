//! examples/cluster: its scripts run each case of the study once, in order, with a Slurm and programs that only say that they ran.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

/// `sbatch` that runs the tasks of the array at once, again as long as they request it, and notes its options.
const SBATCH: &str = r#"echo sbatch "$@" >> ran
until [ -f "$1" ]; do
    case "$1" in --array=*) rows=${1#--array=} ;; esac
    shift
done
job=$(( $(cat jobs 2> /dev/null || echo 0) + 1 ))
echo $job > jobs
for row in $(echo "$rows" | tr , ' '); do
    export SLURM_ARRAY_JOB_ID=$job SLURM_ARRAY_TASK_ID=$row SLURM_CPUS_PER_TASK=1
    touch again
    while [ -e again ]; do rm again; bash "$@" || { echo failed $row >> ran; exit 1; }; done
done > output
echo "$job;cluster"
"#;

/// The folder of the example with its study written, and stand-ins for Slurm and the programs on PATH.
struct Study(TempDir);

impl Study {
    fn new() -> Study {
        let study = Study(tempfile::tempdir().unwrap());
        let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/cluster");
        for name in ["scene.ron", "changes.ron", "study.ron", "submit.sh", "case.sbatch"] {
            fs::copy(example.join(name), study.path(name)).unwrap();
        }
        let words = ["cd-pre".into(), "study".into(), study.path("study.ron").into_os_string()];
        assert_eq!(cd_pre::run(words), 0);
        fs::create_dir(study.path("bin")).unwrap();
        study.program("sbatch", SBATCH);
        study.program("srun", "exec \"$@\"");
        study.program("scontrol", "echo scontrol \"$@\" >> ran; touch again");
        study.program("cd-pre", "echo cd-pre \"$@\" >> ran");
        study.program("cd-solve", "echo cd-solve \"$@\" >> ran");
        study.program("cd-post", "echo cd-post \"$@\" >> ran");
        study
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn program(&self, name: &str, action: &str) {
        let path = self.path("bin").join(name);
        fs::write(&path, format!("#!/bin/bash\n{action}\n")).unwrap();
        fs::set_permissions(path, fs::Permissions::from_mode(0o755)).unwrap();
    }

    fn submit(&self, arguments: &[&str]) -> Output {
        let path = format!("{}:{}", self.path("bin").display(), std::env::var("PATH").unwrap());
        let run = Command::new("./submit.sh").current_dir(&self.0).args(arguments).env("PATH", path).output();
        run.expect("bash and awk, which these tests need")
    }

    /// Returns the programs that ran since the last call with their arguments, a line each.
    fn ran(&self) -> Vec<String> {
        let ran = fs::read_to_string(self.path("ran")).unwrap_or_default();
        let _ = fs::remove_file(self.path("ran"));
        ran.lines().map(String::from).collect()
    }
}

#[test]
fn each_case_runs_once_and_after_the_case_that_it_starts_from() {
    let study = Study::new();
    let output = study.submit(&["study.csv", "--time=01:00:00"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let cases: Vec<String> =
        ["0.2", "0.6"].iter().flat_map(|mu| (1..=3).map(move |s| format!("mu{mu}-s{s}"))).collect();
    let stages = |case: &str, pre: String| {
        [pre, format!("cd-solve {case} --resume --threads 1"), format!("cd-post {case} --no-vtk --threads 1")]
    };
    let mut expected = vec!["sbatch --parsable --array=1,2,3,4,5,6 --time=01:00:00 case.sbatch study.csv".to_string()];
    expected.extend(cases.iter().flat_map(|case| stages(case, format!("cd-pre {case}/scene.ron"))));
    expected.push(
        "sbatch --parsable --array=7,8,9,10,11,12 --dependency=afterok:1 --kill-on-invalid-dep=yes --time=01:00:00 \
         case.sbatch study.csv"
            .to_string(),
    );
    expected.extend(cases.iter().flat_map(|from| {
        let case = format!("spun-{from}");
        stages(&case, format!("cd-pre from-outbox {from} {case} --changes {case}/changes.ron"))
    }));
    assert_eq!(study.ran(), expected);
}

#[test]
fn a_task_that_reaches_the_limit_of_time_continues() {
    let study = Study::new();
    let once = "echo cd-solve \"$@\" >> ran\nmkdir -p $1/DATBOX && touch $1/DATBOX/COMPUTE.RON\n\
                [ -e $1/stopped ] || { touch $1/stopped; exit 4; }";
    study.program("cd-solve", once);
    assert!(study.submit(&["study.csv"]).status.success());
    let ran = study.ran();
    let of_first: Vec<&str> = ran[1..6].iter().map(|line| line.split(' ').next().unwrap()).collect();
    assert_eq!(of_first, ["cd-pre", "cd-solve", "scontrol", "cd-solve", "cd-post"]);
    assert_eq!(ran[3], "scontrol requeue 1_1");
}

/// Exit code 1 means that a stage is done, with something reported; others end the task, and what depends on it is not submitted.
#[test]
fn a_failure_ends_the_task_and_a_report_does_not() {
    let study = Study::new();
    study.program("cd-solve", "exit 1");
    assert!(study.submit(&["study.csv"]).status.success());
    assert_eq!(study.ran().iter().filter(|line| line.starts_with("cd-post")).count(), 12);
    study.program("cd-solve", "exit 2");
    assert!(!study.submit(&["study.csv"]).status.success());
    let ran = study.ran();
    assert!(ran.contains(&"failed 1".to_string()) && ran.iter().all(|line| !line.starts_with("cd-post")), "{ran:?}");
}

#[test]
fn a_table_that_is_not_there_is_named() {
    let study = Study::new();
    let output = study.submit(&["none.csv"]);
    assert_eq!(output.status.code(), Some(2));
    let words = String::from_utf8_lossy(&output.stderr);
    assert_eq!(words, "submit.sh: none.csv: cannot be read; expected the table that cd-pre study writes\n");
}

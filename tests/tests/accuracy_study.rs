//! The study of the options of a scene, from `cd-pre accuracy-study` to the recommended setting.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use cd_tests::case::{cloud, post, pre, solve};
use tempfile::TempDir;

fn cd_pre(words: &[&str]) -> i32 {
    cd_pre::run(["cd-pre"].iter().chain(words).map(|word| word.into()))
}

fn cd_post(words: &[&str]) -> i32 {
    cd_post::run(["cd-post"].iter().chain(words).map(|word| word.into()))
}

/// Rows of a table by the names of its columns.
fn rows(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names: Vec<String> = lines.next().unwrap().split(',').map(str::to_string).collect();
    lines.map(|line| names.iter().cloned().zip(line.split(',').map(str::to_string)).collect()).collect()
}

/// Folder with ten spheres that fall towards each other and do not meet yet: errors of the time step
/// alone.
fn falling_cloud() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.ron"), cloud(10, 0.4, 1, "dt: 10.0, steps: 32, output_every: 16")).unwrap();
    folder
}

#[test]
fn a_study_finds_the_order_and_the_fastest_setting() {
    let folder = falling_cloud();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let (scene, study) = (path("scene.ron"), path("accuracy-study/study.ron"));
    assert_eq!(cd_pre(&["accuracy-study", &scene, "--replicates", "2", "--options", "dt,theta"]), 0);
    assert_eq!(cd_pre(&["study", &study]), 0);
    let makefile = fs::read_to_string(path("accuracy-study/Makefile")).unwrap();
    assert!(makefile.contains("FROM ?= 256\n"), "{makefile}");
    let table = path("accuracy-study/study.csv");
    let cases = rows(Path::new(&table));
    // Four time steps, three values of theta and the reference, with two seeds.
    assert_eq!(cases.len(), 2 * (4 + 3 + 1));
    for case in &cases {
        let case = folder.path().join("accuracy-study").join(&case["case"]);
        assert_eq!(pre(&case.join("scene.ron"), &case), 0);
        assert_eq!(solve(&case, &["--threads", "1"]), 0);
        // Hulls, the default, take long in an unoptimised build.
        assert_eq!(post(&case, &["--no-plots", "--no-vtk", "--region", "ball:100@com"]), 0);
    }
    let output = path("results");
    let words = ["accuracy-study", &table, "-o", &output, "--from", "256", "--observables", "a"];
    assert_eq!(cd_post(&[&words[..], &["--error", "0.5,1e-12"]].concat()), 0);
    for name in ["accuracy.csv", "orders.csv", "accuracy.svg", "bias.svg"] {
        assert!(Path::new(&output).join(name).is_file(), "{name}");
    }
    let biases = rows(&Path::new(&output).join("bias.csv"));
    assert_eq!(biases.len(), 7 * (4 + 3 + 1));
    let orders = rows(&Path::new(&output).join("bias_orders.csv"));
    let order = |group: &str| {
        let row = orders.iter().find(|row| row["group"] == group && row["observable"] == "a").unwrap();
        row["order"].parse::<f64>().unwrap()
    };
    // The theta scheme is of second order with 1/2, and its error is proportional to theta - 1/2; the longest steps have some
    // of the next orders.
    assert!((order("dt") - 2.0).abs() < 0.1, "{orders:?}");
    assert!((order("theta") - 1.0).abs() < 0.1, "{orders:?}");
    let recommended = rows(&Path::new(&output).join("recommended.csv"));
    let settings = rows(&Path::new(&output).join("settings.csv"));
    let seconds = |row: &BTreeMap<String, String>| row["seconds"].parse::<f64>().unwrap();
    let compared = settings.iter().filter(|row| !row["setting"].contains("reference"));
    let fastest = compared.map(seconds).fold(f64::INFINITY, f64::min);
    // All have the error of one half; none the error of rounding.
    assert_eq!(seconds(&recommended[0]), fastest);
    assert_eq!((recommended[1]["setting"].as_str(), recommended[1]["needed"].as_str()), ("", ""));
}

#[test]
fn faults_of_a_study_of_options_say_what_to_do() {
    let folder = falling_cloud();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let scene = path("scene.ron");
    let study = ["accuracy-study", &scene];
    let files = || fs::read_dir(folder.path()).unwrap().count();
    // Options that do not exist, or have no effect; a reference that is not finer than the other settings.
    for flags in [["--options", "to"], ["--options", "narrow_phase"], ["--reference-dt", "5"]] {
        assert_eq!(cd_pre(&[&study[..], &flags].concat()), 2, "{flags:?}");
    }
    fs::write(path("changes.ron"), "(compute: (dt: 1.0, steps: 5))").unwrap();
    assert_eq!((cd_pre(&["accuracy-study", &path("changes.ron")]), files()), (2, 2));
    // Files that are not its own are kept.
    fs::create_dir(path("accuracy-study")).unwrap();
    fs::write(path("accuracy-study/Makefile"), "all:\n").unwrap();
    assert_eq!(cd_pre(&study), 2);
    assert_eq!(fs::read_to_string(path("accuracy-study/Makefile")).unwrap(), "all:\n");
}

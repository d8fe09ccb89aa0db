//! Makes the expected files of `tests/golden` anew, of all scenes or of those named, and prints the largest change of
//! each column; `!` marks what the tests would not have allowed. Files of a stage without such a change stay as they
//! are. A stage whose input was made anew changes by that too.

use cd_tests::golden::{rewrite, scenes};

fn main() {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let name = |scene: &std::path::Path| scene.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let known: Vec<String> = scenes().iter().map(|scene| name(scene)).collect();
    if let Some(unknown) = wanted.iter().find(|scene| !known.contains(scene)) {
        eprintln!("golden: no scene '{unknown}'; there are {}", known.join(", "));
        std::process::exit(2);
    }
    let chosen = scenes().into_iter().filter(|scene| wanted.is_empty() || wanted.contains(&name(scene)));
    let reports: Vec<String> = chosen.map(|scene| rewrite(&scene)).collect();
    println!("\n{}", reports.concat());
}

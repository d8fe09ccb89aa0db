//! The reference of scenes is complete, and what the guides and the reference show is accepted.

use std::path::{Path, PathBuf};

use cd_formats::compute::{Compute, Event, from_ron};
use cd_formats::law_table::LawModel;
use cd_pre::from_outbox::Changes;
use cd_pre::scene;
use cd_pre::study::Study;

/// Pages that describe scenes.
const SCENE_PAGES: [&str; 7] = [
    "reference/scene/README.md",
    "reference/scene/grains.md",
    "reference/scene/models.md",
    "reference/scene/placement.md",
    "reference/scene/walls.md",
    "reference/scene/periodic.md",
    "reference/laws.md",
];

fn page_of(name: &str) -> (PathBuf, String) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs").join(name);
    let text = std::fs::read_to_string(&path).unwrap();
    (path, text)
}

/// Names of fields and variants in the source of `scene.rs`, as they stand in a scene.
fn names() -> Vec<String> {
    names_in(include_str!("../src/scene.rs").split("impl Law ").next().unwrap())
}

fn names_in(types: &str) -> Vec<String> {
    let mut names = Vec::new();
    let mut renamed = None;
    for line in types.lines().map(str::trim).filter(|line| !line.starts_with("//")) {
        if let Some(name) = line.strip_prefix("#[serde(rename = \"") {
            renamed = name.split('"').next().map(str::to_string);
        }
        if line.starts_with('#') || line.starts_with("use ") || line.starts_with("fn ") {
            continue;
        }
        // `Variant { field: type, ... },`, `Variant(type),`, `pub field: type,` or `field: type,`.
        let words: Vec<&str> = line.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')).collect();
        let first = words[0];
        if first.starts_with(char::is_uppercase) && line.ends_with(['{', ',']) && !line.contains("::default()") {
            names.push(renamed.take().unwrap_or_else(|| first.trim_end_matches(',').to_string()));
        }
        names.extend(words.iter().filter_map(|word| word.strip_suffix(':')).map(str::to_string));
    }
    names.retain(|name| !name.is_empty() && !["D", "Rotation"].contains(&name.as_str()));
    names
}

#[test]
fn every_field_and_variant_is_described() {
    let text = SCENE_PAGES.map(|page| page_of(page).1).concat();
    let names = names();
    // A check of the check: one of each sort.
    for known in ["solid_fraction", "min", "Ellipsoid", "Constant", "ramp_start"] {
        assert!(names.iter().any(|name| name == known), "{known} is not among {names:?}");
    }
    expect_described(names, "docs/reference/scene", &text);
}

/// Each name is in `code` outside of the examples.
fn expect_described(names: Vec<String>, file: &str, text: &str) {
    let prose: String = text.split("```").step_by(2).collect();
    let code = prose.split('`').skip(1).step_by(2);
    let words: Vec<&str> = code.flat_map(|span| span.split(|c: char| !(c.is_alphanumeric() || c == '_'))).collect();
    for name in names {
        assert!(words.contains(&name.as_str()), "{file} does not describe {name}");
    }
}

#[test]
fn what_is_shown_is_accepted() {
    for page in SCENE_PAGES {
        let (path, text) = page_of(page);
        assert_eq!(expect_accepted(&path, &text), text.matches("```ron").count(), "{page}");
    }
}

/// Reads each block `ron KIND` as a value of this kind. Returns their number.
fn expect_accepted(path: &Path, text: &str) -> usize {
    let mut shown = 0;
    for block in text.split("```ron ").skip(1) {
        let (kind, rest) = block.split_once('\n').unwrap();
        let ron = rest.split("```").next().unwrap();
        let read = match kind {
            "Scene" => cd_pre::read_scene(path, ron, &[]).map(drop),
            "LawModel" => from_ron::<LawModel>(path, ron, kind).map(drop),
            "Compute" => from_ron::<Compute>(path, ron, kind).map(drop),
            "Law" => from_ron::<scene::Law>(path, ron, kind).map(drop),
            "Contact" => from_ron::<scene::ColourPairLaw>(path, ron, kind).map(drop),
            "Grains" => from_ron::<scene::Grains>(path, ron, kind).map(drop),
            "Sizes" => from_ron::<scene::SizeDistribution>(path, ron, kind).map(drop),
            "Placement" => from_ron::<scene::GrainPlacement>(path, ron, kind).map(drop),
            "Shape" => from_ron::<scene::GrainShape>(path, ron, kind).map(drop),
            "Wall" => from_ron::<scene::SceneWall>(path, ron, kind).map(drop),
            "TimeFunction" => from_ron::<scene::TimeFunction>(path, ron, kind).map(drop),
            "Events" => from_ron::<Vec<Event>>(path, ron, kind).map(drop),
            "Changes" => from_ron::<Changes>(path, ron, kind).map(drop),
            "Study" => from_ron::<Study>(path, ron, kind).map(drop),
            _ => panic!("no type for {kind}"),
        };
        read.unwrap_or_else(|faults| panic!("{ron}\n{faults}"));
        shown += 1;
    }
    shown
}

#[test]
fn what_the_guides_show_is_accepted() {
    for page in ["set-up", "dense-start", "run", "results"] {
        let (path, text) = page_of(&format!("how-to/{page}.md"));
        assert_eq!(expect_accepted(&path, &text), text.matches("```ron").count(), "{page}");
    }
    let names =
        ["bed", "belt", "cell", "clumps", "cradle", "flap", "ice", "mixer", "pour", "pressed", "rods", "silo", "tube"];
    let scenes = names.map(|name| format!("how-to/{name}.ron"));
    for scene in scenes.iter().map(String::as_str).chain(["tutorial/scene.ron"]) {
        let (path, text) = page_of(scene);
        cd_pre::read_scene(&path, &text, &[]).unwrap_or_else(|faults| panic!("{scene}\n{faults}"));
    }
    let changes = ["flyby", "heap", "planet", "settled", "shear", "silo-open"].map(|name| format!("how-to/{name}.ron"));
    for changes in changes.iter().map(String::as_str).chain(["tutorial/changes.ron"]) {
        let (path, text) = page_of(changes);
        from_ron::<Changes>(&path, &text, "changes").unwrap_or_else(|faults| panic!("{changes}\n{faults}"));
    }
}

/// The blocks `ron FILE` of the tutorial are the files in docs/tutorial.
#[test]
fn the_tutorial_shows_its_files() {
    let (_, text) = page_of("tutorial/README.md");
    for block in text.split("```ron ").skip(1) {
        let (file, rest) = block.split_once('\n').unwrap();
        let (_, stored) = page_of(&format!("tutorial/{file}"));
        assert_eq!(rest.split("```").next().unwrap(), stored, "docs/tutorial/{file}");
    }
}

#[test]
fn changes_of_from_outbox_are_described_and_what_is_shown_is_accepted() {
    let (path, text) = page_of("reference/from-outbox.md");
    let source = include_str!("../src/from_outbox/changes.rs");
    let of = |name: &str| {
        let (_, rest) = source.split_once(&format!("pub {name} {{")).unwrap();
        names_in(rest.split("\n}").next().unwrap())
    };
    let names = ["struct Changes", "struct Selection", "enum WallSelector", "enum BodyFilter", "enum MotionRemoval"]
        .map(of)
        .concat();
    assert!(["keep_time", "Largest", "RigidMotion"].iter().all(|known| names.iter().any(|name| name == known)));
    expect_described(names, "docs/reference/from-outbox.md", &text);
    let (_, rest) = text.split_once("```ron Changes\n").unwrap();
    from_ron::<Changes>(&path, rest.split("```").next().unwrap(), "changes").unwrap();
}

#[test]
fn studies_are_described_and_what_is_shown_is_accepted() {
    let (path, text) = page_of("reference/study.md");
    let source = include_str!("../src/study.rs");
    let of = |name: &str| {
        let (_, rest) = source.split_once(&format!("pub struct {name} {{")).unwrap();
        names_in(rest.split("\n}").next().unwrap())
    };
    let names = ["Study", "Group", "Parameter"].map(of).concat();
    assert!(["groups", "seeds", "with"].iter().all(|known| names.iter().any(|name| name == known)));
    expect_described(names, "docs/reference/study.md", &text);
    for block in text.split("```ron Study\n").skip(1) {
        from_ron::<Study>(&path, block.split("```").next().unwrap(), "study").unwrap();
    }
}

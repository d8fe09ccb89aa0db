//! The reference of files, laws and options is complete, and what it shows is accepted.

use std::path::{Path, PathBuf};

use cd_formats::compute::{Accuracy, Compute, Event, from_ron};
use cd_formats::law_table::{
    ContactMemory, LAW_TABLE, LawCohesion, LawEntry, LawModel, LawParameter, is_law_of_points,
};
use cd_formats::snapshot::{
    AttractionArrays, BodyArrays, ContactArrays, ContactPartArrays, DepartureArrays, GravityArrays, IntervalArrays,
    LawArrays, LawName, MaterialName, MemoryArrays, PairArrays, PresenceArrays, SnapshotMeta, TurningArrays,
};

const OPTIONS: &str = "docs/reference/options.md";
const LAWS: &str = "docs/reference/laws.md";
const PAIR_LAWS: &str = "docs/reference/laws-pairs.md";
const SPRING_LAWS: &str = "docs/reference/laws-springs.md";
const SPEED_LAWS: &str = "docs/reference/laws-speed.md";
const SNAPSHOTS: &str = "docs/reference/files/snapshots.md";

fn page_of(name: &str) -> (PathBuf, String) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name);
    let text = std::fs::read_to_string(&path).unwrap();
    (path, text)
}

/// The section under a heading such as `## Presets`, without its subsections.
fn section<'a>(page: &'a str, heading: &str) -> &'a str {
    let (_, rest) = page.split_once(&format!("\n{heading}\n")).unwrap_or_else(|| panic!("no section {heading}"));
    rest.split("\n## ").next().unwrap().split("\n### ").next().unwrap()
}

/// Names in the headings of the third level, in their order.
fn names_of_sections(page: &str) -> Vec<&str> {
    page.lines().filter_map(|line| line.strip_prefix("### ")).collect()
}

/// The text in one line.
fn in_one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The cells of the table rows whose first cell is one name in code and that have `cells` cells.
fn rows(section: &str, cells: usize) -> Vec<Vec<String>> {
    let row = |line: &str| -> Option<Vec<String>> {
        let inner = line.strip_prefix("| ")?.strip_suffix(" |")?.replace("\\|", "\u{1}");
        Some(inner.split(" | ").map(|cell| cell.replace('\u{1}', "|")).collect())
    };
    section.lines().filter_map(row).filter(|row| row.len() == cells && row[0].starts_with('`')).collect()
}

#[test]
fn options_are_those_of_compute_ron() {
    let (path, text) = page_of(OPTIONS);
    let options = Compute::option_table();
    assert_eq!(names_of_sections(&text), options.iter().map(|(name, ..)| *name).collect::<Vec<_>>());
    for (name, default, help) in options {
        let section = in_one_line(section(&text, &format!("### {name}")));
        assert!(section.starts_with(&help), "{name}: `{section}` does not begin with `{help}`");
        assert!(section.contains(" Unit: ") && section.contains(&format!(" Default: `{default}`.")), "{name}");
        let (_, example) = section.split_once("Example: `").unwrap();
        let example = example.strip_suffix("`.").unwrap();
        assert!(example.starts_with(&format!("{name}: ")), "{name}: {example}");
        let compute = from_ron::<Compute>(&path, &format!("({example})"), name).unwrap();
        compute.check(&path).unwrap();
        assert_ne!(compute, Compute::default(), "{example}");
    }
}

#[test]
fn presets_are_those_of_accuracy() {
    let (_, text) = page_of(OPTIONS);
    let documented = rows(section(&text, "## Presets"), 6);
    let of = |accuracy| Compute { accuracy, ..Compute::default() }.accuracy_options();
    let [draft, standard, fine, reference] = Accuracy::ALL.map(|accuracy| of(Some(accuracy)));
    let presets = [of(None), draft, standard, fine, reference];
    for (k, row) in documented.iter().enumerate() {
        let expected = [0, 1, 2, 3, 4].map(|preset| presets[preset][k].value.clone());
        assert_eq!((row[0].clone(), &row[1..]), (format!("`{}`", presets[0][k].name), &expected[..]));
    }
    assert_eq!(documented.len(), presets[0].len());
}

/// Name, type, shape and meaning of every array; the page may say more behind the first clause.
#[test]
fn arrays_are_those_of_snapshots() {
    let (_, text) = page_of(SNAPSHOTS);
    let documented = rows(section(&text, "## snapshot-NNNNNN.npz"), 5);
    let arrays: Vec<_> = BodyArrays::array_table()
        .into_iter()
        .map(|array| ("N", array))
        .chain(ContactArrays::array_table().into_iter().map(|array| ("C", array)))
        .chain(MemoryArrays::array_table().into_iter().map(|array| ("C", array)))
        .chain(LawArrays::array_table().into_iter().map(|array| ("C", array)))
        .chain(AttractionArrays::array_table().into_iter().map(|array| ("C", array)))
        .chain(GravityArrays::array_table().into_iter().map(|array| ("N", array)))
        .chain(PresenceArrays::array_table().into_iter().map(|array| ("N", array)))
        .chain(DepartureArrays::array_table().into_iter().map(|array| ("N", array)))
        .chain(TurningArrays::array_table().into_iter().map(|array| ("U", array)))
        .chain(ContactPartArrays::array_table().into_iter().map(|array| ("C", array)))
        .chain(PairArrays::array_table().into_iter().map(|array| ("K", array)))
        .chain(IntervalArrays::array_table().into_iter().map(|array| ("P", array)))
        .collect();
    assert_eq!(documented.len(), arrays.len());
    for (row, (count, (name, descr, shape, help))) in documented.iter().zip(arrays) {
        let shape: String = shape.iter().fold(count.to_string(), |shape, n| format!("{shape}, {n}"));
        assert_eq!(row[..3], [format!("`{name}`"), format!("`{descr}`"), format!("({shape})")]);
        let meaning = help.trim().split(';').next().unwrap();
        assert!(row[4].starts_with(meaning), "{name}: `{}` does not begin with `{meaning}`", row[4]);
        let unit = row[3].replace('²', "^2");
        assert!(unit == "-" || help.contains(&format!(", {unit}")), "{name}: unit {unit} is not in `{help}`");
    }
}

#[test]
fn meta_is_described_field_by_field() {
    fn names(value: &serde_json::Value, into: &mut Vec<String>) {
        match value {
            serde_json::Value::Object(fields) => fields.iter().for_each(|(name, value)| {
                into.push(name.clone());
                names(value, into);
            }),
            serde_json::Value::Array(items) => items.iter().for_each(|item| names(item, into)),
            _ => {}
        }
    }
    let (_, text) = page_of(SNAPSHOTS);
    let section = section(&text, "## snapshot-NNNNNN.npz");
    let mut meta = SnapshotMeta::default();
    meta.materials.push(MaterialName { name: String::new(), density: 1.0 });
    meta.laws.push(LawName { nickname: String::new(), kind: String::new(), parameters: vec![] });
    meta.laws_at_start = meta.laws.clone();
    meta.attraction = Some(Default::default());
    meta.primary_response = Some(Default::default());
    meta.revolutions.push(Default::default());
    meta.accuracy_control = Some(Default::default());
    meta.parameters.adaptive = Some(Default::default());
    let mut fields = Vec::new();
    names(&serde_json::to_value(&meta).unwrap(), &mut fields);
    assert!(fields.len() > 30, "{fields:?}"); // a check of the check
    // Parameters that are left out by default.
    let source = page_of("formats/src/snapshot/mod.rs").1;
    let parameters = source.split_once("pub struct RunParameters").unwrap().1.split_once("\n}").unwrap().0;
    for left_out in parameters.split("skip_serializing_if").skip(1) {
        fields.push(left_out.split_once("pub ").unwrap().1.split_once(':').unwrap().0.to_string());
    }
    for field in fields {
        assert!(section.contains(&format!("`{field}`")), "{SNAPSHOTS} does not describe {field}");
    }
}

/// The next run takes these from COMPUTE.RON; the length of steps, `dt`, follows from the snapshot if it is constant.
#[test]
fn options_that_snapshots_do_not_contain_are_listed() {
    let source = page_of("formats/src/snapshot/mod.rs").1;
    let parameters = source.split_once("pub struct RunParameters").unwrap().1.split_once("\n}").unwrap().0;
    let recorded: Vec<&str> = parameters.split("pub ").skip(1).map(|field| field.split(':').next().unwrap()).collect();
    let options = Compute::option_table();
    let mut expected: Vec<&str> =
        options.iter().map(|(name, ..)| *name).filter(|name| *name != "dt" && !recorded.contains(name)).collect();
    let text = in_one_line(&page_of("docs/reference/from-outbox.md").1);
    let (_, sentence) = text.split_once("Not taken from the snapshot are ").unwrap();
    let mut listed: Vec<&str> = sentence.split_once(", nor `dt`").unwrap().0.split('`').skip(1).step_by(2).collect();
    expected.sort_unstable();
    listed.sort_unstable();
    assert_eq!(listed, expected);
}

/// Rows of the table of laws that the programs compute with.
fn computed_laws() -> Vec<&'static LawEntry> {
    LAW_TABLE.iter().filter(|entry| entry.computed).collect()
}

/// A law with all parameters 1/2.
fn example_of(entry: &LawEntry) -> LawModel {
    LawModel::from_values(entry.label, &vec![0.5; entry.parameters().count()]).unwrap()
}

fn with_unit(text: String, parameter: LawParameter) -> String {
    let unit = parameter.quantity().unit();
    if unit.is_empty() { text } else { format!("{text} ({unit})") }
}

/// Parameters of a law by lines, as the page lists them.
fn parameter_lines(entry: &LawEntry) -> String {
    let symbol = |parameter: &LawParameter| with_unit(parameter.symbol().to_string(), *parameter);
    let line = |line: &&[LawParameter]| line.iter().map(symbol).collect::<Vec<_>>().join(", ");
    let lines: Vec<String> = entry.lines.iter().map(line).collect();
    if lines.is_empty() { "none".into() } else { lines.join(" / ") }
}

/// Largest friction force of a law, in words.
fn friction_limit(cohesion: Option<LawCohesion>) -> &'static str {
    match cohesion {
        None => "μ f_n",
        Some(LawCohesion::Liquid { remembers: false, .. }) => "μ (f_n + cohesion) while g ≤ range, else μ f_n",
        Some(LawCohesion::Liquid { remembers: true, .. }) => "μ (f_n + cohesion) while wet, else μ f_n",
        Some(LawCohesion::Pair(_)) => "μ (f_n + attraction)",
        Some(LawCohesion::Bond { .. }) => "c_t S + (c_t/c_n) f_n with a bond, else μ f_n",
    }
}

/// State of a contact that a law keeps, in words.
fn kept_state(model: &LawModel) -> String {
    let word = |memory: ContactMemory| match memory {
        ContactMemory::Sliding => "sliding",
        ContactMemory::LiquidBridge => "liquid bridge",
        ContactMemory::Bond => "bond",
        ContactMemory::Moment => "moment",
        ContactMemory::ReferenceGap => "reference gap",
        ContactMemory::Damage => "damage",
    };
    let kept: Vec<&str> = model.memory().into_iter().map(word).collect();
    if kept.is_empty() { "-".into() } else { kept.join(", ") }
}

/// A section may say more behind the description.
#[test]
fn laws_are_those_of_the_table() {
    let (path, text) = page_of(LAWS);
    let text = text + &page_of(PAIR_LAWS).1 + &page_of(SPRING_LAWS).1 + &page_of(SPEED_LAWS).1;
    let laws = computed_laws();
    let (mut documented, mut labels) = (names_of_sections(&text), laws.iter().map(|law| law.label).collect::<Vec<_>>());
    documented.sort_unstable();
    labels.sort_unstable();
    assert_eq!(documented, labels);
    for entry in laws {
        let section = section(&text, &format!("### {}", entry.label));
        let (description, line) = (entry.description, in_one_line(section));
        let begins = line.to_lowercase().starts_with(&description.to_lowercase());
        assert!(begins, "{}: `{line}` does not begin with `{description}`", entry.label);
        let used = entry.parameters().filter(|parameter| *parameter != LawParameter::UnusedCohesion);
        let names: Vec<String> =
            used.map(|parameter| with_unit(format!("`{}`", parameter.name()), parameter)).collect();
        let model = example_of(entry);
        let friction = match model {
            LawModel::CoupledDof { .. } => "none: contacts do not slide".to_string(),
            _ if is_law_of_points(entry.label) => "none: forces act along the line".to_string(),
            _ if model.interface().is_some() => "(1 - β) μ f_n".to_string(),
            _ => friction_limit(model.cohesion()).to_string(),
        };
        for row in [
            format!("| parameters | {} |", names.join(", ")),
            format!("| lines | {} |", parameter_lines(entry)),
            format!("| largest friction force | {friction} |"),
            format!("| kept | {} |", kept_state(&model)),
        ] {
            assert!(section.contains(&row), "{}: no row {row}", entry.label);
        }
        let (_, example) = section.split_once("```ron LawModel\n").unwrap();
        let shown = from_ron::<LawModel>(&path, example.split("```").next().unwrap(), "kind").unwrap();
        assert_eq!(shown.label(), entry.label);
    }
}

#[test]
fn laws_for_exchange_are_those_of_the_table() {
    let (_, text) = page_of(LAWS);
    let named = |row: Vec<String>| -> Vec<(String, String)> {
        row[0].split(", ").map(|name| (name.trim_matches('`').to_string(), row[1].clone())).collect()
    };
    let mut documented: Vec<_> =
        rows(section(&text, "## Exchange with LMGC90"), 2).into_iter().flat_map(named).collect();
    let others = LAW_TABLE.iter().filter(|entry| !entry.computed);
    let mut expected: Vec<(String, String)> =
        others.map(|entry| (entry.label.to_string(), parameter_lines(entry))).collect();
    documented.sort();
    expected.sort();
    assert_eq!(documented, expected);
}

#[test]
fn other_pages_name_every_law() {
    let (_, snapshots) = page_of(SNAPSHOTS);
    use ContactMemory::{Bond, Damage, LiquidBridge, Moment, ReferenceGap};
    for (condition, kinds) in [
        ("memory or rolling moments", &[LiquidBridge, Bond, Moment][..]),
        (
            "[reference gaps](../laws-springs.md#reference-gaps) or [interfaces](../laws-springs.md#interfaces)",
            &[ReferenceGap, Damage],
        ),
    ] {
        let keeps = |entry: &&LawEntry| example_of(entry).memory().iter().any(|kind| kinds.contains(kind));
        let names: Vec<String> =
            computed_laws().into_iter().filter(keeps).map(|entry| format!("`{}`", entry.label)).collect();
        let sentence = format!("If a law has {condition} ({}), also:", names.join(", "));
        assert!(in_one_line(&snapshots).contains(&sentence), "{SNAPSHOTS}: {sentence}");
    }
    let of_pairs = |entry: &&LawEntry| matches!(example_of(entry).cohesion(), Some(LawCohesion::Pair(_)));
    let names: Vec<String> =
        computed_laws().into_iter().filter(of_pairs).map(|entry| format!("`{}`", entry.label)).collect();
    let sentence = format!("If a law has [cohesion of pairs](../laws-pairs.md) ({}), also:", names.join(", "));
    assert!(in_one_line(&snapshots).contains(&sentence), "{SNAPSHOTS}: {sentence}");
    let (_, method) = page_of("docs/explanation/method/laws.md");
    let (_, readme) = page_of("README.md");
    for entry in computed_laws() {
        let name = format!("`{}`", entry.label);
        assert!(section(&method, "## Laws: M4").contains(&name), "the method, Laws: no {name}");
        assert!(readme.contains(&name), "README.md: no {name}");
    }
}

#[test]
fn what_is_shown_is_accepted() {
    let mut shown = 0;
    let pages = ["fields", "events", "probes", "growth-and-loss"].map(|name| format!("docs/reference/{name}.md"));
    for page in [OPTIONS.to_string()].into_iter().chain(pages) {
        let (path, text) = page_of(&page);
        for block in text.split("```ron ").skip(1) {
            let (kind, rest) = block.split_once('\n').unwrap();
            let ron = rest.split("```").next().unwrap();
            let read = match kind {
                "Compute" => from_ron::<Compute>(&path, ron, kind).and_then(|compute| compute.check(&path)),
                "Events" => from_ron::<Vec<Event>>(&path, ron, kind)
                    .and_then(|events| Compute { events, ..Compute::default() }.check(&path)),
                _ => panic!("no type for {kind}"),
            };
            read.unwrap_or_else(|faults| panic!("{ron}\n{faults}"));
            shown += 1;
        }
    }
    assert_eq!(shown, 10);
}

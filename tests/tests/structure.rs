//! Who may import whom, and what no source may call, read from the sources.
//!
//! Between crates: `formats` stands below, the programs import it and never each other.
//!
//! Within each crate, no file imports itself by way of others.
//!
//! Within cd-solve, where a *type* is a name with a capital letter, and a stage's types are those of any
//! of its files:
//!
//! | who | may import | never |
//! |---|---|---|
//! | kernel: `laws`, `gravity`, `geometry`, `math` | `math`; `geometry` types of `formats::faces` and `formats::wall_mesh`, with which cd-pre checks shapes; `laws` types of `formats::law_table` | data, stages, other formats |
//! | data: `scene`, `state` | kernels, types of formats | stages |
//! | stage: `integrate`, `detect`, `assemble`, `solve` | data, kernels, types of stages earlier in the step, types of options | functions of another stage, other formats |
//! | stage: `read`, `write` | data, kernels, formats, types of `step` | functions of another stage, printing (`formats::messages`) |
//! | `step` | stages, data, kernels | formats, `read`, `write` |
//! | `run`, `plan`, `probe`, `sinks_and_sources`, `cli`, `contact_division`, `thread_pool`, `progress`, `agreement`, `verify` | all | |
//! | `ranks` | errors of formats | all else |
//! | all | `crate::ranks`: the processes that compute the scene together | |
//! | all | `crate::activity`: the current stage of the step, and whether it is abandoned | |
//! | all | `crate::features::BARE`: models with which the program is built | |

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

const KERNELS: [&str; 4] = ["laws", "gravity", "geometry", "math"];
const DATA: [&str; 2] = ["scene", "state"];
/// In the order in which a step first enters them.
const STAGES: [&str; 4] = ["integrate", "detect", "assemble", "solve"];
const FILE_STAGES: [&str; 2] = ["read", "write"];
const OUTSIDE: [&str; 12] = [
    "accuracy_control",
    "run",
    "plan",
    "probe",
    "sinks_and_sources",
    "cli",
    "contact_division",
    "thread_pool",
    "progress",
    "agreement",
    "verify",
    "lib",
];

/// Types of formats that the data and the stages may name: options, events, functions of time, fields from outside,
/// periodic cells and surfaces of walls are the same there as in the files; and disjoint sets.
fn is_shared_type(path: &str) -> bool {
    [
        "cd_formats::accuracy::",
        "cd_formats::compute::",
        "cd_formats::deforming_cell::",
        "cd_formats::doubts::EVENT_SLACK",
        "cd_formats::drv_dof::Evolution",
        "cd_formats::field::",
        "cd_formats::geometry::periodic_cell::",
        "cd_formats::groups::DisjointSets",
        "cd_formats::sinks_and_sources::",
        "cd_formats::hollow_radius::",
        "cd_formats::ids::BodyId",
        "cd_formats::postpro::",
        "cd_formats::probe::",
        "cd_formats::region::",
        "cd_formats::snapshot::",
        "cd_formats::wall_mesh::",
    ]
    .iter()
    .any(|p| path.starts_with(p))
        && is_type(path)
        && !path.ends_with("::Snapshot")
}

/// The last name that is not a method's or a variant's parent: a type, as rustc names them.
fn is_type(path: &str) -> bool {
    path.split("::").any(|name| name.starts_with(char::is_uppercase))
}

fn allowed(who: &str, path: &str) -> bool {
    let mut words = path.split("::");
    let (root, what) = (words.next().unwrap(), words.next().unwrap_or_default());
    let is = |list: &[&str]| list.contains(&what);
    let step_types = what == "step" && is_type(path);
    if path == "crate::features::BARE" || path == "cd_formats::index_types" {
        return true;
    }
    if ["crate::activity", "crate::ranks"].iter().any(|shared| path.starts_with(shared)) {
        return true;
    }
    if who == "ranks" {
        return path.starts_with("cd_formats::error::");
    }
    match root {
        "cd_formats" if OUTSIDE.contains(&who) => true,
        "cd_formats" if FILE_STAGES.contains(&who) => !path.starts_with("cd_formats::messages::"),
        "cd_formats" if who == "laws" => path.starts_with("cd_formats::law_table::") && is_type(path),
        "cd_formats" if who == "geometry" => {
            ["cd_formats::faces::", "cd_formats::wall_mesh::"].iter().any(|p| path.starts_with(p)) && is_type(path)
        }
        "cd_formats" => (DATA.contains(&who) || STAGES.contains(&who)) && is_shared_type(path),
        _ if what == who || OUTSIDE.contains(&who) => true,
        _ if KERNELS.contains(&who) => what == "math",
        _ if DATA.contains(&who) => is(&KERNELS) || is(&DATA),
        _ if FILE_STAGES.contains(&who) => is(&KERNELS) || is(&DATA) || step_types || (is(&STAGES) && is_type(path)),
        _ if who == "step" => is(&KERNELS) || is(&DATA) || is(&STAGES),
        _ => {
            let place = |stage: &str| STAGES.iter().position(|r| *r == stage);
            let mine =
                place(who).unwrap_or_else(|| panic!("'{who}' is neither stage, kernel nor data: extend the table"));
            // The two halves of `assemble` are on either side of `detect`.
            let earlier = place(what).is_some_and(|theirs| theirs < mine);
            is(&KERNELS) || is(&DATA) || (earlier && is_type(path))
        }
    }
}

/// The `.rs` files below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap().flatten() {
        match entry.path() {
            path if path.is_dir() => found.extend(sources(&path)),
            path if path.extension().is_some_and(|e| e == "rs") => found.push(path),
            _ => {}
        }
    }
    found
}

/// Every path in `text` that begins with one of `roots`, in `use` lines and elsewhere, groups written out.
/// Comments and what follows `#[cfg(test)]` do not count.
fn paths(text: &str, roots: &[&str]) -> BTreeSet<String> {
    let text = text.split("#[cfg(test)]").next().unwrap_or_default();
    let code: String =
        text.lines().map(|line| line.split("//").next().unwrap_or_default().trim().to_string() + " ").collect();
    let mut found = BTreeSet::new();
    for root in roots {
        for (at, _) in code.match_indices(&format!("{root}::")) {
            let inside_word = code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':');
            if !inside_word {
                expand("", &code[at..], &mut found);
            }
        }
    }
    found
}

/// Reads one path with its groups; returns its length.
fn expand(prefix: &str, text: &str, found: &mut BTreeSet<String>) -> usize {
    let name = text.find(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')).unwrap_or(text.len());
    let path = format!("{prefix}{}", &text[..name]);
    if !path.ends_with("::") || !text[name..].starts_with('{') {
        found.insert(path.trim_end_matches(':').trim_end_matches("::self").to_string());
        return name;
    }
    let mut at = name + 1;
    loop {
        at += text[at..].len() - text[at..].trim_start_matches([' ', ',']).len();
        if text[at..].starts_with('}') || text[at..].is_empty() {
            return at + 1;
        }
        at += expand(&path, &text[at..], found).max(1);
    }
}

#[test]
fn the_solver_keeps_its_table_of_imports() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../solver/src");
    let mut faults = Vec::new();
    for file in sources(&root) {
        let inside = file.strip_prefix(&root).unwrap();
        let who = inside.iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs");
        if who == "main" {
            continue;
        }
        for path in paths(&fs::read_to_string(&file).unwrap(), &["crate", "cd_formats"]) {
            if !allowed(who, &path) {
                faults.push(format!("solver/src/{}: {who} imports {path}", inside.display()));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Functions of std that call the C library, whose last bits depend on system and processor. The crate libm has them in
/// portable arithmetic.
const FUNCTIONS_OF_THE_SYSTEM: [&str; 27] = [
    "sin", "cos", "sin_cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh",
    "exp", "exp2", "exp_m1", "ln", "ln_1p", "log", "log2", "log10", "powf", "cbrt", "hypot", "gamma", "ln_gamma",
];

/// Names in [`FUNCTIONS_OF_THE_SYSTEM`] that a line of code uses: called as methods, `x.sin()`, or named by the path of a
/// primitive type, `f64::sin`. Paths of the crate libm are allowed.
fn functions_of_the_system(code: &str) -> Vec<&'static str> {
    let is_end = |rest: &str| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_');
    let is_used = |name: &&str| {
        code.contains(&format!(".{name}("))
            || ["f64", "f32"].iter().any(|float| {
                let path = format!("{float}::{name}");
                code.match_indices(&path).any(|(at, _)| is_end(&code[at + path.len()..]))
            })
    };
    FUNCTIONS_OF_THE_SYSTEM.into_iter().filter(is_used).collect()
}

#[test]
fn functions_of_the_system_are_found_as_methods_and_by_path() {
    let found = [
        ("let y = (u / h).asinh();", "asinh"),
        ("_ => f64::log10,", "log10"),
        ("angles.map(f32::sin)", "sin"),
        ("f64::ln_1p(x)", "ln_1p"),
    ];
    for (code, name) in found {
        assert_eq!(functions_of_the_system(code), [name], "{code}");
    }
    for code in ["libm::exp(x)", "f64::EPSILON", "f64::sinus", "super::log::LogTable", "2f64.powi(3)"] {
        assert!(functions_of_the_system(code).is_empty(), "{code}");
    }
}

#[test]
fn results_depend_on_no_function_of_the_system() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut faults = Vec::new();
    for file in ["formats", "pre", "solver"].iter().flat_map(|krate| sources(&root.join(krate).join("src"))) {
        let text = fs::read_to_string(&file).unwrap();
        let code = text.split("#[cfg(test)]").next().unwrap();
        for (line, code) in code.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//")) {
            let used = functions_of_the_system(code).into_iter();
            faults.extend(used.map(|name| format!("{}:{}: {name}; expected that of libm", file.display(), line + 1)));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Files are read by [`cd_formats::atomic::open_to_read`], which rejects pipes and devices; others are not input.
#[test]
fn no_file_is_opened_but_by_the_function_that_rejects_pipes() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let calls =
        [" fs::read(", "(fs::read(", "std::fs::read(", "fs::read_to_string(", " File::open(", "fs::File::open("];
    // The function itself; a folder that was just created; memory of the process.
    let exceptions = ["formats/src/atomic.rs", "solver/src/write/mod.rs", "solver/src/plan/mod.rs"];
    let mut faults = Vec::new();
    for file in ["formats", "pre", "solver", "post"].iter().flat_map(|krate| sources(&root.join(krate).join("src"))) {
        let name = file.strip_prefix(&root).unwrap().to_str().unwrap().to_string();
        let text = fs::read_to_string(&file).unwrap();
        let code = text.split("#[cfg(test)]").next().unwrap();
        let is_call = |line: &&str| calls.iter().any(|call| line.contains(call));
        if !exceptions.contains(&name.as_str()) {
            faults.extend(code.lines().filter(is_call).map(|line| format!("{name}: {}", line.trim())));
        }
    }
    assert!(faults.is_empty(), "{}; expected cd_formats::atomic", faults.join("\n"));
}

#[test]
fn the_step_in_the_docs_is_that_of_the_source() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let read = |path: &str| fs::read_to_string(root.join(path)).unwrap();
    let (docs, source) = (read("docs/development/architecture.md"), read("solver/src/step/mod.rs"));
    let quote = docs.split("```rust\n").nth(1).unwrap().split("```").next().unwrap();
    assert!(quote.contains("pub fn step(") && source.contains(quote), "docs/development/architecture.md: {quote}");
}

/// `docs/development/architecture.md` names the function that computes the values of a row, and the one that blanks them.
#[test]
fn functions_named_for_a_new_observable_do_what_the_docs_say() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let read = |path: &str| fs::read_to_string(root.join(path)).unwrap();
    let docs = read("docs/development/architecture.md").split_whitespace().collect::<Vec<_>>().join(" ");
    let source = read("post/src/derive/mod.rs");
    for (before, expected) in [("its value in `Row::", "= Row {"), ("also set to NaN in `Row::", "f64::NAN")] {
        let name = docs.split_once(before).unwrap().1.split('`').next().unwrap();
        let (_, body) = source.split_once(&format!("fn {name}(")).unwrap();
        assert!(body.split("\n    }\n").next().unwrap().contains(expected), "docs/development/architecture.md: {name}");
    }
}

#[test]
fn programs_import_formats_and_never_each_other() {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let of_programs = ["cd-formats", "cd-version"];
    for (krate, may) in [("formats", &[][..]), ("pre", &of_programs), ("solver", &of_programs), ("post", &of_programs)]
    {
        let text = fs::read_to_string(workspace.join(krate).join("Cargo.toml")).unwrap();
        let dependencies = text.split("[dependencies]").nth(1).unwrap().split("\n[").next().unwrap();
        for line in dependencies.lines().filter(|line| line.starts_with("cd-")) {
            let name = line.split(['.', ' ', '=']).next().unwrap();
            assert!(may.contains(&name), "{krate}/Cargo.toml: {name}");
        }
    }
}

/// The modules that each module of a crate imports; a module is its path, the crate itself the empty one.
fn module_imports(root: &Path) -> BTreeMap<Vec<String>, BTreeSet<Vec<String>>> {
    let module = |file: &Path| -> Vec<String> {
        let mut path: Vec<String> =
            file.strip_prefix(root).unwrap().iter().map(|part| part.to_str().unwrap().to_string()).collect();
        let name = path.pop().unwrap();
        let name = name.trim_end_matches(".rs");
        path.extend((!["mod", "lib"].contains(&name)).then(|| name.to_string()));
        path
    };
    let files: BTreeMap<Vec<String>, PathBuf> =
        sources(root).into_iter().filter(|file| !file.ends_with("main.rs")).map(|file| (module(&file), file)).collect();
    let mut imports = BTreeMap::new();
    for (module, file) in &files {
        let children = files.keys().filter(|other| other.len() == module.len() + 1 && other.starts_with(module));
        let children: Vec<&str> = children.map(|child| child[module.len()].as_str()).collect();
        let roots = [&["crate", "super", "self"], &children[..]].concat();
        let mut imported = BTreeSet::new();
        for path in paths(&fs::read_to_string(file).unwrap(), &roots) {
            let mut target = if path.starts_with("crate::") { Vec::new() } else { module.clone() };
            for word in path.split("::") {
                match word {
                    "crate" | "self" => {}
                    "super" => drop(target.pop()),
                    word => target.push(word.to_string()),
                }
            }
            while !files.contains_key(&target) {
                target.pop();
            }
            imported.insert(target);
        }
        imported.remove(module);
        imports.insert(module.clone(), imported);
    }
    imports
}

#[test]
fn no_file_imports_itself_by_way_of_others() {
    for krate in ["formats", "pre", "solver", "post"] {
        let mut left = module_imports(&Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(krate).join("src"));
        assert!(left.len() > 30, "{krate}: {left:?}"); // a check of the check
        // Modules that import none of those left are in no circle.
        while let Some(lowest) = left.iter().find(|(_, imported)| imported.is_empty()).map(|(module, _)| module.clone())
        {
            left.remove(&lowest);
            left.values_mut().for_each(|imported| imported.retain(|module| *module != lowest));
        }
        let names: Vec<String> = left.keys().map(|module| module.join("/")).collect();
        assert!(left.is_empty(), "{krate}/src: a circle of imports among {}", names.join(", "));
    }
}

#[test]
fn paths_are_found_in_groups_and_in_code() {
    let text = "
        use crate::math::{Vec3, simd::{self, Line}};
        // use crate::comment::Nothing;
        fn f() -> crate::state::State { my_crate::no(); crate::read::case(1) }
        #[cfg(test)]
        mod tests { use crate::write::path; }";
    let found: Vec<String> = paths(text, &["crate"]).into_iter().collect();
    let expected = [
        "crate::math::Vec3",
        "crate::math::simd",
        "crate::math::simd::Line",
        "crate::read::case",
        "crate::state::State",
    ];
    assert_eq!(found, expected);
}

#[test]
fn the_table_rejects_what_it_should() {
    for (who, path) in [
        ("laws", "crate::state::Contact"),
        ("laws", "cd_formats::snapshot::LawName"),
        ("gravity", "crate::laws::ContactLaw"),
        ("math", "cd_formats::snapshot::Ledger"),
        ("scene", "crate::detect::listed_contacts"),
        ("scene", "cd_formats::bodies::Bodies"),
        ("integrate", "crate::solve::ContactSolution"),
        ("solve", "crate::assemble::contact_problem"),
        ("solve", "cd_formats::error::Fault"),
        ("step", "cd_formats::compute::Compute"),
        ("step", "crate::write::ResultFiles"),
        ("write", "crate::read::read_case"),
        ("ranks", "crate::solve::solve_nlgs"),
    ] {
        assert!(!allowed(who, path), "{who} imports {path}");
    }
    for (who, path) in [
        ("laws", "crate::math::Vec3"),
        ("laws", "cd_formats::law_table::LawModel"),
        ("scene", "cd_formats::compute::Compute"),
        ("solve", "crate::assemble::ContactProblem"),
        ("read", "cd_formats::error::Fault"),
        ("write", "crate::step::StepReport"),
        ("step", "crate::assemble::relative_velocity"),
        ("run", "crate::write::ResultFiles"),
        ("solve", "crate::ranks::communicator"),
    ] {
        assert!(allowed(who, path), "{who} may import {path}");
    }
}

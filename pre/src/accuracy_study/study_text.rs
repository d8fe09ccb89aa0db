//! Text of a study.

use std::path::Path;

/// Group of a study, in the words of [`crate::study::Group`].
#[derive(Debug, Clone, PartialEq)]
pub struct StudyGroup {
    /// Comment before the group; empty for none.
    pub comment: String,
    /// Folder of a case below that of its seed.
    pub name: String,
    /// Paths and values that its cases share.
    pub set: Vec<(String, String)>,
    pub parameters: Vec<StudyParameter>,
}

/// Parameter of a study, in the words of [`crate::study::Parameter`].
#[derive(Debug, Clone, PartialEq)]
pub struct StudyParameter {
    /// Name; empty for none.
    pub name: String,
    pub paths: Vec<String>,
    /// Values in RON.
    pub values: Vec<String>,
    /// Parameters that vary together with this one.
    pub companions: Vec<StudyParameter>,
}

impl StudyGroup {
    /// Number of cases with one seed.
    pub fn case_count(&self) -> usize {
        self.parameters.iter().map(|parameter| parameter.values.len()).product()
    }
}

/// Text of the groups, whose cases are below the folder of their seed, `s{seed}`; `base`: path of the scene.
pub fn groups_text(groups: &[StudyGroup], base: &Path, seeds: &[u64]) -> String {
    let base = base.display().to_string();
    let seeds: Vec<String> = seeds.iter().map(u64::to_string).collect();
    let mut text = String::from("(groups: [\n");
    for group in groups {
        if !group.comment.is_empty() {
            text += &format!("    // {}\n", group.comment);
        }
        let name = format!("s{{seed}}/{}", group.name);
        text += &format!("    (name: {name:?}, base: {base:?}, seeds: [{}],\n", seeds.join(", "));
        if !group.set.is_empty() {
            let pairs: Vec<String> = group.set.iter().map(|(path, value)| format!("({path:?}, {value})")).collect();
            text += &format!("        set: [{}],\n", pairs.join(", "));
        }
        let parameters: Vec<String> =
            group.parameters.iter().map(|parameter| format!("            {},\n", parameter_text(parameter))).collect();
        text += &format!("        parameters: [\n{}        ]),\n", parameters.concat());
    }
    text + "])\n"
}

/// Text of a parameter: the parameters that vary with it are on lines of their own.
fn parameter_text(parameter: &StudyParameter) -> String {
    let mut fields = Vec::new();
    if !parameter.name.is_empty() {
        fields.push(format!("name: {:?}", parameter.name));
    }
    if !parameter.paths.is_empty() {
        fields.push(format!("paths: {:?}", parameter.paths));
    }
    fields.push(format!("values: [{}]", parameter.values.join(", ")));
    if !parameter.companions.is_empty() {
        let lines: Vec<String> = parameter
            .companions
            .iter()
            .map(|companion| format!("                {},\n", parameter_text(companion)))
            .collect();
        fields.push(format!("with: [\n{}            ]", lines.concat()));
    }
    format!("({})", fields.join(", "))
}

//! Surfaces of attracting bodies: read from files that the scene names, written to DATBOX as OBJ.

use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::compute::{Compute, ExternalField};
use cd_formats::error::{Fault, Faults};
use cd_formats::obj::{self, surface_text};

use crate::shapes::read::read_surface;

/// Names and texts of the files in DATBOX with the surfaces of the polyhedra among `fields`, which are then named by these.
///
/// Names of the options are relative to `folder`. If it is a DATBOX (`is_datbox`), its files are taken as they are: the attraction
/// depends in its last bits on the order of the triangles. Errors: the faults of the surfaces, and two files that would have one
/// name.
pub fn take_surfaces(options: &mut Compute, folder: &Path, is_datbox: bool) -> Result<Vec<(String, String)>, Faults> {
    let mut faults = Faults::default();
    let mut sources: Vec<PathBuf> = Vec::new();
    let mut files: Vec<(String, String)> = Vec::new();
    for field in &mut options.fields {
        let ExternalField::Polyhedron { surface, .. } = field else { continue };
        let source = folder.join(surface.as_str());
        let stem = source.file_stem().unwrap_or_default().to_string_lossy();
        let name = format!("{stem}.obj");
        match files.iter().position(|(known, _)| *known == name) {
            Some(k) if sources[k] != source => {
                let found = format!("two files of the name {stem}");
                faults.push(Fault::new(&source, None, "fields", found, "expected another name of one of them"));
            }
            Some(_) => {}
            None => {
                let text = if is_datbox && *surface == name {
                    obj::read_surface(&source).and_then(|_| atomic::read_text(&source))
                } else {
                    read_surface(&source).map(|read| surface_text(&read.surface))
                };
                let Some(text) = faults.gather_result(text) else { continue };
                sources.push(source);
                files.push((name.clone(), text));
            }
        }
        *surface = name;
    }
    faults.into_result(files)
}

/// Names of the files with the surfaces of the polyhedra among the fields, as they are in the options.
pub fn surface_names(options: &Compute) -> impl Iterator<Item = &str> {
    options.fields.iter().filter_map(|field| match field {
        ExternalField::Polyhedron { surface, .. } => Some(surface.as_str()),
        _ => None,
    })
}

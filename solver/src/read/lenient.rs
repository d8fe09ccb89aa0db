//! Files of DATBOX with the notices of their readers, and files that may be absent.

use std::path::Path;

use cd_formats::atomic::path_exists;
use cd_formats::bodies::{Bodies, Body, ShapeRecord};
use cd_formats::error::{Fault, Faults};
use cd_formats::foreign::foreign_bodies;
use cd_formats::scan::AsciiText;

/// Reader of a text of DATBOX; the path is for messages.
type Parser<T> = fn(&Path, &AsciiText) -> Result<(T, Vec<String>), Faults>;

/// Reads the files of a folder and collects faults and notices.
pub struct FolderReader<'a> {
    datbox: &'a Path,
    pub faults: Faults,
    /// Notices for the user: deviations from the form of the files, and files that are absent.
    pub notices: Vec<String>,
}

impl<'a> FolderReader<'a> {
    /// Reader of the folder `datbox`, and its bodies; `None` after a fault.
    ///
    /// Errors: a folder of 2D or deformable bodies, of which each line would be a fault.
    pub fn new(datbox: &'a Path) -> Result<(FolderReader<'a>, Option<Bodies>), Faults> {
        let mut reader = FolderReader { datbox, faults: Faults::default(), notices: Vec::new() };
        let path = datbox.join("BODIES.DAT");
        let text = AsciiText::read_file(&path);
        if let Some(fault) = text.as_ref().ok().and_then(|text| foreign_bodies(&path, text)) {
            return Err(fault.into());
        }
        let bodies = reader.gather_parsed(text.and_then(|text| Bodies::parse_rigid_with_notices(&path, &text)));
        let bodies = bodies.and_then(|mut bodies| {
            let read = bodies.read_meshes(&path);
            reader.faults.gather_result(read).map(|()| bodies)
        });
        Ok((reader, bodies))
    }

    /// Value of a file; `None` after a fault.
    pub fn read<T>(&mut self, name: &str, parse: Parser<T>) -> Option<T> {
        let path = self.datbox.join(name);
        self.gather_parsed(AsciiText::read_file(&path).and_then(|text| parse(&path, &text)))
    }

    /// Value of a file that has been read, whose faults or notices it keeps.
    fn gather_parsed<T>(&mut self, parsed: Result<(T, Vec<String>), Faults>) -> Option<T> {
        let (value, notices) = self.faults.gather_result(parsed)?;
        self.notices.extend(notices);
        Some(value)
    }

    /// Value of a file that `parse` gets as a text, or the default if there is none.
    pub fn read_optional<T: Default>(&mut self, name: &str, parse: Parser<T>, notice: &str) -> Option<T> {
        let read = |path: &Path| AsciiText::read_file(path).and_then(|text| parse(path, &text));
        self.read_optional_file(name, read, Some(notice))
    }

    /// Value of a file, or the default if there is none; `notice`: notice about the default, if it is not expected.
    pub fn read_optional_file<T: Default>(
        &mut self,
        name: &str,
        read: impl FnOnce(&Path) -> Result<(T, Vec<String>), Faults>,
        notice: Option<&str>,
    ) -> Option<T> {
        let path = self.datbox.join(name);
        if path_exists(&path) {
            return self.gather_parsed(read(&path));
        }
        self.notices.extend(notice.map(|notice| format!("{name}: absent; {notice}")));
        Some(T::default())
    }
}

/// Rejects an absent DOF.INI if shapes are given in their principal axes, whose directions are in that file only.
pub fn check_absent_axes(datbox: &Path, bodies: &Bodies, faults: &mut Faults) {
    let path = datbox.join("DOF.INI");
    let needs_axes = |body: &&Body| {
        let is_sphere = |shape: &ShapeRecord| matches!(shape, ShapeRecord::Sphere { .. } | ShapeRecord::Point { .. });
        let has_inertia = body.inertia.is_some_and(|inertia| inertia != [0.0; 3]);
        has_inertia && !body.contactors.iter().all(|contactor| is_sphere(&contactor.shape))
    };
    let Some(body) = bodies.0.iter().position(|body| needs_axes(&body)).filter(|_| !path_exists(&path)) else { return };
    let found = format!("absent, and body {} is given in its principal axes", body + 1);
    faults.push(Fault::new(&path, None, "file", found, "expected the directions of these axes, a, b, g"));
}

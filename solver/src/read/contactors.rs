//! Contactors of BODIES.DAT as the other files name them: in rows of TACT_BEHAV.DAT by kind and colour, in Vloc_Rloc.INI by
//! kind and number.

use std::collections::BTreeMap;

use cd_formats::bodies::Bodies;
use cd_formats::tact_behav::{VisibilityRow, VisibilitySide};
use cd_formats::vloc_rloc::{ContactSide, VlocRloc};

use crate::math::Vec3;
use crate::scene::{BodyId, BodyPart, BodyShape, ContactorShape, Scene};

/// Name of the contactors between which wires and rods act.
pub const POINT_NAME: &str = "PT3Dx";

/// Kind of a contactor in Vloc_Rloc.INI, where SPHEb counts as SPHER.
fn contactor_kind(name: &str) -> &str {
    if name == "SPHEb" { "SPHER" } else { name }
}

/// Bodies that have a contactor of some kind and colour.
#[derive(Debug, Default)]
struct ContactorOwners {
    /// Index of the first of them.
    first: usize,
    /// Whether a second body has one.
    several: bool,
    /// Whether a body that [can be pushed](crate::scene::RigidBody::can_be_pushed) has one.
    moves: bool,
}

/// Contactors of all bodies by kind and colour.
pub struct ContactorTable(BTreeMap<(String, String), ContactorOwners>);

impl ContactorTable {
    /// Table of the contactors in BODIES.DAT; `scene` has the bodies in their order.
    pub fn new(records: &Bodies, scene: &Scene) -> ContactorTable {
        let mut table: BTreeMap<(String, String), ContactorOwners> = BTreeMap::new();
        for (index, (record, body)) in records.0.iter().zip(&scene.bodies).enumerate() {
            for contactor in &record.contactors {
                let key = (contactor.shape.row_name().to_string(), contactor.colour.clone());
                let owners = table.entry(key).or_insert_with(|| ContactorOwners { first: index, ..Default::default() });
                owners.several |= owners.first != index;
                owners.moves |= body.can_be_pushed();
            }
        }
        ContactorTable(table)
    }

    /// Bodies with the contactor of a side of a row; `None` if no body has one.
    fn owners(&self, side: &VisibilitySide) -> Option<&ContactorOwners> {
        self.0.get(&(side.contactor.clone(), side.colour.clone()))
    }

    /// Whether both contactors of a row exist.
    pub fn has_both(&self, row: &VisibilityRow) -> bool {
        self.owners(&row.candidate).is_some() && self.owners(&row.antagonist).is_some()
    }

    /// Whether contactors of a row can meet: if two bodies have them and contacts can push one of the two; points meet only
    /// points, as in LMGC90.
    pub fn can_meet(&self, row: &VisibilityRow) -> bool {
        let points = [&row.candidate, &row.antagonist].map(|side| side.contactor == POINT_NAME);
        points[0] == points[1] && self.has_bodies_that_meet(row)
    }

    /// Whether two bodies have the contactors of a row, of which contacts can push one.
    pub fn has_bodies_that_meet(&self, row: &VisibilityRow) -> bool {
        let (Some(a), Some(b)) = (self.owners(&row.candidate), self.owners(&row.antagonist)) else { return false };
        (a.moves || b.moves) && (a.first != b.first || a.several || b.several)
    }

    /// Whether both contactors of a row exist and are on bodies that contacts cannot push.
    pub fn joins_imposed_bodies(&self, row: &VisibilityRow) -> bool {
        let is_imposed = |side| self.owners(side).is_some_and(|owners| !owners.moves);
        is_imposed(&row.candidate) && is_imposed(&row.antagonist)
    }

    /// Whether both contactors of a row exist, and one alone is a point PT3Dx.
    pub fn pairs_point_with_surface(&self, row: &VisibilityRow) -> bool {
        let points = [&row.candidate, &row.antagonist].map(|side| side.contactor == POINT_NAME);
        points[0] != points[1] && self.has_both(row)
    }

    /// Whether a row is for points PT3Dx that can meet.
    pub fn joins_points(&self, row: &VisibilityRow) -> bool {
        row.candidate.contactor == POINT_NAME && self.can_meet(row)
    }
}

/// Numbers of contactors in Vloc_Rloc.INI.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ContactorNumbers {
    /// Counted in each body.
    InBody,
    /// Counted over all bodies, as in files of earlier versions of LMGC90. For each body, the number of contactors of all
    /// earlier bodies.
    OverAll(Vec<usize>),
}

/// Contactor that a side of a contact names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NamedContactor {
    /// Index in its body.
    Found(usize),
    /// The number is none of the body's, and there are several of its kind.
    Ambiguous,
    /// The body has no contactor of this kind.
    OtherKind,
}

impl ContactorNumbers {
    /// Numbers of a file: over all bodies if that, and not their count in each body, fits all contacts.
    pub fn from_contacts(records: &Bodies, history: &VlocRloc) -> ContactorNumbers {
        let sides = || {
            let all = history.contacts.iter().flat_map(|contact| [&contact.candidate, &contact.antagonist]);
            all.filter(|side| side.body < records.0.len())
        };
        let fits = |numbers: &ContactorNumbers| sides().all(|side| numbers.exact_index(records, side).is_some());
        let mut count_before = 0;
        let starts = records.0.iter().map(|body| {
            count_before += body.contactors.len();
            count_before - body.contactors.len()
        });
        let over_all = ContactorNumbers::OverAll(starts.collect());
        if !fits(&ContactorNumbers::InBody) && fits(&over_all) { over_all } else { ContactorNumbers::InBody }
    }

    /// Index of the contactor with the number and the kind of a side.
    fn exact_index(&self, records: &Bodies, side: &ContactSide) -> Option<usize> {
        let index = match self {
            ContactorNumbers::InBody => side.number,
            ContactorNumbers::OverAll(starts) => side.number.checked_sub(starts[side.body])?,
        };
        let contactor = records.0[side.body].contactors.get(index)?;
        (contactor_kind(contactor.shape.type_name()) == contactor_kind(&side.contactor)).then_some(index)
    }

    /// Contactor of a side. If the number does not fit it is the only one of its kind.
    pub fn find(&self, records: &Bodies, side: &ContactSide) -> NamedContactor {
        if let Some(index) = self.exact_index(records, side) {
            return NamedContactor::Found(index);
        }
        let contactors = records.0[side.body].contactors.iter().enumerate();
        let index_of_kind = |(index, contactor): (usize, &cd_formats::bodies::Contactor)| {
            (contactor_kind(contactor.shape.type_name()) == contactor_kind(&side.contactor)).then_some(index)
        };
        match contactors.filter_map(index_of_kind).collect::<Vec<_>>()[..] {
            [] => NamedContactor::OtherKind,
            [only] => NamedContactor::Found(only),
            _ => NamedContactor::Ambiguous,
        }
    }

    /// Whether the number of a side is the number of its contactor in its body.
    pub fn is_in_body(&self, records: &Bodies, side: &ContactSide) -> bool {
        ContactorNumbers::InBody.exact_index(records, side).is_some() && *self == ContactorNumbers::InBody
    }
}

/// Number of the part that a contactor of BODIES.DAT is in the scene; of its convex pieces that in which a point in the
/// body's frame lies deepest. `None` for a contactor PT3Dx.
pub fn part_number_in_scene(scene: &Scene, body: BodyId, contactor: usize, point: &Vec3) -> Option<u16> {
    if scene.bodies[body.index()].shape != BodyShape::Parts {
        return (contactor == 0).then_some(0);
    }
    let pieces = scene.parts_of(body).iter().filter(|part| usize::from(part.contactor) == contactor);
    let nearest = pieces.min_by(|a, b| height_over(a, point).total_cmp(&height_over(b, point)));
    nearest.map(|part| part.number)
}

/// Largest height of a point in the body's frame above the faces of a polyhedron, m; 0 for other shapes.
fn height_over(part: &BodyPart, point: &Vec3) -> f64 {
    let ContactorShape::Polyhedron(shape) = &part.geometry else { return 0.0 };
    let local = part.axes.inverse_transform_vector(&(point - part.offset));
    let height = |face: &[u16]| {
        let corner = |k: usize| shape.vertices()[usize::from(face[k])];
        let normal = (corner(1) - corner(0)).cross(&(corner(2) - corner(0))).normalize();
        normal.dot(&(local - corner(0)))
    };
    shape.faces().map(height).fold(f64::NEG_INFINITY, f64::max)
}

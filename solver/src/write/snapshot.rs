//! Converts the state, with the scene data that a reader needs, to a snapshot, which `formats` writes to a file.

use cd_formats::compute::{Adaptive, SweepPrecision};
use cd_formats::law_table::{LawParameter, law_parameters};
use cd_formats::snapshot::{
    AttractionArrays, BodyArrays, ContactArrays, DepartureArrays, FORMAT_VERSION, GravityArrays, IntervalArrays,
    LawArrays, LawName, MemoryArrays, PRESENCE_GONE, PRESENCE_PRESENT, PRESENCE_WAITING, PresenceArrays, RunParameters,
    SHAPE_PARTS, SHAPE_PLANE, SHAPE_SPHERE, STATUS_NO_CONTACT, STATUS_SLIDE, STATUS_STICK, ShapeArrays, Snapshot,
    SnapshotMeta,
};

use crate::laws::{Cohesion, ContactLaw};
use crate::math::Vec3;
use crate::scene::{BodyPart, BodyPresence, BodyShape, RigidBody, Scene};
use crate::state::{ContactId, ContactStatus, LawMemory, SolvedContact, State};

/// Returns the snapshot of a state: all of it except loads and caches that only save time.
pub fn state_snapshot(scene: &Scene, state: &State) -> Snapshot {
    let has_attractions = state.laws.iter().any(|law| law.pair_cohesion().is_some());
    let memory = state.laws.iter().any(ContactLaw::has_memory).then(|| memory_arrays(state));
    Snapshot {
        meta: snapshot_meta(scene, state),
        bodies: body_arrays(scene, state),
        contacts: contact_arrays(state),
        memory,
        laws: state.laws.iter().any(ContactLaw::has_law_memory).then(|| law_arrays(state)),
        attractions: has_attractions.then(|| AttractionArrays { contact_attraction: state.pair_attractions.clone() }),
        gravity: gravity_arrays(scene, state),
        presence: scene.roster.is_some().then(|| presence_arrays(state)),
        departures: (!state.exit_velocities.is_empty()).then(|| departure_arrays(state)),
        shapes: scene.has_parts().then(|| shape_arrays(scene, state)),
        interval: Some(interval_arrays(state)),
    }
}

fn snapshot_meta(scene: &Scene, state: &State) -> SnapshotMeta {
    let options = &scene.options;
    let laws: Vec<LawName> =
        scene.law_names.iter().zip(&state.laws).map(|(name, law)| current_law(name, law)).collect();
    let changed = laws != scene.law_names;
    SnapshotMeta {
        format: FORMAT_VERSION,
        program: format!("cd-solve {}", env!("CARGO_PKG_VERSION")),
        step: state.step,
        time: state.time,
        h: state.h,
        counted_from: (scene.counted_from != scene.start).then_some((scene.counted_from.step, scene.counted_from.time)),
        interval_start: Some(state.interval.start),
        parameters: RunParameters {
            theta: options.theta,
            accuracy: options.accuracy,
            target_error: options.target_error,
            adaptive: Some(options.adaptive()).filter(Adaptive::is_on),
            tol: options.tol(),
            penetration_tol: options.penetration_tol(),
            solver: options.solver,
            sweep_precision: Some(options.sweep_precision).filter(|precision| *precision != SweepPrecision::Auto),
            max_sweeps: options.max_sweeps(),
            check_every: options.check_every,
            alert: options.alert,
            self_gravity: options.self_gravity,
            gravity: options.gravity,
            xperiode: options.xperiode,
            yperiode: options.yperiode,
            zperiode: options.zperiode,
            narrow_phase: scene.has_parts().then_some(options.narrow_phase()),
            face_friction: scene.has_parts().then_some(options.face_friction),
            gravity_constant: options.gravity_constant,
            gravity_error: options.gravity_error(),
            gravity_order: options.gravity_order,
            gravity_opening: options.gravity_opening,
            gravity_refresh: (scene.gravity_refresh() > 1).then_some(scene.gravity_refresh()),
            gravity_moved: (scene.gravity_refresh() > 1).then_some(options.gravity_moved),
            gravity_quadrupole: options.gravity_quadrupole,
            gravity_softening: options.gravity_softening,
            fields: options.fields.clone(),
            uniform_gravity: state.gravity.into(),
            quench: state.quench,
            events_done: state.events_done as u64,
        },
        colours: scene.colours.clone(),
        materials: scene.materials.clone(),
        laws,
        laws_at_start: if changed { scene.law_names.clone() } else { Vec::new() },
        ledger: state.ledger.clone(),
        attraction: state.attraction.as_ref().map(|attraction| attraction.record.clone()),
        fallback: state.fallback,
        postpro: state.postpro,
        rest_since: state.rest_since,
        accuracy_control: state.accuracy_control,
        primary_response: state.primary_response,
        revolutions: scene.wall_circles(),
        cell: state.cell,
        radii: state.radii.clone(),
        bodies_entered: state.bodies_entered,
        continues_run: false,
        options: options.result_options(),
        parts: Vec::new(),
    }
}

/// Law of TACT_BEHAV.DAT with its present parameters.
fn current_law(name: &LawName, law: &ContactLaw) -> LawName {
    let mut current = name.clone();
    for (parameter, value) in law_parameters(&name.kind).zip(&mut current.parameters) {
        *value = match (parameter, law.cohesion) {
            (LawParameter::Friction | LawParameter::StaticFriction, _) => law.friction_static,
            (LawParameter::DynamicFriction, _) => law.friction_dynamic,
            (LawParameter::LiquidCohesion, Some(Cohesion::Wet { force, .. })) => force,
            (LawParameter::CohesiveStress | LawParameter::HamakerConstant, Some(Cohesion::Pair(pair))) => {
                pair.strength_parameter()
            }
            (LawParameter::NormalCohesion, Some(Cohesion::Bond { now, .. })) => now,
            (LawParameter::TangentialCohesion, Some(Cohesion::Bond { normal, tangential, now, .. }))
                if normal > 0.0 =>
            {
                tangential * (now / normal)
            }
            // No event changes the other parameters.
            _ => *value,
        };
    }
    current
}

fn body_arrays(scene: &Scene, state: &State) -> BodyArrays {
    let vectors =
        |value: &dyn Fn(usize) -> Vec3| -> Vec<[f64; 3]> { (0..state.x.len()).map(|i| value(i).into()).collect() };
    let bodies = &scene.bodies;
    BodyArrays {
        body_id: (1..=bodies.len() as u64).collect(),
        body_x: vectors(&|i| state.x[i]),
        body_q: state.q.iter().map(|q| [q.w, q.i, q.j, q.k]).collect(),
        body_v: vectors(&|i| state.v[i]),
        body_w: vectors(&|i| state.q[i].inverse_transform_vector(&state.w[i])),
        body_w_world: vectors(&|i| state.w[i]),
        body_mass: bodies.iter().map(|b| b.mass).collect(),
        body_inertia: bodies.iter().map(|b| b.inertia).collect(),
        body_radius: bodies.iter().map(|b| b.radius).collect(),
        body_half_lengths: vectors(&|i| match bodies[i].shape {
            BodyShape::Plane { half_lengths } => half_lengths,
            BodyShape::Sphere { .. } | BodyShape::Parts => Vec3::repeat(bodies[i].radius),
        }),
        body_shape: (bodies.iter())
            .map(|b| match b.shape {
                BodyShape::Sphere { .. } => SHAPE_SPHERE,
                BodyShape::Plane { .. } => SHAPE_PLANE,
                BodyShape::Parts => SHAPE_PARTS,
            })
            .collect(),
        body_driven: bodies.iter().map(RigidBody::imposed_components).collect(),
        body_colour: bodies.iter().map(|b| b.colour).collect(),
        body_material: bodies.iter().map(|b| b.material).collect(),
    }
}

fn shape_arrays(scene: &Scene, state: &State) -> ShapeArrays {
    let mut shapes = ShapeArrays::default();
    shapes.turning.turning_body = scene.free_rotors.iter().map(|body| body.0).collect();
    shapes.turning.turning_momentum = state.angular_momentum.iter().map(|&l| l.into()).collect();
    shapes.contacts.contact_rank =
        state.contacts.iter().map(|c| <[u16; 2]>::from(c.contact.part_numbers).map(u32::from)).collect();
    shapes.contacts.contact_area = state.contacts.iter().map(|c| c.contact.area).collect();
    let cached_pairs = state.detection_cache.cached_pairs();
    let pair_values = |value: fn(&BodyPart) -> u32| -> Vec<[u32; 2]> {
        cached_pairs.iter().map(|pair| pair.parts.map(|part| value(&scene.parts[part.index()]))).collect()
    };
    shapes.pairs.pair_body = pair_values(|part| part.body.0);
    shapes.pairs.pair_rank = pair_values(|part| part.number.into());
    shapes.pairs.pair_memory = cached_pairs.iter().map(|pair| pair.memory.to_words()).collect();
    shapes
}

fn interval_arrays(state: &State) -> IntervalArrays {
    let pair_virials = &state.interval.pair_virials;
    IntervalArrays {
        interval_body: pair_virials.iter().map(|pair| pair.bodies.map(|body| body.0)).collect(),
        interval_virial: pair_virials.iter().map(|pair| pair.virial).collect(),
    }
}

fn presence_arrays(state: &State) -> PresenceArrays {
    let value = |presence: &BodyPresence| match presence {
        BodyPresence::Waiting => PRESENCE_WAITING,
        BodyPresence::Present => PRESENCE_PRESENT,
        BodyPresence::Gone => PRESENCE_GONE,
    };
    PresenceArrays { body_presence: state.presence.iter().map(value).collect() }
}

fn departure_arrays(state: &State) -> DepartureArrays {
    DepartureArrays { body_exit_v: state.exit_velocities.iter().map(|v| (*v).into()).collect() }
}

fn gravity_arrays(scene: &Scene, state: &State) -> Option<GravityArrays> {
    let attraction = state.attraction.as_ref()?;
    let rows_of_all_bodies = |rows: &[Vec3]| {
        let mut all = vec![[0.0; 3]; scene.bodies.len()];
        scene.free.iter().zip(rows).for_each(|(&i, row)| all[i.index()] = (*row).into());
        all
    };
    Some(GravityArrays {
        gravity_last: rows_of_all_bodies(&attraction.last),
        gravity_before: rows_of_all_bodies(&attraction.previous),
    })
}

fn contact_arrays(state: &State) -> ContactArrays {
    let list = &state.contacts;
    let vectors =
        |value: &dyn Fn(&SolvedContact) -> Vec3| -> Vec<[f64; 3]> { list.iter().map(|c| value(c).into()).collect() };
    ContactArrays {
        contact_body: list.iter().map(|c| [c.contact.candidate.0, c.contact.antagonist.0]).collect(),
        contact_feature: list.iter().map(|c| c.contact.features.into()).collect(),
        contact_point: vectors(&|c| c.contact.point),
        contact_frame: list.iter().map(|c| c.contact.frame().map(Into::into)).collect(),
        contact_gap: list.iter().map(|c| c.contact.gap).collect(),
        contact_force: vectors(&|c| c.impulse / state.h),
        contact_impulse: vectors(&|c| c.impulse),
        contact_velocity: vectors(&|c| c.velocity),
        contact_status: list
            .iter()
            .map(|c| match c.status {
                ContactStatus::NoContact => STATUS_NO_CONTACT,
                ContactStatus::Stick => STATUS_STICK,
                ContactStatus::Slide => STATUS_SLIDE,
            })
            .collect(),
        contact_law: list.iter().map(|c| c.contact.law.0).collect(),
    }
}

fn memory_arrays(state: &State) -> MemoryArrays {
    MemoryArrays {
        contact_bonded: state.contacts.iter().map(|c| c.bond.is_some().into()).collect(),
        contact_moment: state.contacts.iter().map(|c| c.moment.into()).collect(),
        contact_bond_gap: state.contacts.iter().map(|c| c.bond.unwrap_or(0.0)).collect(),
    }
}

fn law_arrays(state: &State) -> LawArrays {
    let memories: Vec<LawMemory> = (0..state.contacts.len()).map(|k| state.law_memory(ContactId::new(k))).collect();
    LawArrays {
        contact_reference_gap: memories.iter().map(|memory| memory.reference_gap).collect(),
        contact_soundness: memories.iter().map(|memory| memory.soundness).collect(),
        contact_sliding: memories.iter().map(|memory| memory.sliding.into()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laws::{GapForecast, LawInput};
    use cd_formats::law_table::LAW_TABLE;

    /// After events a snapshot has the law in force: made from its parameters it acts as the law that was changed.
    #[test]
    fn changed_laws_are_those_of_the_snapshot() {
        for entry in LAW_TABLE.iter().filter(|entry| entry.computed) {
            let parameters: Vec<f64> = (1..).take(entry.parameters().count()).map(|k| 0.25 * f64::from(k)).collect();
            let name = LawName { nickname: "law_0".into(), kind: entry.label.into(), parameters };
            let model = name.model().unwrap();
            let mut law = ContactLaw::new(&model);
            law.set_friction(2.0);
            assert_eq!(law.set_cohesion(4.0), model.has_settable_cohesion(), "{}", entry.label);
            let now = ContactLaw::new(&current_law(&name, &law).model().unwrap());
            let at = LawInput {
                gap: 0.0,
                h: 0.5,
                closing_time: 0.5,
                gap_forecast: GapForecast::Due,
                u_n: -1.0,
                sliding_speed: 0.0,
                radius: 2.0,
                slid_before: false,
                bonded: true,
                pair_attraction: 0.0,
            };
            if law.is_coupled() || law.strain_spring().is_some() {
                continue; // neither friction nor cohesion to change
            }
            // An attraction of pairs is made before the shifts.
            let terms = |law: &ContactLaw| (law.contact_shift(&at), law.pair_cohesion());
            assert_ne!(terms(&ContactLaw::new(&model)), terms(&law), "{}", entry.label);
            assert_eq!(terms(&now), terms(&law), "{}", entry.label);
        }
    }
}

//! Bodies that enter and leave the run.

use crate::scene::{BodyId, BodyPresence, PartId, Scene};
use crate::state::{CachedPair, DetectionCache, State};

impl State {
    /// Applies the presence of the bodies to the scene, and removes from the state all data of bodies that are not in the
    /// run.
    pub fn apply_presence(&mut self, scene: &mut Scene) {
        let identity = |part: PartId| (scene.parts[part.index()].body, scene.parts[part.index()].number);
        let cached = self.detection_cache.cached_pairs();
        let cached: Vec<_> = cached.into_iter().map(|pair| (pair.parts.map(identity), pair.memory)).collect();
        let turning = std::mem::take(&mut scene.free_rotors);
        scene.set_presence(&self.presence);
        let scene = &*scene;
        let restored = cached.into_iter().filter_map(|([a, b], memory)| {
            let part = |(body, number): (BodyId, u16)| scene.part_index(body, number);
            Some(CachedPair { parts: [part(a)?, part(b)?], memory })
        });
        self.detection_cache = DetectionCache { restored_pairs: restored.collect(), ..DetectionCache::default() };
        let momentum = |&body: &BodyId| match turning.binary_search(&body) {
            Ok(position) => self.angular_momentum[position],
            Err(_) => scene.bodies[body.index()].angular_momentum(&self.q[body.index()], &self.w[body.index()]),
        };
        self.angular_momentum = scene.free_rotors.iter().map(momentum).collect();
        let is_present = |body: BodyId| self.presence[body.index()] == BodyPresence::Present;
        let kept: Vec<bool> = self
            .contacts
            .iter()
            .map(|solved| is_present(solved.contact.candidate) && is_present(solved.contact.antagonist))
            .collect();
        fn retain<T>(rows: &mut Vec<T>, kept: &[bool]) {
            let mut kept = kept.iter();
            rows.retain(|_| *kept.next().unwrap_or(&true));
        }
        retain(&mut self.contacts, &kept);
        retain(&mut self.memories, &kept);
        retain(&mut self.pair_attractions, &kept);
        self.interval.pair_virials.retain(|pair| pair.bodies.into_iter().all(is_present));
        // Its rows belong to the free bodies before.
        self.attraction = None;
    }
}

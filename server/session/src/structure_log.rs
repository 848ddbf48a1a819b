//! The structure of a scene as an ordered, bounded log: one keyframe and the patches since.
//!
//! All readers share it. A reader is a cursor; one whose version has left the log gets a keyframe,
//! so a slow reader costs no memory and slows nobody.

use std::collections::VecDeque;
use std::sync::Arc;

use kerf_physics::surface::delta::{BodyStructure, Keyframe, TopologyPatch};

/// How far a reader has read; [`Cursor::default`] has read nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Cursor(Option<Place>);

/// A version within one life of the scene: versions start over when the scene is reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Place {
    pub epoch: u64,
    pub version: u64,
}

impl Cursor {
    pub fn place(self) -> Option<Place> {
        self.0
    }
}

/// What a reader gets next.
#[derive(Debug)]
pub(crate) enum Next {
    Keyframe(Arc<Keyframe>),
    Patch(Arc<TopologyPatch>),
    /// The reader has everything.
    UpToDate,
    /// The reader needs a keyframe that has yet to be taken.
    Awaiting,
}

pub(crate) struct StructureLog {
    epoch: u64,
    /// The newest version that the log leads to.
    head: Option<u64>,
    keyframe: Option<Arc<Keyframe>>,
    /// Contiguous: each begins at the version that the one before led to.
    patches: VecDeque<Arc<TopologyPatch>>,
    bytes: usize,
    max_patches: usize,
    max_bytes: usize,
    keyframe_wanted: bool,
}

impl StructureLog {
    pub fn new(max_patches: usize, max_bytes: usize) -> Self {
        Self {
            epoch: 0,
            head: None,
            keyframe: None,
            patches: VecDeque::new(),
            bytes: 0,
            max_patches,
            max_bytes,
            keyframe_wanted: false,
        }
    }

    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Patches that are kept, and the bytes that they hold.
    pub fn kept(&self) -> (usize, usize) {
        (self.patches.len(), self.bytes)
    }

    /// Whether a reader waits for a keyframe.
    pub fn keyframe_wanted(&self) -> bool {
        self.keyframe_wanted
    }

    /// Forgets everything. Readers that come, or are still there, need a keyframe.
    pub fn clear(&mut self) {
        self.head = None;
        self.keyframe = None;
        self.patches.clear();
        self.bytes = 0;
    }

    /// The scene starts over; every reader needs a keyframe.
    pub fn start_over(&mut self) {
        self.clear();
        self.epoch += 1;
    }

    pub fn set_keyframe(&mut self, keyframe: Keyframe) {
        if self.head != Some(keyframe.topology_version) {
            self.clear();
        }
        self.head = Some(keyframe.topology_version);
        self.keyframe = Some(Arc::new(keyframe));
        self.keyframe_wanted = false;
    }

    pub fn push(&mut self, patch: TopologyPatch) {
        if self.head != Some(patch.from_version) {
            // Steps went by while nobody read.
            self.clear();
        }
        self.head = Some(patch.to_version);
        self.bytes += bytes_of(&patch);
        self.patches.push_back(Arc::new(patch));
        while self.patches.len() > self.max_patches || self.bytes > self.max_bytes {
            let Some(gone) = self.patches.pop_front() else { break };
            self.bytes -= bytes_of(&gone);
        }
        // A keyframe that no patch leads on from is of no use to anybody.
        if self.keyframe.as_ref().is_some_and(|keyframe| !self.leads_on(keyframe.topology_version)) {
            self.keyframe = None;
        }
    }

    fn patch_from(&self, version: u64) -> Option<&Arc<TopologyPatch>> {
        let index = self.patches.binary_search_by_key(&version, |patch| patch.from_version).ok()?;
        self.patches.get(index)
    }

    fn leads_on(&self, version: u64) -> bool {
        self.head == Some(version) || self.patch_from(version).is_some()
    }

    /// What the reader at `cursor` gets next; moves the cursor past it.
    pub fn next(&mut self, cursor: &mut Cursor) -> Next {
        if let Some(place) = cursor.0.filter(|place| place.epoch == self.epoch) {
            if self.head == Some(place.version) {
                return Next::UpToDate;
            }
            if let Some(patch) = self.patch_from(place.version).cloned() {
                cursor.0 = Some(Place { version: patch.to_version, ..place });
                return Next::Patch(patch);
            }
        }
        match &self.keyframe {
            Some(keyframe) => {
                cursor.0 = Some(Place { epoch: self.epoch, version: keyframe.topology_version });
                Next::Keyframe(Arc::clone(keyframe))
            }
            None => {
                self.keyframe_wanted = true;
                Next::Awaiting
            }
        }
    }
}

/// Memory that a patch holds, near enough to bound it.
fn bytes_of(patch: &TopologyPatch) -> usize {
    let body_bytes = |body: &BodyStructure| {
        size_of::<BodyStructure>()
            + size_of_val(body.nodes.as_slice())
            + size_of_val(body.elements.as_slice())
            + size_of_val(body.vertices.as_slice())
            + size_of_val(body.held.as_slice())
            + size_of_val(body.quads.as_slice())
    };
    size_of::<TopologyPatch>() + patch.bodies.iter().map(body_bytes).sum::<usize>()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patch(from_version: u64) -> TopologyPatch {
        TopologyPatch { from_version, to_version: from_version + 1, ..TopologyPatch::default() }
    }

    fn keyframe(topology_version: u64) -> Keyframe {
        Keyframe { topology_version, ..Keyframe::default() }
    }

    fn log_with_keyframe(version: u64) -> StructureLog {
        let mut log = StructureLog::new(3, 1 << 20);
        log.set_keyframe(keyframe(version));
        log
    }

    /// Versions that a reader goes through: negative where a keyframe was needed.
    fn read_all(log: &mut StructureLog, cursor: &mut Cursor) -> Vec<i64> {
        let mut seen = Vec::new();
        loop {
            match log.next(cursor) {
                Next::Keyframe(keyframe) => seen.push(-(keyframe.topology_version as i64)),
                Next::Patch(patch) => seen.push(patch.to_version as i64),
                Next::UpToDate | Next::Awaiting => return seen,
            }
        }
    }

    #[test]
    fn a_reader_that_joins_gets_the_keyframe_then_every_patch_in_order() {
        let mut log = log_with_keyframe(4);
        log.push(patch(4));
        log.push(patch(5));
        let mut cursor = Cursor::default();
        assert_eq!(read_all(&mut log, &mut cursor), [-4, 5, 6]);
        log.push(patch(6));
        assert_eq!(read_all(&mut log, &mut cursor), [7]);
    }

    #[test]
    fn a_reader_that_fell_off_the_log_waits_for_a_keyframe_and_goes_on_from_it() {
        let mut log = log_with_keyframe(0);
        let mut cursor = Cursor::default();
        assert_eq!(read_all(&mut log, &mut cursor), [0]);
        (0..10).for_each(|from| log.push(patch(from)));
        assert!(matches!(log.next(&mut cursor), Next::Awaiting));
        assert!(log.keyframe_wanted());
        log.set_keyframe(keyframe(10));
        log.push(patch(10));
        assert_eq!(read_all(&mut log, &mut cursor), [-10, 11]);
    }

    #[test]
    fn a_keyframe_for_one_reader_does_not_cut_off_another() {
        let mut log = log_with_keyframe(0);
        let mut behind = Cursor::default();
        read_all(&mut log, &mut behind);
        log.push(patch(0));
        log.push(patch(1));
        log.set_keyframe(keyframe(2));
        assert_eq!(read_all(&mut log, &mut behind), [1, 2]);
        assert_eq!(read_all(&mut log, &mut Cursor::default()), [-2]);
    }

    #[test]
    fn patches_are_bounded_in_number_and_in_bytes() {
        let mut log = log_with_keyframe(0);
        (0..100).for_each(|from| log.push(patch(from)));
        assert_eq!(log.patches.len(), 3);
        let mut small = StructureLog::new(100, bytes_of(&patch(0)) * 2);
        small.set_keyframe(keyframe(0));
        (0..100).for_each(|from| small.push(patch(from)));
        assert_eq!(small.patches.len(), 2);
        assert_eq!(small.bytes, bytes_of(&patch(0)) * 2);
    }

    #[test]
    fn a_patch_larger_than_the_log_leaves_readers_to_a_keyframe() {
        let mut log = StructureLog::new(3, 1);
        log.set_keyframe(keyframe(0));
        let mut cursor = Cursor::default();
        read_all(&mut log, &mut cursor);
        log.push(patch(0));
        assert!(matches!(log.next(&mut cursor), Next::Awaiting));
    }

    #[test]
    fn after_a_reset_every_reader_gets_a_keyframe_though_versions_repeat() {
        let mut log = log_with_keyframe(0);
        let mut cursor = Cursor::default();
        assert_eq!(read_all(&mut log, &mut cursor), [0]);
        log.start_over();
        assert!(matches!(log.next(&mut cursor), Next::Awaiting));
        log.set_keyframe(keyframe(0));
        assert!(matches!(log.next(&mut cursor), Next::Keyframe(_)));
    }

    #[test]
    fn a_gap_in_versions_is_never_bridged() {
        let mut log = log_with_keyframe(0);
        let mut cursor = Cursor::default();
        read_all(&mut log, &mut cursor);
        log.push(patch(7));
        assert!(matches!(log.next(&mut cursor), Next::Awaiting));
    }
}

//! What steps change in the structure of a scene.

use crate::likeness::LikenessChange;

/// What one or several steps have changed: [`crate::World::structure_change`].
#[derive(Clone, Debug)]
pub struct StructureChange {
    pub(crate) from_version: u64,
    pub(crate) to_version: u64,
    /// By object.
    pub(crate) objects: Vec<LikenessChange>,
}

impl StructureChange {
    /// Goes on with the change that begins where this one leads to.
    pub fn append(&mut self, next: Self) {
        assert_eq!(self.to_version, next.from_version, "changes come in order");
        self.to_version = next.to_version;
        self.objects.iter_mut().zip(next.objects).for_each(|(object, next)| object.append(next));
    }

    /// Number of things that it names: links, voxels, elements, nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.objects.iter().map(LikenessChange::len).sum()
    }

    /// Whether it names none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

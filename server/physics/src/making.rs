//! How far the making of a world is.

/// What of an object is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MakingStage {
    /// The voxels that its shape fills, and their materials.
    Voxels,
    /// The composite elements over them.
    Elements,
    /// The hierarchy that its steps are solved on.
    Solver,
    /// The rest under its prestrain, load by load.
    Equilibrium,
}

/// How far a world is that is being made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Making {
    /// Index of the object that is made.
    pub object: usize,
    /// How many there are.
    pub objects: usize,
    /// What of it.
    pub stage: MakingStage,
    /// Fine voxels of the object; 0: they are not counted yet.
    pub voxels: usize,
    /// Its composite elements, in the same way.
    pub elements: usize,
    /// Done of the whole world, 0 to 1: an estimate by time, in which every object counts alike. It never falls.
    pub share: f64,
}

impl MakingStage {
    /// Of the time that an object takes, where this stage begins. Measured on `liver-tissue`.
    fn begins_at(self) -> f64 {
        match self {
            Self::Voxels => 0.0,
            Self::Elements => 0.3,
            Self::Solver => 0.35,
            Self::Equilibrium => 0.5,
        }
    }
}

/// Where the last of them ends: then the world is looked through for what it hardly means.
const ENDS_AT: f64 = 0.7;

/// Tells somebody how far a world is.
pub(crate) struct Teller<'a> {
    tell: &'a mut dyn FnMut(Making),
    making: Making,
}

impl<'a> Teller<'a> {
    pub(crate) fn new(objects: usize, tell: &'a mut dyn FnMut(Making)) -> Self {
        let making = Making { object: 0, objects, stage: MakingStage::Voxels, voxels: 0, elements: 0, share: 0.0 };
        Self { tell, making }
    }

    pub(crate) fn object(&mut self, object: usize) {
        (self.making.object, self.making.voxels, self.making.elements) = (object, 0, 0);
        self.stage(MakingStage::Voxels);
    }

    /// A stage begins.
    pub(crate) fn stage(&mut self, stage: MakingStage) {
        self.making.stage = stage;
        self.done(stage.begins_at());
    }

    pub(crate) fn counted(&mut self, voxels: usize, elements: usize) {
        (self.making.voxels, self.making.elements) = (voxels, elements);
    }

    /// So much of the equilibrium is reached.
    pub(crate) fn relaxed(&mut self, share: f64) {
        let begins_at = MakingStage::Equilibrium.begins_at();
        self.done(begins_at + (ENDS_AT - begins_at) * share);
    }

    fn done(&mut self, of_object: f64) {
        let share = (self.making.object as f64 + of_object) / self.making.objects as f64;
        self.making.share = self.making.share.max(share);
        (self.tell)(self.making);
    }
}

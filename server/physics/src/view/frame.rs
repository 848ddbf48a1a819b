//! Where a step has left a scene.

use crate::body::Body;
use crate::likeness::Placement;
use crate::surface::adapt::Dent;
use crate::tool::Pose;
use crate::tool::blade::Blade;

/// Where a step has left the objects of a scene, and the blades that touch them: [`crate::World::write_frame`].
#[derive(Default)]
pub struct Frame {
    pub(crate) objects: Vec<ObjectFrame>,
}

/// One object's part of a frame.
#[derive(Default)]
pub(crate) struct ObjectFrame {
    pub(crate) placement: Placement,
    dents: Vec<Dent>,
    /// As many of them are of this frame; the others are room.
    dent_count: usize,
}

/// A blade that touches an object.
pub(crate) struct Touch<'a> {
    pub(crate) blade: &'a Blade,
    pub(crate) pose: Pose,
    /// How far the edge has gone past the points it presses on, at most, m.
    pub(crate) depth_m: f64,
}

impl Frame {
    /// Whether a blade touches any of the objects.
    #[must_use]
    pub fn is_touched(&self) -> bool {
        self.objects.iter().any(|object| object.dent_count > 0)
    }
}

impl ObjectFrame {
    /// Takes over where a body is and what touches it; allocates nothing unless there is more than ever before.
    pub(crate) fn write<'a>(&mut self, body: &Body, touches: impl Iterator<Item = Touch<'a>>) {
        self.placement.write(body);
        self.dent_count = 0;
        for touch in touches {
            if self.dents.len() == self.dent_count {
                self.dents.push(Dent::default());
            }
            let dent = &mut self.dents[self.dent_count];
            dent.blade.place(touch.blade, &touch.pose);
            dent.depth_m = touch.depth_m;
            self.dent_count += 1;
        }
    }

    pub(crate) fn dents(&self) -> &[Dent] {
        &self.dents[..self.dent_count]
    }
}

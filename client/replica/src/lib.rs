//! A client's copy of what a session shows: built from a keyframe, kept by patches, moved by states.
//!
//! Everything that comes in is checked before it is used, with the field named in the error; after
//! each change of structure the surface's hash is compared with the server's. A refused message
//! leaves the replica as it was, except that a patch which fails half-way, or leads to another hash,
//! drops the structure: [`ReplicaError::needs_keyframe`] says so.
//!
//! Deliberately absent: network, threads, and any knowledge of the physics.

mod assembler;
mod body;
mod error;
pub mod glb;
mod hash;
pub mod stl;
mod surface;
mod vertex;

pub use assembler::Assembler;
pub use body::Body;
pub use error::{FieldError, Problem, ReplicaError};
pub use hash::surface_hash;
pub use surface::{Face, Surface, Triangle};
pub use vertex::Vertex;

use body::MAX_NODES;
use kerf_proto::v1::{self, view_response};

/// The structure and state of every object of a session.
#[derive(Clone, Debug, Default)]
pub struct Replica {
    structure: Option<Structure>,
    moment: Option<Moment>,
}

/// All objects at one topology version.
#[derive(Clone, Debug)]
struct Structure {
    topology_version: u64,
    /// Surfaces come as plain vertices, of which there is no hash.
    has_plain_vertices: bool,
    /// Step of the reference of the displacements, once one has come.
    reference_step: Option<u64>,
    bodies: Vec<Body>,
}

/// When the displacements were read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Steps taken.
    pub step: u64,
    /// Simulated time, s.
    pub sim_time_s: f64,
}

impl Replica {
    /// Applies what an event says of structure and state; events and faults change nothing.
    ///
    /// # Errors
    /// See [`ReplicaError`].
    pub fn apply(&mut self, message: &view_response::Message) -> Result<(), ReplicaError> {
        match message {
            view_response::Message::Keyframe(keyframe) => self.apply_keyframe(keyframe),
            view_response::Message::Patch(patch) => self.apply_patch(patch),
            view_response::Message::State(state) => self.apply_state(state),
            view_response::Message::Hello(_) | view_response::Message::Event(_) | view_response::Message::Fault(_) => {
                Ok(())
            }
            // The part of one says nothing: see [`Assembler`].
            view_response::Message::Fragment(_) => Err(ReplicaError::Fragments),
        }
    }

    /// Replaces the whole structure.
    ///
    /// # Errors
    /// A field that is not valid, or a hash that does not match.
    pub fn apply_keyframe(&mut self, keyframe: &v1::Keyframe) -> Result<(), ReplicaError> {
        let has_plain_vertices = keyframe.encoding() == v1::SurfaceEncoding::Vertices;
        let mut bodies = vec![Body::new(has_plain_vertices); keyframe.bodies.len()];
        change("keyframe", &mut bodies, &keyframe.bodies)?;
        let structure =
            Structure { topology_version: keyframe.topology_version, has_plain_vertices, reference_step: None, bodies };
        structure.check_hash(keyframe.surface_hash)?;
        self.structure = Some(structure);
        self.moment = None;
        Ok(())
    }

    /// Changes the structure.
    ///
    /// # Errors
    /// No keyframe yet, another version, a field that is not valid, or a hash that does not match.
    pub fn apply_patch(&mut self, patch: &v1::TopologyPatch) -> Result<(), ReplicaError> {
        let structure = self.structure.as_ref().ok_or(ReplicaError::NoKeyframe)?;
        if patch.from_version != structure.topology_version || patch.to_version <= patch.from_version {
            return Err(ReplicaError::PatchOfOtherVersion {
                have: structure.topology_version,
                from: patch.from_version,
                to: patch.to_version,
            });
        }
        check_body_count("patch", structure.bodies.len(), patch.bodies.len())?;
        // Taken out, so that a patch that fails half-way leaves nothing half-changed behind.
        let Some(mut structure) = self.structure.take() else {
            return Err(ReplicaError::NoKeyframe);
        };
        self.moment = None;
        change("patch", &mut structure.bodies, &patch.bodies)?;
        structure.topology_version = patch.to_version;
        structure.check_hash(patch.surface_hash)?;
        self.structure = Some(structure);
        Ok(())
    }

    /// Moves the nodes.
    ///
    /// # Errors
    /// No keyframe yet, another version or reference, or a field that is not valid.
    pub fn apply_state(&mut self, state: &v1::State) -> Result<(), ReplicaError> {
        let structure = self.structure.as_mut().ok_or(ReplicaError::NoKeyframe)?;
        if state.topology_version != structure.topology_version {
            return Err(ReplicaError::StateOfOtherVersion {
                have: structure.topology_version,
                got: state.topology_version,
            });
        }
        check_body_count("state", structure.bodies.len(), state.bodies.len())?;
        if !state.has_reference && structure.reference_step != Some(state.reference_step) {
            return Err(ReplicaError::NoReference { got: state.reference_step });
        }
        let bodies = structure.bodies.iter().zip(&state.bodies).enumerate();
        let moved = bodies.map(|(index, (body, moved))| {
            body.read_state(moved, state.has_reference).map_err(|source| ReplicaError::field("state", index, source))
        });
        let moved: Vec<_> = moved.collect::<Result<_, _>>()?;
        for (body, moved) in structure.bodies.iter_mut().zip(moved) {
            body.displace(moved);
        }
        structure.reference_step = Some(state.reference_step);
        self.moment = Some(Moment { step: state.step, sim_time_s: state.sim_time_s });
        Ok(())
    }

    /// Version of the structure; `None` before the first keyframe and after a loss of it.
    #[must_use]
    pub fn topology_version(&self) -> Option<u64> {
        self.structure.as_ref().map(|structure| structure.topology_version)
    }

    /// When the state was read; `None` until a state has come for the structure as it is now.
    #[must_use]
    pub fn moment(&self) -> Option<Moment> {
        self.moment
    }

    /// The objects, in the order of the scene; empty before the first keyframe.
    #[must_use]
    pub fn bodies(&self) -> &[Body] {
        self.structure.as_ref().map_or(&[], |structure| &structure.bodies)
    }

    /// The surface of each object where it is now; `None` until a state has come for the structure
    /// as it is now, because nodes that are new in a patch have no place before it.
    #[must_use]
    pub fn surfaces(&self) -> Option<Vec<Surface>> {
        self.moment?;
        Some(self.bodies().iter().map(Surface::of).collect())
    }
}

/// Changes each object, as far as there is room for the nodes of all.
fn change(message: &'static str, bodies: &mut [Body], changes: &[v1::BodyStructure]) -> Result<(), ReplicaError> {
    let mut room = MAX_NODES;
    for (index, (body, change)) in bodies.iter_mut().zip(changes).enumerate() {
        body.change(change, room).map_err(|source| ReplicaError::field(message, index, source))?;
        room -= change.node_count;
    }
    Ok(())
}

fn check_body_count(message: &'static str, expected: usize, got: usize) -> Result<(), ReplicaError> {
    if expected == got { Ok(()) } else { Err(ReplicaError::BodyCount { message, expected, got }) }
}

impl Structure {
    fn check_hash(&self, expected: u64) -> Result<(), ReplicaError> {
        let computed = hash::of_objects(self.bodies.iter().map(Body::hash_sum));
        if self.has_plain_vertices || computed == expected {
            return Ok(());
        }
        Err(ReplicaError::HashMismatch { topology_version: self.topology_version, expected, computed })
    }
}

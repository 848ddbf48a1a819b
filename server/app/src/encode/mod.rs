//! States as viewers get them: in quanta, encoded once for all who want the same.

mod differences;
mod vertices;

use std::sync::Arc;

use kerf_physics::surface::delta::{AdaptedVertex, Keyframe, TopologyPatch};
use kerf_proto::{integers, v1};
use kerf_session::ViewState;
use prost::bytes::Bytes;

use self::differences::Differences;
use self::vertices::Vertices;
use crate::convert::view;
use crate::status::RequestError;

/// A component is off by at most 2^-7 of a voxel where nobody asks for more or less.
const DEFAULT_EXPONENT: i32 = 7;
/// Coarsest and finest that may be asked for.
const EXPONENTS: (i32, i32) = (4, 12);

/// What a viewer chooses of how its states are encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Encoding {
    /// A component is off by at most two to the power of minus this, in voxels.
    error_exponent: i32,
    surface: Surface,
}

/// How surfaces go to a viewer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Surface {
    /// Bound to elements, whose nodes move.
    Lattice,
    /// As plain vertices.
    Vertices { with_normals: bool },
}

impl Surface {
    fn granted(request: &v1::ViewRequest) -> Result<Self, RequestError> {
        match (v1::SurfaceEncoding::try_from(request.encoding), request.wants_normals) {
            (Ok(v1::SurfaceEncoding::Vertices), with_normals) => Ok(Self::Vertices { with_normals }),
            (Ok(_), false) => Ok(Self::Lattice),
            (Ok(_), true) => Err(RequestError::Choice {
                field: "wants_normals",
                limit: "false, but with SURFACE_ENCODING_VERTICES: a lattice's client has the surface's place for itself",
            }),
            (Err(_), _) => Err(RequestError::Choice { field: "encoding", limit: "one that this server knows" }),
        }
    }
}

impl Encoding {
    /// What is granted for a wish: the next smaller power of two.
    ///
    /// # Errors
    /// The wish is no error at all.
    pub fn granted(request: &v1::ViewRequest) -> Result<Self, RequestError> {
        let max_error = request.max_error_voxels;
        if !max_error.is_finite() || max_error < 0.0 {
            return Err(RequestError::Rate { field: "max_error_voxels", value: max_error });
        }
        let error_exponent = match max_error == 0.0 {
            true => DEFAULT_EXPONENT,
            false => (-max_error.log2()).ceil().clamp(EXPONENTS.0.into(), EXPONENTS.1.into()) as i32,
        };
        Ok(Self { error_exponent, surface: Surface::granted(request)? })
    }

    /// What a displacement is counted in, m: rounding errs by half of it.
    fn quantum_m(self, voxel_size_m: f64) -> f64 {
        2.0 * voxel_size_m * (-f64::from(self.error_exponent)).exp2()
    }
}

/// Encodes a session's states for the viewers who want them alike.
pub struct Encoder {
    /// Per object, m.
    quanta_m: Vec<f64>,
    surface: Surface,
    /// What plain vertices are told by; unused for a lattice.
    vertices: Vertices,
    differences: Differences,
    epoch: u64,
    newest: Option<(Arc<ViewState>, Arc<EncodedState>)>,
}

/// A state, ready for every viewer.
pub struct EncodedState {
    epoch: u64,
    /// Without a reference, with energies.
    message: v1::State,
    reference: Vec<Bytes>,
}

/// The reference that a viewer has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeldReference {
    epoch: u64,
    step: u64,
}

impl Encoder {
    /// For objects of these voxels.
    #[must_use]
    pub fn new(encoding: Encoding, voxel_sizes_m: impl Iterator<Item = f64>) -> Self {
        Self {
            quanta_m: voxel_sizes_m.map(|size_m| encoding.quantum_m(size_m)).collect(),
            surface: encoding.surface,
            vertices: Vertices::default(),
            differences: Differences::default(),
            epoch: 0,
            newest: None,
        }
    }

    /// Unit of each object's displacements, m.
    #[must_use]
    pub fn quanta_m(&self) -> &[f64] {
        &self.quanta_m
    }

    /// Encodes a keyframe of the epoch; `None` where the scene has started over since.
    pub fn keyframe(&mut self, epoch: u64, keyframe: &Keyframe) -> Option<v1::Keyframe> {
        match self.surface {
            Surface::Lattice => Some(view::keyframe(keyframe, &self.quanta_m)),
            Surface::Vertices { .. } => self.vertices.keyframe(epoch, keyframe, &self.quanta_m),
        }
    }

    /// Encodes a patch of the epoch; `None` where the scene has started over since.
    pub fn patch(&mut self, epoch: u64, patch: &TopologyPatch) -> Option<v1::TopologyPatch> {
        match self.surface {
            Surface::Lattice => Some(view::patch(patch)),
            Surface::Vertices { .. } => self.vertices.patch(epoch, patch),
        }
    }

    /// Encodes a state, unless it was the last one that was asked for; `None` where other viewers are told of a later
    /// structure already, and this one will be.
    pub fn encode(&mut self, state: &Arc<ViewState>) -> Option<Arc<EncodedState>> {
        if let Some((_, encoded)) = self.newest.as_ref().filter(|(newest, _)| Arc::ptr_eq(newest, state)) {
            return Some(Arc::clone(encoded));
        }
        let (moved, shown) = self.moved(state)?;
        if std::mem::replace(&mut self.epoch, state.epoch()) != state.epoch() {
            self.differences.start_over();
        }
        let coded = self.differences.encode(state.step, moved);
        let bodies = coded.differences.into_iter().zip(shown);
        let message = v1::State {
            bodies: bodies.map(|(displacements, shown)| v1::BodyState { displacements, ..shown }).collect(),
            reference_step: coded.reference_step,
            has_reference: false,
            ..view::state_without_bodies(state)
        };
        let encoded = Arc::new(EncodedState { epoch: self.epoch, message, reference: coded.reference });
        self.newest = Some((Arc::clone(state), Arc::clone(&encoded)));
        Some(encoded)
    }

    /// Displacements in quanta per object, and what else is said of its surface.
    fn moved(&self, state: &ViewState) -> Option<(Vec<Vec<i32>>, Vec<v1::BodyState>)> {
        let Surface::Vertices { with_normals } = self.surface else {
            let quanta =
                state.node_displacements_m.iter().zip(&self.quanta_m).map(|(m, quantum)| quantised(m, *quantum));
            let adapted = state.adapted.iter().zip(&self.quanta_m).map(|(adapted, quantum_m)| v1::BodyState {
                adapted_ids: adapted_ids(adapted),
                adapted_offsets: adapted_offsets(adapted, *quantum_m),
                ..v1::BodyState::default()
            });
            return Some((quanta.collect(), adapted.collect()));
        };
        let moved_m = self.vertices.displacements_m(state)?;
        let quanta = moved_m.iter().zip(&self.quanta_m).map(|(m, quantum_m)| quantised(m.as_flattened(), *quantum_m));
        let mut shown = vec![v1::BodyState::default(); moved_m.len()];
        if with_normals {
            let normals = self.vertices.normals(&moved_m);
            shown.iter_mut().zip(normals).for_each(|(body, normals)| body.normals = normals);
        }
        Some((quanta.collect(), shown))
    }
}

impl EncodedState {
    /// What goes to a viewer that has the reference in `held`: with another one if that is needed, which it has then.
    pub fn message(&self, held: &mut Option<HeldReference>, wants_energy: bool) -> v1::State {
        let mut message = self.message.clone();
        let needed = HeldReference { epoch: self.epoch, step: message.reference_step };
        if held.replace(needed) != Some(needed) {
            message.has_reference = true;
            for (body, reference) in message.bodies.iter_mut().zip(&self.reference) {
                body.reference = reference.clone();
            }
        }
        message.energy = message.energy.filter(|_| wants_energy);
        message
    }
}

fn quantised(lengths_m: &[f32], quantum_m: f64) -> Vec<i32> {
    let per_m = 1.0 / quantum_m;
    lengths_m.iter().map(|length_m| (f64::from(*length_m) * per_m).round_ties_even() as i32).collect()
}

fn adapted_ids(adapted: &[AdaptedVertex]) -> Bytes {
    let before = std::iter::once(0).chain(adapted.iter().map(|vertex| vertex.id));
    integers::encode(adapted.iter().zip(before).map(|(vertex, before)| i64::from(vertex.id) - i64::from(before))).into()
}

fn adapted_offsets(adapted: &[AdaptedVertex], quantum_m: f64) -> Bytes {
    let offsets_m: Vec<f32> = adapted.iter().flat_map(|vertex| vertex.offset_m).collect();
    integers::encode(quantised(&offsets_m, quantum_m).into_iter().map(i64::from)).into()
}

#[cfg(test)]
mod tests {
    use kerf_replica::Replica;
    use proptest::prelude::*;

    use super::*;

    const VOXEL_M: f64 = 3.5e-3;

    fn encoder(max_error_voxels: f64) -> Encoder {
        let request = v1::ViewRequest { max_error_voxels, ..v1::ViewRequest::default() };
        Encoder::new(Encoding::granted(&request).unwrap(), std::iter::once(VOXEL_M))
    }

    fn state(step: u64, displacements_m: &[f32]) -> Arc<ViewState> {
        let mut state = ViewState::default();
        state.step = step;
        state.node_displacements_m = vec![displacements_m.to_vec()];
        state.adapted = vec![Vec::new()];
        Arc::new(state)
    }

    /// One element whose vertices are its nodes, as a viewer has it.
    fn replica(encoder: &Encoder) -> Replica {
        let body = v1::BodyStructure {
            node_count: 8,
            node_ids: (0..8).collect(),
            node_rest_m: vec![0.0; 24],
            element_ids: vec![0],
            element_nodes: (0..8).collect(),
            vertex_ids: (0..8).collect(),
            vertex_elements: vec![0; 8],
            vertex_local: (0..8).flat_map(|c| [c & 1, c >> 1 & 1, c >> 2].map(|bit| bit as f32)).collect(),
            quantum_m: encoder.quanta_m()[0],
            ..v1::BodyStructure::default()
        };
        let surface_hash = kerf_replica::surface_hash(std::slice::from_ref(&body));
        let mut replica = Replica::default();
        let bodies = vec![body];
        replica.apply_keyframe(&v1::Keyframe { bodies, surface_hash, ..v1::Keyframe::default() }).unwrap();
        replica
    }

    #[test]
    fn fifty_viewers_share_one_encoding_and_each_gets_a_reference_once() {
        let mut encoder = encoder(0.0);
        let mut viewers = vec![None; 50];
        for step in 0..10 {
            let state = state(step, &[1e-3; 24]);
            let encoded: Vec<_> = viewers.iter().map(|_| encoder.encode(&state).unwrap()).collect();
            assert!(encoded.iter().all(|other| Arc::ptr_eq(other, &encoded[0])));
            for (held, encoded) in viewers.iter_mut().zip(&encoded) {
                let message = encoded.message(held, false);
                assert_eq!((message.has_reference, message.energy), (step == 0, None));
                assert!(Arc::ptr_eq(&encoder.encode(&state).unwrap(), encoded));
            }
        }
        let late = encoder.encode(&state(10, &[1e-3; 24])).unwrap().message(&mut None, true);
        assert!(late.has_reference && late.energy.is_some() && late.reference_step == 0);
    }

    #[test]
    fn a_wish_is_granted_by_the_next_smaller_power_of_two_within_limits() {
        let quantum_voxels = |wish: f64| encoder(wish).quanta_m()[0] / VOXEL_M;
        let granted = [(0.0, 64.0), (0.05, 16.0), (0.03125, 16.0), (0.5, 8.0), (1e-9, 2048.0)];
        for (wish, per_voxel) in granted {
            assert_eq!(quantum_voxels(wish), 1.0 / per_voxel, "{wish}");
        }
        for wish in [-0.1, f64::NAN, f64::INFINITY] {
            let request = v1::ViewRequest { max_error_voxels: wish, ..v1::ViewRequest::default() };
            assert!(Encoding::granted(&request).is_err());
        }
    }

    proptest! {
        #[test]
        fn viewers_of_every_rate_see_each_vertex_within_the_bound(
            max_error_voxels in 1.0 / 4096.0..1.0 / 16.0,
            states in proptest::collection::vec((proptest::collection::vec(-0.3_f32..0.3, 24), 0.0_f32..1.0), 1..20),
        ) {
            let mut encoder = encoder(max_error_voxels);
            let mut viewers = [1, 3, 7].map(|every| (every, None, replica(&encoder)));
            for (step, (displacements_m, scale)) in states.iter().enumerate() {
                let displacements_m: Vec<f32> = displacements_m.iter().map(|m| m * scale).collect();
                let state = state(step as u64, &displacements_m);
                for (every, held, replica) in &mut viewers {
                    if step % *every != 0 {
                        continue;
                    }
                    replica.apply_state(&encoder.encode(&state).unwrap().message(held, false)).unwrap();
                    let shown_m = replica.surfaces().unwrap()[0].positions_m.concat();
                    for (shown_m, true_m) in shown_m.iter().zip(&displacements_m) {
                        // To which the 32-bit floats at either end add their own rounding.
                        let bound_m = max_error_voxels * VOXEL_M + 6e-8;
                        prop_assert!(f64::from(shown_m - true_m).abs() <= bound_m, "{shown_m} for {true_m}");
                    }
                }
            }
        }
    }
}

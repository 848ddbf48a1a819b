//! A grasper's grasp of one body.
//!
//! Jaws that close take hold of material points on a lattice through the ball around the reference
//! point: each stays where it is relative to the tool, on springs in three directions that push and
//! pull. The points belong to voxels, so a cut through what is held leaves each with its own side.

use super::broad::NearElements;
use super::{Contact, Mode, ToolEnds, narrow};
use crate::Vec3;
use crate::body::Body;
use crate::grid::MaterialPoint;
use crate::grow::make_room;
use crate::math::Aabb;
use crate::tool::grasper::{Grasper, Jaws};
use crate::tool::{Pose, ToolPath};
use crate::walk::Kept;
use serde::{Deserialize, Serialize};

/// Points along the radius: as close as the elements' edge, which resolve no more; but enough to hold
/// against turning, and not so many that they cost more than the elements. At 2 there are 33 in the ball, at 4 257.
const POINTS_PER_RADIUS: std::ops::RangeInclusive<f64> = 2.0..=4.0;
/// Stiffness of a point over Young's modulus times the distance between points. A rigid ball of radius a
/// in the tissue is held with about 6 E a, the 33 points of the coarsest lattice hold with 165 E a: the
/// springs add less than a twentieth to the compliance of what they hold.
const STIFFNESS: f64 = 10.0;

/// A material point that is held.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct HeldPoint {
    point: MaterialPoint,
    /// Where it is held, tool frame, m.
    place_m: Vec3,
    stiffness_n_per_m: f64,
}

/// What one grasper does in one body.
#[derive(Clone, Serialize, Deserialize)]
pub struct Grasp {
    grasper: Grasper,
    jaws: Jaws,
    /// Points of the tool that may hold one of the tissue, tool frame, m.
    places_m: Kept<Vec<Vec3>>,
    /// Distance between them, m.
    spacing_m: f64,
    held: Vec<HeldPoint>,
    #[serde(skip)]
    near: NearElements,
    /// Springs of the step that is being taken, three per held point.
    pub contacts: Vec<Contact>,
}

impl Grasp {
    /// Open jaws.
    #[must_use]
    pub fn new(grasper: Grasper, body: &Body) -> Self {
        let per_radius = (grasper.radius_m / body.lattice_edge_m()).ceil();
        let per_radius = per_radius.clamp(*POINTS_PER_RADIUS.start(), *POINTS_PER_RADIUS.end()) as i32;
        let spacing_m = grasper.radius_m / f64::from(per_radius);
        let axis = || -per_radius..=per_radius;
        let lattice = axis().flat_map(|i| axis().flat_map(move |j| axis().map(move |k| [i, j, k])));
        let places_m: Vec<Vec3> = lattice
            .filter(|cell| cell.iter().map(|c| c * c).sum::<i32>() <= per_radius * per_radius)
            .map(|cell| Vec3::from(cell.map(f64::from)) * spacing_m)
            .collect();
        Self {
            grasper,
            jaws: Jaws::default(),
            held: Vec::new(),
            contacts: Vec::new(),
            places_m: places_m.into(),
            spacing_m,
            near: NearElements::default(),
        }
    }

    /// Room for all elements of the body around the jaws, and for all that they can hold.
    pub fn reserve(&mut self, elements: usize) {
        self.near.reserve(elements);
        make_room(&mut self.held, self.places_m.len());
        let most = self.most_springs();
        make_room(&mut self.contacts, most);
    }

    /// Number of springs that the grasp may have at most.
    #[must_use]
    pub fn most_springs(&self) -> usize {
        3 * self.places_m.len()
    }

    /// Lets go of everything; jaws that stay closed take hold of nothing until they have opened.
    pub fn let_go(&mut self) {
        self.held.clear();
        self.contacts.clear();
    }

    /// Takes hold as the jaws close, lets go as they open, and sets up the springs of what is held. Jaws
    /// that come in closed hold nothing.
    pub fn detect(&mut self, body: &Body, path: &ToolPath) {
        let was = if path.entered { Jaws::Closed } else { self.jaws };
        self.jaws = self.jaws.at(path.opening);
        self.contacts.clear();
        if path.entered || self.jaws == Jaws::Open {
            self.held.clear();
        }
        if was == Jaws::Open && self.jaws == Jaws::Closed {
            self.take_hold(body, &path.before);
        }
        for held in &self.held {
            self.contacts.extend(held.springs(body, path));
        }
    }

    /// Holds the tissue where it is: no spring starts with a force.
    fn take_hold(&mut self, body: &Body, pose: &Pose) {
        self.near.find(body, [Aabb::around([pose.position_m]).grown(self.grasper.radius_m)]);
        for place_m in self.places_m.iter() {
            if let Some(point) = narrow::locate(body, &self.near, &pose.transform(place_m)) {
                let young_modulus_pa = body.material_of(point.voxel).young_modulus_pa;
                let stiffness_n_per_m = STIFFNESS * young_modulus_pa * self.spacing_m;
                self.held.push(HeldPoint { point, place_m: *place_m, stiffness_n_per_m });
            }
        }
    }
}

impl HeldPoint {
    fn springs(&self, body: &Body, path: &ToolPath) -> [Contact; 3] {
        let [before, now] = [&path.before, &path.pose].map(|pose| pose.transform(&self.place_m));
        let ends = ToolEnds::of(body, &self.point, [before, now]);
        let at = ends.weights.place_m(&body.state.position_m);
        let drift = ends.weights.sum(&body.state.velocity_m_per_s) * body.dt_s();
        [Vec3::x(), Vec3::y(), Vec3::z()].map(|direction| Contact {
            ends,
            direction,
            stiffness_n_per_m: self.stiffness_n_per_m,
            gap_before_m: (before - at).dot(&direction),
            gap_predicted_m: (now - at - drift).dot(&direction),
            bilateral: true,
            mode: Mode::Spring,
            ..Contact::default()
        })
    }
}

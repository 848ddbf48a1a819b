//! The anchor of a marker in contact: the material point X that its share of the edge pushes on.
//!
//! The push is a spring of the contact's compliance whose force per length is capped: at
//! `initiation_ratio Gc` until it first gives, at Gc from then on (Griffith: the energy release rate
//! of a sharp edge is the edge-normal force per length). Where the link ahead is parted already the
//! cap is zero.

use crate::body::{Body, MaterialPoint};
use crate::contact::{ContactWeights, Mode};
use crate::grid::{Link, LinkId, VoxelId};
use crate::tool::blade::BladeFrame;
use crate::{Mat3, Vec3};

/// A front advances through the deformed material in steps of at most this share of a voxel, and in
/// so many of them at most.
const MARCH_VOXELS: f64 = 0.25;
const MAX_MARCH_STEPS: u32 = 64;
/// Strips are shifted by this share of a voxel toward the blade's positive side: a voxel centre that
/// lies on the blade's plane, give or take the drift of the front, is on its negative side for every
/// link and every strip.
const NUDGE_VOXELS: f64 = 1e-3;
/// Compression between H and a of a material that stiffens, over `H / sqrt(c)`.
const SATURATED_GAP: f64 = 1.2;
/// Least compliance of the contact, times E: keeps the spring finite where the formula goes negative.
const LEAST_COMPLIANCE: f64 = 0.1;

/// What lies ahead of a marker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Ahead {
    /// Material that holds, with its fracture energy (infinite: cannot be cut) and initiation ratio.
    Intact { fracture_energy_j_per_m2: f64, initiation_ratio: f64 },
    /// A cut that is there already.
    Parted,
    /// The outside.
    Outside,
}

/// The material point of a marker in contact.
#[derive(Clone, Copy, Debug)]
pub(super) struct Anchor {
    /// Reference position of the front, m.
    pub(super) position_m: Vec3,
    /// Where the material that has been swept ends here, m: `position_m` as the last sweep left it.
    /// Strips start exactly where the last ones ended, so that the cut has no gaps.
    pub(super) swept_m: Vec3,
    /// Where the cut begins here, m; moves with `position_m` until the marker yields.
    pub(super) start_m: Vec3,
    /// The voxels at the ends of the next link; the force is shared between them.
    voxels: [VoxelId; 2],
    pub(super) ahead: Ahead,
    /// Whether it has given: from then on it gives at Gc.
    pub(super) yielded: bool,
    /// What the forward spring did at the end of the last step.
    pub(super) mode: Mode,
    /// Energy in the spring at the end of the last step, J.
    pub(super) stored_j: f64,
}

impl Anchor {
    /// An anchor at `point`, with nothing ahead of it yet.
    pub(super) fn at(point: MaterialPoint) -> Self {
        Self {
            position_m: point.position_m,
            swept_m: point.position_m,
            start_m: point.position_m,
            voxels: [point.voxel; 2],
            ahead: Ahead::Outside,
            yielded: false,
            mode: Mode::Off,
            stored_j: 0.0,
        }
    }

    /// Starts the cut where the anchor is: what lies ahead is seen from here, strips begin here.
    pub(super) fn start_here(&mut self, body: &Body, frame: &BladeFrame) {
        self.start_m = self.position_m;
        self.look_ahead(body, frame);
        self.swept_m = self.strip_end_m(body, frame);
    }

    fn points(&self) -> [MaterialPoint; 2] {
        self.voxels.map(|voxel| MaterialPoint { position_m: self.position_m, voxel })
    }

    /// Scene position of the front's material point, m.
    pub(super) fn current_m(&self, body: &Body) -> Vec3 {
        let [a, b] = self.points();
        0.5 * (body.current_m(&a) + body.current_m(&b))
    }

    pub(super) fn weights(&self, body: &Body) -> ContactWeights {
        let mut weights = ContactWeights::default();
        for point in self.points() {
            let (nodes, n) = body.weights(&point);
            nodes.iter().zip(n).for_each(|(node, n)| weights.add(*node, 0.5 * n));
        }
        weights
    }

    fn gradient(&self, body: &Body) -> Mat3 {
        let [a, b] = self.points();
        let first = body.deformation_gradient(&a);
        // Within one element both ends of the link move with one field.
        if body.element_of(a.voxel) == body.element_of(b.voxel) {
            return first;
        }
        0.5 * (first + body.deformation_gradient(&b))
    }

    /// `F^-1 d`: the reference vector that the deformation takes to a scene direction. Where the
    /// material is squeezed to a fifth or less, as if it were squeezed to a fifth.
    pub(super) fn pull_back(&self, body: &Body, direction: &Vec3) -> Vec3 {
        pulled_back(&self.gradient(body), direction)
    }

    /// The reference vector from the front to the point that lies `distance` farther along the cutting
    /// direction in the scene, at most as far as the material ahead stays what it is. In short steps:
    /// under the edge soft tissue is squeezed to a third, a few millimetres on it is not.
    pub(super) fn march(&self, body: &Body, frame: &BladeFrame, distance: f64) -> Vec3 {
        if distance <= 0.0 {
            return Vec3::zeros();
        }
        let longest = MARCH_VOXELS * body.grid.voxel_size_m();
        let from = self.current_m(body);
        let mut ahead = *self;
        for _ in 0..MAX_MARCH_STEPS {
            let left = distance - (ahead.current_m(body) - from).dot(&frame.forward);
            if left <= 1e-3 * distance {
                break;
            }
            let step = ahead.pull_back(body, &frame.forward) * left;
            ahead.position_m += step * (longest / step.norm()).min(1.0);
            ahead.look_ahead(body, frame);
            if ahead.ahead != self.ahead {
                break;
            }
        }
        ahead.position_m - self.position_m
    }

    /// The shift of strips that settles on which side a centre on the blade's plane is.
    pub(super) fn nudge(&self, body: &Body, frame: &BladeFrame) -> Vec3 {
        let normal = (self.gradient(body).transpose() * frame.normal).try_normalize(0.0).unwrap_or(frame.normal);
        normal * (NUDGE_VOXELS * body.grid.voxel_size_m())
    }

    /// Where the strip that is swept now ends here, m.
    pub(super) fn strip_end_m(&self, body: &Body, frame: &BladeFrame) -> Vec3 {
        self.position_m + self.nudge(body, frame)
    }

    /// Finds the link that the blade's plane crosses ahead: so far ahead that the crossing of the
    /// column it is looked for in cannot lie behind the front, where the blade itself has parted it.
    pub(super) fn look_ahead(&mut self, body: &Body, frame: &BladeFrame) {
        let grid = &body.grid;
        let h = grid.voxel_size_m();
        let f = self.gradient(body);
        let ahead = pulled_back(&f, &frame.forward).normalize();
        let normal = f.transpose() * frame.normal;
        let axis = normal.iamax();
        // A point of the plane half a voxel off in one of the other axes is this far off along `ahead`.
        let along = |a: usize| (ahead[a] - ahead[axis] * normal[a] / normal[axis]).abs();
        let reach = 0.5 * (0..3).filter(|a| *a != axis).map(along).sum::<f64>();
        let at = self.position_m + ahead * (reach.max(0.5) * h);
        let cell = grid.cell_of(&at);
        let centre = grid.centre_m(cell);
        // The plane's height over the centre of the column, not over the marker.
        let across: f64 = (0..3).filter(|a| *a != axis).map(|a| normal[a] * (centre[a] - at[a])).sum();
        let height = (at[axis] - across / normal[axis] - grid.origin_m()[axis]) / h - 0.5;
        let mut lower = cell;
        lower[axis] = height.floor() as i32;
        let link = LinkId { cell: lower, axis: axis as u8 };
        let ends = [grid.voxel_at(link.cell), grid.voxel_at(link.upper())];
        if let Some(any) = ends[0].or(ends[1]) {
            self.voxels = [ends[0].unwrap_or(any), ends[1].unwrap_or(any)];
        }
        self.ahead = match grid.link(link) {
            Link::Parted(_) => Ahead::Parted,
            Link::Intact | Link::Boundary(_) if grid.signed_distance_m(&at) < 0.0 => {
                let material = body.material_of(self.voxels[0]);
                Ahead::Intact {
                    fracture_energy_j_per_m2: fracture_energy(body, link),
                    initiation_ratio: material.initiation_ratio,
                }
            }
            // Past the last link what held there holds on to the surface.
            _ if grid.signed_distance_m(&self.position_m) < 0.0 => self.ahead,
            _ => Ahead::Outside,
        };
        // Beyond an old cut the crack is there already: nothing has to be initiated.
        self.yielded |= self.ahead == Ahead::Parted;
    }

    /// Width of the strip that a share of the edge cuts, reference configuration: the material has
    /// spread along the edge. A blade that goes on at the same force in a state that goes with it
    /// spends `F dz` on `w dz` of reference area, so that `F = Gc w` is in reference width however the
    /// material is squeezed ahead of the edge.
    pub(super) fn reference_width_m(&self, body: &Body, frame: &BladeFrame, share_m: f64) -> f64 {
        let f = self.gradient(body);
        let ahead = pulled_back(&f, &frame.forward).normalize();
        ahead.cross(&(pulled_back(&f, &frame.along) * share_m)).norm()
    }

    /// Force at which the marker gives, and the force it goes on at, N. It starts at a line load on
    /// the surface as it stands, and goes on at Gc per reference area.
    pub(super) fn limits_n(&self, body: &Body, frame: &BladeFrame, share_m: f64) -> (f64, f64) {
        match self.ahead {
            Ahead::Intact { fracture_energy_j_per_m2, initiation_ratio } => {
                let steady = fracture_energy_j_per_m2 * self.reference_width_m(body, frame, share_m);
                let start = fracture_energy_j_per_m2 * initiation_ratio * share_m;
                (if self.yielded { steady } else { start.max(steady) }, steady)
            }
            Ahead::Parted | Ahead::Outside => (0.0, 0.0),
        }
    }

    /// Stiffness of the contact per length of edge: in series with the composite element, it gives
    /// the compliance that a line load of half-width a has on the continuum wherever it stands in
    /// its cell, `k = E / (2 (1 - nu^2) / pi ln(H / a) - 0.24 + 0.65 (1 - nu^2) / 0.7975 4 xi (1 - xi))`,
    /// H the element's edge, xi the place across the blade in the cell. Stiffened tissue stiffens it;
    /// and as its strain under the edge saturates, between H and a it gives by no more than
    /// `H / sqrt(c)` or so at the load at which it is cut (the integral of the strain
    /// `eps exp(c eps^2) = sigma / E` over that range).
    pub(super) fn stiffness_n_per_m2(&self, body: &Body, frame: &BladeFrame, half_width_m: f64) -> f64 {
        let material = body.material_of(self.voxels[0]);
        let element = body.element_of(self.voxels[0]);
        let axis = (self.gradient(body).transpose() * frame.normal).iamax();
        let xi = body.local_coordinates(element, &self.position_m)[axis].clamp(0.0, 1.0);
        let plane = 1.0 - material.poisson_ratio * material.poisson_ratio;
        let line = 2.0 * plane / std::f64::consts::PI * ln(body.element_edge_m(element) / half_width_m);
        let compliance = line - 0.24 + 0.65 * plane / 0.7975 * 4.0 * xi * (1.0 - xi);
        let small = material.young_modulus_pa * body.stiffening(element) / compliance.max(LEAST_COMPLIANCE);
        let c = 0.5 * material.law.stiffening_rate_per_pa * material.young_modulus_pa;
        let load = material.fracture_energy_j_per_m2.unwrap_or(0.0) * material.initiation_ratio;
        small.max(load * c.sqrt() / (SATURATED_GAP * body.element_edge_m(element)))
    }
}

/// `F^-1 d`, bounded as [`Anchor::pull_back`] says.
fn pulled_back(f: &Mat3, direction: &Vec3) -> Vec3 {
    let pulled = f.try_inverse().map_or(*direction, |inverse| inverse * direction);
    let length = pulled.norm();
    if length.is_finite() && length > 0.0 { pulled * (length.min(5.0) / length) } else { *direction }
}

/// Natural logarithm through the vector library's own polynomial: the same bits on every machine.
fn ln(x: f64) -> f64 {
    wide::f64x4::splat(x).ln().to_array()[0]
}

/// Fracture energy of a link: the lesser of its ends', infinite where neither end can be cut.
pub(super) fn fracture_energy(body: &Body, link: LinkId) -> f64 {
    [link.cell, link.upper()]
        .into_iter()
        .filter_map(|cell| body.grid.voxel_at(cell))
        .map(|v| body.material_of(v).fracture_energy_j_per_m2.unwrap_or(f64::INFINITY))
        .fold(f64::INFINITY, f64::min)
}

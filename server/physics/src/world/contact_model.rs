//! The local contact model of a tool: how its wrench goes on from where the step left it.
//!
//! The springs of the contacts and the tissue behind them act in series. With the springs `k` along `d`, which a twist
//! `x` of the tool stretches by `B x` and a displacement `u` of the tissue by `-H u`, the energy is
//! `1/2 (B x - H u)^T k (B x - H u) + 1/2 u^T K u`. The tissue takes the `u` that minimises it. Here it is found
//! among six fields, one for each unit twist ([`Response`]). Fields are warm-started and refined by at most 12 CG
//! iterations. The resulting Schur complement is symmetric for any fields, has no negative eigenvalue, and is too stiff
//! by the square of the fields' error.
//!
//! "Errors" of the constants below are those of strokes in stiff tissue, rms over the rms force, where a station renders
//! the models at 250 and 60 Hz (`contact_model::strokes_in_stiff_tissue_are_rendered_as_they_are`).

use super::body_slot::BodySlot;
use crate::body::{Body, Response};
use crate::contact::Contact;
use crate::math::{Mat3x6, Mat6, Vec6};
use crate::solve::spring::PointSpring;
use crate::step_io::{ContactModel, Give, Wrench};
use crate::tool::{Pose, ToolPath, ToolShape};
use crate::work::WorkMeter;
use crate::workers::Workers;
use crate::{Mat3, Vec3};
use wide::f32x4;

/// Relative residual, over what the tissue carries, at which a field has converged: the stiffness is then wrong by its
/// square, 1 %. With 0.03 and 0.3 no error moves by more than 0.15 % of the force.
const RELATIVE_TOLERANCE: f64 = 0.1;
/// Share of the springs' load that the tissue is first assumed to carry. From 0.03 to 0.3 no error moves by more than
/// 0.01 %: the share is measured with the first fields.
const FIRST_SHARE: f64 = 0.1;
/// Fields of a model: one for each unit twist.
const FIELDS: u32 = 6;
/// Iterations for a model, of all of its fields; fields that have not converged are refined with the next model. With 6
/// the probe's error at 60 Hz rises from 2.2 to 2.9 %; with 24 no error falls by more than 0.01 %.
const MOST_ITERATIONS: u32 = 12;
/// The same at a first touch, without fields to start from: jaws that close need 30.
const MOST_AT_FIRST: u32 = 36;
/// Steps that a model in the making waits in a row where their work is used up. A session that is late at every step so has
/// a model after 18 steps instead of 6, and its steps take .2 to .6 ms less.
const MOST_WAITS: u32 = 2;
/// Relative pivot below which a field is dropped as linearly dependent. Between 1e-12 and 1e-6 no error changes: fields
/// are either independent or copies up to rounding.
const LEAST_PIVOT: f64 = 1e-9;
/// Distance from a pose within which the contact is about the same, over the tool's size. With twice of it the error of
/// moves by half the radius rises by a tenth on average (`the_model_says_the_next_forces_at_level_2`).
const VALID_SHARE: f64 = 0.05;
/// Distance within which the model holds, over the tissue's compression under the present force. Over half of it a
/// round dent (Hertz) gets stiffer or softer by a twelfth; twice as far a ball on patches as coarse as a third of it is off
/// by a third.
const LINEAR_SHARE: f64 = 0.25;

/// Share of an edge that ruptures before the rest follows within a step or two, under the load that it releases. With
/// 0.05 the blade's error at 60 Hz rises from 3.1 to 10.9 %; with 0.2 no error changes.
const GIVES_FIRST: f64 = 0.1;
/// The force then, over that at which so much would have ruptured if the load grew uniformly. Ours: in three cuts into
/// a block the edge ruptured at 0.992 to 0.998 of it.
const GIVES_EARLIER: f64 = 0.995;
/// Share of the cap that must not have ruptured yet, for a cut to be about to start. With 0.3 no error changes.
const LEAST_TO_GIVE: f64 = 0.1;
/// Bisections between no load and the greatest, for the load at which that share ruptures: to 2e-5 of it.
const HALVINGS: u32 = 16;

/// What is carried from model to model of one tool.
#[derive(Default)]
pub(super) struct ToolModel {
    /// By body.
    tissues: Vec<Tissue>,
    /// Of the body that is looked at.
    springs: Vec<Spring>,
    /// What the tool was last found to feel; none while it touches nothing.
    pub(super) felt: Option<Felt>,
    /// Fields that the model in the making has still to look at; 0: none is in the making.
    fields_left: u32,
    /// Iterations that are left for it.
    iterations_left: u32,
    /// Steps in a row in which it has waited.
    waited: u32,
}

/// How a body answers to a tool.
struct Tissue {
    /// To each unit twist.
    fields: [Response; 6],
    /// What it carries of what the springs alone would, by twist.
    shares: [f64; 6],
    /// The twist whose field a model looks at first.
    first: usize,
    /// The twist whose field is looked at next.
    next: usize,
}

impl Default for Tissue {
    fn default() -> Self {
        Self { fields: Default::default(), shares: [FIRST_SHARE; 6], first: 0, next: 0 }
    }
}

/// How the wrench on a tool changes as it moves on.
#[derive(Clone, Copy)]
pub(super) struct Felt {
    /// `dF/dx`, reversed: [translation m; rotation rad] -> [N; N m].
    stiffness: Mat6,
    /// `dF/dv`, reversed.
    damping: Mat6,
}

/// A part of a tool, where it is.
#[derive(Clone, Copy)]
pub(super) struct Placed<'a> {
    /// Its index.
    pub(super) part: usize,
    pub(super) shape: &'a ToolShape,
    pub(super) pose: Pose,
}

/// Whether any of these parts presses on a body.
pub(super) fn presses<'a>(slot: &BodySlot, mut parts: impl Iterator<Item = Placed<'a>>) -> bool {
    parts.any(|placed| slot.contacts[placed.part].pressing().next().is_some())
}

/// A spring of a contact, as a tool feels it.
struct Spring {
    /// What a twist of the tool stretches it by.
    row: Vec6,
    stiffness_n_per_m: f64,
    direction: Vec3,
    /// Its [`Contact::quasi_static_spring`], among the solver's unknowns.
    point: PointSpring,
    /// Present where the direction turns as the point slides: the lever arm of what it turns about, m, and how much
    /// stiffness that takes away, N/m.
    turning: Option<(Vec3, Mat3)>,
}

impl Spring {
    /// Of a contact of this part, as felt at `about_m`.
    fn new(contact: &Contact, body: &Body, placed: &Placed<'_>, about_m: Vec3) -> Self {
        let (d, at_m) = (contact.direction, contact.ends.tool_point_m);
        let turn = (at_m - about_m).cross(&d);
        let turning = placed.shape.turning(&placed.pose, &at_m);
        let turning = turning.map(|(centre_m, per_m)| (centre_m - about_m, per_m * contact.force_n));
        Self {
            row: Vec6::new(d.x, d.y, d.z, turn.x, turn.y, turn.z),
            stiffness_n_per_m: contact.stiffness_n_per_m,
            direction: d,
            point: body.among_unknowns(&contact.quasi_static_spring(body.quasi_static_dt_s())),
            turning,
        }
    }

    /// What a unit twist of the tool moves its point by along its direction.
    fn moved(&self, twist: usize) -> f32x4 {
        let [x, y, z] = (self.direction * self.row[twist]).into();
        f32x4::new([x as f32, y as f32, z as f32, 0.0])
    }

    /// What each field moves its point by.
    fn given(&self, fields: &[Response; 6]) -> Mat3x6 {
        Mat3x6::from_columns(&std::array::from_fn::<_, 6, _>(|i| {
            let [x, y, z, _] = self.point.value(&fields[i].displacement).to_array().map(f64::from);
            Vec3::new(x, y, z)
        }))
    }
}

impl ToolModel {
    /// Asks for a new model, unless one is in the making.
    pub(super) fn ask(&mut self) {
        if self.fields_left == 0 {
            self.fields_left = FIELDS;
            self.iterations_left = if self.felt.is_some() { MOST_ITERATIONS } else { MOST_AT_FIRST };
            self.tissues.iter_mut().for_each(|tissue| tissue.next = tissue.first);
        }
    }

    /// Whether a model is in the making.
    pub(super) fn is_asked(&self) -> bool {
        self.fields_left > 0
    }

    /// Leaves a step whose work is used up to the others, unless it has waited for long or nothing is felt yet.
    pub(super) fn waits(&mut self) -> bool {
        let waits = self.felt.is_some() && self.waited < MOST_WAITS;
        self.waited = if waits { self.waited + 1 } else { 0 };
        waits
    }

    /// What the tool feels is forgotten: it touches nothing.
    pub(super) fn forget(&mut self) {
        (self.felt, self.fields_left) = (None, 0);
    }

    /// Goes on with the model of a tool at a pose with these parts: as far as the step's work allows, and by one field at
    /// least, so that it comes to an end. The operators of the bodies that the tool presses on get the springs of all
    /// contacts, by [`Contact::quasi_static_spring`], from `load`.
    pub(super) fn go_on<'a, P: Iterator<Item = Placed<'a>>>(
        &mut self,
        workers: &Workers<'_>,
        (pose, parts): (&Pose, impl Fn() -> P),
        slots: &mut [BodySlot],
        work: &mut WorkMeter,
        mut load: impl FnMut(usize, &mut BodySlot),
    ) {
        let presses = |slot: &BodySlot| presses(slot, parts());
        let elements = slots.iter().filter(|slot| presses(slot)).map(|slot| slot.body.base().elements.len()).sum();
        let (fields, mut left) = work.share_of_model(elements, (self.fields_left, self.iterations_left));
        self.fields_left -= fields;
        let mut felt: Option<Felt> = None;
        for (body, slot) in slots.iter_mut().enumerate().filter(|(_, slot)| presses(slot)) {
            load(body, slot);
            let springs = &mut self.springs;
            springs.clear();
            for placed in parts() {
                let pressing = slot.contacts[placed.part].pressing();
                springs.extend(pressing.map(|c| Spring::new(c, &slot.body, &placed, pose.position_m)));
            }
            let tissue = &mut self.tissues[body];
            let iterations = tissue.look(workers, &mut slot.body, springs, (fields, left));
            work.add_fields(slot.body.base().elements.len(), fields, iterations);
            left -= iterations;
            self.iterations_left -= iterations;
            if self.fields_left == 0 {
                let of_body = tissue.felt(workers, &slot.body, springs);
                let sum = felt.get_or_insert(Felt { stiffness: Mat6::zeros(), damping: Mat6::zeros() });
                sum.stiffness += of_body.stiffness;
                sum.damping += of_body.damping;
            }
        }
        if self.fields_left == 0 {
            self.felt = felt;
        }
    }

    /// Room for all that the tool may come to feel.
    pub(super) fn fit(&mut self, parts: impl Iterator<Item = usize> + Clone, slots: &mut [BodySlot]) {
        self.tissues.resize_with(slots.len(), Default::default);
        self.springs.clear();
        for (tissue, slot) in self.tissues.iter_mut().zip(slots) {
            tissue.fields.iter_mut().for_each(|field| slot.body.fit(field));
            self.springs.reserve(parts.clone().map(|part| slot.contacts[part].most_springs(&slot.body)).sum());
        }
    }
}

impl Tissue {
    /// Makes so many fields better, in turns, within so many iterations. Returns how many it took.
    fn look(
        &mut self,
        workers: &Workers<'_>,
        body: &mut Body,
        springs: &[Spring],
        (fields, most_iterations): (u32, u32),
    ) -> u32 {
        let mut iterations = 0;
        // What has no iterations left is still measured against the matrix of now.
        for _ in 0..fields {
            let twist = self.next;
            self.next = (twist + 1) % 6;
            let load = || springs.iter().map(|spring| (&spring.point, spring.moved(twist)));
            let tolerance = RELATIVE_TOLERANCE * self.shares[twist];
            let left = most_iterations - iterations;
            iterations += body.respond(workers, load, (tolerance, left), &mut self.fields[twist]);
            if left > 0 {
                self.first = twist;
            }
        }
        iterations
    }

    fn felt(&mut self, workers: &Workers<'_>, body: &Body, springs: &[Spring]) -> Felt {
        let dt2_s2 = body.quasi_static_dt_s().powi(2);
        let of_tissue = Mat6::from_fn(|i, j| Response::work(workers, &self.fields[i], &self.fields[j]) / dt2_s2);
        let (mut of_tool, mut shared, mut of_springs) = (Mat6::zeros(), Mat6::zeros(), Mat6::zeros());
        for spring in springs {
            let (row, k) = (spring.row, spring.stiffness_n_per_m);
            let given = spring.given(&self.fields).transpose() * spring.direction;
            of_tool += k * row * row.transpose();
            shared += k * given * row.transpose();
            of_springs += k * given * given.transpose();
        }
        let least = solve_definite(of_springs + of_tissue, &shared);
        let mut stiffness = of_tool - shared.transpose() * least;
        for (i, share) in self.shares.iter_mut().enumerate() {
            *share = if of_tool[(i, i)] > 0.0 { (stiffness[(i, i)] / of_tool[(i, i)]).clamp(1e-3, 1.0) } else { 1.0 };
        }
        for (spring, (arm, turning)) in springs.iter().filter_map(|spring| Some((spring, spring.turning?))) {
            let slid = moved_at(&arm) - spring.given(&self.fields) * least;
            stiffness -= slid.transpose() * turning * slid;
        }
        let damping = body.damping_time_s() * least.transpose() * of_tissue * least;
        Felt { stiffness, damping: 0.5 * (damping + damping.transpose()) }
    }
}

/// What each unit twist moves a point by that is so far from the reference point.
fn moved_at(arm: &Vec3) -> Mat3x6 {
    let [x, y, z] = [Vec3::x(), Vec3::y(), Vec3::z()];
    Mat3x6::from_columns(&[x, y, z, x.cross(arm), y.cross(arm), z.cross(arm)])
}

impl Felt {
    /// Without what pushes a tool on where it has begun to slip: of the stiffness, symmetric, the part without negative
    /// eigenvalues, turning measured by what it moves at `length_m`.
    fn definite(&self, length_m: f64) -> Self {
        let scale = Mat6::from_diagonal(&Vec6::new(1.0, 1.0, 1.0, length_m, length_m, length_m));
        let back = Mat6::from_diagonal(&scale.diagonal().map(|s| 1.0 / s));
        // What moves the reference point by a metre, or turns it by as much at the length.
        let symmetric = 0.5 * (self.stiffness + self.stiffness.transpose());
        let mut eigen = (back * symmetric * back).symmetric_eigen();
        eigen.eigenvalues.apply(|value| *value = value.max(0.0));
        Self { stiffness: scale * eigen.recompose() * scale, damping: self.damping }
    }
}

/// `A^-1 B` of a symmetric matrix without negative eigenvalues, zero along what A does not have.
fn solve_definite(mut a: Mat6, b: &Mat6) -> Mat6 {
    let mut x = *b;
    let before = a.diagonal();
    let mut holds = [false; 6];
    for i in 0..6 {
        let pivot = a[(i, i)];
        holds[i] = pivot > LEAST_PIVOT * before[i];
        if !holds[i] {
            continue;
        }
        for row in i + 1..6 {
            let factor = a[(row, i)] / pivot;
            (i..6).for_each(|column| a[(row, column)] -= factor * a[(i, column)]);
            (0..6).for_each(|column| x[(row, column)] -= factor * x[(i, column)]);
        }
    }
    for i in (0..6).rev() {
        for column in 0..6 {
            let known: f64 = (i + 1..6).map(|j| a[(i, j)] * x[(j, column)]).sum();
            x[(i, column)] = if holds[i] { (x[(i, column)] - known) / a[(i, i)] } else { 0.0 };
        }
    }
    x
}

/// Accumulates the wrench of a tool, and what bounds its model.
pub(super) struct ContactSum {
    pose: Pose,
    wrench: Wrench,
    cap_n: f64,
    pub(super) touches: bool,
    /// Size of the smallest part that touches, m.
    size_m: f64,
    /// Whether a part that touches pulls as it pushes.
    pulls: bool,
    /// Whether all parts that touch cut forward: what a handle bears has no cap.
    cuts_forward: bool,
}

impl ContactSum {
    pub(super) fn new(pose: Pose) -> Self {
        Self {
            pose,
            wrench: Wrench::default(),
            cap_n: 0.0,
            touches: false,
            size_m: f64::INFINITY,
            pulls: false,
            cuts_forward: true,
        }
    }

    pub(super) fn wrench(&self) -> Wrench {
        self.wrench
    }

    /// Adds a contact's force.
    pub(super) fn push(&mut self, contact: &Contact) {
        let arm = contact.ends.tool_point_m - self.pose.position_m;
        let force = -contact.applied_n();
        self.wrench.force_n += force;
        self.wrench.torque_nm += arm.cross(&force);
    }

    /// Takes note of a part's contacts that hold a pose.
    pub(super) fn bound<'a>(&mut self, shape: &ToolShape, pressing: impl Iterator<Item = &'a Contact>) {
        let mut pressing = pressing.peekable();
        if pressing.peek().is_none() {
            return;
        }
        self.touches = true;
        self.size_m = self.size_m.min(shape.size_m());
        self.pulls |= shape.pulls();
        self.cuts_forward &= shape.cuts_forward();
        for contact in pressing.filter(|contact| contact.limit_n.is_finite()) {
            self.cap_n += contact.limit_n;
        }
    }

    /// The model of what touches.
    pub(super) fn model(&self, path: &ToolPath, dt_s: f64, felt: &Felt, give: Option<Give>) -> ContactModel {
        let turn = path.pose.orientation * path.before.orientation.inverse();
        let felt = felt.definite(self.size_m);
        let force_n = self.wrench.force_n;
        let along_force = felt.stiffness.fixed_view::<3, 3>(0, 0) * force_n;
        // A spring that pushes and does not pull holds as far as its force falls to nothing, and is not the same till then.
        let gives_m = force_n.norm_squared() * force_n.norm() / along_force.dot(&force_n).max(f64::MIN_POSITIVE);
        let reach_m = if self.pulls { f64::INFINITY } else { LINEAR_SHARE * gives_m };
        let is_capped = self.cap_n > 0.0 && self.cuts_forward;
        ContactModel {
            reference: self.pose,
            velocity_m_per_s: (path.pose.position_m - path.before.position_m) / dt_s,
            angular_velocity_rad_per_s: turn.scaled_axis() / dt_s,
            wrench: self.wrench,
            stiffness: felt.stiffness.into(),
            damping: felt.damping.into(),
            force_cap_n: is_capped.then_some(self.cap_n),
            give: give.filter(|_| is_capped),
            cap_direction: self.pose.orientation * Vec3::y(),
            validity_radius_m: (VALID_SHARE * self.size_m).min(reach_m),
        }
    }
}

/// How the cut begins where a tool presses with these contacts, if there is a cut yet to begin: their load grows everywhere
/// alike until enough of them give. Those that have given go on bearing what they bear.
pub(super) fn give<'a, C: Iterator<Item = &'a Contact>>(pressing: impl Fn() -> C) -> Option<Give> {
    let capped = || pressing().filter(|contact| contact.limit_n.is_finite());
    let whole = || pressing().filter(|contact| contact.is_yet_to_give());
    let load = |contact: &Contact| contact.force_n / contact.limit_n;
    let [cap_n, given_n] = [capped().map(|c| c.limit_n).sum::<f64>(), capped().map(|c| c.yield_n).sum()];
    let [whole_n, force_n] = [whole().map(|c| c.limit_n).sum::<f64>(), whole().map(|c| c.force_n).sum()];
    if whole_n <= LEAST_TO_GIVE * cap_n || force_n <= 0.0 {
        return None;
    }
    let mut least = 0.0;
    let mut most = whole().map(load).fold(0.0, f64::max);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (least + most);
        let beyond_n: f64 = whole().filter(|contact| load(contact) >= middle).map(|contact| contact.limit_n).sum();
        *(if beyond_n >= GIVES_FIRST * whole_n { &mut least } else { &mut most }) = middle;
    }
    let of_whole_n = (GIVES_EARLIER * force_n / most).min(whole_n);
    Some(Give { at_n: of_whole_n + cap_n - whole_n, cap_n: given_n })
}

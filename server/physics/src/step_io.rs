//! All that crosses the border of a step: [`StepInputs`] in, [`StepOutput`] out.

use crate::Vec3;
use crate::fault::Fault;
use crate::stage::StepProfile;
use crate::tool::{OPEN, Pose};
use serde::{Deserialize, Serialize};

/// Input of one step.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepInputs<'a> {
    /// At most one per tool. A tool without one stays where it is, or lifted.
    pub tools: &'a [ToolInput],
    /// Work that the step may do before it is content with less, in units of which [`SolveReport::work_units`] says how
    /// many a step took; absent: all that it takes. Solves then end at [`crate::SceneDesc::most_relative_residual`], what
    /// is left waits for the next step, and contact models are made over several steps.
    pub work_units: Option<u64>,
    /// Tools, by index, for which a new contact model is asked; one that is not named keeps what it was last found to feel
    /// for as long as it touches. Without a budget it is made in this step. What the step does is the same whichever
    /// they are.
    pub models: &'a [usize],
}

impl<'a> StepInputs<'a> {
    /// Inputs of tools alone.
    #[must_use]
    pub fn of(tools: &'a [ToolInput]) -> Self {
        Self { tools, ..Self::default() }
    }
}

/// What one tool does in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolInput {
    /// Index into [`crate::SceneDesc::tools`].
    pub tool: usize,
    /// How it gets to where it is at t + dt.
    pub motion: ToolMotion,
}

/// How a tool gets to where it is at t + dt. Where a tool is comprises its pose and its `opening`: the fraction of
/// their full opening that its jaws take, 0 (closed) to 1 ([`OPEN`]). A tool without jaws takes no notice of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ToolMotion {
    /// Moves there, touching what lies between; a tool that is lifted enters.
    MoveTo {
        /// Pose at t + dt.
        pose: Pose,
        /// Opening at t + dt.
        opening: f64,
    },
    /// Is lifted and put down there, touching nothing between (first pose, teleport).
    EnterAt {
        /// Pose at t + dt.
        pose: Pose,
        /// Opening at t + dt.
        opening: f64,
    },
    /// Leaves the scene; it touches nothing until it enters again.
    Lift,
}

impl ToolMotion {
    /// [`Self::MoveTo`] this pose, with open jaws if the tool has any.
    #[must_use]
    pub fn move_to(pose: Pose) -> Self {
        Self::MoveTo { pose, opening: OPEN }
    }

    /// [`Self::EnterAt`] this pose, with open jaws if the tool has any.
    #[must_use]
    pub fn enter_at(pose: Pose) -> Self {
        Self::EnterAt { pose, opening: OPEN }
    }
}

/// Force and torque on a tool, scene frame, torque about the tool's reference point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Wrench {
    /// Force on the tool, N.
    pub force_n: Vec3,
    /// Torque on the tool about its reference point, N m.
    pub torque_nm: Vec3,
}

/// Local model of the contact that a station evaluates at its servo rate: wrench(pose, velocity) =
/// `wrench - stiffness * (pose - reference pose) - damping * (velocity - reference velocity)`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ContactModel {
    /// Tool pose that `wrench` belongs to.
    pub reference: Pose,
    /// Velocity of the tool's reference point that `wrench` belongs to: that of the step, m/s.
    pub velocity_m_per_s: Vec3,
    /// Angular velocity of the tool that `wrench` belongs to, rad/s.
    pub angular_velocity_rad_per_s: Vec3,
    /// Wrench on the tool at the reference pose.
    pub wrench: Wrench,
    /// Of springs and tissue in series: symmetric 6x6 without negative eigenvalues, row-major, [translation m; rotation
    /// rad] -> [N; N m].
    pub stiffness: [[f64; 6]; 6],
    /// Of the tissue: symmetric 6x6 without negative eigenvalues, row-major, [m/s; rad/s] -> [N; N m].
    pub damping: [[f64; 6]; 6],
    /// While cutting: the force along `cap_direction` does not exceed this, N.
    pub force_cap_n: Option<f64>,
    /// Present where the cut has yet to begin along some of the edge.
    pub give: Option<Give>,
    /// Unit vector of the cap, scene frame: the tool's cutting direction, reversed.
    pub cap_direction: Vec3,
    /// Distance from the reference pose within which the model holds, m.
    pub validity_radius_m: f64,
}

/// How a cut begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Give {
    /// Force along the cap's direction at which it does along most of the edge, N; no more than the cap.
    pub at_n: f64,
    /// What the cap is once it has begun along all of the edge, N.
    pub cap_n: f64,
}

/// What the jaws of a tool hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Grasp {
    /// Nothing.
    #[default]
    Nothing,
    /// Some tissue.
    Holding,
    /// Nothing from now on: what they held in this step took more force than they have.
    Slipped,
}

/// State of one tool after a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ToolOutput {
    /// Pose at t + dt; `None` while lifted.
    pub pose: Option<Pose>,
    /// Wrench on the tool, from the forces the solver applied.
    pub wrench: Wrench,
    /// Whether the tool touches tissue.
    pub touches: bool,
    /// Present while the tool touches tissue, once [`StepInputs::models`] has named it.
    pub contact: Option<ContactModel>,
    /// Length of the edge whose front is yielding, m; none by the link-energy rule, whose springs are not capped.
    pub cutting_length_m: f64,
    /// Fraction of their full opening that its jaws take at t + dt, if it has any.
    pub opening: f64,
    /// What its jaws hold.
    pub grasp: Grasp,
}

/// Energy booked in one step, J; positive terms leave the first line and enter the others:
/// `tool + load = d elastic + d contact + d kinetic + fracture + front_slip + initiation + damping
///  + friction + contact_loss + parting + numerical + residual`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EnergyStep {
    /// Work done by tools on the tissue.
    pub tool_work_j: f64,
    /// Work done by gravity, tractions and body forces.
    pub load_work_j: f64,
    /// Elastic energy after the step, of relaxing branches too (a level, not a difference).
    pub elastic_j: f64,
    /// Energy in contact springs and held voxels after the step (a level).
    pub contact_j: f64,
    /// Kinetic energy after the step (a level).
    pub kinetic_j: f64,
    /// Gc times the area that parted; at the speed it parted at where it depends on that.
    pub fracture_j: f64,
    /// Work of the capped force on material that slipped past the edge, and of the cohesive springs across what tension
    /// opens, less `fracture_j`; by the link-energy rule what the edge's springs let go as links part, less that.
    pub front_slip_j: f64,
    /// Energy set free when the front dropped from its initiation to its propagation value.
    pub initiation_j: f64,
    /// Rayleigh damping, and what the dashpots of relaxing materials dissipated.
    pub damping_j: f64,
    /// Dissipated by friction, on the flanks of tools and of tissue on tissue.
    pub friction_j: f64,
    /// Elastic energy that vanished as composite elements were split: what holding both sides in one
    /// trilinear field had cost.
    pub parting_j: f64,
    /// What the springs of contact lost: of tools and fronts, between tissue and tissue, across what tension opens.
    /// An implicit step takes half of `k dx^2` of a spring whose length it changes by dx; beside that a spring loses,
    /// or is given, energy where it is let go, comes on or is anchored anew.
    pub contact_loss_j: f64,
    /// Dissipation of the implicit Euler step in the tissue and its linearisation, computed, not by difference.
    pub numerical_j: f64,
    /// What the terms above leave unexplained.
    pub residual_j: f64,
}

/// How the velocity solve went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SolveReport {
    /// PCG iterations of all solves of the step.
    pub iterations: u32,
    /// Solves of the step: of each system that bodies make up, 1 + the number of times its contacts changed, and those
    /// that were taken up again.
    pub solves: u32,
    /// Largest relative residual that the last solve of a system left.
    pub relative_residual: f64,
    /// Solves that did not get to their tolerance and were taken up again with a preconditioner made anew.
    pub retries: u32,
    /// Whether the last solve of a system did not get to its tolerance, and was integrated for want of a better one.
    pub is_unconverged: bool,
    /// Norm of the impulses by which contacts are wrong after the last solves of the step, N s; 0 where they have
    /// settled. They wait for the next step.
    pub unsettled_n_s: f64,
    /// Work of the step, its contact models included: what [`StepInputs::work_units`] bounds.
    pub work_units: u64,
    /// Whether a solve ended short of the tolerance, or with contacts that would go on changing, because the work was
    /// used up.
    pub is_cut_short: bool,
}

/// What parted in one step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FractureStep {
    /// Links that parted.
    pub parted_links: u32,
    /// Links that were crossed and spared, because parting them would have set free a piece of fewer
    /// than [`crate::LEAST_PIECE_VOXELS`].
    pub spared_links: u32,
    /// Area that the fronts swept through intact material, m^2, reference configuration.
    pub cut_area_m2: f64,
    /// Stations at the ends of cuts at which the energy release rate was taken: those whose surroundings had changed.
    pub looks: u32,
}

/// Everything a step reports. Owned by the world and reused.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepOutput {
    /// Steps taken so far, this one included.
    pub step: u64,
    /// Simulated time at the end of the step, s.
    pub sim_time_s: f64,
    /// One entry per tool of the scene.
    pub tools: Vec<ToolOutput>,
    /// Energy booked.
    pub energy: EnergyStep,
    /// One displacement per tracked point of the scene, m, scene frame.
    pub tracked_displacement_m: Vec<Vec3>,
    /// How the solve went.
    pub solve: SolveReport,
    /// What parted.
    pub fracture: FractureStep,
    /// Pieces that left the scene's reach in this step and were put away.
    pub put_away: u32,
    /// Rises by one each time links part.
    pub topology_version: u64,
    /// Set when non-finite state was found and rolled back.
    pub fault: Option<Fault>,
    /// Nanoseconds per stage.
    #[serde(skip)]
    pub profile: StepProfile,
}

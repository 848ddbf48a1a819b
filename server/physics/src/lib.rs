//! The physics of one Kerf scene: composite-FEM tissue, tools, fracture and the surface that is seen.
//!
//! A [`Scene`] describes objects, materials and tools. [`Scene::judge`] makes of it a [`SoundScene`], whose values are
//! within their limits. A [`World`] is built from that, and [`World::step`] takes it on by one step: [`StepInputs`] say
//! how the tools move, the [`StepOutput`] has forces, energies, the displacements of tracked points and what was cut.
//! [`Workers`] lend the step threads. Who wants to see the tissue asks the world for a keyframe of its surface and for
//! what changes of it ([`surface::delta`]).
//!
//! Deliberately absent: I/O, clocks, async, hash order and threads of its own. Input comes in as values, time
//! through a [`StageClock`], threads as [`Workers`]; the same scene and the same inputs give the same bits.
//!
//! Conventions: SI units; scene frame right-handed, +y up, +z toward the user; `f64` for state,
//! forces and residuals, `f32` inside preconditioners and in what leaves for the wire.
//!
//! # Press, and read a force
//!
//! ```
//! use kerf_physics::step_io::ToolMotion;
//! use kerf_physics::{NoClock, Pose, Scene, SceneDesc, StepInputs, ToolInput, Vec3, Workers, World};
//!
//! let text = r#"
//! version = 1
//! name = "block"
//! rate_hz = 1000.0
//! [[objects]]
//! name = "block"
//! shape = { box = { min_m = [-0.02, 0.0, -0.02], max_m = [0.02, 0.04, 0.02] } }
//! voxel_size_m = 0.0025
//! level = 2 # elements of 4 x 4 x 4 voxels
//! fixed = [{ box = { min_m = [-1.0, -1.0, -1.0], max_m = [1.0, 0.005, 1.0] } }]
//! [objects.material]
//! young_modulus_pa = 1e6
//! poisson_ratio = 0.45
//! fracture_energy_j_per_m2 = 500.0
//! [[tools]]
//! name = "blade"
//! shape = { blade = { width_m = 0.06, height_m = 0.05 } }
//! "#;
//! let scene = Scene { desc: SceneDesc::from_toml("block.toml", text)?, meshes: Default::default() }.judge()?;
//! let mut world = World::new(&scene)?;
//! // The edge comes down on the block's top at 0.1 m/s, to 0.5 mm below it.
//! for step in 0..15 {
//!     let position_m = Vec3::new(0.0, 0.041 - 1e-4 * f64::from(step + 1), 0.0);
//!     let motion = ToolMotion::move_to(Pose { position_m, ..Pose::default() });
//!     world.step(&Workers::serial(), &NoClock, &StepInputs::of(&[ToolInput { tool: 0, motion }]));
//! }
//! let force_n = world.output().tools[0].wrench.force_n;
//! assert!(force_n.y > 0.1, "the block pushes the blade up: {force_n}");
//! assert_eq!(world.output().fracture.parted_links, 0, "so far it only dents");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Cut, and write the surface
//!
//! ```
//! # use kerf_physics::step_io::ToolMotion;
//! # use kerf_physics::{NoClock, Pose, Scene, SceneDesc, StepInputs, ToolInput, Vec3, Workers, World};
//! use kerf_physics::MaterialPoint;
//! use kerf_physics::surface::triangulate;
//!
//! # let text = r#"
//! # version = 1
//! # name = "block"
//! # rate_hz = 1000.0
//! # [[objects]]
//! # name = "block"
//! # shape = { box = { min_m = [-0.02, 0.0, -0.02], max_m = [0.02, 0.04, 0.02] } }
//! # voxel_size_m = 0.0025
//! # level = 2 # elements of 4 x 4 x 4 voxels
//! # fixed = [{ box = { min_m = [-1.0, -1.0, -1.0], max_m = [1.0, 0.005, 1.0] } }]
//! # [objects.material]
//! # young_modulus_pa = 1e6
//! # poisson_ratio = 0.45
//! # fracture_energy_j_per_m2 = 500.0
//! # [[tools]]
//! # name = "blade"
//! # shape = { blade = { width_m = 0.06, height_m = 0.05 } }
//! # "#;
//! # let scene = Scene { desc: SceneDesc::from_toml("block.toml", text)?, meshes: Default::default() }.judge()?;
//! let mut world = World::new(&scene)?;
//! for step in 0..60 {
//!     let position_m = Vec3::new(0.0, 0.041 - 4e-4 * f64::from(step + 1), 0.0);
//!     let motion = ToolMotion::move_to(Pose { position_m, ..Pose::default() });
//!     world.step(&Workers::serial(), &NoClock, &StepInputs::of(&[ToolInput { tool: 0, motion }]));
//! }
//! assert!(world.output().fracture.cut_area_m2 > 0.0);
//!
//! // Wavefront OBJ: a line a vertex, a line a triangle, counted from 1.
//! let mut obj = String::new();
//! for (body, surface) in world.bodies_and_surfaces() {
//!     for (_, vertex) in surface.vertices() {
//!         let position_m = vertex.position_m.map(f64::from).into();
//!         let now_m = body.current_m(&MaterialPoint { position_m, voxel: vertex.voxel });
//!         obj += &format!("v {} {} {}\n", now_m.x, now_m.y, now_m.z);
//!     }
//!     let ids: Vec<u32> = surface.vertices().map(|(id, _)| id).collect();
//!     let number = |id| ids.binary_search(&id).expect("a quad's vertices exist") + 1;
//!     for [a, b, c] in surface.quads().flat_map(|(_, quad)| triangulate(*quad)) {
//!         obj += &format!("f {} {} {}\n", number(a), number(b), number(c));
//!     }
//! }
//! // The skin has 16 x 16 quads on each of six sides; the walls of the cut come on top.
//! assert!(obj.lines().filter(|line| line.starts_with('f')).count() > 2 * 6 * 16 * 16);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Record, and replay to the same bits
//!
//! ```
//! # use kerf_physics::step_io::ToolMotion;
//! # use kerf_physics::{NoClock, Pose, Scene, SceneDesc, StepInputs, ToolInput, Vec3, Workers, World};
//! # let text = r#"
//! # version = 1
//! # name = "block"
//! # rate_hz = 1000.0
//! # [[objects]]
//! # name = "block"
//! # shape = { box = { min_m = [-0.02, 0.0, -0.02], max_m = [0.02, 0.04, 0.02] } }
//! # voxel_size_m = 0.0025
//! # level = 2 # elements of 4 x 4 x 4 voxels
//! # fixed = [{ box = { min_m = [-1.0, -1.0, -1.0], max_m = [1.0, 0.005, 1.0] } }]
//! # [objects.material]
//! # young_modulus_pa = 1e6
//! # poisson_ratio = 0.45
//! # fracture_energy_j_per_m2 = 500.0
//! # [[tools]]
//! # name = "blade"
//! # shape = { blade = { width_m = 0.06, height_m = 0.05 } }
//! # "#;
//! # let scene = Scene { desc: SceneDesc::from_toml("block.toml", text)?, meshes: Default::default() }.judge()?;
//! let mut world = World::new(&scene)?;
//! let mut recorded = Vec::new();
//! for step in 0..40 {
//!     let position_m = Vec3::new(0.0, 0.041 - 4e-4 * (step + 1) as f64, 0.0);
//!     let motion = ToolMotion::move_to(Pose { position_m, ..Pose::default() });
//!     recorded.push([ToolInput { tool: 0, motion }]);
//!     world.step(&Workers::serial(), &NoClock, &StepInputs::of(&recorded[step]));
//! }
//! let mut replayed = World::new(&scene)?;
//! for inputs in &recorded {
//!     replayed.step(&Workers::serial(), &NoClock, &StepInputs::of(inputs));
//! }
//! assert_eq!(replayed.state_hash(), world.state_hash());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// A type that others meet in a signature has a page.
#![deny(unnameable_types)]

mod body;
mod boundary;
mod contact;
pub mod energy_terms;
pub mod fault;
mod fem;
mod fracture;
mod grid;
mod grow;
mod hash;
mod ledger;
mod likeness;
pub mod making;
mod math;
mod params;
pub mod scene;
mod solve;
pub mod stage;
pub mod step_io;
pub mod surface;
mod tool;
mod validate;
#[doc(hidden)]
pub mod verification;
pub mod view;
mod walk;
mod work;
mod workers;
pub mod world;

pub use body::{Body, MOST_CONTRAST};
pub use grid::lattice::Bounds;
pub use grid::missed::{Missed, MissedPart};
pub use grid::thickness::Thickness;
pub use grid::voxelize::{Measures, measures, region_voxels, voxel_size_m, voxelize, wanted_levels};
pub use grid::{Crossing, Grid, Ijk, LEAST_PIECE_VOXELS, LeftOut, Link, LinkId, MaterialPoint, Voxel, VoxelId};
pub use hash::StateHasher;
pub use math::{Mat3, Quat, Vec3};
pub use scene::{Scene, SceneDesc, SceneError, SceneProblems};
pub use stage::{NoClock, Stage, StageClock, StepProfile};
pub use step_io::{StepInputs, StepOutput, ToolInput};
pub use tool::{OPEN, Pose, PoseError};
pub use validate::SoundScene;
pub use workers::Workers;
pub use world::World;

#[cfg(test)]
extern crate self as kerf_physics;
#[cfg(test)]
#[path = "../tests/main.rs"]
mod tests;

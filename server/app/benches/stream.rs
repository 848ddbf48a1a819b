//! What a viewer's stream takes: bytes, and time to encode. The built-in liver at 60 Hz while a blade goes 60 mm into its
//! right lobe, cutting all the while; a table on standard output.

use std::sync::Arc;

use kerf_physics::step_io::ToolMotion;
use kerf_physics::tool::Pose;
use kerf_physics::{NoClock, Quat, StepInputs, ToolInput, Vec3, Workers, World};
use kerf_proto::v1;
use kerf_scenes::catalog;
use kerf_server::wire::{self, Encoder, Encoding};
use kerf_session::ViewState;
use kerf_session::clock::MonotonicClock;
use prost::Message;

const RATE_HZ: f64 = 60.0;
const SPEED_M_PER_S: f64 = 0.05;
const DEPTH_M: f64 = 0.06;

/// What one step gives viewers.
struct Shown {
    state: Arc<ViewState>,
    patch_bytes: usize,
}

fn stroke() -> (f64, Vec<Shown>) {
    let mut scene = catalog::builtin("liver").expect("a built-in scene");
    scene.desc.rate_hz = RATE_HZ;
    let mut world = World::new(&scene).expect("a valid scene");
    let keyframe = wire::keyframe(&world.keyframe(), &[1.0]);
    println!("keyframe: {:.0} kB", keyframe.encoded_len() as f64 * 1e-3);
    let steps = (DEPTH_M / SPEED_M_PER_S * RATE_HZ) as u32;
    let shown = (0..steps).map(|step| {
        let height_m = 0.158 - SPEED_M_PER_S * f64::from(step) / RATE_HZ;
        let orientation = Quat::from_euler_angles(0.0, 0.2, 0.0);
        let pose = Pose { position_m: Vec3::new(-0.0420, height_m, -0.0210), orientation };
        let input = ToolInput { tool: 0, motion: ToolMotion::move_to(pose) };
        world.step(&Workers::serial(), &NoClock, &StepInputs::of(&[input]));
        world.adapt_surface(&NoClock);
        let mut state = ViewState::default();
        state.step = u64::from(step) + 1;
        state.node_displacements_m.push(Vec::new());
        world.node_displacements_m(0, &mut state.node_displacements_m[0]);
        state.adapted = vec![world.adapted_vertices(0).to_vec()];
        let patch_bytes = world.topology_patch().map_or(0, |patch| wire::patch(patch).encoded_len());
        Shown { state: Arc::new(state), patch_bytes }
    });
    (world_voxel_m(&scene), shown.collect())
}

fn world_voxel_m(scene: &kerf_physics::Scene) -> f64 {
    scene.desc.objects[0].voxel_size_m.expect("the liver states its voxels' size")
}

fn main() {
    let (voxel_m, shown) = stroke();
    let floats: usize = shown.iter().map(|shown| 4 * shown.state.node_displacements_m[0].len()).sum();
    let per_s = |bytes: usize| bytes as f64 * RATE_HZ / shown.len() as f64 * 1e-3;
    let patches = shown.iter().map(|shown| shown.patch_bytes).sum();
    println!("node displacements as floats: {:.0} kB/s; patches: {:.0} kB/s", per_s(floats), per_s(patches));
    println!("| largest error, voxels | states, kB/s | of that adapted vertices | all, kB/s | encoding a state, ms |");
    println!("|---|---|---|---|---|");
    for max_error_voxels in [1.0 / 32.0, 0.0, 1.0 / 1024.0] {
        let request = v1::ViewRequest { max_error_voxels, ..v1::ViewRequest::default() };
        let encoding = Encoding::granted(&request).expect("a valid wish");
        let mut encoder = Encoder::new(encoding, std::iter::once(voxel_m));
        let (mut held, mut bytes, mut adapted_bytes) = (None, 0, 0);
        let mut took_ns = 0;
        for Shown { state, .. } in &shown {
            let start_ns = MonotonicClock::now_ns();
            let encoded = encoder.encode(state);
            took_ns += MonotonicClock::now_ns() - start_ns;
            let message = encoded.message(&mut held, false);
            bytes += message.encoded_len();
            adapted_bytes += message.bodies[0].adapted_ids.len() + message.bodies[0].adapted_offsets.len();
        }
        let error = if max_error_voxels == 0.0 { "default".into() } else { format!("1/{}", 1.0 / max_error_voxels) };
        let (states, adapted, all) = (per_s(bytes), per_s(adapted_bytes), per_s(bytes + patches));
        let took_ms = took_ns as f64 * 1e-6 / shown.len() as f64;
        println!("| {error} | {states:.0} | {adapted:.0} | {all:.0} | {took_ms:.3} |");
    }
}

//! What a viewer's stream takes: bytes, and time to encode. The built-in liver at 60 Hz while a blade goes 60 mm into its
//! right lobe, cutting all the while; a table on standard output.

use std::sync::Arc;

use kerf_physics::step_io::ToolMotion;
use kerf_physics::surface::delta::{Keyframe, TopologyPatch};
use kerf_physics::{NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};
use kerf_proto::v1;
use kerf_scenes::catalog;
use kerf_server::wire::{Encoder, Encoding};
use kerf_session::ViewState;
use kerf_session::clock::MonotonicClock;
use prost::Message;

const RATE_HZ: f64 = 60.0;
const SPEED_M_PER_S: f64 = 0.05;
const DEPTH_M: f64 = 0.06;

/// What one step gives viewers.
struct Shown {
    state: Arc<ViewState>,
    patch: Option<TopologyPatch>,
}

/// The stroke: a keyframe before it, and what each step gives.
fn stroke() -> (f64, Keyframe, Vec<Shown>) {
    let scene = catalog::builtin("liver").expect("a built-in scene");
    let scene = scene.with(|desc| desc.rate_hz = RATE_HZ).expect("a sound rate");
    let mut world = World::new(&scene).expect("a valid scene");
    let keyframe = world.keyframe();
    let steps = (DEPTH_M / SPEED_M_PER_S * RATE_HZ) as u32;
    let shown = (0..steps).map(|step| {
        let height_m = 0.158 - SPEED_M_PER_S * f64::from(step) / RATE_HZ;
        let orientation = Quat::from_euler_angles(0.0, 0.2, 0.0);
        let pose = Pose { position_m: Vec3::new(-0.0420, height_m, -0.0210), orientation };
        let input = ToolInput { tool: 0, motion: ToolMotion::move_to(pose) };
        let version = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&[input])).topology_version;
        world.adapt_surface(&NoClock);
        let mut state = ViewState::default();
        state.step = u64::from(step) + 1;
        state.node_displacements_m.push(Vec::new());
        world.node_displacements_m(0, &mut state.node_displacements_m[0]);
        state.adapted = vec![world.adapted_vertices(0).to_vec()];
        let patch = world.topology_patch().cloned();
        state.topology_version = version;
        Shown { state: Arc::new(state), patch }
    });
    let shown = shown.collect();
    (world_voxel_m(&scene), keyframe, shown)
}

fn world_voxel_m(scene: &kerf_physics::Scene) -> f64 {
    scene.desc.objects[0].voxel_size_m.expect("the liver states its voxels' size")
}

/// How a viewer asks for its stream.
fn requests() -> Vec<(&'static str, v1::ViewRequest)> {
    let lattice = v1::ViewRequest::default();
    let plain = v1::ViewRequest { encoding: v1::SurfaceEncoding::Vertices.into(), ..lattice.clone() };
    let of_error =
        |max_error_voxels, request: &v1::ViewRequest| v1::ViewRequest { max_error_voxels, ..request.clone() };
    vec![
        ("lattice, error 1/32 voxel", of_error(1.0 / 32.0, &lattice)),
        ("lattice, error 1/128 (default)", lattice.clone()),
        ("lattice, error 1/1024", of_error(1.0 / 1024.0, &lattice)),
        ("vertices, error 1/32", of_error(1.0 / 32.0, &plain)),
        ("vertices, error 1/128 (default)", plain.clone()),
        ("vertices with normals", v1::ViewRequest { wants_normals: true, ..plain }),
    ]
}

fn main() {
    let (voxel_m, keyframe, shown) = stroke();
    let per_s = |bytes: usize| bytes as f64 * RATE_HZ / shown.len() as f64 * 1e-3;
    let floats: usize = shown.iter().map(|shown| 4 * shown.state.node_displacements_m[0].len()).sum();
    println!("node displacements as floats: {:.0} kB/s", per_s(floats));
    println!("| stream | keyframe, kB | patches, kB/s | states, kB/s | all, kB/s | encoding a state, ms |");
    println!("|---|---|---|---|---|---|");
    for (name, request) in requests() {
        let encoding = Encoding::granted(&request).expect("a valid wish");
        let mut encoder = Encoder::new(encoding, std::iter::once(voxel_m));
        let whole = encoder.keyframe(0, &keyframe).expect("of this epoch").encoded_len();
        let (mut held, mut patches, mut states, mut took_ns) = (None, 0, 0, 0);
        for Shown { state, patch } in &shown {
            patches +=
                patch.iter().map(|patch| encoder.patch(0, patch).expect("of this epoch").encoded_len()).sum::<usize>();
            let start_ns = MonotonicClock::now_ns();
            let encoded = encoder.encode(state).expect("of the newest structure");
            took_ns += MonotonicClock::now_ns() - start_ns;
            states += encoded.message(&mut held, false).encoded_len();
        }
        let took_ms = took_ns as f64 * 1e-6 / shown.len() as f64;
        let (whole, patches, states, all) =
            (whole as f64 * 1e-3, per_s(patches), per_s(states), per_s(patches + states));
        println!("| {name} | {whole:.0} | {patches:.0} | {states:.0} | {all:.0} | {took_ms:.3} |");
    }
}

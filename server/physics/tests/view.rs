//! What viewers get of a scene that is cut: keyframes, patches and the hash they are checked by.

use super::support::cutting::attitude;
use super::support::{Lcg, object, scene, world_of};
use kerf_physics::scene::{BladeDesc, MaterialDesc, RegionDesc, Scene, ShapeDesc, ToolDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::surface::delta::{BodyStructure, TopologyPatch};
use kerf_physics::surface::hash::{ObjectHash, surface_hash};
use kerf_physics::view::{Frame, StructureChange, View};
use kerf_physics::{NoClock, Pose, Stage, StepInputs, StepOutput, ToolInput, Vec3, Workers, World};

const STEPS_PER_STROKE: usize = 60;

/// Two blocks side by side under a blade that reaches over both.
fn two_blocks() -> World {
    world_of(&two_blocks_scene())
}

fn two_blocks_scene() -> Scene {
    let mut blocks = [-0.032, 0.002].map(|x_m| object([x_m, 0.0, -0.015], [x_m + 0.03, 0.03, 0.015], 0.005, 1));
    for (block, name) in blocks.iter_mut().zip(["left", "right"]) {
        block.name = name.into();
        block.material.young_modulus_pa = 2e4;
        block.material.fracture_energy_j_per_m2 = Some(20.0);
        block.material.rayleigh_beta_s = 1e-3;
        block.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 0.0051, 1.0] }];
    }
    let mut scene = scene(blocks.into());
    scene.desc.solver.relative_tolerance = Some(1e-3);
    let blade = BladeDesc::straight(0.06, 0.06);
    scene.desc.tools = vec![ToolDesc::blade("blade", blade)];
    scene
}

/// A stroke down through the blocks, somewhere and askew; `after` sees the world after every step.
fn stroke(world: &mut World, rng: &mut Lcg, mut after: impl FnMut(&mut World, &StepOutput)) {
    let mut spread = |half: f64| (2.0 * rng.unit() - 1.0) * half;
    let orientation = attitude(spread(40.0), spread(10.0), spread(20.0));
    let from_m = Vec3::new(spread(0.01), 0.033, spread(0.01));
    for step in 0..STEPS_PER_STROKE {
        let position_m = from_m - Vec3::y() * (5e-4 * step as f64);
        let pose = Pose { position_m, orientation };
        let motion = if step == 0 { ToolMotion::enter_at(pose) } else { ToolMotion::move_to(pose) };
        let inputs = [ToolInput { tool: 0, motion }];
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs)).clone();
        after(world, &output);
    }
}

/// The hash of whole structures, of which nothing was known before.
fn hash_of(bodies: &[BodyStructure]) -> u64 {
    let hashes: Vec<ObjectHash> = bodies
        .iter()
        .map(|body| {
            let mut hash = ObjectHash::default();
            hash.follow(body);
            hash
        })
        .collect();
    surface_hash(hashes.iter())
}

#[test]
fn the_hash_that_follows_the_patches_is_that_of_the_surface_as_it_is() {
    let mut world = two_blocks();
    let first = world.keyframe();
    assert_eq!(first.surface_hash, hash_of(&first.bodies));
    let mut rng = Lcg(11);
    let (mut patches, mut hashes) = (0, vec![first.surface_hash]);
    for _ in 0..5 {
        stroke(&mut world, &mut rng, |world, output| {
            let Some(patch) = world.topology_patch().cloned() else {
                assert_eq!(output.fracture.parted_links, 0);
                return;
            };
            let now = world.keyframe();
            assert_eq!(patch.to_version, now.topology_version);
            assert_eq!(patch.surface_hash, hash_of(&now.bodies), "version {}", patch.to_version);
            assert_eq!(now.surface_hash, patch.surface_hash);
            patches += 1;
            hashes.push(patch.surface_hash);
        });
    }
    assert!(patches > 20, "{patches} patches");
    hashes.sort_unstable();
    hashes.dedup();
    assert_eq!(hashes.len(), patches + 1, "every version has a hash of its own");
}

/// Two blocks that stand on what is held; half of the right one is of a second material.
fn blocks_of_two_materials() -> World {
    let mut scene = two_blocks_scene();
    let block = &mut scene.desc.objects[1];
    let shape = ShapeDesc::Box { min_m: [0.017, -1.0, -1.0], max_m: [1.0; 3] };
    let material = MaterialDesc { young_modulus_pa: 4e4, ..block.material.clone() };
    block.regions = vec![RegionDesc { name: "stiff".into(), shape, material }];
    world_of(&scene)
}

#[test]
fn a_structure_that_is_followed_through_cuts_is_a_keyframe_made_anew() {
    for seed in 21..25 {
        let mut world = blocks_of_two_materials();
        let mut rng = Lcg(seed);
        let mut choice = Lcg(seed + 100);
        // By every patch, and by patches put together at random, as a viewer gets them who reads slowly.
        let mut stepwise = world.keyframe();
        let mut now_and_then = stepwise.clone();
        assert!(stepwise.bodies[1].vertices.iter().any(|vertex| vertex.material == 1), "a second material");
        let (mut together, mut patches, mut held_anew) = (None::<TopologyPatch>, 0, 0);
        for _ in 0..3 {
            stroke(&mut world, &mut rng, |world, _| {
                let Some(patch) = world.topology_patch().cloned() else { return };
                let anew = world.keyframe();
                stepwise.follow(&patch).expect("patches without a gap");
                assert_eq!(stepwise, anew, "seed {seed}, version {}", anew.topology_version);
                match &mut together {
                    Some(together) => together.append(&patch).expect("patches without a gap"),
                    None => together = Some(patch.clone()),
                }
                if choice.unit() < 0.3 {
                    let together = together.take().expect("a patch");
                    now_and_then.follow(&together).expect("patches without a gap");
                    assert_eq!(now_and_then, anew, "seed {seed}, version {}", anew.topology_version);
                }
                patches += 1;
                held_anew += patch.bodies.iter().map(|body| body.held.len()).sum::<usize>();
            });
        }
        assert!(patches > 10 && held_anew > 20, "seed {seed}: {patches} patches, {held_anew} held vertices");
    }
}

#[test]
fn a_surface_that_was_forgotten_costs_nothing_and_comes_back_as_if_it_had_been_followed() {
    let [mut followed, mut forgotten] = [two_blocks(), two_blocks()];
    let (mut rng, mut same) = (Lcg(12), Lcg(12));
    assert_eq!(followed.keyframe(), forgotten.keyframe());
    forgotten.forget_surface();
    for _ in 0..3 {
        stroke(&mut followed, &mut rng, |_, _| ());
        let mut parted = 0;
        stroke(&mut forgotten, &mut same, |world, output| {
            assert_eq!(output.profile.stage_ns[Stage::Surface as usize], None);
            assert_eq!(world.topology_patch(), None);
            parted += output.fracture.parted_links;
        });
        assert!(parted > 0);
        assert_eq!(followed.keyframe(), forgotten.keyframe());
        forgotten.forget_surface();
    }
    assert_eq!(followed.state_hash(), forgotten.state_hash());
    // From a keyframe on it is followed again.
    let _ = forgotten.keyframe();
    let mut patches: [Vec<_>; 2] = Default::default();
    stroke(&mut followed, &mut rng, |world, _| patches[0].extend(world.topology_patch().cloned()));
    stroke(&mut forgotten, &mut same, |world, _| patches[1].extend(world.topology_patch().cloned()));
    assert!(!patches[0].is_empty());
    assert_eq!(patches[0], patches[1]);
}

#[test]
fn a_view_without_a_world_that_gets_changes_of_several_steps_at_once_shows_what_the_world_does() {
    let mut world = two_blocks();
    let (first, mut view, mut frame) = (world.keyframe(), View::new(world.structure()), Frame::default());
    assert_eq!(view.keyframe(), first);
    let (mut waiting, mut step) = (None::<StructureChange>, 0);
    let (mut changes, mut looks, mut adapted) = (0, 0, 0);
    let mut rng = Lcg(13);
    for _ in 0..3 {
        stroke(&mut world, &mut rng, |world, _| {
            step += 1;
            if let Some(change) = world.structure_change() {
                changes += 1;
                match &mut waiting {
                    Some(waiting) => waiting.append(change),
                    None => waiting = Some(change),
                }
            }
            if step % 7 != 0 {
                return;
            }
            let patch = waiting.take().map(|change| view.follow(&change));
            world.write_frame(&mut frame);
            view.adapt(&frame);
            world.adapt_surface(&NoClock);
            let keyframe = world.keyframe();
            assert!(patch.is_none_or(|patch| patch.surface_hash == keyframe.surface_hash));
            assert_eq!(view.keyframe(), keyframe);
            for object in 0..2 {
                let mut displacements_m = [Vec::new(), Vec::new()];
                world.node_displacements_m(object, &mut displacements_m[0]);
                view.node_displacements_m(&frame, object, &mut displacements_m[1]);
                assert_eq!(displacements_m[0], displacements_m[1]);
                assert_eq!(view.adapted_vertices(object), world.adapted_vertices(object));
                adapted += view.adapted_vertices(object).len();
            }
            looks += 1;
        });
    }
    assert!(changes > 2 * looks && adapted > 100, "{changes} changes in {looks} looks, {adapted} vertices adapted");
}

/// What a viewer knows of an object, and where it puts the vertices.
#[derive(Default)]
struct Viewer {
    nodes: std::collections::BTreeMap<u32, Vec3>,
    elements: std::collections::BTreeMap<u32, [u32; 8]>,
    vertices: std::collections::BTreeMap<u32, (u32, Vec3)>,
    held: std::collections::BTreeMap<u32, [f32; 8]>,
}

impl Viewer {
    fn take(&mut self, change: &BodyStructure) {
        self.nodes.extend(change.nodes.iter().map(|node| (node.id, Vec3::from(node.rest_m.map(f64::from)))));
        self.elements.extend(change.elements.iter().map(|element| (element.id, element.nodes)));
        for vertex in &change.vertices {
            self.vertices.insert(vertex.id, (vertex.element, vertex.local.map(f64::from).into()));
            self.held.remove(&vertex.id);
        }
        self.held.extend(change.held.iter().map(|vertex| (vertex.id, vertex.weights)));
    }

    fn place_m(&self, id: u32, moved_m: &[f32]) -> Vec3 {
        let (element, local) = &self.vertices[&id];
        let mut at_m = Vec3::zeros();
        for (corner, node) in self.elements[element].iter().enumerate() {
            let along = |axis: usize| if corner >> axis & 1 == 1 { local[axis] } else { 1.0 - local[axis] };
            let trilinear = along(0) * along(1) * along(2);
            let weight = self.held.get(&id).map_or(trilinear, |weights| f64::from(weights[corner]));
            let moved = Vec3::from_fn(|axis, _| f64::from(moved_m[3 * *node as usize + axis]));
            at_m += self.nodes[node] * trilinear + moved * weight;
        }
        at_m
    }
}

#[test]
fn viewers_put_every_vertex_where_its_material_is_also_beside_what_is_held() {
    use kerf_physics::MaterialPoint;
    let mut world = two_blocks();
    let mut viewers: [Viewer; 2] = Default::default();
    viewers.iter_mut().zip(&world.keyframe().bodies).for_each(|(viewer, body)| viewer.take(body));
    assert!(viewers.iter().all(|viewer| viewer.held.len() > 20), "the blocks stand on what is held");
    let (mut rng, mut moved_m) = (Lcg(13), Vec::new());
    for _ in 0..3 {
        stroke(&mut world, &mut rng, |world, _| {
            if let Some(patch) = world.topology_patch().cloned() {
                viewers.iter_mut().zip(&patch.bodies).for_each(|(viewer, body)| viewer.take(body));
            }
        });
        for (object, viewer) in viewers.iter().enumerate() {
            moved_m.clear();
            world.node_displacements_m(object, &mut moved_m);
            let (body, surface) = world.bodies_and_surfaces().nth(object).expect("two objects");
            for (id, vertex) in surface.vertices() {
                let point = MaterialPoint { position_m: vertex.position_m.map(f64::from).into(), voxel: vertex.voxel };
                let off_m = (viewer.place_m(id, &moved_m) - body.current_m(&point)).norm();
                assert!(off_m < 1e-7, "vertex {id} of object {object} is off by {off_m} m");
            }
        }
    }
}

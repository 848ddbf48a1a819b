//! `kerf-server check`: what is wrong with a scene, and what its elements are asked to carry.

use anyhow::{Result, bail};
use kerf_physics::scene::toughness::{asked_over_eh, carried_over_eh, composite_edge_m, gc_over_eh};
use kerf_physics::scene::{MaterialDesc, ObjectDesc};
use kerf_physics::{Grid, Scene, World, region_voxels};
use kerf_scenes::ReadError;

use crate::scene_args::{Run, SceneArgs, counted};

/// Prints a scene's sizes and all warnings, or its problems.
///
/// # Errors
/// The scene cannot be read, it has problems, or warnings that are denied; they have been printed.
pub fn run(args: &SceneArgs) -> Result<()> {
    let name = &args.scene;
    let Run { scene, world, warnings, .. } = args.examine().or_else(|error| match error.downcast_ref() {
        Some(ReadError::Invalid { problems, .. }) => {
            problems.iter().for_each(|problem| println!("problem: {problem}"));
            bail!("{name}: {}", counted(problems.len(), "problem"))
        }
        _ => Err(error),
    })?;
    sizes(&scene, &world).iter().for_each(|line| println!("{line}"));
    warnings.iter().for_each(|warning| println!("warning: {warning}"));
    println!("{name}: no problems, {}", counted(warnings.len(), "warning"));
    args.warnings.judge(warnings.len())
}

/// What a scene consists of, and what its elements are asked to carry.
fn sizes(scene: &Scene, world: &World) -> Vec<String> {
    let mut lines = Vec::new();
    for (object, body) in scene.desc.objects.iter().zip(world.bodies()) {
        let grid = body.grid();
        let [nx, ny, nz] = grid.dims();
        lines.push(format!(
            "object {}: {} voxels of {:.3} mm in {nx} x {ny} x {nz}, level {}: H = {:.2} mm",
            object.name,
            grid.voxels().len(),
            grid.voxel_size_m() * 1e3,
            object.level,
            composite_edge_m(grid.voxel_size_m(), object.level) * 1e3,
        ));
        lines.push(material("  material", &object.material, object, grid));
        for (i, region) in object.regions.iter().enumerate() {
            let held = grid.voxels().iter().filter(|v| usize::from(v.material) == i + 1).count();
            lines.push(material(&format!("  region {} ({held} voxels)", region.name), &region.material, object, grid));
        }
        let held = |shape| region_voxels(grid, shape, &scene.meshes).map_or(0, |voxels| voxels.len());
        lines.extend(object.finer.iter().map(|f| format!("  finer: {} voxels at level {}", held(&f.shape), f.level)));
        lines.push(format!("  fixed: {} voxels", object.fixed.iter().map(held).sum::<usize>()));
    }
    lines
}

fn material(what: &str, material: &MaterialDesc, object: &ObjectDesc, grid: &Grid) -> String {
    let (level, voxel_size_m) = (object.level, grid.voxel_size_m());
    let carried = carried_over_eh(material, level);
    let ratio = gc_over_eh(material, composite_edge_m(voxel_size_m, level));
    let start = asked_over_eh(material, object.fracture_rule, voxel_size_m, level);
    let toughness = ratio.zip(start).map_or("cannot be cut".to_owned(), |(ratio, start)| {
        format!("Gc/(E H) {ratio:.3}, {start:.3} to start a cut, of {carried:.2} that the element law carries")
    });
    let relaxes = material.viscosity.map_or(String::new(), |v| {
        let at_once = material.instantaneous_modulus_pa();
        format!(", from {at_once:.3e} Pa at once in {} s", v.relaxation_time_s)
    });
    format!("{what}: E {:.3e} Pa{relaxes}, {toughness}", material.young_modulus_pa)
}

#[cfg(test)]
mod tests {
    use kerf_scenes::catalog;

    use super::*;

    #[test]
    fn toughness_is_told_where_something_may_cut() {
        let jelly = catalog::builtin("jelly").unwrap();
        let lines = sizes(&jelly, &World::new(&jelly).unwrap()).join("\n");
        assert!(lines.contains("Gc/(E H) 0.500, 1.000 to start a cut") && lines.contains("fixed: "), "{lines}");
        let pressed = catalog::builtin("pressed-block").unwrap();
        let lines = sizes(&pressed, &World::new(&pressed).unwrap()).join("\n");
        assert!(lines.contains("cannot be cut"), "{lines}");
    }

    #[test]
    fn a_material_that_relaxes_is_told_with_both_moduli() {
        let mut scene = catalog::builtin("jelly").unwrap().into_scene();
        let material = &mut scene.desc.objects[0].material;
        let young = material.young_modulus_pa;
        material.viscosity =
            Some(kerf_physics::scene::ViscosityDesc { relaxation_time_s: 0.3, relaxing_modulus_ratio: 0.5 });
        let scene = scene.judge().unwrap();
        let lines = sizes(&scene, &World::new(&scene).unwrap()).join("\n");
        let expected = format!("E {young:.3e} Pa, from {:.3e} Pa at once in 0.3 s", 1.5 * young);
        assert!(lines.contains(&expected), "{lines}");
    }
}

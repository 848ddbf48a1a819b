//! `kerf-server scenes`: the built-in scenes in a table.

use anyhow::{Context, Result};
use kerf_physics::scene::toughness::{composite_edge_m, gc_over_eh};
use kerf_physics::{World, voxel_size_m};
use kerf_scenes::catalog;

/// Prints a line per built-in scene; in parentheses what the paper's Table 1 says.
///
/// # Errors
/// A built-in scene that cannot be built, which its tests exclude.
pub fn run() -> Result<()> {
    println!(
        "{:<15} {:>16} {:>15} {:>6} {:>7} {:>7} {:>9} {:>8} {:>9}",
        "scene", "voxels", "elements", "level", "h mm", "H mm", "E kPa", "Gc J/m2", "Gc/(E H)"
    );
    for name in catalog::builtin_names() {
        println!("{}", line(name)?);
    }
    println!("in parentheses: the paper's Table 1; H = 2^level h, the edge of a composite element");
    Ok(())
}

fn line(name: &str) -> Result<String> {
    let scene = catalog::builtin(name)?;
    let counts = World::new(&scene)?.counts();
    let object = &scene.desc.objects[0];
    let material = &object.material;
    let voxel_size_m = voxel_size_m(object, &scene.meshes)?.context("the mesh was not read")?;
    let edge_m = composite_edge_m(voxel_size_m, object.level);
    let paper = catalog::paper_counts(name);
    let beside = |ours: usize, theirs: Option<u32>| theirs.map_or(format!("{ours}"), |n| format!("{ours} ({n})"));
    Ok(format!(
        "{name:<15} {:>16} {:>15} {:>6} {:>7.2} {:>7.1} {:>9.1} {:>8} {:>9}",
        beside(counts.voxels, paper.map(|p| p.voxels)),
        beside(counts.composite_elements, paper.map(|p| p.composite_elements)),
        object.level,
        voxel_size_m * 1e3,
        edge_m * 1e3,
        material.young_modulus_pa / 1e3,
        material.fracture_energy_j_per_m2.map_or("-".into(), |gc| format!("{gc:.0}")),
        gc_over_eh(material, edge_m).map_or("-".into(), |ratio| format!("{ratio:.2}")),
    ))
}

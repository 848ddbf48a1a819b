//! `kerf-server check`: what is wrong with a scene, and what its elements are asked to carry.

use std::path::Path;

use anyhow::{Result, bail};
use kerf_physics::grid::voxelize::{region_voxels, voxelize};
use kerf_physics::grid::{Grid, LEAST_PIECE_VOXELS, LeftOut};
use kerf_physics::scene::toughness::{asked_over_eh, carried_over_eh, composite_edge_m, gc_over_eh};
use kerf_physics::scene::{MaterialDesc, ObjectDesc};
use kerf_physics::{Scene, SceneError};
use kerf_scenes::catalog;

/// Prints all problems and warnings of a scene, then its sizes.
///
/// # Errors
/// The scene cannot be read, or it has problems; they have been printed.
pub fn run(file: &Path) -> Result<()> {
    let name = file.display().to_string();
    let report = examine(&catalog::open(&name)?);
    report.lines.iter().for_each(|line| println!("{line}"));
    report.warnings.iter().for_each(|warning| println!("warning: {warning}"));
    report.problems.iter().for_each(|problem| println!("problem: {problem}"));
    if !report.problems.is_empty() {
        bail!("{name}: {} problems", report.problems.len());
    }
    println!("{name}: no problems, {} warnings", report.warnings.len());
    Ok(())
}

/// What [`examine`] found.
#[derive(Debug, Default)]
pub struct Report {
    /// Sizes and ratios.
    pub lines: Vec<String>,
    /// What a scene can run with but hardly means.
    pub warnings: Vec<String>,
    /// What a scene cannot run with.
    pub problems: Vec<SceneError>,
}

/// Judges a scene's values and, where they allow it, its voxels.
#[must_use]
pub fn examine(scene: &Scene) -> Report {
    let mut report = Report { problems: scene.problems(), ..Report::default() };
    if !report.problems.is_empty() {
        return report;
    }
    for (i, object) in scene.desc.objects.iter().enumerate() {
        match voxelize(object, &scene.meshes) {
            Ok(grid) => report.object(i, scene, &grid),
            Err(problem) => report.problems.push(problem),
        }
    }
    report
}

impl Report {
    fn object(&mut self, index: usize, scene: &Scene, grid: &Grid) {
        let object = &scene.desc.objects[index];
        let edge_m = composite_edge_m(grid.voxel_size_m(), object.level);
        let [nx, ny, nz] = grid.dims();
        self.lines.push(format!(
            "object {}: {} voxels of {:.3} mm in {nx} x {ny} x {nz}, level {}: H = {:.2} mm",
            object.name,
            grid.voxels().len(),
            grid.voxel_size_m() * 1e3,
            object.level,
            edge_m * 1e3,
        ));
        self.material("  material", &object.material, object, grid.voxel_size_m());
        for (i, region) in object.regions.iter().enumerate() {
            let held = grid.voxels().iter().filter(|v| usize::from(v.material) == i + 1).count();
            let what = format!("  region {} ({held} voxels)", region.name);
            self.material(&what, &region.material, object, grid.voxel_size_m());
            if held == 0 {
                self.warnings.push(format!("objects[{index}].regions[{i}]: holds no voxel"));
            }
        }
        for (i, finer) in object.finer.iter().enumerate() {
            match region_voxels(grid, &finer.shape, &scene.meshes) {
                Ok(voxels) if voxels.is_empty() => {
                    self.warnings.push(format!("objects[{index}].finer[{i}]: holds no voxel"));
                }
                Ok(voxels) => self.lines.push(format!("  finer: {} voxels at level {}", voxels.len(), finer.level)),
                Err(problem) => self.problems.push(problem.within(&format!("objects[{index}].finer[{i}]"))),
            }
        }
        self.supports(index, object, scene, grid);
        self.left_out(index, grid);
        for (i, point) in scene.desc.tracked_points.iter().enumerate().filter(|(_, p)| p.object == object.name) {
            if grid.voxel_at(grid.cell_of(&point.position_m.into())).is_none() {
                self.warnings
                    .push(format!("tracked_points[{i}]: {:?} lies in no voxel of the object", point.position_m));
            }
        }
    }

    fn material(&mut self, what: &str, material: &MaterialDesc, object: &ObjectDesc, voxel_size_m: f64) {
        let level = object.level;
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
        self.lines.push(format!("{what}: E {:.3e} Pa{relaxes}, {toughness}", material.young_modulus_pa));
    }

    fn left_out(&mut self, index: usize, grid: &Grid) {
        let LeftOut { pieces, voxels, smallest } = grid.left_out();
        if pieces > 0 {
            let voxel_mm = grid.voxel_size_m() * 1e3;
            self.warnings.push(format!(
                "objects[{index}]: {pieces} pieces of fewer than {LEAST_PIECE_VOXELS} voxels are left out, {voxels} voxels, \
                 the smallest of {smallest}: voxels of {voxel_mm:.3} mm do not join its thin parts"
            ));
        }
    }

    fn supports(&mut self, index: usize, object: &ObjectDesc, scene: &Scene, grid: &Grid) {
        let mut all = 0;
        for (i, shape) in object.fixed.iter().enumerate() {
            match region_voxels(grid, shape, &scene.meshes) {
                Ok(held) if held.is_empty() => {
                    self.warnings.push(format!("objects[{index}].fixed[{i}]: holds no voxel"));
                }
                Ok(held) => all += held.len(),
                Err(problem) => self.problems.push(problem.within(&format!("objects[{index}].fixed[{i}]"))),
            }
        }
        self.lines.push(format!("  fixed: {all} voxels"));
        if all == 0 && scene.desc.gravity_m_per_s2 != [0.0; 3] {
            self.warnings.push(format!("objects[{index}]: nothing holds it, so it falls without end"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn builtin_scenes_have_neither_problems_nor_warnings() {
        for name in catalog::builtin_names() {
            let scene = catalog::builtin(name).unwrap();
            let report = examine(&scene);
            assert!(report.problems.is_empty() && report.warnings.is_empty(), "{name}: {report:?}");
            let tells_toughness = report.lines.iter().any(|line| line.contains("Gc/(E H)"));
            assert_eq!(tells_toughness, !scene.desc.tools.is_empty(), "{name}");
        }
    }

    #[test]
    fn a_material_that_relaxes_is_told_with_both_moduli() {
        let mut scene = catalog::builtin("jelly").unwrap();
        let material = &mut scene.desc.objects[0].material;
        let young = material.young_modulus_pa;
        material.viscosity =
            Some(kerf_physics::scene::ViscosityDesc { relaxation_time_s: 0.3, relaxing_modulus_ratio: 0.5 });
        let lines = examine(&scene).lines.join("\n");
        let expected = format!("E {young:.3e} Pa, from {:.3e} Pa at once in 0.3 s", 1.5 * young);
        assert!(lines.contains(&expected), "{lines}");
    }

    #[test]
    fn small_pieces_that_are_left_out_are_warned_of() {
        use kerf_physics::World;
        use kerf_physics::scene::{ShapeDesc, TriangleMesh};
        // A block and, off it, two cubes of one voxel and of two.
        let corner = |x: f64, size: [f64; 3], c: usize| {
            std::array::from_fn(|a| if a == 0 { x } else { 0.0 } + size[a] * (c >> a & 1) as f64)
        };
        let bar = |x, size| (0..8).map(move |c| corner(x, size, c));
        let faces = [
            [0, 2, 1],
            [1, 2, 3],
            [4, 5, 6],
            [5, 7, 6],
            [0, 1, 4],
            [1, 5, 4],
            [2, 6, 3],
            [3, 6, 7],
            [0, 4, 2],
            [2, 4, 6],
            [1, 3, 5],
            [3, 7, 5],
        ];
        let mut mesh = TriangleMesh::default();
        for bar in [bar(0.0, [0.04, 0.03, 0.03]), bar(0.06, [0.01, 0.01, 0.01]), bar(0.09, [0.02, 0.01, 0.01])] {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(bar);
            mesh.triangles.extend(faces.map(|face| face.map(|v: u32| v + first)));
        }
        let mut scene = catalog::builtin("jelly").unwrap();
        let object = &mut scene.desc.objects[0];
        object.shape = ShapeDesc::Mesh { file: "bars".into(), scale_m_per_unit: 1.0, offset_m: [0.0; 3] };
        (object.voxel_size_m, object.resolution) = (Some(0.01), None);
        scene.meshes.insert("bars".into(), mesh);
        scene.desc.tracked_points.clear();
        let warnings = examine(&scene).warnings.join("\n");
        assert!(
            warnings.contains("2 pieces of fewer than 8 voxels are left out, 3 voxels, the smallest of 1:"),
            "{warnings}"
        );
        let mut world = World::new(&scene).unwrap();
        let stats = world.object_stats()[0];
        assert_eq!((stats.left_out.pieces, stats.left_out.voxels, stats.voxels), (2, 3, 36));
        assert_eq!(world.counts().parts, 1);
        // What is small as a whole is meant.
        scene.meshes.get_mut("bars").unwrap().triangles.drain(..12);
        let stats = World::new(&scene).unwrap().object_stats()[0];
        assert_eq!((stats.left_out.pieces, stats.voxels), (0, 3));
    }

    #[test]
    fn what_holds_nothing_is_warned_of() {
        let mut scene = catalog::builtin("jelly").unwrap();
        scene.desc.objects[0].fixed[0] =
            kerf_physics::scene::ShapeDesc::Sphere { center_m: [9.0, 9.0, 9.0], radius_m: 0.01 };
        scene.desc.tracked_points[0].position_m = [1.0, 0.0, 0.0];
        let warnings = examine(&scene).warnings.join("\n");
        for expected in ["fixed[0]: holds no voxel", "falls without end", "tracked_points[0]"] {
            assert!(warnings.contains(expected), "{warnings}");
        }
    }
}

//! What is to be said of a scene before it runs. Whoever runs scenes asks here, so that all refuse and warn alike.

use kerf_physics::making::Making;
use kerf_physics::scene::toughness::{carries, composite_edge_m};
use kerf_physics::scene::{LoadDesc, ObjectDesc, PlacedMesh, ShapeDesc, Strays};
use kerf_physics::surface::Surface;
use kerf_physics::{
    Grid, LEAST_PIECE_VOXELS, LeftOut, MOST_CONTRAST, Missed, MissedPart, Scene, SceneError, SceneProblems, SoundScene,
    Thickness, VoxelId, World, region_voxels,
};

use crate::mesh_faults::mesh_faults;

/// A part that voxels miss is worth a word where it is longer than so many of them: tips and edges are not.
const LEAST_MISSED_VOXELS: f64 = 3.0;
/// Share of a shape's volume by which its surface may be off without a word.
const MOST_VOLUME_ERROR: f64 = 0.05;

/// A scene that can run.
pub struct Examined {
    /// At rest.
    pub world: World,
    /// See [`warnings`].
    pub warnings: Vec<SceneError>,
}

/// Builds a scene, tells how far it is, and says what it hardly means.
///
/// # Errors
/// Those of [`World::new`].
pub fn examine(scene: &SoundScene, tell: &mut dyn FnMut(Making)) -> Result<Examined, SceneProblems> {
    let world = World::make(scene, tell)?;
    Ok(Examined { warnings: warnings(scene, &world), world })
}

/// What a scene can run with but hardly means; `world` is built of it.
#[must_use]
pub fn warnings(scene: &Scene, world: &World) -> Vec<SceneError> {
    let mut warnings = Vec::new();
    let bodies = world.bodies();
    let grids: Vec<&Grid> = bodies.iter().map(|body| body.grid()).collect();
    for (index, object) in scene.desc.objects.iter().enumerate() {
        let mut remarks = Remarks { scene, object, grid: grids[index], field: format!("objects[{index}]"), warnings };
        remarks.meshes();
        remarks.regions();
        remarks.contrast();
        remarks.supports();
        remarks.thin_parts();
        remarks.missed();
        remarks.loads();
        remarks.left_out();
        warnings = remarks.warnings;
        for (earlier, grid) in grids[..index].iter().enumerate() {
            let within = overlap(grids[index], grid).max(overlap(grid, grids[index]));
            if within > 0 {
                let message = format!(
                    "{within} voxels lie within `{}` at the start; what overlaps then never pushes itself apart: move \
                     them apart, a gap of a tenth of a voxel will do",
                    scene.desc.objects[earlier].name
                );
                warnings.push(SceneError::Field { field: format!("objects[{index}].shape"), message });
            }
        }
    }
    warnings
}

/// Voxels of a grid whose centre lies in a voxel of another.
fn overlap(grid: &Grid, other: &Grid) -> usize {
    let centres = grid.voxels().iter().map(|voxel| grid.centre_m(voxel.ijk));
    centres.filter(|centre_m| other.voxel_at(other.cell_of(centre_m)).is_some()).count()
}

/// What is collected of one object.
struct Remarks<'a> {
    scene: &'a Scene,
    object: &'a ObjectDesc,
    grid: &'a Grid,
    /// The object's.
    field: String,
    warnings: Vec<SceneError>,
}

impl Remarks<'_> {
    fn warn(&mut self, field: &str, message: impl Into<String>) {
        self.warnings.push(SceneError::Field { field: format!("{}{field}", self.field), message: message.into() });
    }

    /// The voxels that a shape holds. One that cannot be told has been refused when the world was built.
    fn held(&self, shape: &ShapeDesc) -> Vec<VoxelId> {
        region_voxels(self.grid, shape, &self.scene.meshes).unwrap_or_default()
    }

    fn meshes(&mut self) {
        let mut named: Vec<String> = Vec::new();
        for shape in self.object.shapes() {
            let (ShapeDesc::Mesh { file, .. } | ShapeDesc::LabelMap { file, .. }) = shape else { continue };
            let Some(PlacedMesh { key, .. }) = shape.mesh().filter(|mesh| !named.contains(&mesh.key)) else { continue };
            let Some(mesh) = self.scene.meshes.get(&key) else { continue };
            self.strays(file, mesh.strays);
            // The surface of labels is closed.
            if let ShapeDesc::Mesh { .. } = shape {
                mesh_faults(mesh).into_iter().for_each(|fault| self.warn("", format!("{file}: {fault}")));
            }
            named.push(key);
        }
    }

    fn strays(&mut self, file: &str, Strays { pieces, voxels }: Strays) {
        if pieces > 0 {
            let message = format!(
                "{file}: {pieces} of the labels' pieces are left out, {voxels} of the file's voxels: each has less than a \
                 thousandth of the largest piece's voxels"
            );
            self.warn("", message);
        }
    }

    fn regions(&mut self) {
        for (i, region) in self.object.regions.iter().enumerate() {
            if !self.grid.voxels().iter().any(|voxel| usize::from(voxel.material) == i + 1) {
                let message =
                    format!("`{}` holds no voxel: its shape is elsewhere, or a later region covers it", region.name);
                self.warn(&format!(".regions[{i}]"), message);
            }
        }
        for (i, finer) in self.object.finer.iter().enumerate() {
            if self.held(&finer.shape).is_empty() {
                self.warn(&format!(".finer[{i}]"), "holds no voxel: its shape is elsewhere");
            }
        }
    }

    /// Materials that count as softer than they are where they share elements with others.
    fn contrast(&mut self) {
        let ObjectDesc { level: 1.., .. } = *self.object else { return };
        let regions = self.object.regions.iter().enumerate();
        let young_pa: Vec<(String, f64)> = std::iter::once((String::new(), self.object.material.young_modulus_pa))
            .chain(regions.map(|(i, region)| (format!(".regions[{i}]"), region.material.young_modulus_pa)))
            .collect();
        let softest_pa = young_pa.iter().map(|(_, young_pa)| *young_pa).fold(f64::INFINITY, f64::min);
        for (field, stiff_pa) in young_pa.into_iter().filter(|(_, young_pa)| *young_pa > MOST_CONTRAST * softest_pa) {
            let message = format!(
                "{:.0} times as stiff as another material of the object; in elements that hold both it counts as {MOST_CONTRAST} \
                 times as stiff; level = 0 has it as it is",
                stiff_pa / softest_pa
            );
            self.warn(&format!("{field}.material.young_modulus_pa"), message);
        }
    }

    /// Limbs, necks and sheets with less than an element and a half across.
    fn thin_parts(&mut self) {
        let ObjectDesc { level: level @ 1.., min_elements_across: None, .. } = *self.object else { return };
        let size_m = self.grid.voxel_size_m();
        if !carries(self.object, size_m, level - 1) {
            return;
        }
        let edge_m = composite_edge_m(size_m, level);
        let thin = Thickness::of(self.grid).thinner_than(1.5 * edge_m);
        let count = thin.iter().filter(|is_thin| **is_thin).count();
        if count * 20 > thin.len() {
            let message = format!(
                "{} % of the voxels lie where the object is thinner than one and a half elements of 2^{level} voxels \
                 ({} mm each), which bend a sixth too little and less; state min_elements_across = 2.5, or a lower level",
                100 * count / thin.len(),
                1e3 * edge_m
            );
            self.warn(".level", message);
        }
    }

    /// Parts of the shape between the voxels' centres, and a surface that encloses too little or too much.
    fn missed(&mut self) {
        let Self { object, scene, grid, .. } = *self;
        let voxel_m = grid.voxel_size_m();
        let field = if object.resolution.is_some() { ".resolution" } else { ".voxel_size_m" };
        // What cannot be told has been refused when the world was built.
        let Ok(Missed { largest_part, shape_volume_m3 }) = Missed::of(grid, &object.shape, &scene.meshes) else {
            return;
        };
        if let Some(MissedPart { bounds, thickness_m }) = largest_part
            && bounds.extent_m().max() > LEAST_MISSED_VOXELS * voxel_m
        {
            let [low, high] = [bounds.min_m, bounds.max_m].map(|p| format!("({:.4}, {:.4}, {:.4})", p.x, p.y, p.z));
            let message = format!(
                "a part of the shape, {:.2} mm thick, from {low} to {high} m, lies between the centres of the voxels of \
                 {:.2} mm and is missing; voxels of {:.2} mm would have it",
                1e3 * thickness_m,
                1e3 * voxel_m,
                1e3 * thickness_m / 2.0,
            );
            self.warn(field, message);
        }
        let surface_m3 = Surface::build(grid).volume_m3();
        let mesh = object.shape.mesh().and_then(|mesh| scene.meshes.get(&mesh.key));
        let is_faulty = || mesh.is_some_and(|mesh| !mesh_faults(mesh).is_empty());
        let excess = surface_m3 / shape_volume_m3 - 1.0;
        if excess.abs() > MOST_VOLUME_ERROR && !is_faulty() {
            let message = format!(
                "the surface of the voxels of {:.2} mm encloses {:.2} cm3, the shape {:.2} cm3, so {:.0} % {}: walls and tips \
                 are thin for such voxels; take smaller ones",
                1e3 * voxel_m,
                1e6 * surface_m3,
                1e6 * shape_volume_m3,
                100.0 * excess.abs(),
                if excess < 0.0 { "less" } else { "more" },
            );
            self.warn(field, message);
        }
    }

    fn supports(&mut self) {
        let mut is_held = false;
        for (i, shape) in self.object.fixed.iter().enumerate() {
            let voxels = self.held(shape);
            is_held |= !voxels.is_empty();
            if voxels.is_empty() {
                self.warn(&format!(".fixed[{i}]"), "holds no voxel: its shape is elsewhere");
            }
        }
        if !is_held {
            let moves = match self.scene.desc.gravity_m_per_s2 {
                [0.0, 0.0, 0.0] => "it drifts off when it is touched",
                _ => "it falls without end unless another object catches it",
            };
            self.warn(
                "",
                format!("nothing holds `{}`, so {moves}; say with `fixed` what stands still", self.object.name),
            );
        }
    }

    fn loads(&mut self) {
        for (i, load) in self.object.loads.iter().enumerate() {
            let (kind, what, is_empty) = match load {
                LoadDesc::BodyForce { region, .. } => ("body_force", "voxel", self.held(region).is_empty()),
                LoadDesc::Traction { region, face, .. } => {
                    let (axis, step) = face.axis_and_step();
                    let is_outer = |voxel: &VoxelId| {
                        let mut beyond = self.grid.voxels()[voxel.index()].ijk;
                        beyond[axis] += step;
                        self.grid.voxel_at(beyond).is_none()
                    };
                    ("traction", "such face of a voxel", !self.held(region).iter().any(is_outer))
                }
            };
            if is_empty {
                self.warn(
                    &format!(".loads[{i}].{kind}"),
                    format!("holds no {what}, so it loads nothing: its region is elsewhere"),
                );
            }
        }
    }

    fn left_out(&mut self) {
        let LeftOut { pieces, voxels, smallest } = self.grid.left_out();
        if pieces > 0 {
            let voxel_mm = self.grid.voxel_size_m() * 1e3;
            self.warn(
                "",
                format!(
                    "{pieces} pieces of fewer than {LEAST_PIECE_VOXELS} voxels are left out, {voxels} voxels, the smallest \
                     of {smallest}: voxels of {voxel_mm:.3} mm do not join its thin parts; take smaller ones"
                ),
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use kerf_physics::scene::{Face, RegionDesc, TriangleMesh};

    use super::*;
    use crate::catalog;

    fn told(scene: &Scene) -> Vec<String> {
        let sound = scene.clone().judge().unwrap();
        let examined = examine(&sound, &mut |_| ()).unwrap_or_else(|problems| panic!("{problems:?}"));
        examined.warnings.iter().map(ToString::to_string).collect()
    }

    fn nowhere() -> ShapeDesc {
        ShapeDesc::Sphere { center_m: [9.0; 3], radius_m: 0.01 }
    }

    #[test]
    fn builtin_scenes_have_neither_problems_nor_warnings() {
        for name in catalog::builtin_names() {
            assert_eq!(told(&catalog::builtin(name).unwrap()), [""; 0], "{name}");
        }
    }

    #[test]
    fn parts_that_are_thin_for_their_level_are_warned_of() {
        let mut scene = catalog::builtin("liver").unwrap().into_scene();
        scene.desc.objects[0].level = 4;
        let [told_of] = &told(&scene)[..] else { panic!("one warning") };
        assert!(told_of.starts_with("objects[0].level: ") && told_of.contains("min_elements_across"), "{told_of}");
        scene.desc.objects[0].min_elements_across = Some(2.0);
        assert_eq!(told(&scene), [""; 0]);
    }

    #[test]
    fn walls_and_fins_that_are_thin_for_their_voxels_are_told_with_place_and_size() {
        let told_of = |shape: &str| {
            let mut scene = catalog::builtin("cuboid").unwrap().into_scene();
            let object = &mut scene.desc.objects[0];
            object.shape = toml::from_str::<std::collections::BTreeMap<String, ShapeDesc>>(&format!("shape = {shape}"))
                .unwrap()
                .remove("shape")
                .unwrap();
            (object.voxel_size_m, object.resolution, object.level) = (Some(0.002), None, 0);
            object.material.fracture_energy_j_per_m2 = Some(100.0);
            object.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [-0.02, 1.0, 1.0] }];
            scene.desc.tracked_points.clear();
            told(&scene)
        };
        let hose = |wall_m: f64| {
            let rod = |radius_m: f64| {
                format!(
                    "{{ capsule = {{ from_m = [-0.03, 0.0, 0.0], to_m = [0.03, 0.003, 0.007], radius_m = {radius_m} }} }}"
                )
            };
            format!(
                "{{ smooth_union = {{ blend_m = 0.0, parts = [{}], without = [{}] }} }}",
                rod(0.02),
                rod(0.02 - wall_m)
            )
        };
        let [volume] = &told_of(&hose(0.002))[..] else { panic!("one warning") };
        assert!(
            volume.starts_with("objects[0].voxel_size_m: the surface of the voxels of 2.00 mm encloses "),
            "{volume}"
        );
        assert!(volume.contains(" % less: walls and tips are thin"), "{volume}");
        assert_eq!(told_of(&hose(0.006)), [""; 0]);
        let fin = |half_m: f64| {
            format!(
                "{{ smooth_union = {{ blend_m = 0.0, parts = [
                   {{ box = {{ min_m = [-0.03, -0.02, -0.02], max_m = [0.01, 0.02, 0.02] }} }},
                   {{ box = {{ min_m = [0.01, -0.02, -{half_m}], max_m = [0.03, 0.02, {half_m}] }} }}] }} }}"
            )
        };
        let told = told_of(&fin(0.000_7));
        let starts = "objects[0].voxel_size_m: a part of the shape, 1.33 mm thick, from (0.0120, -0.0200, -0.0007) to (0.0300, 0.0200, 0.0007) m, ";
        assert!(told[0].starts_with(starts) && told[0].ends_with("voxels of 0.67 mm would have it"), "{told:?}");
        assert_eq!(told_of(&fin(0.003)), [""; 0]);
    }

    #[test]
    fn what_holds_nothing_and_loads_that_select_nothing_are_warned_of() {
        let mut scene = catalog::builtin("jelly").unwrap().into_scene();
        let object = &mut scene.desc.objects[0];
        object.fixed[0] = nowhere();
        let traction = |region| LoadDesc::Traction { region, face: Face::MaxX, traction_pa: [1.0, 0.0, 0.0] };
        // Within the dome, where no voxel's upper face is outside.
        let inside = ShapeDesc::Sphere { center_m: [0.0, 0.02, 0.0], radius_m: 0.01 };
        let everywhere = ShapeDesc::Sphere { center_m: [0.0; 3], radius_m: 1.0 };
        object.loads = vec![
            traction(inside),
            traction(everywhere),
            LoadDesc::BodyForce { region: nowhere(), force_n_per_m3: [0.0; 3] },
        ];
        let told = told(&scene);
        let starts = [
            "objects[0].fixed[0]: holds no voxel",
            "objects[0]: nothing holds `jelly`, so it falls without end",
            "objects[0].loads[0].traction: holds no such face of a voxel",
            "objects[0].loads[2].body_force: holds no voxel",
        ];
        assert_eq!(told.len(), starts.len(), "{told:?}");
        assert!(told.iter().zip(starts).all(|(told, start)| told.starts_with(start)), "{told:?}");
    }

    #[test]
    fn materials_that_are_too_stiff_to_share_elements_are_warned_of_where_they_may() {
        let mut scene = catalog::builtin("jelly").unwrap().into_scene();
        let object = &mut scene.desc.objects[0];
        let mut bone = object.material.clone();
        bone.young_modulus_pa = 2e3 * object.material.young_modulus_pa;
        let shape = ShapeDesc::Sphere { center_m: [0.0, 0.02, 0.0], radius_m: 0.01 };
        object.regions.push(RegionDesc { name: "bone".into(), shape, material: bone });
        let told_of =
            |scene: &Scene| told(scene).into_iter().filter(|told| told.contains("regions[0]")).collect::<Vec<_>>();
        let starts = "objects[0].regions[0].material.young_modulus_pa: 2000 times as stiff";
        assert!(told_of(&scene)[0].starts_with(starts), "{:?}", told_of(&scene));
        scene.desc.objects[0].regions[0].material.young_modulus_pa /= 2.1;
        assert_eq!(told_of(&scene), [""; 0]);
        let object = &mut scene.desc.objects[0];
        (object.regions[0].material.young_modulus_pa, object.level) = (1e9, 0);
        assert_eq!(told_of(&scene), [""; 0], "no voxel shares an element");
    }

    #[test]
    fn objects_that_start_overlapped_are_warned_of() {
        let mut scene = catalog::builtin("two-organs").unwrap().into_scene();
        let ShapeDesc::Ellipsoid { center_m, .. } = &mut scene.desc.objects[0].shape else { panic!("an ellipsoid") };
        center_m[1] -= 0.01;
        scene.desc.tracked_points.clear();
        let told = told(&scene);
        assert!(told.len() == 1 && told[0].starts_with("objects[1].shape: "), "{told:?}");
        assert!(told[0].contains("lie within `lobe` at the start"), "{told:?}");
    }

    #[test]
    fn faults_of_a_mesh_are_warned_of_with_its_file() {
        let mut scene = catalog::builtin("jelly").unwrap().into_scene();
        let object = &mut scene.desc.objects[0];
        object.shape = ShapeDesc::Mesh { file: "tetrahedron.obj".into(), scale_m_per_unit: 1.0, offset_m: [0.0; 3] };
        scene.desc.tracked_points.clear();
        let positions = vec![[-0.04, 0.0, -0.04], [0.08, 0.0, -0.04], [-0.04, 0.0, 0.08], [-0.04, 0.09, -0.04]];
        let triangles = vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 2, 3]];
        scene.meshes.insert("tetrahedron.obj".into(), TriangleMesh { positions, triangles, ..TriangleMesh::default() });
        let told = told(&scene);
        let [fault, thin_corners] = &told[..] else { panic!("{told:?}") };
        assert!(fault.contains("tetrahedron.obj: the mesh is wound inconsistently"), "{fault}");
        assert!(thin_corners.contains("min_elements_across"), "{thin_corners}");
    }

    #[test]
    fn what_a_world_cannot_be_built_of_is_a_problem() {
        let mut scene = catalog::builtin("jelly").unwrap().into_scene();
        scene.desc.tracked_points[0].position_m = [1.0, 0.0, 0.0];
        let problems = examine(&scene.judge().unwrap(), &mut |_| ()).err().expect("it is refused");
        assert!(problems.to_string().contains("the nearest voxel's centre is"), "{problems:?}");
    }

    #[test]
    fn small_pieces_that_are_left_out_are_warned_of() {
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
        let mut scene = catalog::builtin("jelly").unwrap().into_scene();
        let object = &mut scene.desc.objects[0];
        object.shape = ShapeDesc::Mesh { file: "bars".into(), scale_m_per_unit: 1.0, offset_m: [0.0; 3] };
        (object.voxel_size_m, object.resolution) = (Some(0.01), None);
        scene.meshes.insert("bars".into(), mesh);
        scene.desc.tracked_points.clear();
        let warnings = told(&scene).join("\n");
        assert!(
            warnings.contains("2 pieces of fewer than 8 voxels are left out, 3 voxels, the smallest of 1:"),
            "{warnings}"
        );
        let mut world = World::new(&scene.clone().judge().unwrap()).unwrap();
        let stats = world.object_stats()[0];
        assert_eq!((stats.left_out.pieces, stats.left_out.voxels, stats.voxels), (2, 3, 36));
        assert_eq!(world.counts().parts, 1);
        // What is small as a whole is meant.
        scene.meshes.get_mut("bars").unwrap().triangles.drain(..12);
        let stats = World::new(&scene.judge().unwrap()).unwrap().object_stats()[0];
        assert_eq!((stats.left_out.pieces, stats.voxels), (0, 3));
    }
}

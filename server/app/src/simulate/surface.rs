//! The surface of a world as it is now, for a file.

use kerf_physics::scene::{Color, ObjectDesc, SceneDesc};
use kerf_physics::surface::{Surface, SurfaceVertex, VertexId, triangulate};
use kerf_physics::{Body, Grid, Link, MaterialPoint, World};
use kerf_replica::glb::Object;
use kerf_replica::{Face, Triangle};

/// Every object with its deformed surface.
pub fn of(scene: &SceneDesc, world: &mut World) -> Vec<Object> {
    let deformed = |((body, surface), desc): ((&Body, &Surface), &ObjectDesc)| Object {
        name: desc.name.clone(),
        regions: desc.regions.iter().map(|region| region.name.clone()).collect(),
        colours: desc.materials().map(|material| material.color.map(Color::srgb)).collect(),
        surface: triangles(body.grid(), surface, |_, vertex| {
            let position_m = vertex.position_m.map(f64::from).into();
            body.current_m(&MaterialPoint { position_m, voxel: vertex.voxel }).map(|c| c as f32).into()
        }),
    };
    world.bodies_and_surfaces().zip(&scene.objects).map(deformed).collect()
}

/// One object's surface, each vertex where `position_m` puts it.
pub fn triangles(
    grid: &Grid,
    surface: &Surface,
    mut position_m: impl FnMut(VertexId, &SurfaceVertex) -> [f32; 3],
) -> kerf_replica::Surface {
    let ids: Vec<VertexId> = surface.vertices().map(|(id, _)| id).collect();
    let index = |id: VertexId| ids.binary_search(&id).expect("a quad's vertices exist") as u32;
    let mut out = kerf_replica::Surface {
        positions_m: surface.vertices().map(|(id, vertex)| position_m(id, vertex)).collect(),
        triangles: Vec::with_capacity(2 * surface.quads().len()),
    };
    for (id, quad) in surface.quads() {
        let link = surface.link_of(id);
        let beside = surface.vertex(quad[0]).expect("a quad's vertices exist").voxel;
        let (face, voxel) = match grid.link(link) {
            Link::Parted(_) => (Face::Cut, beside),
            _ => (Face::Skin, grid.voxel_at(link.cell).or(grid.voxel_at(link.upper())).unwrap_or(beside)),
        };
        let region = grid.voxels()[voxel.index()].material;
        let split = triangulate(quad.map(index));
        out.triangles.extend(split.map(|vertices| Triangle { vertices, face, region }));
    }
    out
}

//! A scene: its description and the meshes that it refers to.

pub use kerf_description::*;

/// A scene with everything it refers to, whatever its values: [`Scene::judge`] says whether a world can be made of it.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The description.
    pub desc: SceneDesc,
    /// Triangle meshes by the `file` their shape names.
    pub meshes: Meshes,
}

/// An object of this shape, of voxels of a metre.
#[cfg(test)]
pub(crate) fn object_of(shape: &str) -> ObjectDesc {
    let text = format!(
        "version = 1\nname = 's'\n[[objects]]\nname = 'o'\nvoxel_size_m = 1.0\nshape = {shape}\n[objects.material]\n\
         young_modulus_pa = 1e4\npoisson_ratio = 0.4\ndensity_kg_per_m3 = 1e3"
    );
    SceneDesc::from_toml("shape.toml", &text).unwrap().objects.remove(0)
}

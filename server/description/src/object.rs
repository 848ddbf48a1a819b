//! A soft body: its shape, how finely it is divided, its materials and what acts on it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{LoadDesc, MaterialDesc, ShapeDesc};

/// A soft body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObjectDesc {
    /// Name, unique among the objects.
    pub name: String,
    /// Its shape at rest.
    pub shape: ShapeDesc,
    /// Edge length of a fine voxel, m. Exactly one of this and `resolution` is given.
    #[serde(default)]
    pub voxel_size_m: Option<f64>,
    /// Voxels along the longest edge of the shape's bounding box (of a union: of the box that holds
    /// its parts' boxes).
    #[serde(default)]
    pub resolution: Option<u32>,
    /// Composite elements are grouped from 2^level voxels a side, 0 to 4; 0 is full FEM. Default 2.
    #[serde(default = "default_level")]
    pub level: u8,
    /// How an element's stiffness follows from its voxels. Default `by_content`.
    #[serde(default)]
    pub element: ElementKind,
    /// The criterion by which a blade cuts it. Default `front`.
    #[serde(default)]
    pub fracture_rule: FractureRule,
    /// Regions of a lower level: around a lesion, along a planned cut. Elements that touch differ by at
    /// most one level, so the elements around a region grow step by step. Default: none.
    #[serde(default)]
    pub finer: Vec<FinerDesc>,
    /// Elements across the thinnest limb, neck or sheet, 1 to 8. Where the object is thinner than so many elements of
    /// its level, they are smaller, but never so small that they would fold under a blade. 2 or 3 are worth their cost.
    /// Default: the level holds everywhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_elements_across: Option<f64>,
    /// Material where no region says otherwise.
    pub material: MaterialDesc,
    /// Shapes within which another material holds; where they overlap the last one wins.
    /// Default: none.
    #[serde(default)]
    pub regions: Vec<RegionDesc>,
    /// Voxels whose centre lies in one of these shapes are fixed. Default: none.
    #[serde(default)]
    pub fixed: Vec<ShapeDesc>,
    /// Loads other than gravity. Default: none.
    #[serde(default)]
    pub loads: Vec<LoadDesc>,
}

impl ObjectDesc {
    /// Its material and those of its regions, in that order.
    pub fn materials(&self) -> impl Iterator<Item = &MaterialDesc> {
        std::iter::once(&self.material).chain(self.regions.iter().map(|region| &region.material))
    }

    /// Every shape that the object names: its own, its regions', its finer and fixed ones, its loads'.
    pub fn shapes(&self) -> impl Iterator<Item = &ShapeDesc> {
        let loads = self.loads.iter().map(|load| match load {
            LoadDesc::Traction { region, .. } | LoadDesc::BodyForce { region, .. } => region,
        });
        let finer = self.finer.iter().map(|f| &f.shape);
        let regions = self.regions.iter().map(|r| &r.shape);
        std::iter::once(&self.shape).chain(regions).chain(finer).chain(&self.fixed).chain(loads)
    }
}

/// How a composite element's stiffness follows from its voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ElementKind {
    /// `incompatible_modes`, or `homogenised` where layers or inclusions are smaller than the element: in whole
    /// cells whose voxels differ tenfold or more in shear modulus. In these the element would also be stiffer than
    /// its voxels by half or more, under some uniform strain. Default.
    #[default]
    ByContent,
    /// Trilinear displacement alone. Locks towards incompressibility; to compare with.
    Galerkin,
    /// Nine incompatible modes, the volumetric part integrated at the voxels' centres.
    IncompatibleModes,
    /// The same element made of one material, in whole cells of more than one: the periodic homogenisation
    /// of the cell's voxels. Each pattern of materials costs a solve over the voxels at set-up, milliseconds
    /// at level 2, a second or two at level 4.
    Homogenised,
}

impl ElementKind {
    /// The name that a scene file has for it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::ByContent => "by_content",
            Self::Galerkin => "galerkin",
            Self::IncompatibleModes => "incompatible_modes",
            Self::Homogenised => "homogenised",
        }
    }
}

/// The criterion by which a blade cuts an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FractureRule {
    /// The front along the edge advances at a force of Gc per length, Griffith's balance of a sharp edge, whatever
    /// the mesh. Default.
    #[default]
    Front,
    /// A link ahead of the edge is cut where its elastic energy per area reaches Gc: the rule of He et al. (2022), its
    /// units mended. The force of the cut depends on the voxels and the level; to compare with.
    /// `initiation_ratio` has no part in it, and a material with a `rate` is refused.
    LinkEnergy,
}

/// Level of an object that states none.
#[must_use]
pub fn default_level() -> u8 {
    2
}

/// A shape within which the elements are smaller than elsewhere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FinerDesc {
    /// Where: every element with a voxel whose centre lies in it.
    pub shape: ShapeDesc,
    /// Level there, below the object's. Where regions overlap the lowest holds.
    pub level: u8,
}

/// A shape within which another material holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RegionDesc {
    /// Name, unique among the object's regions.
    pub name: String,
    /// Where it holds.
    pub shape: ShapeDesc,
    /// The material within the shape.
    pub material: MaterialDesc,
}

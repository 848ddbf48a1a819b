//! The description of a scene: one TOML file, version 1.
//!
//! Data and defaults stand here; [`SceneDesc::from_toml`] reads a file, [`SceneDesc::problems`] says
//! what is wrong with its values, [`toughness`] what a material asks of its elements.

mod edge;
mod loads;
mod parse;
pub mod toughness;
mod validate;

pub use edge::{EdgeDesc, MAX_EDGE_POINTS};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Version of the scene format that this crate reads.
pub const SCENE_VERSION: u32 = 1;

/// Triangle meshes by the `file` their shape names, or by the key of [`ShapeDesc::mesh`].
pub type Meshes = std::collections::BTreeMap<String, TriangleMesh>;

/// A scene with everything it refers to: what [`crate::World::new`] is built from.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The validated description.
    pub desc: SceneDesc,
    /// Triangle meshes by the `file` their shape names.
    pub meshes: Meshes,
}

/// A triangle mesh as read from a file, before scaling.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertex positions in the file's units.
    pub positions: Vec<[f64; 3]>,
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// What is wrong with a scene.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum SceneError {
    /// The text is not the TOML of a scene.
    #[error("{file}:{line}:{column}: {field}: {message}")]
    Parse {
        /// The file's name as given.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
        /// Path of the field, as `objects[0].material`; `syntax` where the text is not TOML.
        field: String,
        /// What was found and what was expected.
        message: String,
    },
    /// A field has a value that is not supported.
    #[error("{field}: {message}")]
    Field {
        /// Path of the field, as `objects[0].material.poisson_ratio`.
        field: String,
        /// The value, the limit and the reason.
        message: String,
    },
}

impl SceneError {
    /// The same problem with its field taken to lie within `owner`.
    #[must_use]
    pub fn within(self, owner: &str) -> Self {
        match self {
            Self::Field { field, message } => Self::Field { field: format!("{owner}.{field}"), message },
            parse @ Self::Parse { .. } => parse,
        }
    }
}

/// A scene. Every number is in SI units, named in the field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneDesc {
    /// Version of the format: 1.
    pub version: u32,
    /// Short name.
    pub name: String,
    /// One sentence for people. Default: empty.
    #[serde(default)]
    pub description: String,
    /// Steps per simulated second, Hz, 10 to 10,000. Default 1000: the rate at which hands are served.
    #[serde(default = "default_rate_hz")]
    pub rate_hz: f64,
    /// Gravity, m/s^2, scene frame. Default: none.
    #[serde(default)]
    pub gravity_m_per_s2: [f64; 3],
    /// The velocity solver. Default: see [`SolverDesc`].
    #[serde(default)]
    pub solver: SolverDesc,
    /// Asks for a setting of the dial by what it is to cost or to err, instead of stating one. It is
    /// settled before a world is built. Default: the scene is taken as it is.
    #[serde(default)]
    pub dial: Option<DialDesc>,
    /// How far the solver's effort may be reduced while a session misses its deadlines. Default: not
    /// at all.
    #[serde(default)]
    pub governor: Option<GovernorDesc>,
    /// The soft bodies; at least one.
    pub objects: Vec<ObjectDesc>,
    /// The tools that may enter the scene. Default: none.
    #[serde(default)]
    pub tools: Vec<ToolDesc>,
    /// Points whose displacement is reported. Default: none.
    #[serde(default)]
    pub tracked_points: Vec<TrackedPointDesc>,
}

impl SceneDesc {
    /// A scene of these objects with every default, as a file that states nothing else makes it.
    #[must_use]
    pub fn of(name: &str, objects: Vec<ObjectDesc>) -> Self {
        Self {
            version: SCENE_VERSION,
            name: name.into(),
            description: String::new(),
            rate_hz: default_rate_hz(),
            gravity_m_per_s2: [0.0; 3],
            solver: SolverDesc::default(),
            dial: None,
            governor: None,
            objects,
            tools: Vec::new(),
            tracked_points: Vec::new(),
        }
    }

    /// Relative tolerance of the velocity solve: the stated one, or that of the rate.
    #[must_use]
    pub fn relative_tolerance(&self) -> f64 {
        let longer = 1000.0 / self.rate_hz;
        // Roots are rounded alike on every machine, powers are not.
        let by_rate = || (1e-3 * (longer * longer.sqrt()).sqrt()).clamp(1e-3, 1e-2);
        self.solver.relative_tolerance.unwrap_or_else(by_rate)
    }
}

fn default_rate_hz() -> f64 {
    1000.0
}

/// The velocity solver of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SolverDesc {
    /// Unbalanced force at which a solve ends, relative to the loads and contact forces. Default: by the rate,
    /// `1e-3 (1000 Hz / rate_hz)^(3/4)`, from 1e-3 to 1e-2. The force on a tool is then off by less than 1e-3 of its
    /// maximum: rms over a stroke through the liver at 60 to 1000 Hz, against a tolerance of 1e-6. Short steps need
    /// the lower tolerance: their errors add up over more of them.
    pub relative_tolerance: Option<f64>,
    /// Iterations after which a solve ends whatever its residual. Default 200: some twenty times
    /// what a warm-started solve takes.
    pub max_iterations: u32,
}

impl Default for SolverDesc {
    fn default() -> Self {
        Self { relative_tolerance: None, max_iterations: 200 }
    }
}

/// A wish for a setting of the dial.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DialDesc {
    /// This level for every object, 0 to 4.
    Level(u8),
    /// The most exact setting whose steps take at most this long in the median, ms.
    BudgetMs(f64),
    /// The cheapest setting that errs by at most this, relative to the reference solution.
    MaxError(f64),
}

/// Bounds of what is given up while a session misses its deadlines.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GovernorDesc {
    /// Largest relative tolerance of the velocity solve, from the solver's own to 0.5.
    pub max_relative_tolerance: f64,
}

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
    /// What decides where a blade parts it. Default `front`.
    #[serde(default)]
    pub fracture_rule: FractureRule,
    /// Regions of a lower level: around a lesion, along a planned cut. Elements that touch differ by at
    /// most one level, so the elements around a region grow step by step. Default: none.
    #[serde(default)]
    pub finer: Vec<FinerDesc>,
    /// Material where no region says otherwise.
    pub material: MaterialDesc,
    /// Shapes within which another material holds; where they overlap the last one wins.
    /// Default: none.
    #[serde(default)]
    pub regions: Vec<RegionDesc>,
    /// Voxels whose centre lies in one of these shapes are held where they are. Default: none.
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
    /// `incompatible_modes`; `homogenised` in whole cells whose voxels differ tenfold in shear modulus or
    /// more and whose element would be half as stiff again as they are, or stiffer, under some uniform
    /// strain: where layers or inclusions are smaller than the element. Default.
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

/// What decides where a blade parts an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FractureRule {
    /// The front along the edge advances at a force of Gc per length, Griffith's balance of a sharp edge, whatever
    /// the mesh. Default.
    #[default]
    Front,
    /// A link ahead of the edge parts where its elastic energy per area reaches Gc: the rule of He et al. (2022), its
    /// units mended. The force of the cut depends on the voxels and the level; to compare with.
    /// `initiation_ratio` has no part in it, and a material with a `rate` is refused.
    LinkEnergy,
}

/// Level of an object that states none.
#[must_use]
pub fn default_level() -> u8 {
    2
}

/// A material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaterialDesc {
    /// Young's modulus at small strain, Pa, 1e2 to 1e10.
    pub young_modulus_pa: f64,
    /// Poisson's ratio, 0 to 0.4999; above 0.499 the bulk modulus is that at 0.499.
    pub poisson_ratio: f64,
    /// Density, kg/m^3, 1 to 2e4. Default 1000: water.
    #[serde(default = "default_density")]
    pub density_kg_per_m3: f64,
    /// Rayleigh damping in proportion to mass, 1/s. Default 0.
    #[serde(default)]
    pub rayleigh_alpha_per_s: f64,
    /// Rayleigh damping in proportion to stiffness, s. Default 0.
    #[serde(default)]
    pub rayleigh_beta_s: f64,
    /// Fracture energy Gc, J/m^2; absent: the material cannot be cut.
    #[serde(default)]
    pub fracture_energy_j_per_m2: Option<f64>,
    /// Energy release rate at which a front starts, over Gc; 1 to 10. Default 2.
    #[serde(default = "default_initiation_ratio")]
    pub initiation_ratio: f64,
    /// How the fracture energy rises with the speed of the cut. Default: it does not.
    #[serde(default)]
    pub rate: Option<RateDesc>,
    /// Coefficient c of the strain-stiffening law (uniaxially sigma = E eps exp(c eps^2)), 0 to 20.
    /// Default 0: linear co-rotational.
    #[serde(default)]
    pub strain_stiffening: f64,
    /// What relaxes in time. Default: nothing, which costs nothing.
    #[serde(default)]
    pub viscosity: Option<ViscosityDesc>,
    /// Coefficient of Coulomb friction of the material's surfaces on each other, 0 to 10; between two
    /// materials the geometric mean of theirs; of a smooth probe on them it is the material's own. Default 0: wet
    /// tissue slides.
    #[serde(default)]
    pub friction_coefficient: f64,
}

impl MaterialDesc {
    /// Young's modulus against a jolt, before anything has relaxed, Pa.
    #[must_use]
    pub fn instantaneous_modulus_pa(&self) -> f64 {
        self.young_modulus_pa * (1.0 + self.viscosity.map_or(0.0, |v| v.relaxing_modulus_ratio))
    }
}

/// Fracture energy that rises with the speed v at which the front goes through the material:
/// `Gc(v) = Gc max(1, v / v0)^p`. A front starts at `initiation_ratio` times Gc at rest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RateDesc {
    /// Speed v0 up to which Gc is that at rest, m/s, 1e-6 to 10.
    pub reference_speed_m_per_s: f64,
    /// Exponent p, 0 to 1.
    pub exponent: f64,
}

/// The relaxing part of a standard linear solid: under a strain held from t = 0 the stress is
/// `E eps (1 + s exp(-t / tau))`. Shear and volume relax alike.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ViscosityDesc {
    /// Relaxation time tau, s, 1e-4 to 1e4.
    pub relaxation_time_s: f64,
    /// Modulus s that relaxes, over `young_modulus_pa`, which remains; 1e-6 to 100.
    pub relaxing_modulus_ratio: f64,
}

fn default_density() -> f64 {
    1000.0
}

fn default_initiation_ratio() -> f64 {
    2.0
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
    /// What holds there.
    pub material: MaterialDesc,
}

/// A solid shape, scene frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum ShapeDesc {
    /// Axis-aligned box.
    Box {
        /// Lower corner, m.
        min_m: [f64; 3],
        /// Upper corner, m.
        max_m: [f64; 3],
    },
    /// Sphere.
    Sphere {
        /// Centre, m.
        center_m: [f64; 3],
        /// Radius, m.
        radius_m: f64,
    },
    /// Axis-aligned ellipsoid.
    Ellipsoid {
        /// Centre, m.
        center_m: [f64; 3],
        /// Semi-axes, m.
        semi_axes_m: [f64; 3],
    },
    /// Capsule: all points within `radius_m` of a segment.
    Capsule {
        /// One end of the segment, m.
        from_m: [f64; 3],
        /// The other end, m.
        to_m: [f64; 3],
        /// Radius, m.
        radius_m: f64,
    },
    /// Smooth union of shapes.
    SmoothUnion {
        /// Distance over which surfaces blend, m; 0: plain union.
        blend_m: f64,
        /// What is united; no meshes, no unions.
        parts: Vec<ShapeDesc>,
    },
    /// A closed triangle mesh from an OBJ, STL or PLY file.
    Mesh {
        /// Path, relative to the scene file.
        file: String,
        /// Metres per unit of the file.
        scale_m_per_unit: f64,
        /// Scene position of the file's origin, m. Default: the scene's origin.
        #[serde(default)]
        offset_m: [f64; 3],
    },
    /// What has some labels in a label map, a NIfTI-1 file (`.nii`, `.nii.gz`) whose voxels are placed by
    /// its sform, else its qform. The patient lies on the back, seen from the feet: of the file's axes
    /// right is -x, anterior +y (up), superior -z.
    LabelMap {
        /// Path, relative to the scene file.
        file: String,
        /// Labels, 1 to 65,535, that belong to the shape. Default: all but 0. As shapes of an object's
        /// regions, single labels give each its material.
        #[serde(default)]
        labels: Vec<u16>,
        /// Size in the scene over the size in the file. Default 1.
        #[serde(default = "default_scale")]
        scale: f64,
        /// Scene position of the file's origin, m. Default: the scene's origin.
        #[serde(default)]
        offset_m: [f64; 3],
    },
}

fn default_scale() -> f64 {
    1.0
}

/// A mesh among a scene's [`Meshes`], and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedMesh {
    /// Its key.
    pub key: String,
    /// Metres per unit of the mesh.
    pub scale_m_per_unit: f64,
    /// Scene position of the mesh's origin, m.
    pub offset_m: [f64; 3],
}

impl ShapeDesc {
    /// The mesh that the shape is; `None` for a formula. The surface of labels is a mesh in metres, by the
    /// key `file#[labels]`.
    #[must_use]
    pub fn mesh(&self) -> Option<PlacedMesh> {
        match self {
            Self::Mesh { file, scale_m_per_unit, offset_m } => {
                Some(PlacedMesh { key: file.clone(), scale_m_per_unit: *scale_m_per_unit, offset_m: *offset_m })
            }
            Self::LabelMap { file, labels, scale, offset_m } => {
                let key = format!("{file}#{labels:?}");
                Some(PlacedMesh { key, scale_m_per_unit: *scale, offset_m: *offset_m })
            }
            _ => None,
        }
    }
}

/// A load other than gravity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum LoadDesc {
    /// Force per area on the boundary faces of voxels whose outward face normal is `face` and whose
    /// centre lies in `region`.
    Traction {
        /// Which voxels.
        region: ShapeDesc,
        /// Which of their faces.
        face: Face,
        /// Traction, Pa, scene frame, dead (it does not turn with the face).
        traction_pa: [f64; 3],
    },
    /// Force per volume on the voxels in `region`.
    BodyForce {
        /// Which voxels.
        region: ShapeDesc,
        /// Force density, N/m^3, scene frame.
        force_n_per_m3: [f64; 3],
    },
}

/// A face of a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Face {
    /// -x.
    MinX,
    /// +x.
    MaxX,
    /// -y.
    MinY,
    /// +y.
    MaxY,
    /// -z.
    MinZ,
    /// +z.
    MaxZ,
}

/// A tool that may enter the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ToolDesc {
    /// Name, unique among the tools.
    pub name: String,
    /// What it is.
    pub shape: ToolShapeDesc,
}

impl ToolDesc {
    /// A tool that is a blade.
    #[must_use]
    pub fn blade(name: &str, blade: BladeDesc) -> Self {
        Self { name: name.into(), shape: ToolShapeDesc::Blade(blade) }
    }

    /// A tool that is a grasper.
    #[must_use]
    pub fn grasper(name: &str, grasper: GrasperDesc) -> Self {
        Self { name: name.into(), shape: ToolShapeDesc::Grasper(grasper) }
    }

    /// A tool that presses with a smooth surface.
    #[must_use]
    pub fn probe(name: &str, capsule: CapsuleDesc) -> Self {
        Self { name: name.into(), shape: ToolShapeDesc::Probe(capsule) }
    }

    /// A tool that cuts between two edges.
    #[must_use]
    pub fn scissors(name: &str, scissors: ScissorsDesc) -> Self {
        Self { name: name.into(), shape: ToolShapeDesc::Scissors(scissors) }
    }
}

/// What a tool is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ToolShapeDesc {
    /// Cuts with its edge.
    Blade(BladeDesc),
    /// Holds what its jaws close on.
    Grasper(GrasperDesc),
    /// Presses with a smooth surface.
    Probe(CapsuleDesc),
    /// Cuts between two edges that pivot.
    Scissors(ScissorsDesc),
}

/// A blade.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BladeDesc {
    /// How far the edge reaches along x, m: the length of a straight one.
    pub width_m: f64,
    /// Height of the flanks above the edge, m. They are what the edge sweeps in +y.
    pub height_m: f64,
    /// Shape of the edge. Default: straight.
    #[serde(default)]
    pub edge: EdgeDesc,
    /// Half-width of the edge, m: the contact's length scale. Default 5e-5: a kitchen knife in use.
    #[serde(default = "default_edge_half_width_m")]
    pub edge_half_width_m: f64,
    /// Thickness of the blade behind its edge, m. Default 0: flanks without volume.
    #[serde(default)]
    pub thickness_m: f64,
    /// Angle between the two flanks at the edge, rad, 0.01 to 2: the thickness grows from nothing at the
    /// edge to `thickness_m`, which is then above 0. Default: it is there from the edge on.
    #[serde(default)]
    pub wedge_angle_rad: Option<f64>,
    /// Coefficient of the Coulomb friction between the flanks and the walls of the cut, 0.001 to 2.
    /// Default: they slide freely.
    #[serde(default)]
    pub flank_friction: Option<f64>,
}

impl BladeDesc {
    /// A straight blade with every default.
    #[must_use]
    pub fn straight(width_m: f64, height_m: f64) -> Self {
        Self {
            width_m,
            height_m,
            edge: EdgeDesc::Straight,
            edge_half_width_m: default_edge_half_width_m(),
            thickness_m: 0.0,
            wedge_angle_rad: None,
            flank_friction: None,
        }
    }
}

fn default_edge_half_width_m() -> f64 {
    5e-5
}

/// A grasper: jaws that take hold of the tissue around the tool's reference point as they close, and keep
/// it where it is relative to the tool until they open.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GrasperDesc {
    /// Radius around the reference point within which the jaws take hold, m, 1e-4 to 0.1.
    pub radius_m: f64,
    /// Force on the tool above which what it holds slips out, N, 1e-6 to 1e6. Default: none is too much.
    #[serde(default)]
    pub max_force_n: Option<f64>,
}

/// A smooth, blunt tool: all points within a radius of a segment of the tool's x axis, about its origin. It
/// presses, rubs by the material's `friction_coefficient`, and cuts nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CapsuleDesc {
    /// Radius, m, 1e-4 to 1; at least two voxels of every object.
    pub radius_m: f64,
    /// Length of the segment, m, 0 to 10. Default 0: a sphere.
    #[serde(default)]
    pub length_m: f64,
}

/// Two straight blades on a pivot, which is the tool's reference point: +x runs from there along the closed
/// blades to their tips, the pivot's axis is z. Closing cuts what lies between them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScissorsDesc {
    /// Length of either edge from the pivot to its tip, m, 1e-4 to 10.
    pub blade_length_m: f64,
    /// Height of the flanks behind the edges, m, 1e-4 to 10.
    pub blade_height_m: f64,
    /// Angle between the edges where they are fully open, rad, 0.1 to 2. Default 0.7: 40 degrees.
    #[serde(default = "default_max_angle_rad")]
    pub max_angle_rad: f64,
    /// Half-width of the edges, m, 1e-8 to 1e-2. Default 5e-5, as a blade's.
    #[serde(default = "default_edge_half_width_m")]
    pub edge_half_width_m: f64,
    /// Thickness behind the edges, m, 0 to 0.1. Default 0: flanks without volume.
    #[serde(default)]
    pub thickness_m: f64,
}

impl ScissorsDesc {
    /// Scissors with every default.
    #[must_use]
    pub fn new(blade_length_m: f64, blade_height_m: f64) -> Self {
        Self {
            blade_length_m,
            blade_height_m,
            max_angle_rad: default_max_angle_rad(),
            edge_half_width_m: default_edge_half_width_m(),
            thickness_m: 0.0,
        }
    }
}

fn default_max_angle_rad() -> f64 {
    0.7
}

/// A point whose displacement is reported.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrackedPointDesc {
    /// Name, unique among the tracked points.
    pub name: String,
    /// Name of the object it belongs to.
    pub object: String,
    /// Material point, reference configuration, m.
    pub position_m: [f64; 3],
}

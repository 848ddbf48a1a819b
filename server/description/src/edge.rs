//! The edge of a blade: what a scene says of its shape, and the points that it means.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::SceneError;
use super::wording::{brief, out_of_range};

/// An edge that leans more than this towards the cutting direction has none of its own: the cosine
/// between its tangent and the tool's y axis, of 80 degrees against the x-z plane.
pub const STEEPEST: f64 = 0.985;
/// Points of an edge: each costs a look per step in every body.
pub const MAX_EDGE_POINTS: usize = 4096;
/// Waves of an edge: at 64 pieces a wave as many points as an edge may have.
const MAX_WAVES: f64 = 64.0;
/// Pieces that a wave is made of: they are off the sine by 1.2e-3 of its amplitude.
const PIECES_PER_WAVE: f64 = 64.0;
/// Pieces that an arc is made of: off the deepest one by 2e-4 of its radius.
const PIECES_PER_ARC: u32 = 64;
/// Fraction of `width_m` by which points may reach more or less far along x: units mistaken are off by more.
const WIDTH_TOLERANCE: f64 = 0.01;
/// Least distance between points in a row, m: below it their difference has no direction to speak of.
const LEAST_PIECE_M: f64 = 1e-6;

/// Shape of a blade's edge in the tool frame, where the blade cuts towards -y.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum EdgeDesc {
    /// On the x axis. Default.
    #[default]
    Straight,
    /// A circular arc in the x-y plane through the origin, as the belly of a scalpel.
    Arc {
        /// How far its middle leads its ends in the cutting direction, m; negative: trails them. At most
        /// 0.42 of the width to either side, where the ends lean by 80 degrees.
        sagitta_m: f64,
    },
    /// `z = amplitude sin(2 pi x / wavelength)`: a wave across the cutting direction.
    Sine {
        /// Amplitude, m.
        amplitude_m: f64,
        /// Wavelength, m; at most 64 go into the width.
        wavelength_m: f64,
    },
    /// Straight pieces between points.
    Polyline {
        /// From one end to the other, m. They reach over `width_m` along x, and no piece leans more than
        /// 80 degrees out of the x-z plane.
        points_m: Vec<[f64; 3]>,
    },
    /// A polyline whose points stand in a text file: three numbers a line, with commas or blanks between
    /// them; what follows a `#` is a remark. It takes the place of this when the scene is loaded.
    File {
        /// Path, relative to the scene file.
        file: String,
        /// Metres per unit of the file.
        scale_m_per_unit: f64,
    },
}

impl EdgeDesc {
    /// The points of an edge that reaches over `width_m`, tool frame, m.
    ///
    /// # Errors
    /// They are still in a file.
    pub fn points_m(&self, width_m: f64) -> Result<Vec<Vector3<f64>>, SceneError> {
        let half = 0.5 * width_m;
        Ok(match self {
            Self::Straight => vec![Vector3::new(-half, 0.0, 0.0), Vector3::new(half, 0.0, 0.0)],
            Self::Arc { sagitta_m } => arc(width_m, *sagitta_m),
            Self::Sine { amplitude_m, wavelength_m } => {
                let pieces = (PIECES_PER_WAVE * width_m / wavelength_m).ceil().max(1.0) as u32;
                let at = |i: u32| {
                    let x = (f64::from(i) / f64::from(pieces) - 0.5) * width_m;
                    Vector3::new(x, 0.0, amplitude_m * sin(std::f64::consts::TAU * x / wavelength_m))
                };
                (0..=pieces).map(at).collect()
            }
            Self::Polyline { points_m } => points_m.iter().map(|p| Vector3::from(*p)).collect(),
            Self::File { file, .. } => {
                let message = format!("`{file}` has not been read; a blade is made of points");
                return Err(SceneError::Field { field: "edge.file".into(), message });
            }
        })
    }
}

/// By the tangent t of half the angle from the middle: `(2 t R, 2 t^2 R) / (1 + t^2)`, R the radius.
fn arc(width_m: f64, sagitta_m: f64) -> Vec<Vector3<f64>> {
    if sagitta_m == 0.0 {
        return EdgeDesc::Straight.points_m(width_m).unwrap_or_default();
    }
    let end = 2.0 * sagitta_m / width_m;
    let radius_m = 0.25 * width_m * (1.0 + end * end) / end;
    let at = |i: u32| {
        let t = (f64::from(2 * i) / f64::from(PIECES_PER_ARC) - 1.0) * end;
        Vector3::new(t, t * t, 0.0) * (2.0 * radius_m / (1.0 + t * t))
    };
    (0..=PIECES_PER_ARC).map(at).collect()
}

/// Sine through the vector library's own polynomial: the same bits on every machine.
fn sin(x: f64) -> f64 {
    wide::f64x4::splat(x).sin().to_array()[0]
}

/// The first thing that is wrong with the edge of a blade, whose width is sound: the field below the blade's, and what
/// it is.
pub fn problem(edge: &EdgeDesc, width_m: f64, smallest_voxel_m: f64, most_voxels: f64) -> Option<(String, String)> {
    let refused = |field: &str, message: String| Some((format!("edge.{field}"), message));
    let field = match edge {
        EdgeDesc::Straight => "straight",
        EdgeDesc::Arc { sagitta_m } => {
            if !sagitta_m.is_finite() {
                return refused("arc.sagitta_m", format!("{sagitta_m} is not finite"));
            }
            "arc.sagitta_m"
        }
        EdgeDesc::Sine { amplitude_m, wavelength_m } => {
            if !(0.0..=10.0).contains(amplitude_m) {
                return refused("sine.amplitude_m", out_of_range("amplitude_m", *amplitude_m, 0.0, 10.0));
            }
            if !(width_m / MAX_WAVES..=1e3).contains(wavelength_m) {
                let least = width_m / MAX_WAVES;
                let message = format!(
                    "{} is not between {}, {MAX_WAVES} waves over width_m, and 1000 m",
                    brief(*wavelength_m),
                    brief(least)
                );
                return refused("sine.wavelength_m", message);
            }
            "sine"
        }
        EdgeDesc::Polyline { points_m } => {
            if !(2..=MAX_EDGE_POINTS).contains(&points_m.len()) {
                let message = format!("{} points are not between 2 and {MAX_EDGE_POINTS}", points_m.len());
                return refused("polyline.points_m", message);
            }
            if let Some(i) = points_m.iter().position(|p| !p.iter().all(|x| x.abs() <= 10.0)) {
                let message = format!("{:?} is not within +-10 in each component", points_m[i]);
                return refused(&format!("polyline.points_m[{i}]"), message);
            }
            "polyline.points_m"
        }
        EdgeDesc::File { file, scale_m_per_unit } => {
            if file.is_empty() {
                return refused("file.file", "is empty".into());
            }
            if !(1e-9..=1e6).contains(scale_m_per_unit) {
                return refused(
                    "file.scale_m_per_unit",
                    out_of_range("scale_m_per_unit", *scale_m_per_unit, 1e-9, 1e6),
                );
            }
            return None;
        }
    };
    let points_m = edge.points_m(width_m).ok()?;
    let message = shape_problem(&points_m, width_m).or_else(|| {
        let length_m: f64 = points_m.windows(2).map(|ends| (ends[1] - ends[0]).norm()).sum();
        let voxels = length_m / smallest_voxel_m;
        // Of a width that reaches over too many voxels enough is said.
        (voxels > most_voxels && width_m / smallest_voxel_m <= most_voxels).then(|| {
            format!(
                "makes an edge of {} m, or {voxels:.0} of the smallest voxels, of {} m: more than {most_voxels}",
                brief(length_m),
                brief(smallest_voxel_m)
            )
        })
    });
    refused(field, message?)
}

/// What is wrong with the points of an edge, all of them finite.
fn shape_problem(points_m: &[Vector3<f64>], width_m: f64) -> Option<String> {
    for (i, ends) in points_m.windows(2).enumerate() {
        let span = ends[1] - ends[0];
        let length_m = span.norm();
        if length_m < LEAST_PIECE_M {
            return Some(format!(
                "points {i} and {} are {} m apart, less than {LEAST_PIECE_M}",
                i + 1,
                brief(length_m)
            ));
        }
        if span.y.abs() > STEEPEST * length_m {
            return Some(format!(
                "the edge leans more than 80 degrees towards the cutting direction between points {i} and {}",
                i + 1
            ));
        }
    }
    let reach = |pick: fn(f64, f64) -> f64| points_m.iter().map(|p| p.x).reduce(pick).unwrap_or_default();
    let reach_m = reach(f64::max) - reach(f64::min);
    ((reach_m - width_m).abs() > WIDTH_TOLERANCE * width_m).then(|| {
        format!(
            "the points reach over {} m along x, not over width_m, {}, to within a hundredth; set width_m to the \
             former, or the points' scale",
            brief(reach_m),
            brief(width_m)
        )
    })
}

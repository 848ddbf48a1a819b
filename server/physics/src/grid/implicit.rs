//! Shapes with a formula: signed distance and outward normal at a point.

use super::lattice::Bounds;
use crate::Vec3;
use crate::scene::ShapeDesc;

/// Distance to a surface and the direction away from the inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSample {
    /// Signed distance, m, negative inside.
    pub distance_m: f64,
    /// Unit normal of the nearest surface, outward, scene frame.
    pub normal: Vec3,
}

/// A shape given by a formula.
#[derive(Clone, Debug)]
pub enum Implicit {
    /// Axis-aligned box.
    Box {
        /// Centre, m.
        center_m: Vec3,
        /// Half the edge lengths, m.
        half_m: Vec3,
    },
    /// Axis-aligned ellipsoid.
    Ellipsoid {
        /// Centre, m.
        center_m: Vec3,
        /// Semi-axes, m.
        semi_axes_m: Vec3,
    },
    /// All points within a radius of a segment (of a point: a sphere).
    Capsule {
        /// One end, m.
        from_m: Vec3,
        /// From that end to the other, m.
        along_m: Vec3,
        /// Radius, m.
        radius_m: f64,
    },
    /// Smooth union, less what others take away.
    Union {
        /// Distance over which surfaces blend, m.
        blend_m: f64,
        /// What is united.
        parts: Vec<Part>,
        /// What is taken away from the union.
        without: Vec<Part>,
    },
}

/// A shape of a union.
#[derive(Clone, Debug)]
pub struct Part {
    shape: Implicit,
    /// Box that the shape does not leave, m.
    reach: Bounds,
}

impl From<Implicit> for Part {
    fn from(shape: Implicit) -> Self {
        Self { reach: shape.reach(), shape }
    }
}

impl Part {
    /// No more than its distance at a point outside of its box; what is inside may be anywhere.
    fn least_distance_m(&self, position_m: &Vec3) -> f64 {
        let beyond = (self.reach.min_m - position_m).sup(&(position_m - self.reach.max_m));
        match beyond.max() > 0.0 {
            true => beyond.sup(&Vec3::zeros()).norm(),
            false => f64::NEG_INFINITY,
        }
    }
}

impl Implicit {
    /// The formula of a shape; `None` for a mesh.
    #[must_use]
    pub fn new(shape: &ShapeDesc) -> Option<Self> {
        Some(match shape {
            ShapeDesc::Box { min_m, max_m } => {
                let (min_m, max_m) = (Vec3::from(*min_m), Vec3::from(*max_m));
                Self::Box { center_m: (min_m + max_m) / 2.0, half_m: (max_m - min_m) / 2.0 }
            }
            ShapeDesc::Sphere { center_m, radius_m } => {
                Self::Capsule { from_m: (*center_m).into(), along_m: Vec3::zeros(), radius_m: *radius_m }
            }
            ShapeDesc::Ellipsoid { center_m, semi_axes_m } => {
                Self::Ellipsoid { center_m: (*center_m).into(), semi_axes_m: (*semi_axes_m).into() }
            }
            ShapeDesc::Capsule { from_m, to_m, radius_m } => {
                let from_m = Vec3::from(*from_m);
                Self::Capsule { from_m, along_m: Vec3::from(*to_m) - from_m, radius_m: *radius_m }
            }
            ShapeDesc::SmoothUnion { blend_m, parts, without } => {
                let part = |shape: &ShapeDesc| Self::new(shape).map(Part::from);
                let formulas = |shapes: &[ShapeDesc]| shapes.iter().map(part).collect::<Option<_>>();
                Self::Union { blend_m: *blend_m, parts: formulas(parts)?, without: formulas(without)? }
            }
            ShapeDesc::Mesh { .. } | ShapeDesc::LabelMap { .. } => return None,
        })
    }

    /// Box of the shape; of a union, the box that holds its parts' boxes.
    ///
    /// # Panics
    /// On a union without parts, which the scene's validation refuses.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let around = |center: &Vec3, half: &Vec3| Bounds { min_m: center - half, max_m: center + half };
        match self {
            Self::Box { center_m, half_m } => around(center_m, half_m),
            Self::Ellipsoid { center_m, semi_axes_m } => around(center_m, semi_axes_m),
            Self::Capsule { from_m, along_m, radius_m } => {
                let half = Vec3::repeat(*radius_m);
                around(from_m, &half).with(around(&(from_m + along_m), &half))
            }
            Self::Union { parts, .. } => {
                parts.iter().map(|part| part.shape.bounds()).reduce(Bounds::with).expect("a union has parts")
            }
        }
    }

    /// Box that the surface does not leave, those of unions within unions neither.
    fn reach(&self) -> Bounds {
        match self {
            Self::Union { parts, .. } => {
                let Bounds { min_m, max_m } =
                    parts.iter().map(|part| part.reach).reduce(Bounds::with).expect("a union has parts");
                let bulge = Vec3::repeat(self.bulge_m());
                Bounds { min_m: min_m - bulge, max_m: max_m + bulge }
            }
            _ => self.bounds(),
        }
    }

    /// How far blending may push the surface beyond [`Self::bounds`], m.
    #[must_use]
    pub fn bulge_m(&self) -> f64 {
        match self {
            Self::Union { blend_m, parts, .. } => blend_m / 4.0 * (parts.len() as f64 - 1.0),
            _ => 0.0,
        }
    }

    /// Signed distance and normal at a point. Exact for all but unions, where the distance is right
    /// to first order at the surface and the zero set is that of the blend.
    #[must_use]
    pub fn sample(&self, position_m: &Vec3) -> SurfaceSample {
        match self {
            Self::Box { center_m, half_m } => sample_box(&(position_m - center_m), half_m),
            Self::Ellipsoid { center_m, semi_axes_m } => sample_ellipsoid(&(position_m - center_m), semi_axes_m),
            Self::Capsule { from_m, along_m, radius_m } => {
                let local = position_m - from_m;
                let share = (local.dot(along_m) / along_m.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
                let away = local - along_m * share;
                SurfaceSample { distance_m: away.norm() - radius_m, normal: unit_or_up(away) }
            }
            Self::Union { blend_m, parts, without } => sample_union(position_m, *blend_m, parts, without),
        }
    }
}

fn unit_or_up(v: Vec3) -> Vec3 {
    v.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vec3::y)
}

fn sample_box(local: &Vec3, half: &Vec3) -> SurfaceSample {
    let beyond = local.abs() - half;
    let signs = local.map(|x| if x < 0.0 { -1.0 } else { 1.0 });
    let outside = beyond.map(|x| x.max(0.0)).component_mul(&signs);
    let distance_m = outside.norm();
    if distance_m > 0.0 {
        return SurfaceSample { distance_m, normal: outside / distance_m };
    }
    let face = beyond.imax();
    let mut normal = Vec3::zeros();
    normal[face] = signs[face];
    SurfaceSample { distance_m: beyond[face], normal }
}

/// Nearest point `x_i = a_i^2 y_i / (t + a_i^2)`, where t is the root of the convex, falling function
/// `g(t) = sum (a_i y_i / (t + a_i^2))^2 - 1`; Newton from the left of the root never oversteps it.
/// The distance is `t |x_i / a_i^2|`: its sign is that of t and it keeps its digits at the surface.
fn sample_ellipsoid(local: &Vec3, semi_axes: &Vec3) -> SurfaceSample {
    let y = local.abs();
    let squares = semi_axes.component_mul(semi_axes);
    let mut t = (semi_axes.component_mul(&y) - squares).max();
    for _ in 0..64 {
        let (mut g, mut slope) = (-1.0, 0.0);
        for a in 0..3 {
            let denominator = t + squares[a];
            if y[a] > 0.0 && denominator > 0.0 {
                let term = semi_axes[a] * y[a] / denominator;
                g += term * term;
                slope -= 2.0 * term * term / denominator;
            }
        }
        if g <= 1e-14 {
            break;
        }
        t -= g / slope;
    }
    let nearest = nearest_on_ellipsoid(&y, &squares, t);
    let gradient = nearest.component_div(&squares);
    let length = gradient.norm();
    let signed = Vec3::from_fn(|a, _| gradient[a].copysign(local[a]));
    SurfaceSample { distance_m: t * length, normal: unit_or_up(signed) }
}

fn nearest_on_ellipsoid(y: &Vec3, squares: &Vec3, t: f64) -> Vec3 {
    let short = squares.imin();
    let mut nearest = Vec3::zeros();
    for a in 0..3 {
        if y[a] > 0.0 {
            nearest[a] = squares[a] * y[a] / (t + squares[a]);
        }
    }
    // In the plane across the shortest axis and near the centre, the nearest points lie off the plane.
    if y[short] <= 0.0 {
        let rest = 1.0 - nearest.component_mul(&nearest).component_div(squares).sum();
        nearest[short] = (squares[short] * rest.max(0.0)).sqrt();
    }
    nearest
}

/// Below this length of the blended gradient (deep between parts, away from any surface) the distance
/// is no longer stretched by it.
const LEAST_GRADIENT: f64 = 0.5;

/// Parts are taken in order; one that is too far away to change the blend is not looked at. What is outside of the union
/// without a shape is what is outside of the one or inside of the other: the blend of the two outsides.
fn sample_union(position: &Vec3, blend: f64, parts: &[Part], without: &[Part]) -> SurfaceSample {
    let add = |so_far: (f64, Vec3), part: &Part| {
        if part.least_distance_m(position) >= so_far.0 + blend {
            return so_far;
        }
        let SurfaceSample { distance_m, normal } = part.shape.sample(position);
        blended(blend, so_far, (distance_m, normal))
    };
    let (first, others) = parts.split_first().expect("a union has parts");
    let SurfaceSample { distance_m, normal } = first.shape.sample(position);
    let united = others.iter().fold((distance_m, normal), add);
    let outside = without.iter().fold((-united.0, -united.1), add);
    let (distance, gradient) = (-outside.0, -outside.1);
    let length = gradient.norm().clamp(LEAST_GRADIENT, 1.0);
    SurfaceSample { distance_m: distance / length, normal: unit_or_up(gradient) }
}

/// Distance and gradient of the polynomial blend of two: where the distances differ by less than the blend b,
/// `min - b s^2/4` with `s = 1 - difference/b`.
fn blended(blend: f64, (distance, gradient): (f64, Vec3), (next, slope): (f64, Vec3)) -> (f64, Vec3) {
    let overlap = blend - (next - distance).abs();
    let share = if overlap > 0.0 { overlap / blend } else { 0.0 };
    let weight = if next < distance { 1.0 - 0.5 * share } else { 0.5 * share };
    (distance.min(next) - 0.25 * share * share * blend, gradient + (slope - gradient) * weight)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shapes() -> Vec<(&'static str, Implicit)> {
        let capsule = |from: [f64; 3], along: [f64; 3], radius_m| Implicit::Capsule {
            from_m: from.into(),
            along_m: along.into(),
            radius_m,
        };
        let ellipsoid = Implicit::Ellipsoid { center_m: Vec3::zeros(), semi_axes_m: Vec3::new(1.0, 0.4, 0.7) };
        vec![
            ("box", Implicit::Box { center_m: Vec3::zeros(), half_m: Vec3::new(0.5, 0.3, 0.8) }),
            ("sphere", capsule([0.1, 0.0, 0.0], [0.0; 3], 0.7)),
            ("ellipsoid", ellipsoid.clone()),
            ("capsule", capsule([-0.4, 0.0, 0.0], [0.9, 0.1, 0.0], 0.3)),
            (
                "union",
                Implicit::Union {
                    blend_m: 0.2,
                    parts: [ellipsoid, capsule([0.0; 3], [0.0, 0.9, 0.0], 0.3)].map(Part::from).into(),
                    without: vec![capsule([0.6, 0.5, 0.0], [0.0; 3], 0.4).into()],
                },
            ),
        ]
    }

    proptest! {
        #[test]
        fn walking_back_along_the_normal_ends_on_the_surface(x in -1.5..1.5f64, y in -1.5..1.5f64, z in -1.5..1.5f64) {
            let p = Vec3::new(x, y, z);
            for (name, shape) in shapes() {
                let s = shape.sample(&p);
                prop_assert!((s.normal.norm() - 1.0).abs() < 1e-12, "{name}");
                // A union is exact to first order only, so look at it near its surface.
                if name == "union" && s.distance_m.abs() > 0.02 { continue; }
                let on_surface = shape.sample(&(p - s.normal * s.distance_m));
                let tolerance = if name == "union" { 3.0 * s.distance_m.powi(2) } else { 1e-7 };
                prop_assert!(on_surface.distance_m.abs() <= tolerance + 1e-12, "{name}: {on_surface:?}");
            }
        }

        #[test]
        fn the_sign_of_an_ellipsoids_distance_is_that_of_its_equation(x in -1.2..1.2f64, y in -0.6..0.6f64, z in -0.9..0.9f64) {
            let (_, ellipsoid) = &shapes()[2];
            let equation = x * x + (y / 0.4).powi(2) + (z / 0.7).powi(2) - 1.0;
            let distance = ellipsoid.sample(&Vec3::new(x, y, z)).distance_m;
            prop_assert!(equation.abs() < 1e-9 || (equation < 0.0) == (distance < 0.0));
        }

        #[test]
        fn the_normal_is_the_gradient(x in -1.5..1.5f64, y in -1.5..1.5f64, z in -1.5..1.5f64) {
            let p = Vec3::new(x, y, z);
            for (name, shape) in shapes().into_iter().filter(|(name, _)| *name != "union") {
                let s = shape.sample(&p);
                // Across a ridge of the distance the gradient jumps: walk away from the inside only.
                let ahead = shape.sample(&(p + s.normal * 1e-6));
                prop_assert!((ahead.distance_m - s.distance_m - 1e-6).abs() < 1e-9, "{name}");
            }
        }
    }

    #[test]
    fn an_ellipsoids_centre_is_its_shortest_semi_axis_deep() {
        let (_, ellipsoid) = &shapes()[2];
        assert!((ellipsoid.sample(&Vec3::zeros()).distance_m + 0.4).abs() < 1e-12);
        // On the long axis within the focal region the nearest point lies off the axis.
        let s = ellipsoid.sample(&Vec3::new(0.3, 0.0, 0.0));
        let brute = (0..100_000)
            .map(|i| f64::from(i) * std::f64::consts::PI / 1e5)
            .map(|a| (a.cos() - 0.3).hypot(0.4 * a.sin()))
            .fold(f64::INFINITY, f64::min);
        assert!((s.distance_m + brute).abs() < 1e-6, "{} {brute}", s.distance_m);
    }

    #[test]
    fn a_blend_adds_material_between_its_parts_only() {
        let ball = |x: f64| Implicit::Capsule { from_m: Vec3::new(x, 0.0, 0.0), along_m: Vec3::zeros(), radius_m: 1.0 };
        let union =
            |blend_m| Implicit::Union { blend_m, parts: vec![ball(-0.8).into(), ball(0.8).into()], without: vec![] };
        let notch = Vec3::new(0.0, 0.65, 0.0);
        assert!(union(0.0).sample(&notch).distance_m > 0.0);
        assert!(union(0.5).sample(&notch).distance_m < 0.0);
        let far = Vec3::new(1.9, 0.0, 0.0);
        assert_eq!(union(0.0).sample(&far), union(0.5).sample(&far));
    }

    /// All parts of a union, near and far.
    fn blend_of_all(shape: &Implicit, position_m: &Vec3) -> SurfaceSample {
        let Implicit::Union { blend_m, parts, without } = shape else { return shape.sample(position_m) };
        let sample = |part: &Part| {
            let SurfaceSample { distance_m, normal } = blend_of_all(&part.shape, position_m);
            (distance_m, normal)
        };
        let united = parts.iter().map(sample).reduce(|a, b| blended(*blend_m, a, b)).unwrap();
        let outside = without.iter().map(sample).fold((-united.0, -united.1), |a, b| blended(*blend_m, a, b));
        let length = outside.1.norm().clamp(LEAST_GRADIENT, 1.0);
        SurfaceSample { distance_m: -outside.0 / length, normal: unit_or_up(-outside.1) }
    }

    proptest! {
        #[test]
        fn what_is_too_far_away_to_change_a_union_is_left_out_to_the_bit(
            balls in prop::collection::vec((prop::array::uniform3(-1.0..1.0f64), 0.05..0.6f64), 2..8),
            blend_m in 0.0..0.3f64,
            points in prop::collection::vec(prop::array::uniform3(-2.0..2.0f64), 50),
        ) {
            let ball = |(center, radius_m): &([f64; 3], f64)| {
                let semi_axes_m = Vec3::new(*radius_m, 0.5 * radius_m, 0.8 * radius_m);
                Part::from(Implicit::Ellipsoid { center_m: (*center).into(), semi_axes_m })
            };
            let (inner, outer) = balls.split_at(balls.len() / 2);
            let nested = Implicit::Union { blend_m, parts: inner.iter().map(ball).collect(), without: vec![] };
            let parts = std::iter::once(nested.into()).chain(outer.iter().map(ball)).collect();
            let shape = Implicit::Union { blend_m, parts, without: vec![ball(&balls[0])] };
            for point in points.into_iter().map(Vec3::from) {
                prop_assert_eq!(shape.sample(&point), blend_of_all(&shape, &point));
            }
        }
    }

    #[test]
    fn what_is_taken_away_leaves_a_hollow_whose_edge_is_rounded() {
        let ball =
            |x: f64, radius_m| Implicit::Capsule { from_m: Vec3::new(x, 0.0, 0.0), along_m: Vec3::zeros(), radius_m };
        let bitten = |blend_m| Implicit::Union {
            blend_m,
            parts: vec![ball(0.0, 1.0).into()],
            without: vec![ball(1.0, 0.5).into()],
        };
        // In the hollow the surface is the ball's that was taken away, seen from outside of it.
        let hollow = bitten(0.0).sample(&Vec3::new(0.6, 0.0, 0.0));
        assert!((hollow.distance_m - 0.1).abs() < 1e-12 && (hollow.normal - Vec3::x()).norm() < 1e-12, "{hollow:?}");
        // Both spheres pass through x = 0.875: a blend takes the edge there, and nothing elsewhere.
        let edge = Vec3::new(0.875, 0.234_375_f64.sqrt(), 0.0);
        assert!(bitten(0.0).sample(&edge).distance_m.abs() < 1e-12);
        // A quarter of the blend, along the mean of the two normals, which is .61 long.
        let mean = (edge + (Vec3::x() - edge) / 0.5) / 2.0;
        assert!((bitten(0.4).sample(&edge).distance_m - 0.1 / mean.norm()).abs() < 1e-9);
        let far = Vec3::new(-1.1, 0.0, 0.0);
        assert_eq!(bitten(0.0).sample(&far), bitten(0.4).sample(&far));
    }
}

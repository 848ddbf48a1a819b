//! What a script hardly means: a tool that never comes near the tissue, positions in millimetres, jumps.

use kerf_physics::scene::wording::brief;
use kerf_physics::{Scene, SceneError, Vec3, World};
use kerf_session::PoseLimits;

use super::{Script, sweep};

/// Metres per millimetre.
const MILLIMETRE_M: f64 = 1e-3;
/// Extents of the tissue that a path may be away from it and long, in millimetres taken for metres.
const NEAR_EXTENTS: f64 = 2.0;

/// An axis-aligned box, m.
type Extent = [Vec3; 2];

/// The warnings of a script from a file of this name, by tool. The tissue is taken as it is at rest.
#[must_use]
pub fn of(file: &str, script: &Script, scene: &Scene, world: &World) -> Vec<SceneError> {
    let objects: Vec<Extent> = world
        .bodies()
        .iter()
        .map(|body| {
            let grid = body.grid();
            let low_m = grid.origin_m();
            [low_m, low_m + Vec3::from(grid.dims().map(f64::from)) * grid.voxel_size_m()]
        })
        .collect();
    let paths = sweep::boxes(&scene.desc, script);
    let tools = scene.desc.tools.iter().zip(paths).filter_map(|(tool, path)| Some((tool, path?)));
    let warnings = tools.filter_map(|(tool, path)| {
        let nearest = objects.iter().zip(&scene.desc.objects).map(|(object, desc)| (gap_m(&path, object), &desc.name));
        let (gap_m, object) = nearest.min_by(|a, b| a.0.total_cmp(&b.0))?;
        if gap_m <= sweep::reach_m(&tool.shape) {
            return None;
        }
        let message = if objects.iter().any(|object| is_in_millimetres(&path, object)) {
            format!(
                "tool `{}` comes no nearer than {} m to the tissue; its positions look like millimetres: divide them by \
                 1000, they are metres here",
                tool.name,
                brief(gap_m)
            )
        } else {
            format!("tool `{}` never touches: it comes no nearer than {} m to `{object}`", tool.name, brief(gap_m))
        };
        Some(SceneError::Field { field: file.to_owned(), message })
    });
    warnings.chain(jumps(file, script, scene)).collect()
}

/// Tools that go faster than a session lets a hand: there they would be lifted and put down again.
fn jumps<'a>(file: &'a str, script: &'a Script, scene: &'a Scene) -> impl Iterator<Item = SceneError> + 'a {
    let limit = PoseLimits::default().max_speed_m_per_s;
    script.speeds_m_per_s().filter(move |(_, speed)| *speed > limit).map(move |(tool, speed)| {
        let name = scene.desc.tools.get(tool).map_or("?", |tool| tool.name.as_str());
        let message = format!(
            "tool `{name}` moves at {} m/s; a session moves tools at {} m/s at most, and a step that does more does work \
             that no hand could do",
            brief(speed),
            brief(limit)
        );
        SceneError::Field { field: file.to_owned(), message }
    })
}

/// Distance between two boxes; 0 where they overlap.
fn gap_m([low, high]: &Extent, [other_low, other_high]: &Extent) -> f64 {
    (low - other_high).sup(&(other_low - high)).sup(&Vec3::zeros()).norm()
}

/// Whether a path would be by an object if it were in millimetres.
fn is_in_millimetres(path: &Extent, object: &Extent) -> bool {
    let scaled = path.map(|corner| corner * MILLIMETRE_M);
    let near_m = NEAR_EXTENTS * (object[1] - object[0]).max();
    gap_m(&scaled, object) <= near_m && gap_m(path, object) > near_m
}

#[cfg(test)]
mod tests {
    use kerf_scenes::catalog;

    use super::*;

    fn told(positions_m: [[f64; 3]; 2]) -> Vec<String> {
        let scene = catalog::builtin("jelly").unwrap();
        let world = World::new(&scene).unwrap();
        let [from, to] = positions_m.map(Vec3::from);
        let script = Script::of_positions(&[(0.0, from), (1.0, to)]);
        of("stroke.csv", &script, &scene, &world).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_tool_that_never_touches_is_told_with_its_distance() {
        assert_eq!(told([[0.0, 0.07, 0.0], [0.0, 0.02, 0.0]]), [""; 0]);
        let [warning] = &told([[0.0, 0.2, 0.0], [0.0, 0.105, 0.0]])[..] else { panic!("one warning") };
        assert_eq!(warning, "stroke.csv: tool `blade` never touches: it comes no nearer than 0.05 m to `jelly`");
    }

    #[test]
    fn a_tool_that_jumps_is_told_with_the_speed_that_hands_have() {
        let scene = catalog::builtin("jelly").unwrap();
        let world = World::new(&scene).unwrap();
        let script = Script::of_positions(&[(0.0, Vec3::new(0.0, 0.07, 0.0)), (0.01, Vec3::new(0.0, 0.02, 0.0))]);
        let [warning] = &of("stroke.csv", &script, &scene, &world)[..] else { panic!("one warning") };
        assert!(warning.to_string().contains("`blade` moves at 5 m/s; a session moves tools at 3 m/s"), "{warning}");
    }

    #[test]
    fn a_script_in_millimetres_is_recognised() {
        let [warning, _speed] = &told([[0.0, 70.0, 0.0], [0.0, 20.0, 0.0]])[..] else { panic!("two warnings") };
        assert!(warning.contains("look like millimetres: divide them by 1000"), "{warning}");
    }
}

//! Random cuts by the hundred thousand, without a blade: links are parted one by one, in discs, or all
//! of them, while the body moves.

use kerf_physics::{Body, Crossing, Grid, LEAST_PIECE_VOXELS, LinkId, Vec3, verification};

use super::materials::parameters;
use super::scenes::{Specimen, SplitMix64};
use super::trial::{Return, Trial};
use super::{Case, Family, Outcome};

pub(super) fn cases(seed: u64) -> Vec<Case> {
    let block = |side: u32, level: u8| Specimen { voxels: [side; 3], level, ..Specimen::default() };
    vec![
        case("1e5 random links", block(40, 2), seed, [100, 1000], single),
        case("1e4 random links, full FEM", block(12, 0), seed, [50, 200], single),
        case("1000 random discs, k 4", block(24, 2), seed, [100, 10], disc),
        case("1000 random discs, k 2", block(16, 1), seed, [100, 10], disc),
    ]
}

type Links = Vec<(LinkId, Crossing)>;
type Cut = fn(&Grid, &mut SplitMix64) -> Links;

/// So many cuts before each of so many steps.
fn case(name: &str, specimen: Specimen, seed: u64, [steps, per_step]: [usize; 2], cut: Cut) -> Case {
    Case::new(Family::Cuts, name, parameters(&specimen), move |_| {
        let mut trial = Trial::new(specimen.scene(specimen.held_block(), 0))?;
        let sound_m_per_s = (specimen.young_modulus_pa / specimen.density_kg_per_m3).sqrt();
        trial.start(|rest_m| (rest_m, Vec3::new(0.0, -rest_m.x, rest_m.y) * (0.2 * sound_m_per_s / 0.1)));
        let mut rng = SplitMix64(seed);
        let mut wrong = Vec::new();
        let mass_kg = trial.world.bodies()[0].mass_kg();
        let mut parted_links = 0;
        for _ in 0..steps {
            let body = verification::body_mut(&mut trial.world, 0);
            let links: Links = (0..per_step).flat_map(|_| cut(body.grid(), &mut rng)).collect();
            parted_links += verification::part(body, &links);
            trial.step(&[]);
        }
        trial.let_go(specimen.period_s(), 1.0, 100, Return::Anywhere);
        let body = trial.world.bodies()[0];
        wrong.extend(check_body(body, specimen.voxels.iter().product::<u32>() as usize));
        if (body.mass_kg() / mass_kg - 1.0).abs() > 1e-12 {
            wrong.push(format!("mass {} kg of {mass_kg} kg", body.mass_kg()));
        }
        let mut seen = trial.finish();
        seen.parted_links = parted_links as u64;
        Ok(Outcome { seen, wrong })
    })
}

/// A random link inside the body.
fn single(grid: &Grid, rng: &mut SplitMix64) -> Links {
    let cell = grid.voxels()[rng.index(grid.voxels().len())].ijk;
    let axis = rng.index(3) as u8;
    let mut normal = [0.0; 3];
    normal[axis as usize] = 1.0;
    vec![(LinkId { cell, axis }, Crossing { t: rng.unit() as f32, normal })]
}

/// Every link across a disc of three voxels' radius, anywhere and any way.
fn disc(grid: &Grid, rng: &mut SplitMix64) -> Links {
    let centre = grid.voxels()[rng.index(grid.voxels().len())].ijk;
    let normal = rng.vector().try_normalize(1e-9).unwrap_or(Vec3::x());
    let offset = rng.unit() - 0.5;
    let mut links = Vec::new();
    let reach = 3i32;
    let range = || -reach..=reach;
    for cell in range().flat_map(|i| range().flat_map(move |j| range().map(move |k| [i, j, k]))) {
        for axis in 0..3u8 {
            let lower = Vec3::from(cell.map(f64::from));
            let height = lower.dot(&normal) - offset;
            let rise = normal[axis as usize];
            let t = -height / rise;
            if rise.abs() < 1e-6 || !(0.0..1.0).contains(&t) || lower.norm() > f64::from(reach) {
                continue;
            }
            let up = if rise > 0.0 { normal } else { -normal };
            let cell = std::array::from_fn(|a| centre[a] + cell[a]);
            links.push((LinkId { cell, axis }, Crossing { t: t as f32, normal: up.cast().into() }));
        }
    }
    links
}

/// What is wrong with the structure of a body: voxels lost, elements without voxels or with voxels of
/// other cells, pieces below the least.
pub(crate) fn check_body(body: &Body, voxels: usize) -> Vec<String> {
    let mut wrong = Vec::new();
    let base = verification::base(body);
    let mut filled = vec![0usize; base.elements.len()];
    let mut astray = 0;
    for (voxel, &owner) in body.grid().voxels().iter().zip(&base.owner) {
        filled[owner as usize] += 1;
        let element = &base.elements[owner as usize];
        let inside = |a: usize| (0..element.size).contains(&((voxel.ijk[a] >> base.exponent) - element.cell[a]));
        astray += usize::from(!(0..3).all(inside));
    }
    let total: usize = filled.iter().sum();
    let orphans = filled.iter().filter(|n| **n == 0).count();
    let unknown = base.elements.iter().flat_map(|e| e.nodes).filter(|n| *n as usize >= body.node_count()).count();
    for (what, count) in [("voxels in another cell's element", astray), ("elements without a voxel", orphans)] {
        if count > 0 {
            wrong.push(format!("{count} {what}"));
        }
    }
    if total != voxels || unknown > 0 {
        wrong.push(format!("{total} voxels of {voxels}, {unknown} unknown nodes"));
    }
    let small: usize = piece_sizes(body.grid()).into_iter().take_while(|size| *size < LEAST_PIECE_VOXELS).sum();
    if small > 0 && voxels >= LEAST_PIECE_VOXELS {
        wrong.push(format!("{small} voxels in pieces of fewer than {LEAST_PIECE_VOXELS}"));
    }
    wrong
}

/// Numbers of voxels of the pieces that intact links hold together, ascending.
pub(crate) fn piece_sizes(grid: &Grid) -> Vec<usize> {
    let mut seen = vec![false; grid.voxels().len()];
    let (mut sizes, mut open) = (Vec::new(), Vec::new());
    for start in 0..seen.len() {
        if std::mem::replace(&mut seen[start], true) {
            continue;
        }
        open.push(start);
        let mut size = 0;
        while let Some(voxel) = open.pop() {
            size += 1;
            for (link, other) in Grid::links_of(grid.voxels()[voxel].ijk) {
                let Some(next) = grid.voxel_at(other).filter(|_| grid.is_intact(link)) else { continue };
                if !std::mem::replace(&mut seen[next.index()], true) {
                    open.push(next.index());
                }
            }
        }
        sizes.push(size);
    }
    sizes.sort_unstable();
    sizes
}

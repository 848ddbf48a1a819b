//! Uniaxial stress: Hooke's law, whatever the filling of the cells.

use anyhow::Result;
use kerf_physics::Vec3;
use kerf_physics::scene::{Face, LoadDesc};
use rayon::prelude::*;

use super::elements::part_at_random;
use super::scenes::{EVERYWHERE, Lcg, Mesh, block, displacement_m, material, scene};
use super::{Extent, Family, Reference, Row, Table, statics};

const SIZE_M: [f64; 3] = [0.03, 0.04, 0.03];
const YOUNG_PA: f64 = 1e6;
const PRESSURE_PA: f64 = 1e4;

/// Axial and lateral strain of a block that is pulled at its ends, over p / E.
fn strains(poisson_ratio: f64, level: u8, parted: bool) -> Result<[f64; 2]> {
    // 6 x 8 x 6 voxels: from k = 4 on the outer cells are partly filled.
    let mut desc = block(SIZE_M, Mesh { voxel_m: 0.005, level }, material(YOUNG_PA, poisson_ratio));
    let pull =
        |face, sign: f64| LoadDesc::Traction { region: EVERYWHERE, face, traction_pa: [0.0, sign * PRESSURE_PA, 0.0] };
    desc.loads = vec![pull(Face::MaxY, 1.0), pull(Face::MinY, -1.0)];
    let mut body = statics::body(&scene(desc), statics::FREE_TAU_S)?;
    if parted {
        // Cracks along the pull carry nothing across: the stress stays uniform.
        part_at_random(&mut body, 250, |axis| axis != 1, &mut Lcg(1));
    }
    statics::settle(&mut body)?;
    let middle = Vec3::from(SIZE_M) * 0.5;
    let strain = |axis: usize| -> Result<f64> {
        let (mut low, mut high) = (middle, middle);
        (low[axis], high[axis]) = (0.0, SIZE_M[axis]);
        Ok((displacement_m(&body, high)? - displacement_m(&body, low)?)[axis] / SIZE_M[axis])
    };
    Ok([strain(1)?, strain(0)?].map(|e| e * YOUNG_PA / PRESSURE_PA))
}

/// The family.
///
/// # Errors
/// A body did not come to rest.
pub fn family(extent: Extent) -> Result<Family> {
    let levels = extent.of(&[0, 1, 2, 3], 3);
    let mut rows = Vec::new();
    for parted in [false, true] {
        for poisson in [0.0, 0.3, 0.49] {
            let found = levels.par_iter().map(|l| strains(poisson, *l, parted)).collect::<Result<Vec<_>>>()?;
            let cut = if parted { ", parted along the pull" } else { "" };
            for (i, (name, reference)) in [("E eps_y / p", 1.0), ("-E eps_x / p", poisson)].into_iter().enumerate() {
                let sign = if i == 0 { 1.0 } else { -1.0 };
                rows.push(Row {
                    case: format!("nu {poisson}{cut}: {name}"),
                    reference: if reference == 0.0 { Reference::Zero } else { Reference::Value(reference, "") },
                    ours: found.iter().map(|f| sign * f[i]).collect(),
                    source: "Hooke; Biot stress".into(),
                });
            }
        }
    }
    Ok(Family {
        title: "Uniaxial stress",
        text: "A free block of 6 x 8 x 6 voxels is pulled at its ends by a dead traction p = E / 100. Dead means that \
               its direction and size do not change. From k = 4 on the outer elements are half full. In the second \
               half of the table up to 250 links across the pull are cut at random; such cracks lie along the pull. \
               The law is linear in the stretch, so eps_y = p / E and eps_x = -nu p / E hold at any load."
            .into(),
        tables: vec![Table { columns: levels.iter().map(|l| format!("k {}", 1 << l)).collect(), rows }],
        ..Family::default()
    })
}

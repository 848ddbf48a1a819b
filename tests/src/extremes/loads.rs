//! Loads that collapse elements: gravity, tractions and body forces up to the most that a scene may have, and what is
//! left of the body when they are taken away.

use kerf_physics::scene::{Face, LoadDesc, ObjectDesc};
use kerf_physics::{SceneProblems, Vec3, verification};

use super::materials::parameters;
use super::scenes::{Specimen, everywhere};
use super::trial::{Measures, Return, Trial};
use super::verdict::findings;
use super::{Budget, Case, Family, Outcome};

/// Time under the load, in periods of the body.
const LOADED_PERIODS: f64 = 12.0;
/// Time after the load, in periods of the body. A cube that a traction of 0.5 E has folded lies close to a saddle of its
/// energy: what takes it away from there doubles every 20 ms, for eight periods, before it springs back.
const RELEASED_PERIODS: f64 = 24.0;

/// Pressures over E, by strain stiffening; the last is the most that is taken.
const LOADS_OVER_YOUNG: [(f64, [f64; 4]); 3] =
    [(0.0, [0.1, 0.2, 0.3, 0.5]), (3.0, [0.1, 0.5, 1.0, 1.5]), (10.0, [0.1, 0.5, 1.0, 1.5])];

/// Adds a load of `pressure_pa` on the block's foot to a scene.
type Load = fn(&Specimen, &mut ObjectDesc, f64) -> [f64; 3];

const LOADS: [(&str, Load); 4] = [
    ("gravity", |s, _, pressure_pa| [0.0, -pressure_pa / (s.density_kg_per_m3 * s.extent_m().y), 0.0]),
    ("pressed by a traction", |s, block, pressure_pa| traction(s, block, [0.0, -pressure_pa, 0.0])),
    ("drawn by a traction", |s, block, pressure_pa| traction(s, block, [0.0, pressure_pa, 0.0])),
    ("sheared by a body force", |s, block, pressure_pa| {
        let force_n_per_m3 = [pressure_pa / s.extent_m().y, 0.0, 0.0];
        block.loads.push(LoadDesc::BodyForce { region: everywhere(), force_n_per_m3 });
        [0.0; 3]
    }),
];

fn traction(_: &Specimen, block: &mut ObjectDesc, traction_pa: [f64; 3]) -> [f64; 3] {
    block.loads.push(LoadDesc::Traction { region: everywhere(), face: Face::MaxY, traction_pa });
    [0.0; 3]
}

pub(super) fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for (name, load) in LOADS {
        for (strain_stiffening, loads_over_young) in LOADS_OVER_YOUNG {
            for over_young in loads_over_young {
                let specimen = Specimen { strain_stiffening, ..Specimen::default() };
                let name = format!("{name}, {over_young} E, c {strain_stiffening}");
                cases.push(Case::new(Family::Loads, name, parameters(&specimen), move |budget| {
                    collapsed(&specimen, load, over_young, budget)
                }));
            }
        }
    }
    cases
}

/// The specimen under a load, then the same state without the load until it is back. Under the load rest is not asked
/// for: pressed beyond a fifth of E a cube buckles (Euler), and leans over for as long as it takes.
fn collapsed(specimen: &Specimen, load: Load, over_young: f64, budget: Budget) -> Result<Outcome, SceneProblems> {
    let mut block = specimen.held_block();
    let gravity_m_per_s2 = load(specimen, &mut block, over_young * specimen.young_modulus_pa);
    let mut scene = specimen.scene(block, 0);
    scene.desc.gravity_m_per_s2 = gravity_m_per_s2;
    let mut loaded = Trial::new(scene)?;
    loaded.let_go(specimen.period_s(), LOADED_PERIODS, budget.most_steps, Return::Anywhere);
    let squeezed: Vec<Vec3> =
        verification::state(loaded.world.bodies()[0]).position_m.iter().map(|x| Vec3::from(*x)).collect();
    let under_load = loaded.finish();
    let mut unloaded = Trial::new(specimen.scene(specimen.held_block(), 0))?;
    let mut node = 0;
    unloaded.start(|_| {
        node += 1;
        (squeezed[node - 1], Vec3::zeros())
    });
    unloaded.let_go(specimen.period_s(), RELEASED_PERIODS, budget.most_steps, Return::ToItsPlace);
    let seen = unloaded.finish();
    // The row tells of the release; what went wrong under the load is told beside it.
    let wrong = findings(&Measures { rest: None, ..under_load });
    let wrong = wrong.iter().map(|f| format!("under load: {f}")).collect();
    Ok(Outcome { seen, wrong })
}

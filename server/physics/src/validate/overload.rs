//! What the loads on an object ask of its elements.
//!
//! A dead load goes on pushing however far the tissue has given way. Beyond a stress of the order of E elements
//! collapse under it, and what was one shape at rest becomes another, or none.

use crate::Vec3;
use crate::scene::toughness::{LEAST_STIFFENING, stiffens};
use crate::scene::{LoadDesc, MaterialDesc, ObjectDesc};

/// Stress over E up to which a material carries a dead load, linear and stiffened: blocks under gravity, pressed,
/// drawn and sheared make no energy, and are at rest and back in shape when they are let go (`make extremes`).
/// Linear ones stay turned through their foot from E on; those that stiffen by 3 or 10 go on moving under the load from
/// 2 E on; energy is made from 5 and 10 E on.
const CARRIED_OVER_YOUNG: [f64; 2] = [0.5, 1.5];

/// Stress up to which a material carries a dead load, Pa.
fn carried_pa(material: &MaterialDesc) -> f64 {
    CARRIED_OVER_YOUNG[usize::from(stiffens(material))] * material.young_modulus_pa
}

/// A load that is more than any material of its object carries.
pub(super) struct Overload {
    /// The stress that it comes to, Pa.
    pub(super) stress_pa: f64,
    /// What the material that carries most carries, Pa.
    pub(super) carried_pa: f64,
}

/// What an object of this extent asks of its elements.
pub(super) struct Loaded<'a> {
    pub(super) object: &'a ObjectDesc,
    pub(super) extent_m: Vec3,
}

impl Loaded<'_> {
    fn over(&self, stress_pa: f64) -> Option<Overload> {
        // Which of them carries it is not known before there are voxels.
        let carried_pa = self.object.materials().map(carried_pa).fold(0.0, f64::max);
        (stress_pa > carried_pa).then_some(Overload { stress_pa, carried_pa })
    }

    /// Whether one of its loads is too much.
    pub(super) fn by(&self, load: &LoadDesc) -> Option<Overload> {
        match load {
            LoadDesc::Traction { traction_pa, .. } => self.over(Vec3::from(*traction_pa).norm()),
            LoadDesc::BodyForce { force_n_per_m3, .. } => self.by_body_force(Vec3::from(*force_n_per_m3)),
        }
    }

    /// Whether its weight is.
    pub(super) fn by_gravity(&self, gravity_m_per_s2: &[f64; 3]) -> Option<Overload> {
        self.by_body_force(Vec3::from(*gravity_m_per_s2) * self.object.material.density_kg_per_m3)
    }

    /// A force per volume adds up over the extent, if something holds on at the other end.
    fn by_body_force(&self, force_n_per_m3: Vec3) -> Option<Overload> {
        let stress_pa = force_n_per_m3.component_mul(&self.extent_m).norm();
        if self.object.fixed.is_empty() { None } else { self.over(stress_pa) }
    }
}

impl Overload {
    /// What to say of it, after what loads the object.
    pub(super) fn message(&self, loads: &str) -> String {
        format!(
            "{loads} with {:.4e} Pa, more than the {:.4e} Pa up to which its elements keep their shape ({} E, from a \
             strain_stiffening of {LEAST_STIFFENING} on {} E)",
            self.stress_pa, self.carried_pa, CARRIED_OVER_YOUNG[0], CARRIED_OVER_YOUNG[1]
        )
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::{Scene, SceneDesc};

    /// A cube of 0.1 m, E 10 kPa, 1000 kg/m^3, on its foot.
    fn problems(gravity: f64, material: &str, rest: &str) -> Vec<String> {
        let text = format!(
            "version = 1\nname = 'cube'\ngravity_m_per_s2 = [0.0, {gravity}, 0.0]\n[[objects]]\nname = 'cube'\n\
             shape = {{ box = {{ min_m = [0.0, 0.0, 0.0], max_m = [0.1, 0.1, 0.1] }} }}\nvoxel_size_m = 0.01\n\
             material = {{ young_modulus_pa = 1e4, poisson_ratio = 0.4, density_kg_per_m3 = 1000.0{material} }}\n{rest}"
        );
        let desc = SceneDesc::from_toml("cube.toml", &text).expect("the text of a scene");
        Scene { desc, meshes: Default::default() }.problems().iter().map(ToString::to_string).collect()
    }

    const FOOT: &str = "fixed = [{ box = { min_m = [-1.0, -1.0, -1.0], max_m = [1.0, 0.01, 1.0] } }]\n";

    #[test]
    fn weight_is_refused_beyond_half_of_e_where_something_holds_the_object() {
        assert_eq!(problems(-49.0, "", FOOT), [""; 0]);
        let [refused] = &problems(-51.0, "", FOOT)[..] else { panic!("one problem") };
        let starts = "gravity_m_per_s2: the weight of `cube` loads it with 5.1000e3 Pa, more than the 5.0000e3 Pa";
        assert!(refused.starts_with(starts), "{refused}");
        assert_eq!(problems(-51.0, "", ""), [""; 0], "it falls");
        assert_eq!(problems(-149.0, ", strain_stiffening = 3.0", FOOT), [""; 0]);
        assert_eq!(problems(-151.0, ", strain_stiffening = 3.0", FOOT).len(), 1);
    }

    #[test]
    fn a_load_is_refused_where_no_material_of_its_object_carries_it() {
        let traction = |pa: f64| {
            format!(
                "loads = [{{ traction = {{ region = {{ box = {{ min_m = [-1.0, -1.0, -1.0], max_m = [1.0, 1.0, 1.0] }} }}, \
                 face = 'max_y', traction_pa = [0.0, {pa}, 0.0] }} }}]\n"
            )
        };
        assert_eq!(problems(0.0, "", &traction(4.9e3)), [""; 0]);
        let [refused] = &problems(0.0, "", &traction(-5.1e3))[..] else { panic!("one problem") };
        assert!(
            refused.starts_with("objects[0].loads[0]: it loads the object with 5.1000e3 Pa, more than"),
            "{refused}"
        );
        let stiff = "[[objects.regions]]\nname = 'stiff'\nshape = { sphere = { center_m = [0.0, 0.0, 0.0], radius_m = \
                     0.02 } }\nmaterial = { young_modulus_pa = 2e4, poisson_ratio = 0.4 }\n";
        assert_eq!(problems(0.0, "", &(traction(-5.1e3) + stiff)), [""; 0]);
        let force = traction(5.1e4).replace("traction =", "body_force =").replace("face = 'max_y', ", "");
        let force = force.replace("traction_pa", "force_n_per_m3");
        assert_eq!(problems(0.0, "", &(force + FOOT)).len(), 1);
    }
}

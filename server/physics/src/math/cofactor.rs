//! What a deformation does to areas.

use super::Mat3;

/// `det(F) F^-T`: what the deformation gradient F takes an area times its normal to (Nanson). Outward it stays outward,
/// also where F crushes the material flat or turns it inside out, where `F^-T` is infinite and points inward.
#[must_use]
pub fn cofactor(f: &Mat3) -> Mat3 {
    let [a, b, c] = [f.column(0), f.column(1), f.column(2)];
    Mat3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;

    #[test]
    fn a_normal_looks_outward_however_far_the_material_is_pressed_through_itself() {
        for squeeze in [0.7, 1e-3, 0.0, -0.2, -1.0] {
            let f = Mat3::from_diagonal(&Vec3::new(1.1, squeeze, 0.9));
            let top = cofactor(&f) * Vec3::y();
            assert!(top.y > 0.0 && top.x == 0.0 && top.z == 0.0, "{squeeze}: {top}");
        }
    }

    #[test]
    fn it_is_the_determinant_times_the_inverse_transposed() {
        let f = Mat3::new(1.2, 0.3, -0.1, 0.2, 0.8, 0.4, -0.3, 0.1, 1.1);
        let expected = f.try_inverse().expect("regular").transpose() * f.determinant();
        assert!((cofactor(&f) - expected).amax() < 1e-15);
    }
}

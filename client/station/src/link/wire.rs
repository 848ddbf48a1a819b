//! From the wire's messages to the servo's and back.

use kerf_proto::v1;
use kerf_script::Pose;
use nalgebra::{Matrix6, Quaternion, UnitQuaternion, Vector3};

use crate::servo::model::{Along, Give, LocalModel};

/// A message that lacks what the protocol requires.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the server sent a contact without {0}")]
pub struct Missing(&'static str);

/// The contact as the servo evaluates it; `None`: nothing is touched. Numbers that are none stay so: the servo is who
/// looks at them.
pub fn model(contact: &v1::Contact) -> Result<Option<LocalModel>, Missing> {
    let force_n = vector(contact.wrench.and_then(|wrench| wrench.force_n)).ok_or(Missing("wrench.force_n"))?;
    let Some(model) = &contact.model else { return Ok(None) };
    let reference = model.reference.and_then(pose).ok_or(Missing("model.reference"))?;
    let stiffness = symmetric(&model.stiffness).ok_or(Missing("model.stiffness"))?;
    let damping = symmetric(&model.damping).ok_or(Missing("model.damping"))?;
    let velocity_m_per_s = vector(model.velocity_m_per_s).ok_or(Missing("model.velocity_m_per_s"))?;
    let is_holding = contact.flags & v1::ContactFlag::Holding as u32 != 0;
    let along = match (model.force_cap_n, vector(model.cap_direction)) {
        _ if is_holding => Along::Holds,
        (Some(cap_n), Some(direction)) => {
            let give = model.gives_at_n.map(|at_n| Give { at_n: at_n.into(), left_n: model.force_cap_given_n.into() });
            Along::Yields { direction, cap_n: f64::from(cap_n), give }
        }
        (Some(_), None) => return Err(Missing("model.cap_direction")),
        (None, _) => Along::Pushes,
    };
    Ok(Some(LocalModel {
        reference,
        force_n,
        stiffness_n_per_m: stiffness.fixed_view::<3, 3>(0, 0).into(),
        turning_n_per_rad: stiffness.fixed_view::<3, 3>(0, 3).into(),
        velocity_m_per_s,
        damping_n_s_per_m: damping.fixed_view::<3, 3>(0, 0).into(),
        along,
    }))
}

/// A pose as it is sent, within the box that tools must stay in.
pub fn pose_to_wire(pose: &Pose, workspace: Option<[v1::Vec3; 2]>) -> v1::Pose {
    let mut wire = kerf_load::wire::pose_to_wire(pose);
    if let (Some([min, max]), Some(p)) = (workspace, &mut wire.position_m) {
        *p = v1::Vec3 { x: p.x.clamp(min.x, max.x), y: p.y.clamp(min.y, max.y), z: p.z.clamp(min.z, max.z) };
    }
    wire
}

fn vector(vector: Option<v1::Vec3>) -> Option<Vector3<f64>> {
    vector.map(|v| Vector3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z)))
}

fn pose(pose: v1::Pose) -> Option<Pose> {
    let v1::Quat { x, y, z, w } = pose.orientation?;
    let quaternion = Quaternion::new(f64::from(w), f64::from(x), f64::from(y), f64::from(z));
    Some(Pose { position_m: vector(pose.position_m)?, orientation: UnitQuaternion::new_normalize(quaternion) })
}

/// The matrix of 21 entries of an upper triangle, row by row.
fn symmetric(upper: &[f32]) -> Option<Matrix6<f64>> {
    let mut entries = upper.iter().map(|entry| f64::from(*entry));
    let mut matrix = Matrix6::zeros();
    for row in 0..6 {
        for column in row..6 {
            let entry = entries.next()?;
            (matrix[(row, column)], matrix[(column, row)]) = (entry, entry);
        }
    }
    Some(matrix)
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    fn contact() -> v1::Contact {
        let zero = Some(v1::Vec3::default());
        let orientation = Some(v1::Quat { x: 0.0, y: 0.0, z: 0.0, w: 1.0 });
        let model = v1::ContactModel {
            reference: Some(v1::Pose { position_m: zero, orientation }),
            stiffness: (0..21).map(|i| i as f32).collect(),
            damping: (0..21).map(|i| 0.5 * i as f32).collect(),
            velocity_m_per_s: zero,
            ..Default::default()
        };
        let wrench = Some(v1::Wrench { force_n: Some(v1::Vec3 { x: 0.0, y: 1.0, z: 0.0 }), torque_nm: zero });
        v1::Contact { wrench, model: Some(model), ..Default::default() }
    }

    #[test]
    fn the_triangle_is_read_row_by_row() {
        let model = model(&contact()).unwrap().unwrap();
        // xx xy xz xa xb xc, yy yz ya yb yc, zz za zb zc
        assert_eq!(model.stiffness_n_per_m, Matrix3::new(0.0, 1.0, 2.0, 1.0, 6.0, 7.0, 2.0, 7.0, 11.0));
        assert_eq!(model.turning_n_per_rad, Matrix3::new(3.0, 4.0, 5.0, 8.0, 9.0, 10.0, 12.0, 13.0, 14.0));
        assert_eq!(model.damping_n_s_per_m, 0.5 * model.stiffness_n_per_m);
        assert_eq!(model.along, Along::Pushes);
    }

    #[test]
    fn poses_stay_in_the_box_that_tools_must_stay_in() {
        let corner = |of: f32| v1::Vec3 { x: of, y: of, z: of };
        let pose = Pose { position_m: Vector3::new(0.5, -2.0, 2.0), orientation: UnitQuaternion::identity() };
        let sent = |workspace| pose_to_wire(&pose, workspace).position_m;
        assert_eq!(sent(Some([corner(-1.0), corner(1.0)])), Some(v1::Vec3 { x: 0.5, y: -1.0, z: 1.0 }));
        assert_eq!(sent(None), Some(v1::Vec3 { x: 0.5, y: -2.0, z: 2.0 }));
    }

    #[test]
    fn what_is_missing_is_named_and_what_is_no_number_is_left_to_the_servo() {
        let without = |change: fn(&mut v1::Contact)| {
            let mut contact = contact();
            change(&mut contact);
            model(&contact)
        };
        assert_eq!(without(|contact| contact.wrench = None), Err(Missing("wrench.force_n")));
        assert_eq!(without(|c| c.model.as_mut().unwrap().reference = None), Err(Missing("model.reference")));
        assert_eq!(without(|c| c.model.as_mut().unwrap().stiffness.truncate(20)), Err(Missing("model.stiffness")));
        assert_eq!(without(|c| c.model.as_mut().unwrap().damping.truncate(20)), Err(Missing("model.damping")));
        let capped = without(|c| c.model.as_mut().unwrap().force_cap_n = Some(1.0));
        assert_eq!(capped, Err(Missing("model.cap_direction")));
        assert_eq!(without(|contact| contact.model = None), Ok(None));
        let beginning = without(|c| {
            let model = c.model.as_mut().unwrap();
            (model.force_cap_n, model.cap_direction) = (Some(2.0), Some(v1::Vec3 { x: 0.0, y: 1.0, z: 0.0 }));
            (model.gives_at_n, model.force_cap_given_n) = (Some(1.75), 1.0);
        });
        let give = Some(Give { at_n: 1.75, left_n: 1.0 });
        assert_eq!(beginning.unwrap().unwrap().along, Along::Yields { direction: Vector3::y(), cap_n: 2.0, give });
        let broken = without(|c| c.model.as_mut().unwrap().stiffness[0] = f32::NAN).unwrap().unwrap();
        assert!(!broken.is_finite());
    }
}

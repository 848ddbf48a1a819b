//! Haply's Inverse3, with a stand-in for the vendor's service.

mod service;

use std::time::{Duration, Instant};

use kerf_station::config::HaplyConfig;
use kerf_station::device::{Device, haply::Haply};
use nalgebra::{UnitQuaternion, Vector3};

use self::service::Service;
use crate::probe::{push, run_until};

fn config(service: &Service, device_id: Option<&str>) -> HaplyConfig {
    HaplyConfig { url: service.url.clone(), device_id: device_id.map(Into::into) }
}

#[test]
fn poses_come_in_and_forces_go_out_in_the_omnis_frame() {
    let service = Service::start();
    // A quarter turn about the service's z, which is up: ours about y.
    service.world().orientation_wxyz = [0.5_f64.sqrt(), 0.0, 0.0, 0.5_f64.sqrt()];
    let mut device = Haply::open(&config(&service, None)).unwrap();
    assert_eq!(device.info().name, "Haply inverse3 049D");
    assert_eq!(device.firmware(), Some("8C20FDC8"));
    let (seen, outcome) = run_until(&mut device, push, || service.world().forces_n.len() > 30);
    assert_eq!(outcome, Ok(()));
    let (_, last) = seen.last().unwrap();
    // Up is y, away from the user is -z.
    assert_eq!(last.position_m, Vector3::new(0.01, 0.15, 0.12));
    assert_eq!(last.velocity_m_per_s, Vector3::new(0.1, 0.3, -0.2));
    let expected = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
    assert!(last.orientation.angle_to(&expected) < 1e-7, "{last:?}");
    assert_eq!((last.buttons, last.hold), (0b10, None));
    let world = service.world();
    assert_eq!((world.forces_n[0], world.forces_n[1]), ([0.0; 3], [0.0, 0.0, 1.0]));
    assert_eq!(world.forces_n.last(), Some(&[0.0; 3]), "the service goes on with the last force");
    // One message for each call of the servo, and the one that clears.
    assert_eq!(world.forces_n.len(), seen.len() + 1);
    assert_eq!(world.profiles, ["kerf-station"]);
}

#[test]
fn the_connection_is_closed_when_the_device_is_let_go() {
    let service = Service::start();
    drop(Haply::open(&config(&service, None)).unwrap());
    let begun = Instant::now();
    while !service.world().is_closed {
        assert!(begun.elapsed() < Duration::from_secs(2));
        std::thread::yield_now();
    }
}

#[test]
fn no_force_is_told_to_an_arm_that_is_not_calibrated() {
    let service = Service::start();
    service.world().is_calibrated = false;
    let mut device = Haply::open(&config(&service, Some("049D"))).unwrap();
    let (seen, _) = run_until(&mut device, push, || service.world().forces_n.len() > 30);
    assert!(seen[0].1.hold.unwrap().contains("not calibrated"));
    assert!(service.world().forces_n.iter().all(|force_n| *force_n == [0.0; 3]));
}

#[test]
fn a_force_is_cut_off_at_the_arms_greatest() {
    let service = Service::start();
    let mut device = Haply::open(&config(&service, None)).unwrap();
    let too_much = |_: &_| Vector3::new(30.0, 0.0, 40.0);
    run_until(&mut device, too_much, || service.world().forces_n.len() > 10).1.unwrap();
    assert!((Vector3::from(service.world().forces_n[5]) - Vector3::new(3.0, -4.0, 0.0)).norm() < 1e-12);
}

#[test]
fn an_arm_that_goes_and_a_service_that_falls_silent_are_told() {
    let service = Service::start();
    let mut device = Haply::open(&config(&service, None)).unwrap();
    let unplug = || {
        let mut world = service.world();
        world.is_present = world.forces_n.len() < 10;
        false
    };
    let text = run_until(&mut device, push, unplug).1.unwrap_err().to_string();
    assert!(text.contains("Haply inverse3 049D at ws://") && text.contains("the arm is gone"), "{text}");
    assert_eq!(service.world().forces_n.last(), Some(&[0.0; 3]));
    drop(device);
    service.world().is_present = true;
    let mut device = Haply::open(&config(&service, None)).unwrap();
    service.world().is_silent = true;
    let text = run_until(&mut device, push, || false).1.unwrap_err().to_string();
    assert!(text.contains("has not answered for 200 ms") && text.contains("Inverse service"), "{text}");
}

#[test]
fn what_was_tried_is_told_where_there_is_no_service_or_no_such_arm() {
    let nowhere = HaplyConfig { url: "ws://127.0.0.1:1".into(), device_id: None };
    let text = Haply::open(&nowhere).err().unwrap().to_string();
    assert!(text.contains("ws://127.0.0.1:1: the service does not answer: ") && text.contains("Hub"), "{text}");
    let service = Service::start();
    let text = Haply::open(&config(&service, Some("0000"))).err().unwrap().to_string();
    assert!(text.contains("no arm `0000`; it knows [\"049D\"]"), "{text}");
}

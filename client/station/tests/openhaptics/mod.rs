//! Devices of OpenHaptics, with a stand-in for the vendor's library.

pub mod library;

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use kerf_stand_in_hd::{Device as Simulated, code};
use kerf_station::config::OpenHapticsConfig;
use kerf_station::device::openhaptics::OpenHaptics;
use kerf_station::device::{Device, DeviceState};
use nalgebra::{Matrix3, Rotation3, Vector3};

use self::library::StandIn;
use crate::probe::{push, run_until};

fn open_failed(config: &OpenHapticsConfig) -> String {
    OpenHaptics::open(config).err().expect("no device").to_string()
}

#[test]
fn poses_come_in_and_forces_go_out_in_si_units() {
    let turn = Rotation3::from_euler_angles(0.3, -0.5, 1.1);
    let mut simulated = Simulated::new("Default Device");
    (simulated.position_mm, simulated.velocity_mm_per_s) = ([10.0, -20.0, 30.0], [100.0, 0.0, -50.0]);
    simulated.buttons = 0b10;
    let columns: &Matrix3<f64> = turn.matrix();
    (0..9).for_each(|i| simulated.transform[i / 3 * 4 + i % 3] = columns[(i % 3, i / 3)]);
    let library = StandIn::new(&[simulated]);
    let mut device = OpenHaptics::open(&library.config(None)).unwrap();
    assert_eq!(device.info().name, "PHANTOM Omni 10402100017");
    assert_eq!((device.info().peak_force_n, device.info().max_stiffness_n_per_m), (3.3, 500.0));
    assert_eq!((device.info().rate_hz, device.info().workspace_m[1].x), (1000.0, 0.08));
    let is_pushed = || library.world().devices[0].force_n == [0.0, 1.0, 0.0];
    let (seen, outcome) = run_until(&mut device, push, is_pushed);
    assert_eq!(outcome, Ok(()));
    let (_, last) = seen.last().unwrap();
    assert_eq!(last.hold, None);
    assert!((last.position_m - Vector3::new(0.01, -0.02, 0.03)).norm() < 1e-12, "{last:?}");
    assert!((last.velocity_m_per_s - Vector3::new(0.1, 0.0, -0.05)).norm() < 1e-12, "{last:?}");
    assert!(last.orientation.to_rotation_matrix().angle_to(&turn) < 1e-7, "{last:?}");
    assert_eq!(last.buttons, 0b10);
    drop(device);
    let world = library.world();
    assert_eq!(world.history, [0; 0], "a call was against the rules");
    assert!(world.devices[0].greatest_force_n == 1.0 && world.devices[0].force_n == [0.0; 3]);
    assert!(!world.is_running() && !world.devices[0].is_open);
}

#[test]
fn nothing_is_rendered_for_the_first_50_ms() {
    let library = StandIn::new(&[Simulated::new("Default Device")]);
    let mut device = OpenHaptics::open(&library.config(None)).unwrap();
    let (seen, _) = run_until(&mut device, push, || library.world().devices[0].force_n[1] > 0.0);
    let held = seen.iter().take_while(|(_, state)| state.hold.is_some()).last().unwrap().0 - seen[0].0;
    assert!(held >= 45_000_000, "{held} ns");
}

#[test]
fn a_device_bears_no_more_than_its_greatest_force() {
    let library = StandIn::new(&[Simulated::new("Default Device")]);
    let mut device = OpenHaptics::open(&library.config(None)).unwrap();
    let too_much = |_: &DeviceState| Vector3::new(30.0, 0.0, 40.0);
    let (_, outcome) = run_until(&mut device, too_much, || library.world().devices[0].force_n[0] > 0.0);
    assert_eq!(outcome, Ok(()));
    assert!((library.world().devices[0].greatest_force_n - 3.3).abs() < 1e-12);
    let frames = library.world().devices[0].frames;
    let no_number = |_: &DeviceState| Vector3::repeat(f64::NAN);
    let (_, outcome) = run_until(&mut device, no_number, || library.world().devices[0].frames > frames + 150);
    assert_eq!(outcome, Ok(()));
    assert!((library.world().devices[0].greatest_force_n - 3.3).abs() < 1e-12);
}

#[test]
fn an_uncalibrated_device_says_what_to_do_and_pushes_nobody() {
    let mut simulated = Simulated::new("Default Device");
    simulated.calibration = code::CALIBRATION_NEEDS_MANUAL_INPUT;
    let library = StandIn::new(&[simulated]);
    let mut device = OpenHaptics::open(&library.config(None)).unwrap();
    let (seen, _) = run_until(&mut device, push, || library.world().devices[0].frames > 150);
    assert!(seen.last().unwrap().1.hold.unwrap().contains("put the stylus into the inkwell"));
    assert_eq!(library.world().devices[0].greatest_force_n, 0.0);
    // The stylus is in the inkwell: the calibration is to be taken over, and forces come.
    library.world().devices[0].calibration = code::CALIBRATION_NEEDS_UPDATE;
    let (_, outcome) = run_until(&mut device, push, || library.world().devices[0].force_n[1] > 0.0);
    assert_eq!(outcome, Ok(()));
    assert_eq!(library.world().devices[0].greatest_force_n, 1.0);
    assert_eq!(library.world().history, [0; 0]);
}

#[test]
fn encoders_are_reset_before_the_scheduler_runs() {
    let mut simulated = Simulated::new("Default Device");
    (simulated.calibration, simulated.calibration_style) = (code::CALIBRATION_NEEDS_UPDATE, 1);
    let library = StandIn::new(&[simulated]);
    let _device = OpenHaptics::open(&library.config(None)).unwrap();
    assert_eq!(library.world().devices[0].calibration, code::CALIBRATION_OK);
    assert_eq!(library.world().history, [0; 0]);
}

#[test]
fn a_device_that_is_said_to_be_in_use_is_asked_again() {
    let mut simulated = Simulated::new("Default Device");
    simulated.refusals = 2;
    let library = StandIn::new(&[simulated]);
    OpenHaptics::open(&library.config(None)).unwrap();
    library.world().devices[0].refusals = u32::MAX;
    let text = open_failed(&library.config(Some("Default Device")));
    assert!(
        text.contains("\"Default Device\": Device already initialized (error 0x301, internal -1), asked 4 x"),
        "{text}"
    );
    assert!(text.contains("close the other program"), "{text}");
}

#[test]
fn what_was_tried_is_told_where_no_device_answers() {
    let library = StandIn::new(&[]);
    let text = open_failed(&library.config(None));
    for expected in
        ["the default: Device fault (error 0x300", "\"Default Device\": ", "\"Default PHANToM\": ", "setup tool"]
    {
        assert!(text.contains(expected), "{expected}: {text}");
    }
}

#[test]
fn a_device_that_is_unplugged_in_contact_is_let_go_and_named() {
    let library = StandIn::new(&[Simulated::new("Default Device")]);
    let mut device = OpenHaptics::open(&library.config(None)).unwrap();
    let unplug = || {
        let mut world = library.world();
        world.devices[0].is_plugged &= world.devices[0].force_n[1] == 0.0;
        false
    };
    let (_, outcome) = run_until(&mut device, push, unplug);
    let text = outcome.unwrap_err().to_string();
    assert!(text.starts_with("PHANTOM Omni 10402100017: Communication error (error 0x302"), "{text}");
    assert!(text.contains("check the cable and the power"), "{text}");
    assert_eq!(library.world().devices[0].force_n, [0.0; 3]);
    // It is plugged in again and opened again.
    drop(device);
    library.world().devices[0].is_plugged = true;
    let mut device = OpenHaptics::open(&library.config(None)).unwrap();
    let (_, outcome) = run_until(&mut device, push, || library.world().devices[0].force_n[1] > 0.0);
    assert_eq!((outcome, library.world().devices[0].greatest_force_n), (Ok(()), 1.0));
}

#[test]
fn warm_motors_hold_the_force_back_but_do_not_end_the_device() {
    let library = StandIn::new(&[Simulated::new("Default Device")]);
    let mut device = OpenHaptics::open(&library.config(None)).unwrap();
    let warm = AtomicBool::new(false);
    let until = || {
        let mut world = library.world();
        if world.devices[0].force_n[1] > 0.0 && !warm.swap(true, Ordering::Relaxed) {
            world.fail(code::WARM_MOTORS, 0);
        }
        world.devices[0].frames > 300
    };
    let (seen, outcome) = run_until(&mut device, push, until);
    assert_eq!(outcome, Ok(()));
    assert!(seen.iter().any(|(_, state)| state.hold.is_some_and(|words| words.contains("motors are too warm"))));
    assert_eq!(library.world().errors, []);
}

#[test]
fn errors_do_not_pile_up_and_each_device_gets_its_own() {
    let library = StandIn::new(&[Simulated::new("left"), Simulated::new("right")]);
    let mut left = OpenHaptics::open(&library.config(Some("left"))).unwrap();
    let mut right = OpenHaptics::open(&library.config(Some("right"))).unwrap();
    thread::scope(|scope| {
        let far = scope.spawn(|| {
            let until = || {
                let mut world = library.world();
                let are_both = world.devices.iter().all(|device| device.force_n[1] > 0.0);
                world.devices[1].is_plugged &= !are_both;
                false
            };
            run_until(&mut right, push, until).1
        });
        let (_, outcome) = run_until(&mut left, push, || !library.world().devices[1].is_plugged && far.is_finished());
        assert_eq!(outcome, Ok(()), "the left device goes on");
        assert!(far.join().unwrap().unwrap_err().what.contains("Communication error"));
    });
    assert!(library.world().devices.iter().all(|device| device.force_n == [0.0; 3]));
    assert_eq!(library.world().errors, []);
    // The one that is left goes on when the other is put away.
    drop(right);
    assert_eq!(run_until(&mut left, push, || library.world().devices[0].force_n[1] > 0.0).1, Ok(()));
}

#[test]
fn the_true_rate_of_a_slow_scheduler_reaches_the_servo() {
    let library = StandIn::new(&[Simulated::new("Default Device")]);
    library.world().rate_hz = 400.0;
    let mut device = OpenHaptics::open(&library.config(None)).unwrap();
    assert_eq!(device.info().rate_hz, 400.0);
    let (seen, _) = run_until(&mut device, push, || library.world().devices[0].frames > 80);
    let period_ns = (seen.last().unwrap().0 - seen[0].0) / (seen.len() as u64 - 1);
    assert!(period_ns >= 2_400_000, "{period_ns} ns");
}

#[test]
fn a_panic_in_the_servo_ends_in_zero_force_and_a_word() {
    let library = StandIn::new(&[Simulated::new("Default Device")]);
    let mut device = OpenHaptics::open(&library.config(None)).unwrap();
    let mut ticks = 0;
    let answer = |_: &DeviceState| {
        ticks += 1;
        if ticks == 100 {
            // As a panic, but without a backtrace, which on a busy machine takes longer than the driver waits.
            std::panic::resume_unwind(Box::new("a servo's mistake"));
        }
        Vector3::y()
    };
    let (_, outcome) = run_until(&mut device, answer, || false);
    assert_eq!(outcome.unwrap_err().what, "the servo panicked");
    assert_eq!(library.world().devices[0].force_n, [0.0; 3]);
}

#[cfg(target_os = "linux")]
#[test]
fn what_was_tried_is_told_where_there_is_no_library() {
    let at = |file: &std::path::Path| OpenHapticsConfig { library: Some(file.into()), name: None };
    let text = open_failed(&at("/nowhere/libHD.so".as_ref()));
    assert!(text.contains("/nowhere/libHD.so: ") && text.contains("No such file"), "{text}");
    assert!(text.contains("set `library`"), "{text}");
    // No machine of ours has the vendor's library.
    let text = open_failed(&OpenHapticsConfig::default());
    assert!(
        text.contains("libHD.so: ") && text.contains("libHD.so.3.4: ") && text.contains("libHD.so.3.0: "),
        "{text}"
    );
    let library = StandIn::new(&[]);
    let wrong = library.file.with_file_name("wrong.so");
    std::fs::copy(std::env::current_exe().unwrap(), &wrong).unwrap();
    assert!(open_failed(&at(&wrong)).contains("wrong.so: "));
}

#[cfg(target_os = "linux")]
#[test]
fn a_library_without_the_symbols_is_named_as_such() {
    let text = open_failed(&OpenHapticsConfig { library: Some("libm.so.6".into()), name: None });
    assert!(
        text.contains("libm.so.6: is a library, but not the vendor's: it has no hdInitDevice, no hdDisable"),
        "{text}"
    );
}

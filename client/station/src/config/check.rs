//! What values may be.

use std::ops::RangeInclusive;

use super::{DeviceConfig, DeviceKind, MappingConfig, StationConfig};

impl StationConfig {
    /// Every value that is not within its limits, with field and limit.
    pub(super) fn faults(&self) -> Vec<String> {
        let Self { server, link, devices } = self;
        let mut faults = Faults::default();
        faults.check("link.pose_rate_hz", link.pose_rate_hz, 10.0..=2000.0, "Hz");
        faults.check("link.contact_rate_hz", link.contact_rate_hz, 10.0..=1000.0, "Hz");
        faults.check("link.deadband", link.deadband, 0.0..=0.5, "");
        faults.check("link.keep_alive_s", link.keep_alive_s, 1e-3..=1.0, "s");
        faults.check("link.silence_s", link.silence_s, 0.1..=60.0, "s");
        if !["http://", "https://"].iter().any(|scheme| server.url.starts_with(scheme)) {
            faults.0.push(format!("server.url: `{}` does not begin with http:// or https://", server.url));
        }
        faults.check("devices", devices.len() as f64, 1.0..=8.0, "devices");
        for (index, device) in devices.iter().enumerate() {
            faults.device(&format!("devices[{index}]"), device);
        }
        faults.0
    }
}

#[derive(Default)]
struct Faults(Vec<String>);

impl Faults {
    fn check(&mut self, field: &str, value: f64, limits: RangeInclusive<f64>, unit: &str) {
        if !limits.contains(&value) {
            let text = format!("{field}: {value} is not between {} and {} {unit}", limits.start(), limits.end());
            self.0.push(text.trim_end().to_owned());
        }
    }

    fn device(&mut self, at: &str, device: &DeviceConfig) {
        let field = |name: &str| format!("{at}.{name}");
        let servo = &device.servo;
        let max_stiffness = servo.max_stiffness_n_per_m.unwrap_or(servo.min_stiffness_n_per_m);
        self.check(&field("servo.max_force_n"), servo.max_force_n.unwrap_or(1.0), 0.0..=1e3, "N");
        self.check(&field("servo.min_stiffness_n_per_m"), servo.min_stiffness_n_per_m, 1.0..=1e4, "N/m");
        let least = servo.min_stiffness_n_per_m;
        self.check(&field("servo.max_stiffness_n_per_m"), max_stiffness, least..=1e9, "N/m");
        self.check(&field("servo.slew_n_per_s"), servo.slew_n_per_s, 1.0..=1e5, "N/s");
        self.check(&field("servo.ramp_s"), servo.ramp_s, 0.01..=10.0, "s");
        self.check(&field("servo.fade_s"), servo.fade_s, 0.005..=1.0, "s");
        self.mapping(&field("mapping"), &device.mapping);
        for (index, button) in device.buttons.iter().enumerate() {
            self.check(&field(&format!("buttons[{index}].button")), f64::from(button.button), 0.0..=31.0, "");
        }
        match &device.kind {
            DeviceKind::Simulated(simulated) => {
                let hand = &simulated.hand;
                let field = |name: &str| field(&format!("kind.simulated.{name}"));
                self.check(&field("mass_kg"), simulated.mass_kg, 0.01..=10.0, "kg");
                self.check(&field("friction_n"), simulated.friction_n, 0.0..=10.0, "N");
                self.check(&field("resolution_m"), simulated.resolution_m, 0.0..=1e-3, "m");
                self.check(&field("hand.stiffness_n_per_m"), hand.stiffness_n_per_m, 0.0..=5e3, "N/m");
                self.check(&field("hand.damping_n_s_per_m"), hand.damping_n_s_per_m, 0.0..=100.0, "N s/m");
                self.check(&field("hand.tremor_m"), hand.tremor_m, 0.0..=0.01, "m");
                for (index, point) in hand.path.iter().enumerate() {
                    let after = index.checked_sub(1).map_or(f64::NEG_INFINITY, |before| hand.path[before][0]);
                    let is_in_order = point.iter().all(|number| number.is_finite()) && point[0] > after;
                    if !is_in_order || point[0] < 0.0 {
                        self.0.push(format!(
                            "{}: {point:?} is not finite, or its time does not come after {after} s",
                            field(&format!("hand.path[{index}]"))
                        ));
                    }
                }
                for (index, press) in hand.presses.iter().enumerate() {
                    let name = field(&format!("hand.presses[{index}].button"));
                    self.check(&name, f64::from(press.button), 0.0..=31.0, "");
                }
            }
            DeviceKind::OpenHaptics(_) => {}
            #[cfg(unix)]
            DeviceKind::Gamepad(gamepad) => {
                self.check(&field("kind.gamepad.speed_m_per_s"), gamepad.speed_m_per_s, 1e-3..=1.0, "m/s");
            }
            #[cfg(unix)]
            DeviceKind::Mouse(mouse) => self.check(&field("kind.mouse.cell_m"), mouse.cell_m, 1e-5..=0.1, "m"),
            DeviceKind::Haply(haply) => {
                if !haply.url.starts_with("ws://") {
                    self.0.push(format!("{}: `{}` does not begin with ws://", field("kind.haply.url"), haply.url));
                }
            }
            DeviceKind::Recorded(recorded) => {
                self.check(&field("kind.recorded.speed"), recorded.speed, 0.01..=100.0, "");
            }
        }
    }

    fn mapping(&mut self, at: &str, mapping: &MappingConfig) {
        self.check(&format!("{at}.scale"), mapping.scale, 1e-3..=1e3, "");
        self.check(&format!("{at}.force_scale"), mapping.force_scale, 1e-6..=1e3, "");
        let lists = [
            ("device_origin_m", mapping.device_origin_m),
            ("scene_origin_m", mapping.scene_origin_m),
            ("tool_orientation_rad", mapping.tool_orientation_rad),
        ];
        for (name, values) in lists {
            for (index, value) in values.into_iter().enumerate() {
                self.check(&format!("{at}.{name}[{index}]"), value, -10.0..=10.0, "");
            }
        }
        // Left-handed axes would mirror the tool's turns.
        if (mapping.axes_matrix().determinant() - 1.0).abs() > 1e-9 {
            self.0.push(format!(
                "{at}.axes: {:?} is no rotation; each axis has to come once, and the third has to be the \
                 first turned towards the second by the right hand",
                mapping.axes
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    fn refused(text: &str) -> String {
        StationConfig::from_toml("station.toml", text).expect_err("refused").to_string()
    }

    #[test]
    fn nothing_is_a_configuration() {
        assert_eq!(StationConfig::from_toml("", "").unwrap(), StationConfig::default());
    }

    #[test]
    fn faults_name_field_and_limit() {
        for (text, expected) in [
            ("[link]\npose_rate_hz = 5000", "link.pose_rate_hz: 5000 is not between 10 and 2000 Hz"),
            ("[link]\npose_rat_hz = 5", "link.pose_rat_hz: unknown field `pose_rat_hz`"),
            ("[link]\npose_rat_hz = 5", "did you mean `pose_rate_hz`?"),
            ("[[devices]]\n[devices.kind.simulatd]\n", "did you mean `simulated`?"),
            ("[[devices]]\n[[devices.buttons]]\nbutton = 1\naction = 'cluch'", "did you mean `clutch`?"),
            ("[[devices]]\n[devices.mapping]\naxes = ['x', 'z', 'y']", "devices[0].mapping.axes: "),
            ("[[devices]]\n[devices.mapping]\naxes = ['x', 'x', 'y']", "is no rotation"),
            ("[server]\nurl = 'localhost'", "server.url: `localhost` does not begin with http:// or https://"),
            ("[[devices]]\n[devices.kind.simulated.hand]\npath = [[1, 0, 0, 0], [1, 0, 0, 0]]", "hand.path[1]"),
            ("[[devices]]\n[devices.servo]\nmax_stiffness_n_per_m = 5", "not between 20 and"),
            ("[[devices]]\n[devices.servo]\nramp_s = 'long'", "devices[0].servo.ramp_s: invalid type: string \"long\""),
            ("[link\n", "station.toml: "),
        ] {
            assert!(refused(text).contains(expected), "{text}: {}", refused(text));
        }
    }

    #[test]
    fn the_schema_takes_what_the_program_takes_and_describes_every_field() {
        let schema = serde_json::to_value(schemars::schema_for!(StationConfig)).unwrap();
        let validator = jsonschema::validator_for(&schema).unwrap();
        let value = |text: &str| toml::from_str::<Value>(text).unwrap();
        assert!(validator.is_valid(&serde_json::to_value(StationConfig::default()).unwrap()));
        assert!(validator.is_valid(&value("[[devices]]\n[devices.kind.recorded]\nfile = 'a.csv'")));
        assert!(!validator.is_valid(&value("[link]\npose_rat_hz = 5")));
        fn undescribed(at: &str, value: &Value, found: &mut Vec<String>) {
            let Value::Object(map) = value else { return };
            if let Some(Value::Object(properties)) = map.get("properties") {
                let bare = properties.iter().filter(|(_, property)| property.get("description").is_none());
                found.extend(bare.map(|(name, _)| format!("{at}.{name}")));
            }
            map.iter().for_each(|(key, value)| undescribed(&format!("{at}.{key}"), value, found));
        }
        let mut found = Vec::new();
        undescribed("", &schema, &mut found);
        assert_eq!(found, [""; 0]);
    }
}

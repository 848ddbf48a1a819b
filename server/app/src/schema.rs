//! `kerf-server schema`: the format of a scene as a JSON schema, for editors and for programs that write
//! scenes.

use anyhow::Result;
use kerf_physics::SceneDesc;
use schemars::schema_for;

/// Prints the schema. It says which fields there are and of what type; the ranges of their values are in
/// their descriptions, and `check` holds a scene against them.
///
/// # Errors
/// None that a test does not exclude.
pub fn run() -> Result<()> {
    println!("{}", text()?);
    Ok(())
}

fn text() -> Result<String> {
    Ok(serde_json::to_string_pretty(&schema_for!(SceneDesc))?)
}

#[cfg(test)]
mod tests {
    use jsonschema::Validator;
    use serde_json::Value;

    use super::*;

    const BLOCK: &str = "version = 1\nname = 'block'\n\
        [[objects]]\nname = 'block'\nvoxel_size_m = 0.01\n\
        shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.1, 0.1, 0.1] } }\n\
        material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }\n";

    fn validator() -> Validator {
        jsonschema::validator_for(&serde_json::from_str(&text().unwrap()).unwrap()).unwrap()
    }

    fn scene(text: &str) -> Value {
        toml::from_str(text).unwrap()
    }

    #[test]
    fn builtin_scenes_are_of_the_schema() {
        let validator = validator();
        for entry in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../scenes/builtin")).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "toml") {
                continue;
            }
            let scene = scene(&std::fs::read_to_string(&path).unwrap());
            let errors: Vec<String> = validator.iter_errors(&scene).map(|e| e.to_string()).collect();
            assert_eq!(errors, [""; 0], "{}", path.display());
        }
    }

    #[test]
    fn what_a_scene_file_is_refused_for_its_form_is_not_of_the_schema() {
        let validator = validator();
        assert!(validator.is_valid(&scene(BLOCK)));
        for (right, wrong) in [
            ("poisson_ratio = 0.4", "poisson = 0.4"),
            (", poisson_ratio = 0.4", ""),
            ("voxel_size_m = 0.01", "voxel_size_m = 'small'"),
            ("[0.0, 0.0, 0.0]", "[0.0, 0.0]"),
            ("box =", "cube ="),
            ("name = 'block'\nvoxel", "level = 300\nname = 'block'\nvoxel"),
        ] {
            let text = BLOCK.replace(right, wrong);
            assert_ne!(text, BLOCK, "{right}");
            assert!(!validator.is_valid(&scene(&text)), "{wrong}");
            assert!(SceneDesc::from_toml("block.toml", &text).is_err(), "{wrong}");
        }
    }

    #[test]
    fn tools_of_every_kind_are_of_the_schema() {
        let validator = validator();
        for (shape, is_valid) in [
            ("blade = { width_m = 0.05, height_m = 0.02 }", true),
            ("grasper = { radius_m = 0.005, max_force_n = 2.0 }", true),
            ("probe = { radius_m = 0.005, length_m = 0.02 }", true),
            ("scissors = { blade_length_m = 0.04, blade_height_m = 0.01, max_angle_rad = 0.8 }", true),
            ("scissors = { blade_length_m = 0.04 }", false),
            ("grasper = { radius_m = 0.005, jaws = 2 }", false),
            ("saw = { width_m = 0.05 }", false),
        ] {
            let text = format!("{BLOCK}[[tools]]\nname = 'tool'\nshape = {{ {shape} }}\n");
            assert_eq!(validator.is_valid(&scene(&text)), is_valid, "{shape}");
            assert_eq!(SceneDesc::from_toml("block.toml", &text).is_ok(), is_valid, "{shape}");
        }
    }

    #[test]
    fn every_field_is_described() {
        fn undescribed(at: &str, value: &Value, found: &mut Vec<String>) {
            let Value::Object(map) = value else { return };
            if let Some(Value::Object(properties)) = map.get("properties") {
                for (name, property) in properties {
                    if property.get("description").is_none() {
                        found.push(format!("{at}.{name}"));
                    }
                }
            }
            map.iter().for_each(|(key, value)| undescribed(&format!("{at}.{key}"), value, found));
        }
        let schema: Value = serde_json::from_str(&text().unwrap()).unwrap();
        let mut found = Vec::new();
        undescribed("", &schema, &mut found);
        assert_eq!(found, [""; 0]);
    }
}

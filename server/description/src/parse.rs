//! From TOML text to a [`SceneDesc`], with the place of what does not fit.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::wording::did_you_mean;
use super::{SCENE_VERSION, SceneDesc, SceneError};

impl SceneDesc {
    /// Reads a scene. Unknown fields are refused; values are not judged (see `kerf_physics::Scene::judge`).
    /// `file` is only used to name the place of an error.
    ///
    /// # Errors
    /// [`SceneError::InFile`] with file, line, column and field of the first thing that does not fit.
    pub fn from_toml(file: &str, text: &str) -> Result<Self, SceneError> {
        let syntax_error = |e: toml::de::Error| parse_error(file, text, "syntax", &e);
        // A file of another version would drown its reader in unknown fields: look at that first.
        let table = DeTable::parse(text).map_err(syntax_error)?;
        if let Some(DeValue::Integer(version)) = table.get_ref().get("version").map(Spanned::get_ref)
            && u32::from_str_radix(version.as_str(), version.radix()) != Ok(SCENE_VERSION)
        {
            let message = format!("version {version} is not supported; this program reads {SCENE_VERSION}");
            return Err(SceneError::Field { field: format!("{file}: version"), message });
        }
        serde_path_to_error::deserialize(toml::Deserializer::from(table))
            .map_err(|e| parse_error(file, text, &e.path().to_string(), e.inner()))
    }
}

fn parse_error(file: &str, text: &str, path: &str, error: &toml::de::Error) -> SceneError {
    let (line, column) = line_and_column(text, error.span().map_or(0, |span| span.start));
    let field = if path == "." { "scene" } else { path };
    SceneError::InFile {
        file: file.to_owned(),
        line,
        column,
        field: field.to_owned(),
        message: in_plain_words(&error.message().trim_end().replace('\n', "; ")),
    }
}

/// What a reader of TOML says, in words that a scene's author knows, and with the name that was probably meant.
fn in_plain_words(message: &str) -> String {
    const TYPES: [(&str, &str); 7] = [
        ("expected f64", "expected a number"),
        ("expected u8", "expected a whole number"),
        ("expected u16", "expected a whole number"),
        ("expected u32", "expected a whole number"),
        ("expected struct ", "expected a table with the fields of "),
        ("expected a sequence", "expected a list"),
        ("invalid type: floating point", "invalid type: number"),
    ];
    let plain = TYPES.iter().fold(message.to_owned(), |text, (theirs, ours)| text.replace(theirs, ours));
    // "unknown field `x`, expected one of `a`, `b`"
    let mut names = message.split('`').skip(1).step_by(2);
    match names.next().filter(|_| message.starts_with("unknown")) {
        Some(word) => plain + &did_you_mean(word, names),
        None => plain,
    }
}

impl SceneError {
    /// The same with its place in the text of the file that the scene was read from: the field's, or that of the
    /// table where the field is missing.
    #[must_use]
    pub fn placed(self, file: &str, text: &str) -> Self {
        let Self::Field { field, message } = self else { return self };
        let Some(offset) = offset_of(text, &field) else { return Self::Field { field, message } };
        let (line, column) = line_and_column(text, offset);
        Self::InFile { file: file.to_owned(), line, column, field, message }
    }
}

/// Where the value of a field such as `objects[0].material.level` begins, or the last table on the way to it.
fn offset_of(text: &str, field: &str) -> Option<usize> {
    let document = DeTable::parse(text).ok()?;
    let names = field.split(['.', '[']).map(|name| name.trim_end_matches(']'));
    let mut found = None;
    let mut table = Some(document.get_ref());
    let mut list = None;
    for name in names {
        let value = match (table, list) {
            (Some(table), _) => table.get(name),
            (None, Some(list)) => <_ as AsRef<[_]>>::as_ref(list).get(name.parse::<usize>().ok()?),
            (None, None) => None,
        };
        let Some(value) = value else { break };
        found = Some(value.span().start);
        (table, list) = match value.get_ref() {
            DeValue::Table(inner) => (Some(inner), None),
            DeValue::Array(inner) => (None, Some(inner)),
            _ => (None, None),
        };
    }
    found
}

/// Line and column (in characters) of a byte offset, both from 1.
fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = r#"
version = 1
name = "block"
[[objects]]
name = "block"
shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.1, 0.1, 0.1] } }
voxel_size_m = 0.01
[objects.material]
young_modulus_pa = 1e5
poisson_ratio = 0.4
"#;

    fn place(text: &str) -> (usize, String, String) {
        match SceneDesc::from_toml("block.toml", text).unwrap_err() {
            SceneError::InFile { file, line, field, message, .. } => {
                assert_eq!(file, "block.toml");
                (line, field, message)
            }
            other => panic!("{other}"),
        }
    }

    #[test]
    fn a_minimal_scene_gets_the_documented_defaults() {
        let scene = SceneDesc::from_toml("block.toml", SCENE).unwrap();
        assert_eq!(scene.rate_hz, 1000.0);
        assert_eq!(scene.gravity_m_per_s2, [0.0; 3]);
        assert_eq!((scene.solver.relative_tolerance, scene.relative_tolerance()), (None, 1e-3));
        assert_eq!(scene.solver.max_iterations, 200);
        let object = &scene.objects[0];
        assert_eq!(object.level, 2);
        assert_eq!(object.material.density_kg_per_m3, 1000.0);
        assert_eq!(object.material.initiation_ratio, 2.0);
        assert_eq!(object.material.strain_stiffening, 0.0);
        assert_eq!(object.material.fracture_energy_j_per_m2, None);
    }

    #[test]
    fn a_scene_survives_the_way_through_toml() {
        let scene = SceneDesc::from_toml("block.toml", SCENE).unwrap();
        let text = toml::to_string(&scene).unwrap();
        assert_eq!(SceneDesc::from_toml("again.toml", &text).unwrap(), scene);
    }

    #[test]
    fn an_unknown_field_is_named_with_its_line() {
        let (line, field, message) = place(&SCENE.replace("poisson_ratio", "poisson"));
        assert_eq!(line, 10);
        assert!(field.starts_with("objects[0].material"), "{field}");
        assert!(message.contains("unknown field `poisson`") && message.contains("`poisson_ratio`"), "{message}");
    }

    #[test]
    fn a_wrong_type_is_named_with_its_field() {
        let (line, field, message) = place(&SCENE.replace("1e5", "\"stiff\""));
        assert_eq!((line, field.as_str()), (9, "objects[0].material.young_modulus_pa"));
        assert!(message.contains("expected a number"), "{message}");
    }

    #[test]
    fn a_value_that_is_refused_is_placed_in_its_file() {
        let place = |field: &str| {
            let error = SceneError::Field { field: field.into(), message: "is wrong".into() };
            error.placed("block.toml", SCENE).to_string()
        };
        assert_eq!(
            place("objects[0].material.poisson_ratio"),
            "block.toml:10:17: objects[0].material.poisson_ratio: is wrong"
        );
        assert!(
            place("objects[0].shape.box.max_m").starts_with("block.toml:6:52: "),
            "{}",
            place("objects[0].shape.box.max_m")
        );
        // What is not stated is looked for in its table.
        assert!(place("objects[0].material.initiation_ratio").starts_with("block.toml:8:1: "));
        assert_eq!(place("rate_hz"), "rate_hz: is wrong");
    }

    #[test]
    fn a_name_that_was_probably_meant_is_suggested() {
        let (.., message) = place(&SCENE.replace("voxel_size_m", "voxel_sise_m"));
        assert!(message.ends_with("; did you mean `voxel_size_m`?"), "{message}");
        let (.., message) = place(&SCENE.replace("{ box", "{ bx"));
        assert!(message.ends_with("; did you mean `box`?"), "{message}");
    }

    #[test]
    fn an_unknown_shape_lists_the_known_ones() {
        let (line, field, message) = place(&SCENE.replace("{ box", "{ cone"));
        assert_eq!(line, 6);
        assert!(field.starts_with("objects[0].shape"), "{field}");
        assert!(message.contains("`cone`") && message.contains("`smooth_union`"), "{message}");
    }

    #[test]
    fn an_unknown_field_inside_a_shape_is_named() {
        let (line, field, message) = place(&SCENE.replace("max_m", "upper_m"));
        assert_eq!(line, 6);
        assert!(field.starts_with("objects[0].shape.box"), "{field}");
        assert!(message.contains("upper_m") && message.contains("max_m"), "{message}");
    }

    #[test]
    fn a_missing_field_is_named_with_its_table() {
        let (_, field, message) = place(&SCENE.replace("poisson_ratio = 0.4", ""));
        assert_eq!(field, "objects[0].material");
        assert!(message.contains("missing field `poisson_ratio`"), "{message}");
    }

    #[test]
    fn broken_toml_is_told_with_its_line() {
        let (line, field, _) = place(&SCENE.replace("[[objects]]", "[[objects"));
        assert_eq!((line, field.as_str()), (4, "syntax"));
    }

    #[test]
    fn another_version_is_refused_before_its_fields() {
        let text = SCENE.replace("version = 1", "version = 2\nfuture = true");
        let error = SceneDesc::from_toml("block.toml", &text).unwrap_err();
        assert!(error.to_string().contains("version 2 is not supported"), "{error}");
    }
}

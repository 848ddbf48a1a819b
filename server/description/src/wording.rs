//! How a value that is refused is told: shortly, in its unit, and with what was probably meant.

/// A number in at most six digits: what a reader takes in, without the rounding errors behind them.
#[must_use]
pub fn brief(value: f64) -> String {
    in_digits(value, 6)
}

/// A number as it was given, which may differ little from a limit.
#[must_use]
pub fn given(value: f64) -> String {
    in_digits(value, 12)
}

fn in_digits(value: f64, digits: usize) -> String {
    let rounded: f64 = format!("{value:.*e}", digits - 1).parse().unwrap_or(value);
    let is_plain = rounded == 0.0 || (1e-4..1e6).contains(&rounded.abs());
    if is_plain { rounded.to_string() } else { format!("{rounded:e}") }
}

/// The end of a field's name, the unit that it stands for, and units that are often written instead, with their
/// size. Longer ends stand before shorter ones.
type Unit = (&'static str, &'static str, &'static [(&'static str, f64)]);
const UNITS: [Unit; 10] = [
    ("_kg_per_m3", " kg/m^3", &[("g/cm^3", 1e3)]),
    ("_j_per_m2", " J/m^2", &[("kJ/m^2", 1e3)]),
    ("_m_per_s", " m/s", &[("mm/s", 1e-3)]),
    ("_per_s", " 1/s", &[]),
    ("_pa", " Pa", &[("kPa", 1e3), ("MPa", 1e6), ("GPa", 1e9)]),
    ("_hz", " Hz", &[("kHz", 1e3)]),
    ("_rad", " rad", &[("degrees", std::f64::consts::PI / 180.0)]),
    ("_m", " m", &[("mm", 1e-3), ("um", 1e-6)]),
    ("_s", " s", &[("ms", 1e-3)]),
    ("_n", " N", &[("mN", 1e-3)]),
];

fn unit(field: &str) -> Option<&'static Unit> {
    let name = field.rsplit('.').next().unwrap_or(field);
    let name = name.split('[').next().unwrap_or(name);
    UNITS.iter().find(|(end, ..)| name.ends_with(end))
}

/// That a field's value is out of a range, with its unit and the value in it that was probably meant.
#[must_use]
pub fn out_of_range(field: &str, value: f64, least: f64, most: f64) -> String {
    let unit = unit(field);
    let name = unit.map_or("", |(_, name, _)| name);
    let message = format!("{} is not between {} and {}{name}", given(value), given(least), given(most));
    let others = unit.map_or(&[][..], |(.., others)| others);
    match others.iter().find(|(_, size)| (least..=most).contains(&(value * size))) {
        Some((other, size)) => {
            format!("{message}; if {} {other} is meant, write {}", given(value), brief(value * size))
        }
        None => message,
    }
}

/// `; did you mean ...?` where one of the names is much like the word, else nothing.
#[must_use]
pub fn did_you_mean<'a>(word: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    // A third of the letters may be wrong, or the word is the beginning of the name.
    let is_like = |(distance, name): &(usize, &str)| {
        3 * distance <= name.chars().count().max(3) || (word.len() >= 3 && name.starts_with(word))
    };
    let distances = names.into_iter().map(|name| (strsim::damerau_levenshtein(word, name), name));
    distances.filter(is_like).min().map_or(String::new(), |(_, name)| format!("; did you mean `{name}`?"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_told_without_rounding_errors() {
        let told = [0.0026000000000000003, 1e10, 5.0, -0.1 - 0.2, 0.0, 1.0 / 3.0].map(brief);
        assert_eq!(told, ["0.0026", "1e10", "5", "-0.3", "0", "0.333333"]);
    }

    #[test]
    fn a_value_in_another_unit_is_recognised() {
        let told = out_of_range("objects[0].material.young_modulus_pa", 18.0, 1e2, 1e10);
        assert_eq!(told, "18 is not between 100 and 1e10 Pa; if 18 kPa is meant, write 18000");
        let told = out_of_range("objects[0].voxel_size_m", 3.5, 1e-5, 1.0);
        assert_eq!(told, "3.5 is not between 1e-5 and 1 m; if 3.5 mm is meant, write 0.0035");
        let told = out_of_range("tools[0].shape.scissors.max_angle_rad", 40.0, 0.1, 2.0);
        assert_eq!(told, "40 is not between 0.1 and 2 rad; if 40 degrees is meant, write 0.698132");
        assert_eq!(out_of_range("objects[0].level", 7.0, 0.0, 4.0), "7 is not between 0 and 4");
        assert_eq!(out_of_range("x.semi_axes_m[2]", -1.0, 0.0, 4.0), "-1 is not between 0 and 4 m");
    }

    #[test]
    fn only_a_name_that_is_much_like_the_word_is_suggested() {
        let names = ["liver", "two-organs", "poisson_ratio"];
        for (word, meant) in [("livre", "liver"), ("two_organs", "two-organs"), ("poisson", "poisson_ratio")] {
            assert_eq!(did_you_mean(word, names), format!("; did you mean `{meant}`?"));
        }
        assert_eq!(did_you_mean("kidney", names), "");
    }
}

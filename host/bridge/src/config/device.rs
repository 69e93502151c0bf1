//! The microcontroller's settings as TOML, in people's units (N, N/s, mm, ratios): for files and recordings. Pure.
//!
//! The wire has whole numbers only; a value is rounded to the nearest. Settings that a file leaves out stay as they are.

use std::fmt::Write as _;

use gripline_pipeline::GripSetting;
use gripline_protocol::configuration::{CONFIGURATION_VALUES, Configuration, OutOfRange, Values};
use gripline_protocol::line::LineKind;
use gripline_protocol::{LSB_PER_NEWTON, PER_UNIT};
use toml::{Table, Value};

use crate::value::nearest;

/// (name in the file, the wire's steps per unit of the file), in the order of [`Values`].
const KEYS: [(&str, f64); CONFIGURATION_VALUES] = {
    const N: f64 = LSB_PER_NEWTON as f64;
    const ONE: f64 = PER_UNIT as f64;
    // The wire's step is 1/4096 N per millisecond.
    const N_PER_S: f64 = N / 1_000.0;
    const MM: f64 = 1_000.0;
    [
        ("sensors", 1.0),
        ("friction", ONE),
        ("friction_max", ONE),
        ("contact_min_n", N),
        ("slip_threshold", ONE),
        ("slip_leave", ONE),
        ("incipient_threshold", ONE),
        ("incipient_horizon_ms", 1.0),
        ("dwell_ms", 1.0),
        ("margin", ONE),
        ("floor_n", N),
        ("ceiling_n", N),
        ("fail_safe_n", N),
        ("reflex_target", ONE),
        ("reflex_rate_n_per_s", N_PER_S),
        ("rise_rate_n_per_s", N_PER_S),
        ("relax_rate_n_per_s", N),
        ("relax_after_ms", 1.0),
        ("release_rate_n_per_s", N_PER_S),
        ("stale_ms", 1.0),
        ("link_lost_ms", 1.0),
        ("line.kind", 1.0),
        ("line.points[0].force_n", N),
        ("line.points[0].code", 1.0),
        ("line.points[1].force_n", N),
        ("line.points[1].code", 1.0),
        ("line.points[2].force_n", N),
        ("line.points[2].code", 1.0),
        ("line.points[3].force_n", N),
        ("line.points[3].code", 1.0),
        ("line.points[4].force_n", N),
        ("line.points[4].code", 1.0),
        ("fingertips[0].pitch_mm", MM),
        ("fingertips[0].centre_mm[0]", MM),
        ("fingertips[0].centre_mm[1]", MM),
        ("fingertips[0].quarter_turns", 1.0),
        ("fingertips[1].pitch_mm", MM),
        ("fingertips[1].centre_mm[0]", MM),
        ("fingertips[1].centre_mm[1]", MM),
        ("fingertips[1].quarter_turns", 1.0),
    ]
};

/// Former names, which files and recordings may still use, and the current ones.
const FORMER: [(&str, &str); 2] = [("friction_most", "friction_max"), ("tighten_n", "fail_safe_n")];

/// One name for margin, maximum friction, relaxation rate and, of the secure one, the floor: a [`GripSetting`].
const GRIP: &str = "grip";

/// Names of the kinds of line.
const KINDS: [(&str, LineKind); 2] = [
    ("analog", LineKind::Analog),
    ("robotiq-2f-140", LineKind::Robotiq2f140),
];

/// The settings as a file's text.
pub(crate) fn settings_text(settings: &Configuration) -> String {
    let values = settings.values();
    let value = |name: &str| {
        let place = KEYS.iter().position(|(key, _)| *key == name).unwrap_or_default();
        let (_, scale) = KEYS[place];
        shown(f64::from(values[place]) / scale, scale)
    };
    let mut text = String::new();
    for (name, _) in KEYS.iter().filter(|(name, _)| !name.contains(['.', '['])) {
        let _ = writeln!(text, "{name} = {}", value(name));
    }
    let kind = KINDS
        .iter()
        .find(|(_, kind)| *kind == settings.line.kind)
        .map_or("", |(name, _)| name);
    let _ = writeln!(text, "\n[line]\nkind = \"{kind}\"\npoints = [");
    for place in 0..settings.line.points.len() {
        let [force, code] = ["force_n", "code"].map(|part| value(&format!("line.points[{place}].{part}")));
        let _ = writeln!(text, "    {{ force_n = {force}, code = {code} }},");
    }
    text.push_str("]\n");
    for tip in 0..settings.fingertips.len() {
        let [pitch, x, y, turns] = ["pitch_mm", "centre_mm[0]", "centre_mm[1]", "quarter_turns"]
            .map(|part| value(&format!("fingertips[{tip}].{part}")));
        let _ = writeln!(
            text,
            "\n[[fingertips]]\npitch_mm = {pitch}\ncentre_mm = [{x}, {y}]\nquarter_turns = {turns}"
        );
    }
    text
}

/// Whether the file holds the wire's whole number itself.
fn is_whole(scale: f64) -> bool {
    (scale - 1.0).abs() < f64::EPSILON
}

/// A number with as many digits as it needs to read back as the same number on the wire.
fn shown(value: f64, scale: f64) -> String {
    if is_whole(scale) {
        return format!("{value:.0}");
    }
    (1..9)
        .map(|digits| format!("{value:.digits$}"))
        .find(|text| {
            text.parse::<f64>()
                .is_ok_and(|read| ((read - value) * scale).abs() < 0.4)
        })
        .unwrap_or_else(|| format!("{value}"))
}

/// The settings `now` changed by a file's text, checked.
///
/// # Errors
/// What is wrong with it.
pub(crate) fn settings_from_text(text: &str, now: &Configuration) -> Result<Configuration, String> {
    let table: Table = text
        .parse()
        .map_err(|error: toml::de::Error| error.message().to_owned())?;
    applied(&table, now)
}

/// The settings `now` changed by a table, checked.
///
/// # Errors
/// Everything that is wrong with names and types, or the first value out of its range.
pub(super) fn applied(table: &Table, now: &Configuration) -> Result<Configuration, String> {
    let mut values = now.values();
    let errors = set_all(table, &mut values);
    if !errors.is_empty() {
        return Err(errors.join("; "));
    }
    let settings = Configuration::from_values(&values).ok_or("a value that fits no setting")?;
    settings.check().map_err(|error| explained(&error))?;
    Ok(settings)
}

/// What is wrong with a table's names and types; ranges depend on what else is in force.
pub(super) fn errors_in(table: &Table) -> Vec<String> {
    set_all(table, &mut Configuration::DEFAULT.values())
}

fn set_all(table: &Table, values: &mut Values) -> Vec<String> {
    let mut errors = Vec::new();
    let grip = table.get(GRIP).and_then(|value| {
        let setting = value.as_str().and_then(GripSetting::named);
        if setting.is_none() {
            errors.push(format!("{GRIP}: found {value}, expected {}", grip_names()));
        }
        setting
    });
    let set_own = |values: &mut Values, errors: &mut Vec<String>| {
        for (name, value) in table.iter().filter(|(name, _)| *name != GRIP) {
            set(name, value, values, errors);
        }
    };
    set_own(values, &mut errors);
    if let (Some(setting), Some(settings)) = (grip, Configuration::from_values(values)) {
        *values = setting.apply(settings).values();
        // What stands by itself overrules the name's; its errors are known.
        set_own(values, &mut Vec::new());
    }
    errors
}

/// The named settings of the grip, as an error lists them.
fn grip_names() -> String {
    GripSetting::ALL.map(|(name, _)| format!("\"{name}\"")).join(", ")
}

/// Settings that are neither in a table nor in a list.
pub(super) fn plain_names() -> impl Iterator<Item = &'static str> {
    KEYS.iter()
        .map(|(name, _)| *name)
        .filter(|name| !name.contains(['.', '[']))
}

/// The value of a plain setting from an environment variable.
///
/// # Errors
/// What was found and what was expected.
pub(super) fn value_of(name: &str, text: &str) -> Result<Value, String> {
    let whole = text.parse().map(Value::Integer);
    let value = whole
        .or_else(|_| text.parse().map(Value::Float))
        .map_err(|_| format!("found {text}, expected a number"))?;
    let scale = KEYS
        .iter()
        .find(|(key, _)| *key == name)
        .map_or(1.0, |(_, scale)| *scale);
    number(name, &value, scale)?;
    Ok(value)
}

/// The default settings, one a line, as they can stand in a section of another file.
pub(super) fn default_lines() -> impl Iterator<Item = String> {
    let table: Table = settings_text(&Configuration::DEFAULT).parse().unwrap_or_default();
    let line = |(name, value): (String, Value)| match value {
        // A line for each part of a table: who sets one need not repeat the others.
        Value::Table(parts) => parts
            .into_iter()
            .map(|(part, value)| format!("{name}.{part} = {value}"))
            .collect::<Vec<_>>(),
        value => vec![format!("{name} = {value}")],
    };
    table.into_iter().flat_map(line)
}

/// Sets a value, or all in it; what is wrong goes to `errors`.
fn set(name: &str, value: &Value, values: &mut Values, errors: &mut Vec<String>) {
    match value {
        Value::Table(table) => {
            for (part, value) in table {
                set(&format!("{name}.{part}"), value, values, errors);
            }
        }
        Value::Array(list) => {
            for (place, value) in list.iter().enumerate() {
                set(&format!("{name}[{place}]"), value, values, errors);
            }
        }
        _ => match KEYS.iter().position(|(key, _)| *key == current(name)) {
            Some(place) => match number(name, value, KEYS[place].1) {
                Ok(wire) => values[place] = wire,
                Err(error) => errors.push(format!("{name}: {error}")),
            },
            None => errors.push(match nearest(name, KEYS.iter().map(|(key, _)| *key)) {
                Some(meant) => format!("{name}: no such setting, did you mean {meant}?"),
                None => format!("{name}: no such setting; `gripline config mcu` prints all there are"),
            }),
        },
    }
}

/// The setting's current name.
fn current(name: &str) -> &str {
    FORMER
        .iter()
        .find(|(former, _)| *former == name)
        .map_or(name, |(_, current)| current)
}

/// The wire's number for a value.
fn number(name: &str, value: &Value, scale: f64) -> Result<i32, String> {
    let expected = |what: &str| format!("found {value}, expected {what}");
    if name == "line.kind" {
        let kind = KINDS.iter().find(|(kind, _)| value.as_str() == Some(kind));
        return kind
            .map(|(_, kind)| *kind as i32)
            .ok_or_else(|| expected("\"analog\" or \"robotiq-2f-140\""));
    }
    let number = match value {
        Value::Integer(whole) => *whole as f64,
        Value::Float(number) if !is_whole(scale) => *number,
        _ if is_whole(scale) => return Err(expected("a whole number")),
        _ => return Err(expected("a number")),
    };
    let wire = (number * scale).round();
    if wire.abs() <= f64::from(u16::MAX) * 16.0 {
        Ok(wire as i32)
    } else {
        Err(expected("something the wire can carry"))
    }
}

/// A refusal in the file's own names and units.
fn explained(error: &OutOfRange) -> String {
    let (name, scale) = KEYS[usize::from(error.field).min(CONFIGURATION_VALUES - 1)];
    let [found, min, max] =
        [error.found, error.min, error.max].map(|wire| shown(f64::from(wire) / scale, scale));
    format!("{name}: found {found}, expected {min} to {max}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use gripline_protocol::message::LinePoint;

    fn odd() -> Configuration {
        let mut settings = Configuration {
            sensors: 2,
            friction: 4_321,
            contact_min: 61,
            floor: 41_003,
            fail_safe: 51_337,
            reflex_rate: 163,
            ..Configuration::DEFAULT
        };
        settings.line.kind = LineKind::Robotiq2f140;
        settings.line.points[1] = LinePoint {
            force: 40_961,
            code: 1_600,
        };
        settings.fingertips[1].centre_um = [-1_234, 5];
        settings.fingertips[1].quarter_turns = 2;
        settings
    }

    #[test]
    fn one_name_chooses_the_grip_and_what_stands_by_itself_overrules_it() {
        let secure = settings_from_text("grip = \"secure\"", &odd()).unwrap();
        assert_eq!(secure, GripSetting::Secure.apply(odd()));
        let gentle =
            settings_from_text("grip = \"secure\"\nfail_safe_n = 5", &Configuration::DEFAULT).unwrap();
        assert_eq!(gentle.floor, gentle.fail_safe, "the secure floor");
        let own = settings_from_text("grip = \"sparing\"\nmargin = 0.25", &odd()).unwrap();
        let sparing = GripSetting::Sparing.apply(odd());
        assert_eq!(
            own,
            Configuration {
                margin: 2_500,
                ..sparing
            }
        );
        let refused = settings_from_text("grip = \"tight\"", &odd()).unwrap_err();
        assert_eq!(
            refused,
            "grip: found \"tight\", expected \"sparing\", \"normal\", \"secure\""
        );
    }

    #[test]
    fn what_is_printed_reads_back_as_the_same_settings() {
        for settings in [Configuration::DEFAULT, odd()] {
            let text = settings_text(&settings);
            assert_eq!(
                settings_from_text(&text, &Configuration::DEFAULT),
                Ok(settings),
                "{text}"
            );
        }
    }

    #[test]
    fn former_names_are_still_read() {
        let settings = settings_from_text("friction_most = 0.8\ntighten_n = 12.0", &odd()).unwrap();
        let expected = Configuration {
            friction_max: 8_000,
            fail_safe: 12 * LSB_PER_NEWTON,
            ..odd()
        };
        assert_eq!(settings, expected);
    }

    #[test]
    fn what_a_file_leaves_out_stays_as_it_is() {
        let settings = settings_from_text("margin = 0.25\nline.kind = \"analog\"", &odd()).unwrap();
        let mut expected = odd();
        expected.margin = 2_500;
        expected.line.kind = LineKind::Analog;
        assert_eq!(settings, expected);
    }

    #[test]
    fn the_default_lines_are_the_default_settings() {
        let text: String = default_lines().map(|line| line + "\n").collect();
        assert_eq!(
            settings_from_text(&text, &odd()),
            Ok(Configuration::DEFAULT),
            "{text}"
        );
    }

    #[test]
    fn the_names_are_those_of_the_wire_with_their_units() {
        for ((key, _), field) in KEYS.iter().zip(Configuration::FIELDS) {
            let part = |name: &str| name.split(['.', '[']).next_back().unwrap_or_default().to_owned();
            let (key, field) = (part(key), part(field).replace("_um", "_mm"));
            assert!(key.starts_with(&field), "{key} stands for {field}");
        }
    }

    #[test]
    fn a_refusal_names_the_setting_and_speaks_the_files_units() {
        let refused = |text: &str| settings_from_text(text, &Configuration::DEFAULT).unwrap_err();
        assert_eq!(
            refused("ceiling_n = 41"),
            "ceiling_n: found 41.0, expected 0.0002 to 40.0"
        );
        assert_eq!(
            refused("friction = 2.5"),
            "friction: found 2.5, expected 0.0 to 2.0"
        );
        assert_eq!(
            refused("sensors = \"two\""),
            "sensors: found \"two\", expected a whole number"
        );
        assert_eq!(
            refused("line.kind = \"pneumatic\""),
            "line.kind: found \"pneumatic\", expected \"analog\" or \"robotiq-2f-140\""
        );
        assert!(refused("frictoin = 0.4").starts_with("frictoin: no such setting"));
        assert!(refused("friction = 1e9").contains("the wire can carry"));
        assert_eq!(
            refused("frictoin = 0.4\nmargin = true"),
            "frictoin: no such setting, did you mean friction?; margin: found true, expected a number"
        );
    }
}

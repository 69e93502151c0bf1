//! What `gripline config show` and `gripline config default` print: TOML that reads back as what it shows.

use std::fmt::Write as _;

use serde_json::json;

use super::device;
use super::key::keys;
use super::layers::Effective;
use super::settings::MICROCONTROLLER;

/// Width of the comments, letters.
const WIDTH: usize = 100;

/// The values in force, each with its origin as a comment.
pub(crate) fn shown(effective: &Effective) -> String {
    let mut text = match &effective.file {
        Some(path) => format!("# file: {}\n", path.display()),
        None => "# no file\n".to_owned(),
    };
    let mut section = "";
    for entry in &effective.entries {
        let (of, name) = entry.name.split_once('.').unwrap_or_default();
        if of != section {
            let _ = writeln!(text, "\n[{of}]");
            section = of;
        }
        let line = match &entry.value {
            Some(value) => format!("{name} = {value}"),
            None => format!("# {name} is not set"),
        };
        let _ = writeln!(text, "{line:<40} # {}", entry.origin);
    }
    text
}

/// The same for programs: one object per key.
pub(crate) fn shown_json(effective: &Effective) -> serde_json::Value {
    let keys = effective.entries.iter().map(|entry| {
        let what = json!({ "value": entry.value, "from": entry.origin });
        (entry.name.clone(), what)
    });
    json!({ "file": effective.file, "keys": keys.collect::<serde_json::Map<_, _>>() })
}

/// The documented default file: every key explained and commented out.
pub(crate) fn default_file() -> String {
    let mut text = comment(
        "Configuration of `gripline run`. Every key stands here with its default, commented out; a key without a default \
         has an example. The environment (GRIPLINE_SECTION_KEY) overrules this file, and a flag overrules both. \
         `gripline config show` prints what is in force and where it comes from.",
    );
    let mut section = "";
    for key in keys() {
        if key.section() == section {
            text.push('\n');
        } else {
            section = key.section();
            let _ = write!(text, "\n[{section}]\n");
        }
        let (help, example) = key.help();
        let value = key.default().map(|value| value.to_string()).or(example);
        text += &comment(&help);
        text += &comment(&format!("Flag --{}, environment {}.", key.flag(), key.variable()));
        let _ = writeln!(text, "#{} = {}", key.own_name(), value.unwrap_or_default());
    }
    let _ = write!(text, "\n[{MICROCONTROLLER}]\n");
    text += &comment(
        "Settings for this run, with the names, units and ranges of `gripline config mcu`. They overrule the weights' \
         calibration (friction, contact_min_n); what neither says stays as the microcontroller has it. Nothing is stored in \
         its flash. Environment GRIPLINE_MICROCONTROLLER_KEY. These are the firmware's own:",
    );
    for line in device::default_lines() {
        let _ = writeln!(text, "#{line}");
    }
    text
}

/// Text as comment lines.
fn comment(words: &str) -> String {
    let mut lines = vec!["#".to_owned()];
    for word in words.split_whitespace() {
        if lines
            .last()
            .is_some_and(|line| line.len() + 1 + word.len() > WIDTH)
        {
            lines.push("#".to_owned());
        }
        if let Some(line) = lines.last_mut() {
            *line += " ";
            *line += word;
        }
    }
    lines.join("\n") + "\n"
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use gripline_protocol::message::Configuration;

    use super::*;
    use crate::config::overrides::Overrides;

    fn of_file(text: &str) -> Effective {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("g.toml");
        std::fs::write(&path, text).unwrap();
        Effective::load(&Overrides::of_file(Some(&path))).unwrap()
    }

    /// The keys' own lines of the default file, live instead of commented out.
    fn uncommented(file: &str) -> String {
        let live = |line: &str| match line.strip_prefix('#') {
            Some(code) if !code.starts_with(' ') => code.to_owned() + "\n",
            _ => line.to_owned() + "\n",
        };
        file.lines().map(live).collect()
    }

    #[test]
    fn the_default_file_says_nothing_and_uncommented_it_says_the_defaults() {
        let file = default_file();
        let as_it_is: toml::Table = file.parse().unwrap();
        assert!(
            as_it_is
                .values()
                .all(|section| section.as_table().unwrap().is_empty())
        );
        let live = of_file(&uncommented(&file));
        for (key, entry) in keys().zip(&live.entries) {
            let value = entry.value.clone().unwrap();
            assert_eq!(entry.origin, "file");
            assert!(
                key.default().is_none_or(|default| default == value),
                "{}",
                key.name()
            );
        }
        // Its calibrations do not exist: only what it says of the microcontroller becomes settings.
        let section: toml::Table = uncommented(&file).parse().unwrap();
        let section = section[MICROCONTROLLER].as_table().unwrap();
        let odd = Configuration::CAREFUL;
        assert_eq!(device::applied(section, &odd), Ok(Configuration::DEFAULT));
        assert!(section.len() > 20);
        assert!(
            file.lines()
                .all(|line| !line.starts_with("# ") || line.len() <= WIDTH)
        );
    }

    #[test]
    fn what_is_shown_reads_back_as_the_same_values() {
        let first =
            of_file("[simulation]\nseed = 9\n[run]\nseconds = 2.5\n[microcontroller]\nfriction = 0.4\n");
        let text = shown(&first);
        let again = of_file(&text);
        for (one, other) in first.entries.iter().zip(&again.entries) {
            assert_eq!((&one.name, &one.value), (&other.name, &other.value), "{text}");
        }
        assert_eq!(first.entries.len(), again.entries.len());
        assert!(text.contains("seed = 9") && text.contains("# file\n"), "{text}");
        assert!(text.contains("# weights is not set"), "{text}");
    }

    #[test]
    fn a_missing_file_that_was_asked_for_is_an_error() {
        let missing = Overrides::of_file(Some(Path::new("no/such.toml")));
        let error = Effective::load(&missing).unwrap_err().to_string();
        assert!(
            error.contains("no/such.toml") && error.contains("config default"),
            "{error}"
        );
    }
}

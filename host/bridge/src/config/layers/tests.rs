use clap::Parser as _;

use super::*;

#[derive(clap::Parser)]
struct Flags {
    #[command(flatten)]
    overrides: Overrides,
}

fn joined(flags: &[&str], environment: &[(&str, &str)], file: &str) -> Result<Effective, Vec<String>> {
    let own = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
    let environment: Vec<_> = environment.iter().map(own).collect();
    let flags = Flags::parse_from([&["gripline"], flags].concat()).overrides;
    Effective::join(&flags, &environment, Some((Path::new("g.toml"), file)))
}

fn value(effective: &Effective, name: &str) -> Option<String> {
    let entry = effective.entries.iter().find(|entry| entry.name == name)?;
    entry.value.as_ref().map(ToString::to_string)
}

#[test]
fn keys_of_one_section_stand_together_and_no_name_or_flag_twice() {
    let mut sections: Vec<_> = keys().map(Key::section).collect();
    sections.dedup();
    for list in [
        sections,
        keys().map(Key::name).collect(),
        keys().map(Key::flag).collect(),
    ] {
        let mut once = list.clone();
        once.sort_unstable();
        once.dedup();
        assert_eq!(once.len(), list.len(), "{list:?}");
    }
}

#[test]
fn every_key_has_a_default_or_an_example_that_may_stand_where_it_stands() {
    for key in keys() {
        let value = key.default().unwrap_or_else(|| {
            let example = key
                .help()
                .1
                .unwrap_or_else(|| panic!("{} has no example", key.name()));
            let table: Table = format!("value = {example}").parse().unwrap();
            table["value"].clone()
        });
        assert_eq!(key.check(&value), Ok(()), "{}", key.name());
    }
}

#[test]
fn a_flag_wins_over_the_environment_over_the_file_over_the_default() {
    let file = "[simulation]\nseed = 2\n[network]\ngate = \"off\"\n[run]\nunpaced = true\n";
    let variables = [
        ("GRIPLINE_SIMULATION_SEED", "3"),
        ("GRIPLINE_NETWORK_GATE", "difference"),
    ];
    let effective = joined(&["--seed", "4"], &variables, file).unwrap();
    for (name, expected, origin) in [
        ("simulation.seed", "4", "flag --seed"),
        (
            "network.gate",
            "\"difference\"",
            "environment, GRIPLINE_NETWORK_GATE",
        ),
        ("run.unpaced", "true", "file"),
        ("link.mcu", "\"embedded\"", "default"),
    ] {
        let entry = effective.entries.iter().find(|entry| entry.name == name).unwrap();
        assert_eq!(value(&effective, name).as_deref(), Some(expected));
        assert_eq!(entry.origin, origin);
    }
    assert_eq!(value(&effective, "network.weights"), None);
    let settings = effective.settings().unwrap();
    assert!(settings.unpaced && !settings.realtime);
    assert_eq!(
        (settings.seed, settings.gate.to_string().as_str()),
        (4, "difference")
    );
}

#[test]
fn every_error_is_reported_with_key_found_and_expected() {
    let file = "gate = \"off\"\n[camera]\nsorce = \"sim\"\nsource = \"webcam\"\n[run]\nseconds = \"long\"\nunpaced = 1\n\
                [network]\nweights = 7\n[simulation]\nseed = -1\n[recrod]\nfile = \"x\"\n\
                [microcontroller]\nfrictoin = 0.4\nmargin = \"wide\"\n";
    let variables = [
        ("GRIPLINE_LINK_MCU", "can0"),
        ("GRIPLINE_LINK_MUC", "usb"),
        ("GRIPLINE_RUN_UNPACED", "yes"),
        ("GRIPLINE_RECORD_FILE", ""),
        ("GRIPLINE_IMAGE", "of others"),
    ];
    let errors = joined(&["--gate", "maybe"], &variables, file).unwrap_err();
    let expected = [
        "g.toml: gate: no such key here, expected it in section [network]",
        "g.toml: camera.sorce: no such key, did you mean camera.source?",
        "g.toml: camera.source: found webcam, expected sim, /dev/videoN (or v4l2:DEVICE), dir:FOLDER, file:CLIP or mcap:RECORDING",
        "g.toml: run.seconds: found \"long\", expected a number from 0.1 to 1000000000",
        "g.toml: run.unpaced: found 1, expected true or false",
        "g.toml: network.weights: found 7, expected a text in quotes",
        "g.toml: simulation.seed: found -1, expected a whole number from 0 to 9223372036854775807",
        "g.toml: recrod: no such key, did you mean record?",
        "g.toml: microcontroller.frictoin: no such setting, did you mean friction?",
        "g.toml: microcontroller.margin: found \"wide\", expected a number",
        "GRIPLINE_LINK_MCU: found can0, expected embedded, emulator, emulator:uart, usb, usb:SERIAL or serial:PORT",
        "environment: GRIPLINE_LINK_MUC: no such key, did you mean GRIPLINE_LINK_MCU?",
        "GRIPLINE_RUN_UNPACED: found yes, expected true or false",
        "GRIPLINE_RECORD_FILE: found \"\", expected a value",
        "--gate: found maybe, expected network, difference or off",
    ];
    for line in expected {
        assert!(
            errors.iter().any(|error| error == line),
            "{line} is missing in {errors:#?}"
        );
    }
    assert_eq!(errors.len(), expected.len(), "{errors:#?}");
}

#[test]
fn a_file_that_is_not_toml_is_refused_with_its_line() {
    let errors = joined(&[], &[], "[camera]\nsource = sim\n").unwrap_err();
    assert_eq!(errors.len(), 1, "{errors:?}");
    assert!(errors[0].starts_with("g.toml: line 2: "), "{errors:?}");
    let errors = joined(&[], &[], "[run]\nunpaced = true\nunpaced = false\n").unwrap_err();
    assert!(errors[0].contains("line 3: duplicate key"), "{errors:?}");
}

#[test]
fn keys_that_contradict_each_other_are_refused_together() {
    for (file, expected) in [
        (
            "[run]\nunpaced = true\n[link]\nmcu = \"usb\"\n",
            "expected embedded or emulator",
        ),
        (
            "[run]\nunpaced = true\n[camera]\nsource = \"/dev/video0\"\n",
            "a camera keeps its own time",
        ),
        (
            "[run]\nunpaced = true\n[realtime]\nenabled = true\n",
            "expected one of them",
        ),
    ] {
        let error = joined(&[], &[], file).unwrap().settings().unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
    }
}

#[test]
fn settings_of_the_microcontroller_come_from_file_and_environment() {
    let file = "[microcontroller]\nmargin = 0.3\nfriction = 0.4\nline.kind = \"analog\"\n";
    let effective = joined(&[], &[("GRIPLINE_MICROCONTROLLER_FRICTION", "0.5")], file).unwrap();
    let expected: Table = "margin = 0.3\nfriction = 0.5\nline.kind = \"analog\""
        .parse()
        .unwrap();
    assert_eq!(effective.microcontroller(), expected);
}

#[test]
fn the_file_is_the_one_asked_for_or_the_variables_or_the_users() {
    let folder = tempfile::tempdir().unwrap();
    let users = folder.path().join("gripline/gripline.toml");
    std::fs::create_dir(users.parent().unwrap()).unwrap();
    std::fs::write(&users, "").unwrap();
    let home = ("XDG_CONFIG_HOME".to_owned(), folder.path().display().to_string());
    let named = (FILE_VARIABLE.to_owned(), "named.toml".to_owned());
    let found =
        |asked: Option<&str>, environment: &[(String, String)]| find_file(asked.map(Path::new), environment);
    let both = [home.clone(), named];
    assert_eq!(found(Some("asked.toml"), &both), Some("asked.toml".into()));
    assert_eq!(found(None, &both), Some("named.toml".into()));
    assert_eq!(found(None, &[home]), Some(users));
}

//! Whole interviews with made-up attachments and a person who has prepared the answers.

use super::*;

/// Answers in order; keeps what was shown.
struct Prepared<'a> {
    answers: Vec<&'a str>,
    shown: String,
}

impl Person for Prepared<'_> {
    fn ask(&mut self, screen: &str) -> Result<String, Error> {
        self.shown += screen;
        if self.answers.is_empty() {
            return Err(Error::failed("no more answers"));
        }
        let answer = self.answers.remove(0);
        self.shown += answer;
        self.shown.push('\n');
        Ok(answer.to_owned())
    }

    fn tell(&mut self, line: &str) {
        self.shown += line;
        self.shown.push('\n');
    }
}

fn webcam() -> Choice {
    Choice::new(
        "/dev/v4l/by-id/usb-046d_HD_Pro_Webcam-video-index0",
        "HD Pro Webcam C920",
    )
}

fn one_of_each() -> Hardware {
    Hardware {
        cameras: vec![webcam()],
        boards: vec![Choice::new("usb:2A0041", "at 1-2")],
        ports: vec![Choice::new("serial:/dev/ttyUSB0", "FT232R USB UART")],
        no_usb: None,
    }
}

fn unasked(said: &Said, hardware: &Hardware) -> Result<Chosen, String> {
    interview(said, &mut || hardware.clone(), None).map_err(|error| error.to_string())
}

fn yes() -> Said {
    Said {
        yes: true,
        ..Said::default()
    }
}

#[test]
fn with_one_camera_and_one_board_enter_is_enough_and_every_screen_fits_eighty_columns() {
    let mut person = Prepared {
        answers: vec!["", "", "", ""],
        shown: String::new(),
    };
    let chosen = interview(&Said::default(), &mut one_of_each, Some(&mut person)).unwrap();
    assert_eq!(Ok(chosen.clone()), unasked(&yes(), &one_of_each()));
    assert_eq!(
        chosen,
        Chosen {
            sensor: "particle-fingertip.1".to_owned(),
            camera: Source::Camera(webcam().value.into()),
            mcu: Target::Usb(Some("2A0041".to_owned())),
            rest: Rest::Now,
        }
    );
    let expected = include_str!("screens.txt");
    assert_eq!(person.shown, expected, "\n{}", person.shown);
    assert!(
        expected.lines().all(|line| line.chars().count() <= 80),
        "{expected}"
    );
}

#[test]
fn what_is_plugged_in_after_the_question_is_found_by_looking_again() {
    let mut looks = 0;
    let mut detect = || {
        looks += 1;
        // Sensor, then the camera twice.
        if looks < 3 {
            Hardware::default()
        } else {
            one_of_each()
        }
    };
    let mut person = Prepared {
        answers: vec!["", "", "", "", "later"],
        shown: String::new(),
    };
    let chosen = interview(&Said::default(), &mut detect, Some(&mut person)).unwrap();
    assert_eq!(chosen.camera, Source::Camera(webcam().value.into()));
    assert!(person.shown.contains("Found no camera, expected one: plug it in"));
}

#[test]
fn a_wrong_answer_is_reported_and_asked_again() {
    let mut person = Prepared {
        answers: vec!["2", "1", "7", "webcam", "1", "3", "later"],
        shown: String::new(),
    };
    let chosen = interview(&Said::default(), &mut one_of_each, Some(&mut person)).unwrap();
    assert_eq!((chosen.mcu, chosen.rest), (Target::Embedded, Rest::Later));
    for part in [
        "found gelsight-mini.1, whose forces are not trained yet",
        "found 7, expected 1 to 2",
        "found webcam, expected sim, /dev/videoN",
    ] {
        assert!(
            person.shown.contains(part),
            "{part:?} is missing in:\n{}",
            person.shown
        );
    }
}

#[test]
fn without_a_terminal_what_is_missing_or_several_is_an_error_with_what_to_do() {
    let no_camera = unasked(&yes(), &Hardware::default()).unwrap_err();
    for part in [
        "--camera: Found no camera, expected one",
        "plug it in",
        "say it with --camera",
    ] {
        assert!(no_camera.contains(part), "{part:?} is missing in: {no_camera}");
    }
    let only_camera = Hardware {
        cameras: vec![webcam()],
        ..Hardware::default()
    };
    let no_board = unasked(&yes(), &only_camera).unwrap_err();
    for part in [
        "--mcu: Found no microcontroller on USB",
        "cargo xtask flash",
        "say it with --mcu",
    ] {
        assert!(no_board.contains(part), "{part:?} is missing in: {no_board}");
    }
    let two = Hardware {
        cameras: vec![webcam(), Choice::new("/dev/video2", "Another")],
        ..one_of_each()
    };
    assert!(
        unasked(&yes(), &two)
            .unwrap_err()
            .contains("Found 2 cameras, expected one")
    );
    let nobody = unasked(&Said::default(), &one_of_each()).unwrap_err();
    assert!(
        nobody.contains("expected --sensor, or --yes for particle-fingertip"),
        "{nobody}"
    );
}

#[test]
fn every_answer_can_be_a_flag_and_a_wrong_one_is_named() {
    let said = Said {
        sensor: Some("particle-fingertip".into()),
        camera: Some(Source::Simulated),
        mcu: Some(Target::Embedded),
        rest: Some(Rest::In("a.toml".into())),
        yes: false,
    };
    let chosen = unasked(&said, &Hardware::default()).unwrap();
    assert_eq!(
        (chosen.camera, chosen.rest),
        (Source::Simulated, Rest::In("a.toml".into()))
    );
    let gelsight = Said {
        sensor: Some("gelsight-mini".into()),
        ..yes()
    };
    let error = unasked(&gelsight, &one_of_each()).unwrap_err();
    assert!(error.starts_with("--sensor: found gelsight-mini"), "{error}");
    assert_eq!(
        "soon".parse::<Rest>().unwrap_err(),
        "found soon, expected now, later or FILE.toml"
    );
}

#[test]
fn pictures_that_do_not_show_the_gripper_never_drive_a_real_one() {
    for camera in ["sim", "dir:pictures", "file:a.avi", "mcap:a.mcap"] {
        let said = Said {
            camera: Some(camera.parse().unwrap()),
            mcu: Some(Target::Usb(None)),
            ..yes()
        };
        let error = unasked(&said, &one_of_each()).unwrap_err();
        assert!(error.contains("a gripper that they do not show"), "{error}");
        // By itself it takes no board either, although one is there.
        let chosen = unasked(&Said { mcu: None, ..said }, &one_of_each()).unwrap();
        assert_eq!(chosen.mcu, Target::Embedded);
    }
}

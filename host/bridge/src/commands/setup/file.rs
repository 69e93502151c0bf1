//! The configuration that `gripline setup` writes, and where. Pure.

use std::path::{Path, PathBuf};

use toml::Value;

use super::interview::Chosen;
use crate::source::Source;

/// The service's path.
const OF_THE_SERVICE: &str = "/etc/gripline/gripline.toml";

/// Where `gripline run` finds the configuration by itself: root's is the service's. `config_home`: the user's configuration folder,
/// if there is one.
pub(super) fn place(is_root: bool, config_home: Option<PathBuf>) -> PathBuf {
    match config_home {
        Some(folder) if !is_root => folder.join("gripline/gripline.toml"),
        _ => OF_THE_SERVICE.into(),
    }
}

/// Whether the file at `out` is the service's.
pub(super) fn is_of_the_service(out: &Path) -> bool {
    out == Path::new(OF_THE_SERVICE)
}

/// The file's text. `calibration`: where it is, from the root.
pub(super) fn text(chosen: &Chosen, calibration: Option<&Path>, date: &str) -> String {
    let quoted = |text: String| Value::String(text);
    let camera = quoted(source_from_anywhere(&chosen.camera).to_string());
    let calibration = calibration.map_or(String::new(), |file| {
        format!("\n[calibration]\nfile = {}\n", quoted(file.display().to_string()))
    });
    format!(
        "# Written by `gripline setup`, {date}, for the sensor {}. `gripline config default` explains every key,\n\
         # `gripline config show` prints what is in force.\n\n\
         [camera]\nsource = {camera}\n{calibration}\n[link]\nmcu = {}\n",
        chosen.sensor,
        quoted(chosen.mcu.to_string()),
    )
}

/// The source with an absolute path.
fn source_from_anywhere(source: &Source) -> Source {
    let whole = |path: &PathBuf| std::path::absolute(path).unwrap_or_else(|_| path.clone());
    match source {
        Source::Simulated => Source::Simulated,
        Source::Camera(device) => Source::Camera(device.clone()),
        Source::Folder(folder) => Source::Folder(whole(folder)),
        Source::Clip(clip) => Source::Clip(whole(clip)),
        Source::Recording(recording) => Source::Recording(whole(recording)),
    }
}

#[cfg(test)]
mod tests {
    use gripline_link::Target;

    use super::super::interview::Rest;
    use super::*;

    #[test]
    fn the_file_says_what_was_chosen_in_keys_of_the_configuration() {
        let chosen = Chosen {
            sensor: "particle-fingertip.1".to_owned(),
            camera: Source::Camera("/dev/v4l/by-id/usb-\"A\"-index0".into()),
            mcu: Target::Usb(Some("2A0041".to_owned())),
            rest: Rest::Now,
        };
        let written = text(
            &chosen,
            Some(Path::new("/etc/gripline/calibration.toml")),
            "2026-11-23",
        );
        let read: toml::Table = written.parse().unwrap();
        assert_eq!(
            read["camera"]["source"].as_str(),
            Some("v4l2:/dev/v4l/by-id/usb-\"A\"-index0"),
            "{written}"
        );
        assert_eq!(
            read["calibration"]["file"].as_str(),
            Some("/etc/gripline/calibration.toml")
        );
        assert_eq!(read["link"]["mcu"].as_str(), Some("usb:2A0041"));
        let folder = Chosen {
            camera: Source::Folder("pictures".into()),
            ..chosen
        };
        let read: toml::Table = text(&folder, None, "2026-11-23").parse().unwrap();
        let source = read["camera"]["source"].as_str().unwrap();
        assert!(
            source.starts_with("dir:/") && source.ends_with("/pictures"),
            "{source}"
        );
        assert!(!read.contains_key("calibration"));
    }

    #[test]
    fn root_sets_the_service_up_and_everybody_else_himself() {
        let home = Some(PathBuf::from("/home/a/.config"));
        assert_eq!(
            place(false, home.clone()),
            Path::new("/home/a/.config/gripline/gripline.toml")
        );
        assert!(is_of_the_service(&place(true, home)));
        assert!(is_of_the_service(&place(false, None)));
    }
}

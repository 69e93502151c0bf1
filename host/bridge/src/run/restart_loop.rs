//! A program in a restart loop must not fill the disk. Recordings named after the time of their start show how long each of them
//! lasted: when the newest [`MOST`] of them were all short, no further one is made. Nothing is ever deleted.

use std::path::Path;
use std::time::{Duration, SystemTime};

/// This many short recordings in a row are a restart loop.
const MOST: usize = 20;
/// A recording below this is short.
const SHORT: Duration = Duration::from_mins(1);
/// Length of a time in a file's name, "2001-09-09T01-46-40Z".
const TIME_LENGTH: usize = 20;

/// Whether the recordings beside `path` whose names differ from its in their time alone show a restart loop.
pub(super) fn is_restart_loop(path: &Path) -> bool {
    let Some((prefix, suffix)) = around_time(path) else {
        return false;
    };
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let Ok(entries) = folder.read_dir() else {
        return false;
    };
    let mut lasted: Vec<(SystemTime, Duration)> = entries
        .flatten()
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            let began = time_of(name.strip_prefix(prefix)?.strip_suffix(suffix)?)?;
            let ended = entry.metadata().ok()?.modified().ok()?;
            Some((began, ended.duration_since(began).unwrap_or_default()))
        })
        .collect();
    lasted.sort_by(|one, other| other.cmp(one));
    lasted.len() >= MOST && lasted.iter().take(MOST).all(|(_, lasted)| *lasted < SHORT)
}

/// What stands before and after the time in a file's name.
fn around_time(path: &Path) -> Option<(&str, &str)> {
    let name = path.file_name()?.to_str()?;
    let at = (0..=name.len().checked_sub(TIME_LENGTH)?)
        .find(|&at| name.get(at..at + TIME_LENGTH).and_then(time_of).is_some())?;
    Some((&name[..at], &name[at + TIME_LENGTH..]))
}

fn time_of(text: &str) -> Option<SystemTime> {
    let (date, time) = text.split_once('T')?;
    humantime::parse_rfc3339(&format!("{date}T{}", time.replace('-', ":"))).ok()
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use super::*;

    /// Recordings a minute apart, the newest last, that lasted this many seconds.
    fn folder(lasted_s: impl Iterator<Item = u64>) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let name = |number: u64| {
            let time = format!("2001-09-09T{:02}-{:02}-40Z", number / 60, number % 60);
            folder.path().join(format!("arm {time}.mcap"))
        };
        let mut next = 0;
        for (number, seconds) in (0..).zip(lasted_s) {
            let path = name(number);
            let began = time_of(&path.to_str().unwrap()[path.to_str().unwrap().len() - 25..][..20]).unwrap();
            let file = File::create(&path).unwrap();
            file.set_modified(began + Duration::from_secs(seconds)).unwrap();
            next = number + 1;
        }
        let path = name(next);
        (folder, path)
    }

    #[test]
    fn many_short_recordings_in_a_row_are_a_restart_loop() {
        for (lasted_s, expected) in [
            (vec![5; 19], false),
            (vec![5; 20], true),
            ([vec![900; 30], vec![5; 19]].concat(), false),
            ([vec![900; 30], vec![5; 20]].concat(), true),
            ([vec![5; 30], vec![61]].concat(), false),
        ] {
            let (_folder, path) = folder(lasted_s.iter().copied());
            assert_eq!(is_restart_loop(&path), expected, "{lasted_s:?}");
        }
    }

    #[test]
    fn recordings_without_a_time_in_their_name_or_of_another_name_count_for_nothing() {
        let (folder, _) = folder(std::iter::repeat_n(5, 30));
        for name in ["arm.mcap", "hand 2001-09-09T01-46-40Z.mcap"] {
            assert!(!is_restart_loop(&folder.path().join(name)), "{name}");
        }
        assert!(!is_restart_loop(Path::new("2001-09-09T01-46-40Z.mcap")));
    }
}

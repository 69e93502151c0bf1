//! Pictures of the untouched fingertip: written, stored from run to run, and chosen when a run starts. If the pictures of the start
//! may show a touch, those stored by an earlier run are used, or the run is refused: a touch taken for rest is a force that is
//! never measured. Pictures that show too little are never rest, new or stored. Limit: without stored pictures an object that lies
//! still on a released fingertip is not detected.

use std::path::{Path, PathBuf};
use std::time::SystemTime;
use std::{env, fmt, fs};

use gripline_evaluation::calibration::surface::{Change, Figures, limit, mean};
use gripline_network::constants::CROP_SIDE;
use npyz::WriterBuilder as _;

use crate::calibration::{Calibration, Rest, write};
use crate::commands::files::grey_png;
use crate::error::Error;

/// Measures the pictures and writes them beside `calibration`, whose section `[rest]` they become. `device` names their device.
///
/// # Errors
/// [`Error`] that names the file which cannot be written.
pub(crate) fn save(
    calibration: &mut Calibration,
    pictures: &[Vec<u8>],
    figures: &Figures,
    device: String,
) -> Result<Rest, Error> {
    let stem = calibration.path.file_stem();
    let stem = stem.map_or("calibration".into(), |stem| stem.to_string_lossy().into_owned());
    let rest = Rest {
        date: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
        device,
        pictures: format!("{stem}-rest.npy").into(),
        mean: format!("{stem}-rest.png").into(),
        count: pictures.len(),
        mean_level: rounded(figures.mean_level),
        saturated_share: rounded(figures.saturated_share),
        particles: figures.particles,
        sharpness: rounded(figures.sharpness),
        noise_levels: rounded(figures.noise_levels),
        residual_px: rounded(figures.moved_px),
    };
    write(&calibration.beside(&rest.pictures), &pictures_npy(pictures)?)?;
    write(&calibration.beside(&rest.mean), &grey_png(&image(&figures.mean))?)?;
    calibration.rest = Some(rest.clone());
    calibration.save()?;
    Ok(rest)
}

fn pictures_npy(pictures: &[Vec<u8>]) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let side = CROP_SIDE as u64;
    let mut writer = npyz::WriteOptions::<u8>::new()
        .default_dtype()
        .shape(&[pictures.len() as u64, side, side])
        .writer(&mut bytes)
        .begin_nd()?;
    writer
        .extend(pictures.iter().flatten().copied())
        .and_then(|()| writer.finish())?;
    Ok(bytes)
}

fn image(pixels: &[u8]) -> gripline_simulation::Image {
    let mut image = gripline_simulation::Image::crop();
    image.pixels.copy_from_slice(pixels);
    image
}

/// Why pictures show too little of the sensor surface to be rest.
pub(crate) struct Unfit {
    pub found: String,
    expected: String,
    advice: &'static str,
}

impl fmt::Display for Unfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            found,
            expected,
            advice,
        } = self;
        write!(f, "found {found}, expected {expected}: {advice}")
    }
}

/// What is wrong with the light of pictures, and with their particles.
pub(crate) fn unfit(figures: &Figures) -> Vec<Unfit> {
    let [dark, bright] = limit::LEVEL;
    let [darkest, brightest] = figures.level_range;
    let of_level = |level: f64, advice| Unfit {
        found: format!("a mean level of {level:.0}"),
        expected: format!("{dark} to {bright}"),
        advice,
    };
    let mut all = Vec::new();
    if darkest < dark {
        all.push(of_level(darkest, "switch the lamps on, expose longer"));
    }
    if brightest > bright {
        all.push(of_level(brightest, "expose shorter, dim the lamps"));
    }
    if figures.particles < limit::PARTICLES {
        all.push(Unfit {
            found: format!("{} particles", figures.particles),
            expected: format!("at least {}", limit::PARTICLES),
            advice: "focus the lens, clean it, check that the whole sensor surface is in the picture",
        });
    }
    all
}

/// Four decimals, for people.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// Where the pictures of one fingertip of one camera are stored.
#[derive(Debug)]
pub(crate) struct Store {
    path: PathBuf,
    /// The camera: pictures of another one at the same place are useless.
    camera: String,
}

/// Pictures that an earlier run stored.
#[derive(Debug)]
pub(crate) struct Kept {
    pictures: Vec<Vec<u8>>,
    date: String,
    path: PathBuf,
}

impl Store {
    /// For fingertip 0 or 1 seen by `camera`, which is plugged in at `source`; `None` if this system has no state folder.
    pub(crate) fn of(source: &str, camera: &str, fingertip: usize) -> Option<Self> {
        Some(Self::in_folder(&state_folder()?, source, camera, fingertip))
    }

    fn in_folder(folder: &Path, source: &str, camera: &str, fingertip: usize) -> Self {
        let name: String = source
            .chars()
            .map(|letter| {
                if letter.is_ascii_alphanumeric() {
                    letter
                } else {
                    '-'
                }
            })
            .collect();
        Self {
            path: folder.join(format!("rest-{}-{name}.toml", fingertip + 1)),
            camera: camera.to_owned(),
        }
    }

    /// The stored pictures. Unreadable files are reported and count as none.
    fn load(&self) -> Option<Kept> {
        if !self.path.exists() {
            return None;
        }
        let read = || {
            let calibration = Calibration::load(&self.path)?;
            let pictures = calibration.rest_pictures()?;
            Ok::<_, Error>(calibration.rest.zip(pictures))
        };
        match read() {
            Ok(Some((rest, pictures))) if rest.device == self.camera => Some(Kept {
                pictures,
                date: rest.date,
                path: self.path.clone(),
            }),
            Ok(Some((rest, _))) => {
                tracing::warn!(
                    "{}: found rest pictures of {}, expected those of {}: not used",
                    self.path.display(),
                    rest.device,
                    self.camera
                );
                None
            }
            Ok(None) => None,
            Err(error) => {
                tracing::warn!("{error}; not used");
                None
            }
        }
    }

    /// Stores the pictures for later runs. A failure is only reported: the run does not need it.
    pub(crate) fn keep(&self, pictures: &[Vec<u8>], figures: &Figures) {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let mut calibration = Calibration {
            path: self.path.clone(),
            ..Calibration::default()
        };
        let kept = fs::create_dir_all(folder)
            .map_err(Error::from)
            .and_then(|()| save(&mut calibration, pictures, figures, self.camera.clone()));
        if let Err(error) = kept {
            tracing::warn!("the rest pictures are not kept for the next start: {error}");
        }
    }
}

/// The state folder: systemd's, else the user's.
pub(crate) fn state_folder() -> Option<PathBuf> {
    let folder = |name: &str| {
        env::var_os(name)
            .filter(|value| !value.is_empty())
            .map(PathBuf::from)
    };
    // Several are separated by colons; the first is as good as any.
    let of_service = folder("STATE_DIRECTORY").map(|all| {
        let text = all.to_string_lossy().into_owned();
        PathBuf::from(text.split(':').next().unwrap_or_default())
    });
    of_service.or_else(|| {
        let of_user = folder("XDG_STATE_HOME").or_else(|| Some(folder("HOME")?.join(".local/state")));
        Some(of_user?.join("gripline"))
    })
}

/// Which pictures a run starts with.
#[derive(Debug, PartialEq)]
enum Choice {
    /// Those of the start, with a note for the user.
    New(Option<String>),
    /// The stored ones, with the reason.
    Kept(String),
}

/// The rest pictures of a run that has just taken `new` ones of a camera. `is_holding`: the gripper holds, or may hold.
///
/// # Errors
/// [`Error`] when the new ones may show a touch and there are no others.
pub(crate) fn at_start(
    new: Vec<Vec<u8>>,
    store: Option<&Store>,
    is_holding: bool,
) -> Result<Vec<Vec<u8>>, Error> {
    let kept = store.and_then(Store::load);
    let figures = Figures::of(&new);
    match choose(&figures, kept.as_ref(), is_holding).map_err(Error::failed)? {
        Choice::New(note) => {
            if let Some(note) = note {
                tracing::warn!("{note}");
            }
            if let Some(store) = store {
                store.keep(&new, &figures);
            }
            Ok(new)
        }
        Choice::Kept(why) => {
            let Some(kept) = kept else { return Ok(new) };
            tracing::warn!("{why}; the rest pictures of {} are used instead", kept.date);
            Ok(kept.pictures)
        }
    }
}

/// Whether the pictures of the start plausibly show an untouched fingertip.
fn choose(new: &Figures, kept: Option<&Kept>, is_holding: bool) -> Result<Choice, String> {
    const KEEP: &str =
        "or take rest pictures beforehand with `gripline calibrate rest` and name them in calibration.file";
    let moves = new.moved_px > limit::STILL_PX;
    let moved = || {
        format!(
            "found parts of the sensor surface that moved by {:.2} pixels while the rest pictures were taken, expected at most {}",
            new.moved_px,
            limit::STILL_PX
        )
    };
    if let Some(problem) = unfit(new).first() {
        return Err(format!("{problem}, and start again, {KEEP}"));
    }
    let useless = kept.and_then(|kept| {
        let problem = unfit(&Figures::of(&kept.pictures)).into_iter().next()?;
        Some(format!(
            "the rest pictures of {} have {}, expected {}, and are not used",
            kept.path.display(),
            problem.found,
            problem.expected
        ))
    });
    let Some(kept) = kept.filter(|_| useless.is_none()) else {
        if is_holding {
            return Err(format!(
                "found a gripper that holds, and no rest pictures of an earlier start{}, expected a released one: what it holds \
                 would count as no contact. Let go (`gripline faults --acknowledge --release`) and start again, {KEEP}",
                useless.map_or(String::new(), |why| format!(" ({why})"))
            ));
        }
        if moves {
            return Err(format!(
                "{}: take everything off it, keep hands and table still, wait until the gel has settled, and start again, {KEEP}",
                moved()
            ));
        }
        return Ok(Choice::New(useless));
    };
    let change = Change::between(&mean(&kept.pictures), &new.mean);
    let path = kept.path.display();
    if change.lost > limit::LOST {
        return Err(format!(
            "found {:.0} % of the particles of {path} missing, expected at most {:.0} %: uncover the sensor surface; if gel or \
             camera were replaced and nothing touches it, delete that file and start again",
            100.0 * change.lost,
            100.0 * limit::LOST
        ));
    }
    if moves {
        return Ok(Choice::Kept(moved()));
    }
    if change.dent_px > limit::STILL_PX {
        return Ok(Choice::Kept(format!(
            "found a part of the sensor surface {:.2} pixels from its place in {path}, expected at most {}: something touches it, \
             or a dent is left",
            change.dent_px,
            limit::STILL_PX
        )));
    }
    if change.drift_px > limit::DRIFT_PX {
        let found = format!(
            "found the sensor surface {:.2} pixels from its place in {path}, expected at most {}: fasten camera and gel",
            change.drift_px,
            limit::DRIFT_PX
        );
        return Ok(if is_holding {
            Choice::Kept(found)
        } else {
            Choice::New(Some(found))
        });
    }
    Ok(Choice::New(None))
}

#[cfg(test)]
mod tests {
    use gripline_simulation::GripScene;

    use super::*;

    fn rest(scene: &mut GripScene, count: usize) -> Vec<Vec<u8>> {
        (0..count).map(|_| scene.rest_image().pixels).collect()
    }

    /// Pictures while something is held firmly, in a still grip.
    fn held(scene: &mut GripScene) -> Vec<Vec<u8>> {
        while !scene.step(0.02, 3.0).unwrap().touching {}
        for _ in 0..20 {
            scene.step(0.02, 3.0).unwrap();
        }
        let crop = scene.step(0.02, 3.0).unwrap().image.pixels;
        vec![crop; 8]
    }

    fn kept(pictures: Vec<Vec<u8>>) -> Kept {
        Kept {
            pictures,
            date: "2026-11-21T14:00:00Z".to_owned(),
            path: "kept.toml".into(),
        }
    }

    #[test]
    fn a_start_while_the_gripper_holds_is_refused_unless_an_earlier_one_kept_rest_pictures() {
        let mut scene = GripScene::new(71);
        let before = rest(&mut scene, 8);
        let held = Figures::of(&held(&mut scene));
        let refused = choose(&held, None, true).unwrap_err();
        for part in [
            "found a gripper that holds",
            "expected a released one",
            "--release",
        ] {
            assert!(refused.contains(part), "{part:?} is missing in: {refused}");
        }
        let Ok(Choice::Kept(why)) = choose(&held, Some(&kept(before)), true) else {
            panic!("the kept pictures are the only ones without a touch");
        };
        assert!(why.contains("something touches it"), "{why}");
    }

    #[test]
    fn a_start_with_something_on_a_released_fingertip_takes_the_kept_rest_pictures() {
        let mut scene = GripScene::new(72);
        let before = rest(&mut scene, 8);
        let touched = Figures::of(&held(&mut scene));
        assert!(matches!(
            choose(&touched, Some(&kept(before)), false),
            Ok(Choice::Kept(_))
        ));
    }

    #[test]
    fn a_start_while_something_moves_or_settles_is_refused_or_takes_the_kept_rest_pictures() {
        let mut scene = GripScene::new(73);
        let before = rest(&mut scene, 8);
        let mut pictures = rest(&mut scene, 4);
        while !scene.step(0.02, 1.0).unwrap().touching {}
        pictures.extend((0..4).map(|_| scene.step(0.02, 1.0).unwrap().image.pixels));
        let moving = Figures::of(&pictures);
        let refused = choose(&moving, None, false).unwrap_err();
        for part in ["that moved by", "expected at most 0.1", "gel has settled"] {
            assert!(refused.contains(part), "{part:?} is missing in: {refused}");
        }
        assert!(matches!(
            choose(&moving, Some(&kept(before)), false),
            Ok(Choice::Kept(_))
        ));
    }

    fn black() -> Vec<u8> {
        vec![0; CROP_SIDE * CROP_SIDE]
    }

    #[test]
    fn pictures_too_dark_to_show_anything_are_never_rest() {
        let mut scene = GripScene::new(78);
        let good = rest(&mut scene, 12);
        let all_black = vec![black(); 16];
        let black_first = [vec![black(); 4], good.clone()].concat();
        for dark in [&all_black, &black_first] {
            let figures = Figures::of(dark);
            for kept_too in [None, Some(kept(good.clone()))] {
                let refused = choose(&figures, kept_too.as_ref(), false).unwrap_err();
                for part in [
                    "found a mean level of 0",
                    "expected 15 to 120",
                    "switch the lamps on",
                    "start again",
                ] {
                    assert!(refused.contains(part), "{part:?} is missing in: {refused}");
                }
            }
        }
    }

    #[test]
    fn pictures_without_particles_are_never_rest() {
        let grey = Figures::of(&vec![vec![60; CROP_SIDE * CROP_SIDE]; 16]);
        let refused = choose(&grey, None, false).unwrap_err();
        for part in ["found 0 particles", "expected at least 900", "start again"] {
            assert!(refused.contains(part), "{part:?} is missing in: {refused}");
        }
    }

    #[test]
    fn kept_pictures_that_show_nothing_count_as_none() {
        let mut scene = GripScene::new(79);
        let untouched = Figures::of(&rest(&mut scene, 8));
        let held = Figures::of(&held(&mut scene));
        let dark = kept(vec![black(); 16]);
        let refused = choose(&held, Some(&dark), true).unwrap_err();
        for part in [
            "found a gripper that holds",
            "kept.toml",
            "a mean level of 0",
            "--release",
        ] {
            assert!(refused.contains(part), "{part:?} is missing in: {refused}");
        }
        let Ok(Choice::New(Some(note))) = choose(&untouched, Some(&dark), false) else {
            panic!("good pictures of a released fingertip replace them");
        };
        assert!(
            note.contains("kept.toml") && note.contains("a mean level of 0"),
            "{note}"
        );
    }

    #[test]
    fn an_untouched_fingertip_starts_with_its_new_pictures_held_or_not() {
        let mut scene = GripScene::new(74);
        let before = rest(&mut scene, 8);
        let new = Figures::of(&rest(&mut scene, 8));
        assert_eq!(choose(&new, None, false), Ok(Choice::New(None)));
        for is_holding in [false, true] {
            let chosen = choose(&new, Some(&kept(before.clone())), is_holding);
            assert_eq!(chosen, Ok(Choice::New(None)), "holding: {is_holding}");
        }
    }

    #[test]
    fn another_gel_is_refused_by_the_name_of_the_file_that_shows_the_old_one() {
        let before = rest(&mut GripScene::new(75), 8);
        let other = Figures::of(&rest(&mut GripScene::new(76), 8));
        let refused = choose(&other, Some(&kept(before)), false).unwrap_err();
        assert!(
            refused.contains("kept.toml") && refused.contains("delete that file"),
            "{refused}"
        );
    }

    #[test]
    fn the_pictures_of_one_start_are_there_at_the_next_for_the_same_camera_only() {
        let folder = tempfile::tempdir().unwrap();
        let state = folder.path().join("not there yet");
        let store = |camera, fingertip| Store::in_folder(&state, "v4l2:/dev/video0", camera, fingertip);
        let mut scene = GripScene::new(77);
        let first = rest(&mut scene, 8);
        let ours = store("a camera", 0);
        assert_eq!(at_start(first.clone(), Some(&ours), false).unwrap(), first);
        // The service starts again while the gripper holds.
        let held = held(&mut scene);
        assert_eq!(at_start(held.clone(), Some(&ours), true).unwrap(), first);
        // A touch is never kept.
        assert_eq!(ours.load().unwrap().pictures, first);
        assert!(at_start(held.clone(), Some(&store("another camera", 0)), true).is_err());
        assert!(at_start(held, Some(&store("a camera", 1)), true).is_err());
    }
}

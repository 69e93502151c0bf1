//! The command `gripline simulate`: arguments, scene in, folder out, progress and summary. Touches the world.
//!
//! A frame whose contact does not converge is left out of frames, maps and truth alike, counted and listed in the
//! manifest, and the command ends with code 3. After an interruption the contact is solved again from the start, which
//! is quick and gives the same bits; pictures that are there are not made again.

use std::fs;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::path::{Path, PathBuf};

use clap::Args;
use gripline_simulation::constants::LARGEST_INDENTATION;
use gripline_simulation::scene_file::{FrameSize, SceneFile};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::canvas::Grey;
use super::clip::{self, Clip};
use super::folder::{Folder, Manifest, Unsolved, WORLD_VERSION, frame_name};
use super::sheet::{self, Column, full_scale};
use crate::commands::files::{decode_grey, encode_png, grey_png, maps_npy};
use crate::error::{Completion, Error};
use gripline_capture::clip::{ClipWriter, ffmpeg_version};
use gripline_capture::geometry;
use gripline_evaluation::play::truth::{self, named};
use gripline_evaluation::play::{self, Moment, Play, PlayError};

/// The arguments of `gripline simulate`.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct SimulateArgs {
    /// The scene: TOML, see host/simulation/scenes/README.md.
    #[arg(value_name = "SCENE.toml")]
    pub scene: PathBuf,
    /// Folder for frames, maps.npy, truth.csv, preview.png and manifest.toml. A folder left by an interrupted run of the same scene
    /// is completed.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Seed instead of the scene's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub seed: Option<u64>,
    /// Full 640×480 pictures or the middle 440×440, instead of the scene's choice.
    #[arg(long, value_name = "SIZE")]
    pub frames: Option<Size>,
    /// Write clip.gif too: camera and force map side by side.
    #[arg(long)]
    pub clip: bool,
    /// Write clip.avi too: the camera's pictures as MJPEG, which `gripline run --source file:clip.avi` plays.
    #[arg(long)]
    pub video: bool,
    /// Print the summary as one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// Which part of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Size {
    /// The middle, 440×440.
    Crop,
    /// All of it, 640×480.
    Full,
}

/// The command's summary.
#[derive(Debug, Serialize)]
struct Summary {
    scene: String,
    kind: &'static str,
    out: String,
    seed: u64,
    fingers: usize,
    /// Frames in the folder.
    frames: usize,
    /// Frames left out because their contact did not converge.
    unsolved: usize,
    /// Frames made by an earlier run.
    resumed: usize,
    seconds: f64,
    slip_frames: usize,
    /// Frames deeper than [`LARGEST_INDENTATION`].
    too_deep: usize,
    normal_n_max: f64,
    stick_ratio_min: Option<f64>,
}

/// Runs the command.
///
/// # Errors
/// [`Error`]: wrong usage for a folder that holds something else; failed for a scene that cannot be read or played.
pub fn run(args: &SimulateArgs) -> Result<Completion, Error> {
    let (file, crc) = read_scene(&args.scene)?;
    let size = match args.frames {
        Some(Size::Crop) => FrameSize::Crop,
        Some(Size::Full) => FrameSize::Full,
        None => file.frames,
    };
    if args.video {
        // Better now than after hours of rendering.
        ffmpeg_version()?;
    }
    let seed = args.seed.unwrap_or(file.seed);
    let mut play = play::open(&file, seed)?;
    let manifest = Manifest {
        scene: args
            .scene
            .file_name()
            .map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        scene_crc64: crc,
        kind: play.kind().to_owned(),
        seed,
        frame_size: if size == FrameSize::Crop { "crop" } else { "full" }.to_owned(),
        world_version: WORLD_VERSION,
        gripline_version: env!("CARGO_PKG_VERSION").to_owned(),
        complete: false,
        frames: 0,
        fingers: play.fingers(),
        too_deep: 0,
        unsolved: Vec::new(),
    };
    simulate(args, play.as_mut(), size, file.frames_per_second, manifest)
}

/// Plays a scene into its folder.
fn simulate(
    args: &SimulateArgs,
    play: &mut dyn Play,
    size: FrameSize,
    frames_per_second: f64,
    mut manifest: Manifest,
) -> Result<Completion, Error> {
    let (folder, found) = Folder::open(&args.out, &manifest)?;
    let resumed = folder.finished(play.fingers());
    if found.is_none() {
        folder.write_manifest(&manifest)?;
    }
    let recording = Recording {
        folder: &folder,
        size,
        resumed,
        highlights: play::highlights(play, sheet::MOST),
    };
    let recorded = recording.make(play, &mut manifest)?;
    if recorded.moments.is_empty() {
        return Err(Error::failed(format!(
            "{}: found no frame whose contact could be solved, expected at least one: take more frames_per_second, \
             gentler edges or less force ({})",
            args.scene.display(),
            manifest.unsolved.first().map_or("", |first| &first.why)
        )));
    }
    write_results(&folder, play, &manifest, &recorded)?;
    if args.clip {
        write_clips(&folder, play, frames_per_second, &recorded.moments)?;
    }
    if args.video {
        write_videos(&folder, play.fingers(), frames_per_second, recorded.moments.len())?;
    }
    manifest.complete = true;
    manifest.frames = recorded.moments.len();
    manifest.too_deep = too_deep(&recorded.moments);
    folder.write_manifest(&manifest)?;
    let summary = summary(args, play, &manifest, resumed, &recorded.moments);
    print_summary(&summary, args.json)?;
    if summary.unsolved > 0 {
        return Ok(Completion::WithLoss(format!(
            "done with loss: {} of {} frames did not converge and are left out; {} lists them",
            summary.unsolved,
            play.frames(),
            folder.path().join("manifest.toml").display()
        )));
    }
    Ok(Completion::Whole)
}

/// The scene, and the checksum of everything that determines it.
fn read_scene(path: &Path) -> Result<(SceneFile, String), Error> {
    let text = fs::read(path).map_err(|error| {
        let found = match error.kind() {
            ErrorKind::NotFound => "no such file".to_owned(),
            ErrorKind::IsADirectory => "a folder".to_owned(),
            _ => format!("a file that cannot be read ({error})"),
        };
        Error::failed(format!(
            "{}: found {found}, expected a scene file: check the path",
            path.display()
        ))
    })?;
    let text = String::from_utf8(text).map_err(|_| {
        Error::failed(format!(
            "{}: found bytes that are no text, expected a scene in TOML: check the path",
            path.display()
        ))
    })?;
    let crc64 = crc::Crc::<u64>::new(&crc::CRC_64_XZ);
    let mut digest = crc64.digest();
    digest.update(text.as_bytes());
    let mut load = |path: &Path| {
        let bytes = fs::read(path)?;
        digest.update(&bytes);
        Ok(bytes)
    };
    let file = SceneFile::parse(path, &text, &mut load)?;
    Ok((file, format!("{:016x}", digest.finalize())))
}

/// What a recording needs.
#[derive(Debug)]
struct Recording<'a> {
    folder: &'a Folder,
    size: FrameSize,
    /// Frames that an earlier run has made.
    resumed: usize,
    /// Steps that the preview shows.
    highlights: Vec<usize>,
}

/// What a recording keeps in memory.
#[derive(Debug)]
struct Recorded {
    /// One per frame; the cells' state only for those in the preview.
    moments: Vec<Moment>,
    /// Numbers of the frames in the preview.
    shown: Vec<usize>,
    /// Each finger's picture at rest.
    rests: Vec<Grey>,
}

impl Recording<'_> {
    /// Plays the scene and writes its frames.
    fn make(&self, play: &mut dyn Play, manifest: &mut Manifest) -> Result<Recorded, Error> {
        let fingers = play.fingers();
        let mut rests = Vec::with_capacity(fingers);
        for finger in 0..fingers {
            let rest = play.rest(finger, self.size);
            self.folder
                .write(&(named("rest", finger) + ".png"), &grey_png(&rest)?)?;
            rests.push(Grey::of(&rest));
        }
        let progress = Progress::new(play.frames());
        let (mut moments, mut shown) = (Vec::new(), Vec::new());
        for step in 0..play.frames() {
            match play.advance() {
                Ok(None) => break,
                Ok(Some(mut moment)) => {
                    let number = moments.len();
                    self.frame(play, number)?;
                    if self.highlights.contains(&step) {
                        shown.push(number);
                    } else {
                        for finger in &mut moment.fingers {
                            finger.states = Vec::new();
                        }
                    }
                    moments.push(moment);
                }
                Err(PlayError::Unsolved { time_s, phase, why }) => {
                    progress.note(&format!("frame at {time_s:.3} s left out: {why}"));
                    manifest.unsolved.push(Unsolved { time_s, phase, why });
                }
                Err(PlayError::Impossible(error)) => return Err(error.into()),
            }
            progress.step();
        }
        progress.done();
        Ok(Recorded {
            moments,
            shown,
            rests,
        })
    }

    /// Makes the pictures of a frame unless they exist. The last existing one is made again and compared: another version of the
    /// world must not continue this run.
    fn frame(&self, play: &mut dyn Play, number: usize) -> Result<(), Error> {
        if number + 1 < self.resumed {
            return Ok(());
        }
        for finger in 0..play.fingers() {
            let name = frame_name(number, finger);
            let bytes = grey_png(&play.render(finger, number, self.size))?;
            if number + 1 > self.resumed {
                self.folder.write(&name, &bytes)?;
            } else if self.folder.read(&name)? != bytes {
                return Err(Error::usage(format!(
                    "--out {}: found a {name} that differs from what this program makes, expected one of the same \
                     version: choose another folder",
                    self.folder.path().display()
                )));
            }
        }
        Ok(())
    }
}

/// Writes maps, truth and preview.
fn write_results(
    folder: &Folder,
    play: &dyn Play,
    manifest: &Manifest,
    recorded: &Recorded,
) -> Result<(), Error> {
    let mut csv = truth::names(play.fingers(), play.extra_columns()).join(",") + "\n";
    for (number, moment) in recorded.moments.iter().enumerate() {
        let cells: Vec<String> = truth::row(number, moment)
            .iter()
            .map(ToString::to_string)
            .collect();
        csv += &(cells.join(",") + "\n");
    }
    folder.write("truth.csv", csv.as_bytes())?;
    for finger in 0..play.fingers() {
        let maps = recorded
            .moments
            .iter()
            .map(|moment| &moment.fingers[finger].forces);
        folder.write(&(named("maps", finger) + ".npy"), &maps_npy(maps)?)?;
        let mut columns = Vec::with_capacity(recorded.shown.len());
        for &number in &recorded.shown {
            let name = frame_name(number, finger);
            columns.push(Column {
                picture: Grey::of(&decode_grey(&folder.read(&name)?, &name)?),
                moment: recorded.moments[number].clone(),
            });
        }
        let sheet = sheet::draw(&manifest.scene, &recorded.rests[finger], &columns, finger);
        let png = encode_png(&sheet.pixels, sheet.width, sheet.height, png::ColorType::Rgb)?;
        folder.write(&(named("preview", finger) + ".png"), &png)?;
    }
    Ok(())
}

fn write_clips(
    folder: &Folder,
    play: &dyn Play,
    frames_per_second: f64,
    moments: &[Moment],
) -> Result<(), Error> {
    for finger in 0..play.fingers() {
        let full = full_scale(moments.iter().map(|moment| &moment.fingers[finger]));
        let mut clip = Clip::new(frames_per_second, full)?;
        for (number, moment) in moments
            .iter()
            .enumerate()
            .step_by(clip::stride(frames_per_second))
        {
            let name = frame_name(number, finger);
            let picture = Grey::of(&decode_grey(&folder.read(&name)?, &name)?);
            let state = &moment.fingers[finger];
            let ratio = state
                .stick_ratio
                .map_or(String::new(), |ratio| format!("  stick ratio {ratio:.2}"));
            let slip = if moment.slip { "  SLIP" } else { "" };
            let caption = format!("{:.2} s  {}{ratio}{slip}", moment.time_s, moment.phase);
            clip.push(&caption, &picture, state)?;
        }
        folder.write(&(named("clip", finger) + ".gif"), &clip.finish()?)?;
    }
    Ok(())
}

/// A clip of each finger at the camera's resolution, as a camera would send it.
fn write_videos(folder: &Folder, fingers: usize, frames_per_second: f64, frames: usize) -> Result<(), Error> {
    for finger in 0..fingers {
        let path = folder.path().join(named("clip", finger) + ".avi");
        let mut clip: Option<ClipWriter> = None;
        for number in 0..frames {
            let name = frame_name(number, finger);
            let picture = decode_grey(&folder.read(&name)?, &name)?;
            let size = geometry::Size::new(picture.width, picture.height);
            let writer = match &mut clip {
                Some(writer) => writer,
                None => clip.insert(ClipWriter::create(&path, size, frames_per_second)?),
            };
            writer.push(&picture.pixels)?;
        }
        if let Some(clip) = clip {
            clip.finish()?;
        }
    }
    Ok(())
}

/// Frames in which a finger is pressed deeper than the linear layer is valid for.
fn too_deep(moments: &[Moment]) -> usize {
    let deep = |moment: &&Moment| {
        let mut fingers = moment.fingers.iter();
        fingers.any(|finger| finger.indentation > LARGEST_INDENTATION)
    };
    moments.iter().filter(deep).count()
}

fn summary(
    args: &SimulateArgs,
    play: &dyn Play,
    manifest: &Manifest,
    resumed: usize,
    moments: &[Moment],
) -> Summary {
    let fingers = || moments.iter().flat_map(|moment| &moment.fingers);
    Summary {
        scene: args.scene.display().to_string(),
        kind: play.kind(),
        out: args.out.display().to_string(),
        seed: manifest.seed,
        fingers: play.fingers(),
        frames: moments.len(),
        unsolved: manifest.unsolved.len(),
        resumed,
        seconds: moments.last().map_or(0.0, |moment| moment.time_s),
        too_deep: manifest.too_deep,
        slip_frames: moments.iter().filter(|moment| moment.slip).count(),
        normal_n_max: fingers().map(|finger| finger.force_n()[2]).fold(0.0, f64::max),
        stick_ratio_min: fingers().filter_map(|finger| finger.stick_ratio).reduce(f64::min),
    }
}

fn print_summary(summary: &Summary, json: bool) -> Result<(), Error> {
    let text = if json {
        serde_json::to_string(summary)?
    } else {
        let ratio = summary
            .stick_ratio_min
            .map_or("nothing touched".to_owned(), |ratio| {
                format!("stick ratio down to {ratio:.3}")
            });
        let deep = match summary.too_deep {
            0 => String::new(),
            frames => format!(
                "\n  {frames} frames are deeper than {:.0} % of the gel: the linear layer is doubtful there (column                  indentation)",
                100.0 * LARGEST_INDENTATION
            ),
        };
        format!(
            "{}: {} frames in {:.3} s ({} there before, {} left out), {}\n  normal force up to {:.3} N, {ratio}, {} \
             frames slip\n  in {}: frames, rest.png, maps.npy, truth.csv, preview.png, manifest.toml",
            summary.scene,
            summary.frames,
            summary.seconds,
            summary.resumed,
            summary.unsolved,
            if summary.fingers == 1 {
                "one finger"
            } else {
                "two fingers"
            },
            summary.normal_n_max,
            summary.slip_frames,
            summary.out,
        ) + &deep
    };
    match writeln!(io::stdout(), "{text}") {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Error::failed(format!(
            "the summary cannot be written ({error}), expected an open standard output"
        ))),
        _ => Ok(()),
    }
}

/// Progress on standard error: a bar on a terminal, ten lines elsewhere.
#[derive(Debug)]
struct Progress {
    bar: Option<ProgressBar>,
    total: usize,
    done: std::cell::Cell<usize>,
}

impl Progress {
    fn new(total: usize) -> Self {
        let bar = io::stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("{bar:40} {pos} of {len} frames, {eta} left")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            ProgressBar::new(total as u64).with_style(style)
        });
        Self {
            bar,
            total,
            done: std::cell::Cell::new(0),
        }
    }

    fn step(&self) {
        let before = self.done.get();
        self.done.set(before + 1);
        match &self.bar {
            Some(bar) => bar.inc(1),
            None if before * 10 / self.total != (before + 1) * 10 / self.total => {
                tracing::info!("{} of {} frames", before + 1, self.total);
            }
            None => {}
        }
    }

    fn note(&self, text: &str) {
        if let Some(bar) = &self.bar {
            bar.println(format!("gripline: {text}"));
        } else {
            tracing::warn!("{text}");
        }
    }

    fn done(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use gripline_simulation::Image;

    use super::*;
    use gripline_evaluation::play::FingerMoment;

    /// Four frames on two fingers, of which the second has no solution.
    #[derive(Debug, Default)]
    struct Stubborn {
        step: usize,
    }

    impl Play for Stubborn {
        fn kind(&self) -> &'static str {
            "press"
        }
        fn frames(&self) -> usize {
            4
        }
        fn fingers(&self) -> usize {
            2
        }
        fn extra_columns(&self) -> &'static [&'static str] {
            &["extra"]
        }
        fn highlights(&self) -> Vec<usize> {
            vec![0, 1, 3]
        }
        fn advance(&mut self) -> Result<Option<Moment>, PlayError> {
            self.step += 1;
            let time_s = 0.1 * self.step as f64;
            if self.step == 2 {
                return Err(PlayError::Unsolved {
                    time_s,
                    phase: "press".to_owned(),
                    why: "contact residual is 0.01".to_owned(),
                });
            }
            let finger = |finger: usize| FingerMoment {
                forces: [[0.0, 0.0, (self.step + 10 * finger) as f32]; 400],
                stick_ratio: Some(0.5),
                gross_slip: false,
                slip_mm: 0.0,
                indentation: 0.15 * self.step as f64 / 2.0,
                states: Vec::new(),
            };
            Ok(Some(Moment {
                time_s,
                phase: "press".to_owned(),
                slip: false,
                fingers: vec![finger(0), finger(1)],
                extra: vec![0.25],
            }))
        }
        fn render(&mut self, finger: usize, number: usize, _: FrameSize) -> Image {
            let mut image = Image::crop();
            image.pixels.fill((100 * finger + number) as u8);
            image
        }
        fn rest(&mut self, _: usize, _: FrameSize) -> Image {
            Image::crop()
        }
    }

    #[test]
    fn a_frame_without_solution_is_missing_everywhere_alike_counted_and_ends_with_loss() {
        let out = std::env::temp_dir().join(format!("gripline-stubborn-{}", std::process::id()));
        let _ = fs::remove_dir_all(&out);
        let args = SimulateArgs {
            scene: "scene.toml".into(),
            out: out.clone(),
            seed: None,
            frames: None,
            clip: true,
            video: true,
            json: true,
        };
        let manifest = Manifest {
            scene: "scene.toml".to_owned(),
            scene_crc64: "0".to_owned(),
            kind: "press".to_owned(),
            seed: 1,
            frame_size: "crop".to_owned(),
            world_version: WORLD_VERSION,
            gripline_version: String::new(),
            complete: false,
            frames: 0,
            fingers: 2,
            too_deep: 0,
            unsolved: Vec::new(),
        };
        let loss = Completion::WithLoss(format!(
            "done with loss: 1 of 4 frames did not converge and are left out; {} lists them",
            out.join("manifest.toml").display()
        ));
        let first = simulate(
            &args,
            &mut Stubborn::default(),
            FrameSize::Crop,
            10.0,
            manifest.clone(),
        );
        assert_eq!(first.unwrap(), loss);
        let csv = fs::read_to_string(out.join("truth.csv")).unwrap();
        let times: Vec<&str> = csv.lines().map(|line| line.split(',').nth(1).unwrap()).collect();
        assert_eq!(times, ["time_s", "0.1", "0.30000000000000004", "0.4"]);
        assert!(csv.starts_with(
            "frame,time_s,phase,slip,fn,fx,fy,mz,stick_ratio,gross_slip,slip_mm,indentation,fn_1,fx_1,fy_1,mz_1,\
             stick_ratio_1,gross_slip_1,slip_mm_1,indentation_1,extra\n\
             0,0.1,press,0,400,0,0,0,0.5,0,0,0.075,4400,0,0,0,0.5,0,0,0.075,0.25\n"
        ));
        let mut forces = Box::new([[0.0; 3]; 400]);
        for (name, first) in [("maps.npy", 1.0), ("maps_1.npy", 11.0)] {
            let mut maps = gripline_recording::maps_file::MapsFile::open(&out.join(name)).unwrap();
            assert_eq!(maps.frames(), 3);
            for step in [0.0, 2.0, 3.0] {
                assert!(maps.read_frame(&mut forces).unwrap());
                assert!((forces[7][2] - first - step).abs() < 1e-9 && forces[7][0] == 0.0);
            }
        }
        for folder in ["frames", "frames_1"] {
            assert_eq!(fs::read_dir(out.join(folder)).unwrap().count(), 3);
        }
        for name in [
            "preview.png",
            "preview_1.png",
            "rest.png",
            "rest_1.png",
            "clip.gif",
            "clip_1.gif",
            "clip.avi",
            "clip_1.avi",
        ] {
            assert!(out.join(name).is_file(), "{name}");
        }
        let text = fs::read_to_string(out.join("manifest.toml")).unwrap();
        let found: Manifest = toml::from_str(&text).unwrap();
        assert!(found.complete && found.frames == 3 && found.unsolved.len() == 1);
        // 0.075, 0.225 and 0.3 of the gel deep.
        assert_eq!(found.too_deep, 2);
        assert!((found.unsolved[0].time_s - 0.2).abs() < 1e-12);
        // Said again when it is asked for again, with nothing made twice.
        let again = simulate(&args, &mut Stubborn::default(), FrameSize::Crop, 10.0, manifest);
        assert_eq!(again.unwrap(), loss);
        fs::remove_dir_all(&out).unwrap();
    }
}

//! What becomes of pictures that cannot be believed, from the camera to the grip-force line and through `gripline infer`;
//! and how often a good picture is doubted. Sensors and scenes here calibrated nothing.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};

use gripline::source::SimulatedSource;
use gripline_firmware::Fault;
use gripline_firmware::sums::TaxelRule;
use gripline_link::EmbeddedLink;
use gripline_link::session::Session;
use gripline_network::scene::{GateDecision, GateKind};
use gripline_network::{Architecture, Network};
use gripline_pipeline::pipeline::Pipeline;
use gripline_pipeline::settings_for;
use gripline_protocol::message::{Command as Order, Status};
use gripline_protocol::{ForceMap, MapInfo};
use gripline_simulation::{CameraFault, Image};

/// A crop as an image.
fn image(crop: &[u8]) -> Image {
    Image {
        width: 440,
        height: 440,
        pixels: crop.to_vec(),
    }
}

fn pipeline(rest: &[Vec<u8>]) -> Pipeline {
    let network = Network::embedded(Architecture::default()).unwrap();
    let rule = TaxelRule::of(&settings_for(&network));
    Pipeline::new(network, rest, GateKind::default(), rule)
}

#[test]
fn every_camera_fault_is_noticed_under_a_touch_and_gives_the_last_good_map_marked() {
    let mut source = SimulatedSource::new(31, 60.0);
    let mut other = SimulatedSource::new(32, 60.0);
    let mut pipeline = pipeline(&source.rest(16));
    let (mut shown, mut forces) = (0, 0);
    for frame in 0..300_u64 {
        let picture = source.next(6.0).unwrap();
        let good = pipeline.process(&picture.crop).unwrap().map.clone();
        forces += u32::from(good != ForceMap::EMPTY);
        if frame % 25 != 0 {
            continue;
        }
        let mut pictures: Vec<(&str, Vec<u8>)> = CameraFault::ALL
            .iter()
            .map(|fault| (fault.name(), fault.of(&image(&picture.crop), frame).pixels))
            .collect();
        pictures.push(("another sensor", other.rest(1).remove(0)));
        for (name, crop) in pictures {
            let processed = pipeline.process(&crop).unwrap();
            assert!(!processed.health.is_good(), "{name} in frame {frame}");
            assert_eq!(processed.gate, GateDecision::Unhealthy, "{name} in frame {frame}");
            assert_eq!(processed.map, &good, "{name} in frame {frame}");
            shown += 1;
        }
    }
    assert!(
        shown == 96 && forces > 100,
        "{shown} faults shown, {forces} maps with forces"
    );
}

#[test]
fn the_line_holds_while_the_camera_is_black_and_the_fault_is_reported() {
    let network = Network::embedded(Architecture::default()).unwrap();
    let settings = settings_for(&network);
    let mut session = Session::open(Box::new(EmbeddedLink::new()), settings).unwrap();
    session.command(Order::Hold).unwrap();
    let mut source = SimulatedSource::new(41, 60.0);
    let mut pipeline = pipeline(&source.rest(16));
    let mut line = 0;
    for sequence in 0..240_u32 {
        let line_n = session
            .status()
            .map_or(2.5, |status| f64::from(status.line) / 4096.0);
        let picture = source.next(line_n).unwrap();
        let black = sequence >= 180;
        let crop = if black {
            CameraFault::Black
                .of(&image(&picture.crop), sequence.into())
                .pixels
        } else {
            picture.crop
        };
        let processed = pipeline.process(&crop).unwrap();
        let info = MapInfo {
            sequence,
            capture_us: session.now_us() as u32,
            health: processed.health,
            ..MapInfo::default()
        };
        session.send_map(&info, processed.map).unwrap();
        session.run_until(session.now_us() + 16_667).unwrap();
        let status = session.status().unwrap();
        let is_reported = (status.faults | status.latched) & Fault::UnhealthyMap.bit() != 0;
        assert_eq!(is_reported, black, "frame {sequence}");
        if black {
            assert!(
                status.line >= line,
                "frame {sequence}: {} after {line} of 4096 a newton",
                status.line
            );
        }
        line = status.line;
    }
    assert!(line > 2 * 4096, "the object was held by {line} of 4096 a newton");
}

/// Pipeline and microcontroller, with the gripper told to hold.
struct Chain {
    pipeline: Pipeline,
    session: Session,
    sequence: u32,
}

impl Chain {
    fn new(rest: &[Vec<u8>]) -> Self {
        let settings = settings_for(&Network::embedded(Architecture::default()).unwrap());
        let mut session = Session::open(Box::new(EmbeddedLink::new()), settings).unwrap();
        session.command(Order::Hold).unwrap();
        Self {
            pipeline: pipeline(rest),
            session,
            sequence: 0,
        }
    }

    /// What the gate decided, whether the map is marked, and what the microcontroller answered.
    fn frame(&mut self, crop: &[u8]) -> (GateDecision, bool, Status) {
        let processed = self.pipeline.process(crop).unwrap();
        let outcome = (processed.gate, !processed.health.is_good());
        let info = MapInfo {
            sequence: self.sequence,
            capture_us: self.session.now_us() as u32,
            health: processed.health,
            ..MapInfo::default()
        };
        self.session.send_map(&info, processed.map).unwrap();
        self.session.run_until(self.session.now_us() + 16_667).unwrap();
        self.sequence += 1;
        (outcome.0, outcome.1, *self.session.status().unwrap())
    }

    /// A firm hold in which nothing moves: a picture that the network has looked at, and the answer once the gate calls it
    /// unchanged.
    fn firm_quiet_hold(&mut self, source: &mut SimulatedSource) -> (Vec<u8>, Status) {
        for _ in 0..200 {
            let crop = source.next(12.0).unwrap().crop;
            let (gate, _, _) = self.frame(&crop);
            if gate != GateDecision::Infer {
                continue;
            }
            let (gate, is_marked, status) = self.frame(&crop);
            if gate == GateDecision::Unchanged && !is_marked && status.sums.force[2] > 2 * 4096 {
                return (crop, status);
            }
        }
        panic!("no picture of the firm hold was unchanged to the gate when it came again");
    }
}

#[test]
fn a_doubtful_picture_in_a_firm_quiet_hold_ends_no_contact_then_or_afterwards() {
    let mut source = SimulatedSource::new(61, 60.0);
    let mut other = SimulatedSource::new(62, 60.0).rest(1);
    let mut chain = Chain::new(&source.rest(16));
    let (crop, before) = chain.firm_quiet_hold(&mut source);
    let mut pictures: Vec<(&str, Vec<u8>)> = CameraFault::ALL
        .iter()
        .map(|fault| (fault.name(), fault.of(&image(&crop), 1).pixels))
        .collect();
    pictures.push(("another sensor", other.remove(0)));
    for (name, doubtful) in &pictures {
        let mut line = 0;
        for _ in 0..3 {
            let (gate, is_marked, status) = chain.frame(doubtful);
            assert!(is_marked && gate == GateDecision::Unhealthy, "{name}");
            assert_eq!(status.sums, before.sums, "{name}: the last good map again");
            assert!(status.line >= line, "{name}: {} after {line}", status.line);
            line = status.line;
        }
        // The gate has nothing to compare the next picture with.
        let (gate, is_marked, status) = chain.frame(&crop);
        assert!(!is_marked && gate == GateDecision::Infer, "{name}: {gate:?}");
        assert_eq!(status.sums, before.sums, "after {name}");
        let (gate, _, status) = chain.frame(&crop);
        assert_eq!(gate, GateDecision::Unchanged, "after {name}");
        assert_eq!(status.sums, before.sums, "after {name}");
        assert_eq!(status.state, before.state, "after {name}");
        assert!(
            status.line >= 2 * 4096,
            "after {name}: {} of 4096 a newton",
            status.line
        );
    }
}

/// Turns every second of the gate's blocks, 40×40 pixels, upside down: its brightness and contrast stay, its particles are
/// not found. Which half is turned matters to the gate's own check, which must not see it in the picture of the test.
fn with_blocks_turned(crop: &[u8]) -> Vec<u8> {
    let source = |pixel: usize| {
        let [row, column] = [pixel / 440, pixel % 440];
        if !(row / 40 + column / 40).is_multiple_of(2) {
            return pixel;
        }
        let [row, column] = [row, column].map(|at| at / 40 * 40 + 39 - at % 40);
        row * 440 + column
    };
    (0..crop.len()).map(|pixel| crop[source(pixel)]).collect()
}

#[test]
fn a_doubtful_output_of_the_network_gives_the_last_good_map_marked_and_the_network_looks_again() {
    let mut source = SimulatedSource::new(63, 60.0);
    let mut chain = Chain::new(&source.rest(16));
    let (crop, before) = chain.firm_quiet_hold(&mut source);
    let turned = with_blocks_turned(&crop);
    let (gate, is_marked, status) = chain.frame(&turned);
    assert!(
        is_marked && gate == GateDecision::Infer,
        "{gate:?}, marked: {is_marked}"
    );
    assert_eq!(status.sums, before.sums);
    let (gate, is_marked, status) = chain.frame(&turned);
    assert!(
        is_marked && gate == GateDecision::Infer,
        "{gate:?}, marked: {is_marked}"
    );
    assert_eq!(status.sums, before.sums);
    let (gate, is_marked, status) = chain.frame(&crop);
    assert!(
        !is_marked && gate == GateDecision::Infer,
        "{gate:?}, marked: {is_marked}"
    );
    assert_eq!(status.sums, before.sums);
}

/// A folder for one test's files, empty.
fn folder(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("infer-{name}"));
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

fn write_png(path: &PathBuf, width: u32, height: u32, pixels: &[u8]) {
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(pixels).unwrap();
}

fn gripline(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .args(arguments)
        .output()
        .unwrap()
}

/// The maps of an npy file: what follows its header, of 1,200 numbers each.
fn maps(path: &PathBuf) -> Vec<Vec<f32>> {
    let bytes = fs::read(path).unwrap();
    let header = usize::from(u16::from_le_bytes([bytes[8], bytes[9]])) + 10;
    let numbers: Vec<f32> = bytes[header..]
        .chunks_exact(4)
        .map(|bytes| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
        .collect();
    numbers.chunks_exact(1_200).map(<[f32]>::to_vec).collect()
}

#[test]
fn infer_gives_forces_for_a_touch_zeros_for_a_black_picture_and_says_so() {
    let folder = folder("black");
    let frames = folder.join("frames");
    fs::create_dir(&frames).unwrap();
    let mut source = SimulatedSource::new(51, 60.0);
    let rest = folder.join("rest.png");
    write_png(&rest, 440, 440, &source.rest(1)[0]);
    let mut last = Vec::new();
    for _ in 0..150 {
        last = source.next(6.0).unwrap().crop;
    }
    write_png(&frames.join("0.png"), 440, 440, &last);
    write_png(
        &frames.join("1.png"),
        440,
        440,
        &CameraFault::Black.of(&image(&last), 1).pixels,
    );
    write_png(&frames.join("2.png"), 440, 440, &last);
    let out = folder.join("maps.npy");
    let path = |path: &PathBuf| path.to_str().unwrap().to_owned();
    let ended = gripline(&[
        "infer",
        "--rest",
        &path(&rest),
        "--frames",
        &path(&frames),
        "--out",
        &path(&out),
    ]);
    let error = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(3), "{error}");
    for part in ["1 of 3 pictures", "1.png (too dark", "maps of zeros"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let maps = maps(&out);
    let normal_n = |map: &[f32]| map[800..].iter().sum::<f32>();
    assert_eq!(maps.len(), 3);
    assert!(normal_n(&maps[0]) > 2.0, "{}", normal_n(&maps[0]));
    assert!(maps[1].iter().all(|force| *force == 0.0));
    assert_eq!(maps[0], maps[2]);
}

#[test]
fn infer_with_a_black_picture_at_rest_believes_nothing() {
    let folder = folder("rest");
    let (rest, now, out) = (
        folder.join("rest.png"),
        folder.join("now.png"),
        folder.join("maps.npy"),
    );
    write_png(&rest, 440, 440, &vec![0; 440 * 440]);
    let crop = SimulatedSource::new(52, 60.0).rest(1).remove(0);
    write_png(&now, 440, 440, &crop);
    let path = |path: &PathBuf| path.to_str().unwrap().to_owned();
    let ended = gripline(&[
        "infer",
        "--rest",
        &path(&rest),
        "--frames",
        &path(&now),
        "--out",
        &path(&out),
    ]);
    assert_eq!(ended.status.code(), Some(3));
    assert!(maps(&out)[0].iter().all(|force| *force == 0.0));
}

/// Only `cargo xtask test --all` runs these.
mod slow {
    use super::*;

    #[test]
    fn of_twelve_hundred_good_pictures_none_is_doubted() {
        let mut doubted = 0;
        for seed in [21, 22, 23] {
            // 2.5 N slips, 12 N crushes: the script's whole range.
            let mut source = SimulatedSource::new(seed, 60.0);
            let mut pipeline = pipeline(&source.rest(16));
            for frame in 0..400_u32 {
                let picture = source.next([2.5, 6.0, 12.0][frame as usize / 10 % 3]).unwrap();
                let processed = pipeline.process(&picture.crop).unwrap();
                doubted += u32::from(!processed.health.is_good());
            }
        }
        // 0 of 1,200: fewer than one in 400 with 95 % confidence; the trainer's report has thousands more.
        assert_eq!(doubted, 0, "{doubted} of 1,200 good pictures were doubted");
    }
}

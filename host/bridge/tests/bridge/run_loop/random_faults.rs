//! Ten thousand frames of the loop with faults at random, from a seed: damaged and missing pictures, black ones, cables that
//! come out, a device that takes nothing, resets of the microcontroller, clocks that jump, a disk that gets full. The
//! loop goes on, every loss is counted, and the line is never driven by old maps. Virtual time, real code.

use std::cell::RefCell;
use std::io::{self, Write};
use std::path::Path;
use std::rc::Rc;
use std::time::Instant;

use gripline_firmware::sums::TaxelRule;
use gripline_firmware::{Fault, Program, ResetCause};
use gripline_network::scene::GateKind;
use gripline_network::{Architecture, Network};
use gripline_protocol::SensorId;
use gripline_protocol::message::{Command, GripMode};

use gripline::run::{Pacing, Run};
use gripline::source::{Picture, SimulatedSource};
use gripline_capture::JpegCrop;
use gripline_link::session::Session;
use gripline_link::usb::UsbFinder;
use gripline_link::{EmbeddedLink, HotPlug};
use gripline_pipeline::pipeline::Pipeline;
use gripline_pipeline::settings_for;
use gripline_recording::telemetry::{NO_DEVICE, NO_STATUS};
use gripline_recording::{Image, Metadata, Pace, Recorder};
use gripline_test_board::fake_usb::{FakeBus, FakeClock, FakeUsb, device};

const FRAME_US: f64 = 1e6 / 60.0;
/// Frames after a disturbance until the next one of a kind that must be counted by itself: everything is as it was.
const CALM: u64 = 180;

/// A recording on a disk with this many bytes left.
fn small_disk(bytes: usize) -> Recorder {
    let (path, metadata) = (Path::new("full.mcap"), Metadata::default());
    Recorder::onto(path, Disk(bytes), &metadata, 1, Pace::AsFastAsPossible).unwrap()
}

/// A disk with this many bytes left.
struct Disk(usize);

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if bytes.len() > self.0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.0 -= bytes.len();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// SplitMix64.
struct Dice(u64);

impl Dice {
    fn throw(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn below(&mut self, end: u64) -> u64 {
        self.throw() % end
    }

    fn happens(&mut self, per_mille: u64) -> bool {
        self.below(1_000) < per_mille
    }
}

/// A camera's picture as it comes, and what the scene wants then.
struct Shot {
    file: Vec<u8>,
    crop: Vec<u8>,
    requested_mode: Option<GripMode>,
}

/// One round of the simulated scene, twenty pictures a second.
fn shots() -> (Vec<Shot>, Vec<Vec<u8>>) {
    let mut source = SimulatedSource::new(1, 20.0);
    let rest = source.rest(4);
    let shots = (0..240).map(|_| {
        let Picture {
            crop, requested_mode, ..
        } = source.next(6.0).unwrap();
        let mut file = Vec::new();
        jpeg_encoder::Encoder::new(&mut file, 95)
            .encode(&crop, 440, 440, jpeg_encoder::ColorType::Luma)
            .unwrap();
        Shot {
            file,
            crop,
            requested_mode,
        }
    });
    (shots.collect(), rest)
}

/// What the microcontroller must never do: go by old maps, or let go while it does not know.
#[derive(Default)]
struct Watch {
    maps: u32,
    uptime_ms: u32,
    mode: GripMode,
    line: i32,
    /// When the newest map was accepted, holding began or it started.
    fresh_us: u64,
    holding: u64,
    stale: u64,
}

impl Watch {
    fn look(&mut self, program: &Program, now_us: u64, stamp_us: u64) {
        let status = program.status();
        let is_anew = status.uptime_ms < self.uptime_ms;
        if status.maps != self.maps || status.mode != self.mode || is_anew {
            self.fresh_us = now_us;
        }
        let is_holding = status.mode == GripMode::Hold;
        self.holding += u64::from(is_holding);
        let stale = status.faults & Fault::StaleMaps.bit() != 0;
        let limit_us = u64::from(program.settings().stale_ms) * 1_000;
        if is_holding && now_us - self.fresh_us.max(stamp_us) > limit_us + 2_000 {
            self.stale += 1;
            assert!(stale, "{now_us} µs: maps of {} µs count as fresh", self.fresh_us);
        }
        if is_holding && stale && !is_anew && self.mode == GripMode::Hold {
            assert!(
                status.line >= self.line,
                "{now_us} µs: the line fell without a fresh map"
            );
        }
        (self.maps, self.uptime_ms) = (status.maps, status.uptime_ms);
        (self.mode, self.line) = (status.mode, status.line);
    }
}

/// What the test did.
#[derive(Debug, Default, PartialEq, Eq)]
struct Done {
    damaged: u64,
    missing: u64,
    black: u64,
    pulls: u32,
    stuck: u64,
    resets: u32,
    jumps: u64,
}

/// Only `cargo xtask test --all` runs these.
mod slow {
    use super::*;

    #[test]
    #[expect(
        clippy::too_many_lines,
        reason = "one story, in the order in which it happens"
    )]
    fn ten_thousand_frames_with_faults_at_random_go_on_and_count_every_loss() {
        const FRAMES: u64 = 10_000;
        let (shots, rest) = shots();
        let network = Network::embedded(Architecture::default()).unwrap();
        let settings = settings_for(&network);
        let world = FakeUsb::with(vec![device("A1", "1-2"), device("B7", "1-3")]);
        let finder = UsbFinder::new(FakeBus(Rc::clone(&world)), Some("A1".to_owned()));
        let link = HotPlug::open_with(Box::new(finder), FakeClock(Rc::clone(&world))).unwrap();
        let session = Session::open(Box::new(link), settings).unwrap();
        let mut pipeline = Pipeline::new(network, &rest, GateKind::default(), TaxelRule::of(&settings));
        let mut run = Run::new(session, Pacing::None, 60.0);
        // Gets full in the middle.
        run.recorder = Some(small_disk(40 << 20));
        run.pictures = gripline_recording::Pictures::Small;
        let watch = Rc::new(RefCell::new(Watch::default()));
        let eye = Rc::clone(&watch);
        *world.watch.borrow_mut() = Some(Box::new(move |program, now_us, stamp_us| {
            eye.borrow_mut().look(program, now_us, stamp_us);
        }));

        let (mut dice, mut done, mut jpeg) = (Dice(7), Done::default(), JpegCrop::default());
        let (mut attached, mut away_until, mut stuck_until, mut last) = (Vec::new(), 0, 0, 0);
        let (mut shown, mut unreported, mut unsound) = (0_u64, 0, 0);
        for number in 0..FRAMES + CALM {
            let may_break = number < FRAMES;
            if number == away_until && !attached.is_empty() {
                world.attached.replace(std::mem::take(&mut attached));
            }
            world.is_stuck.set(number < stuck_until);
            let is_calm = number > last + CALM && run.control.session.is_sound();
            if may_break && attached.is_empty() && dice.happens(6) {
                attached = world.pull();
                (away_until, last) = (number + 1 + dice.below(60), number + 60);
                done.pulls += 1;
            } else if may_break && is_calm && dice.happens(10) {
                let causes = [ResetCause::Watchdog, ResetCause::Software, ResetCause::PowerOn];
                world.reset(causes[dice.below(3) as usize], dice.below(300_000));
                (done.resets, last) = (done.resets + 1, number);
            } else if may_break && is_calm && dice.happens(12) {
                // The host stands still, or its clock goes ahead.
                let jump_us = 120_000 + dice.below(2_000_000);
                if dice.happens(500) {
                    world.pass_to(world.now_us() + jump_us);
                    world
                        .host_ahead_us
                        .set(world.host_ahead_us.get() - jump_us as i64);
                } else {
                    world
                        .host_ahead_us
                        .set(world.host_ahead_us.get() + jump_us as i64);
                }
                (done.jumps, last) = (done.jumps + 1, number + jump_us / FRAME_US as u64);
            } else if may_break && dice.happens(3) {
                stuck_until = number + 1 + dice.below(8);
                last = number.max(last);
                done.stuck += 1;
            }
            if number % 500 == 499 {
                // A person looks, and acknowledges.
                run.control
                    .session
                    .command(Command::Acknowledge { faults: u32::MAX })
                    .unwrap();
            }

            let begun_us = world.now_us();
            let shot = &shots[(number % shots.len() as u64) as usize];
            let mut crop = shot.crop.clone();
            let is_there = if may_break && dice.happens(30) {
                done.missing += 1;
                false
            } else if may_break && dice.happens(20) {
                let mut file = shot.file.clone();
                file.truncate(dice.below(file.len() as u64) as usize);
                assert!(jpeg.decode(&file, &mut crop).is_err(), "half a picture is none");
                done.damaged += 1;
                false
            } else {
                if may_break && dice.happens(10) {
                    crop.fill(0);
                    done.black += 1;
                }
                true
            };
            let was_sound = run.control.session.is_sound();
            if is_there {
                let picture = Picture {
                    crop,
                    came: Instant::now(),
                    taken: Instant::now(),
                    decode_us: 0.0,
                    truth: None,
                    requested_mode: shot.requested_mode,
                };
                let report = run.frame(&mut pipeline, SensorId::FIRST, picture).unwrap();
                let is_reported = report
                    .faults
                    .iter()
                    .any(|fault| [NO_DEVICE, NO_STATUS].contains(fault));
                // What the microcontroller said a quarter of a second ago is never shown as the present without a word.
                unreported = if is_reported || run.control.session.status_age_us() <= 250_000 {
                    0
                } else {
                    unreported + 1
                };
                assert_eq!(unreported, 0, "frame {number}");
                shown += u64::from(is_reported);
                unsound += u64::from(!was_sound || !run.control.session.is_sound());
            } else {
                // As a source does that has nothing to give: the frame's time passes.
                run.control
                    .idle(((run.frame + 1) as f64 * FRAME_US) as u64)
                    .unwrap();
                run.frame += 1;
            }
            // Whatever the host's clock shows, the world goes on.
            world.pass_to(begun_us + FRAME_US as u64);
        }

        let (session, summary) = (&run.control.session, &run.summary);
        assert!(session.is_sound());
        assert_eq!(session.presence().away, None);
        assert_eq!(session.shadow().mismatches(), 0);
        assert_eq!(session.presence().losses, done.pulls, "{done:?}");
        assert_eq!(session.restarts(), done.resets, "{done:?}");
        assert_eq!(session.clock_jumps(), done.jumps, "{done:?}");
        let frames = FRAMES + CALM - done.missing - done.damaged;
        let gated =
            summary.gate_no_contact + summary.gate_unchanged + summary.gate_network + summary.gate_unhealthy;
        assert_eq!((gated, summary.gate_unhealthy >= done.black), (frames, true));
        // Answered in its frame, or counted; some answers come a frame too late and are checked anyway. Those of one who may
        // have other settings are not.
        let (checked, unanswered) = (session.shadow().checked(), summary.maps_unanswered);
        assert!(
            checked <= frames && frames - unanswered <= checked + unsound,
            "{checked} of {frames} checked, {unanswered} unanswered, {unsound} while it was not known"
        );
        assert!(unanswered >= summary.maps_not_taken && summary.maps_not_taken > 0);
        assert_eq!(
            (summary.pictures_late, summary.maps_late),
            (0, 0),
            "the world waits"
        );
        let watch = watch.borrow();
        assert!(
            watch.holding > 50_000 && watch.stale > 1_000,
            "{} ticks holding, {} of them stale",
            watch.holding,
            watch.stale
        );
        assert!(shown > 100, "{shown} frames without device or status");
        let recorded = run.recorder.take().unwrap().finish();
        assert!(recorded.failed.is_some() && recorded.frames > 0, "{recorded:?}");
        assert_eq!(recorded.frames + recorded.frames_dropped, frames, "{recorded:?}");
        println!(
            "{frames} of {} frames: {done:?}; {unanswered} maps unanswered, {} of them not taken, {} of {} ms holding with old maps; \
             recorded {} until the disk was full, {} not; {checked} answers checked, 0 wrong",
            FRAMES + CALM,
            summary.maps_not_taken,
            watch.stale,
            watch.holding,
            recorded.frames,
            recorded.frames_dropped
        );
    }

    /// Memory of this process that lies in RAM, KiB.
    #[cfg(target_os = "linux")]
    fn resident_kib() -> u64 {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
        line.split_whitespace().nth(1).unwrap().parse().unwrap()
    }

    /// Unpaced, recorded without pictures: three minutes' worth of frames, or as many as `GRIPLINE_SOAK_FRAMES` says; half an hour
    /// has 108,000, which take 0.7 GB of disk.
    #[cfg(target_os = "linux")]
    #[test]
    fn memory_stays_flat_while_frames_are_recorded() {
        // In a process of its own: other tests have memory too.
        const ALONE: &str = "GRIPLINE_SOAK_ALONE";
        if std::env::var_os(ALONE).is_none() {
            let name = concat!(module_path!(), "::memory_stays_flat_while_frames_are_recorded");
            let output = std::process::Command::new(std::env::current_exe().unwrap())
                .args(["--exact", name.split_once("::").unwrap().1, "--nocapture"])
                .env(ALONE, "1")
                .output()
                .unwrap();
            let said = String::from_utf8_lossy(&output.stdout);
            println!("{said}");
            assert!(
                output.status.success() && said.contains("1 passed"),
                "{said}{}",
                String::from_utf8_lossy(&output.stderr)
            );
            return;
        }
        let frames: u64 =
            std::env::var("GRIPLINE_SOAK_FRAMES").map_or(3 * 60 * 60, |text| text.parse().unwrap());
        let (shots, rest) = shots();
        let network = Network::embedded(Architecture::default()).unwrap();
        let settings = settings_for(&network);
        let session = Session::open(Box::new(EmbeddedLink::new()), settings).unwrap();
        let mut pipeline = Pipeline::new(network, &rest, GateKind::default(), TaxelRule::of(&settings));
        let mut run = Run::new(session, Pacing::None, 60.0);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("soak.mcap");
        let rest = rest.into_iter().map(|crop| Image::grey(440, crop)).collect();
        let recorder = Recorder::start(&path, &Metadata::default(), &[rest], Pace::AsFastAsPossible);
        run.recorder = Some(recorder.unwrap());
        run.pictures = gripline_recording::Pictures::Off;
        let mut samples = Vec::new();
        for number in 0..frames {
            let shot = &shots[(number % shots.len() as u64) as usize];
            let picture = Picture {
                crop: shot.crop.clone(),
                came: Instant::now(),
                taken: Instant::now(),
                decode_us: 0.0,
                truth: None,
                requested_mode: shot.requested_mode,
            };
            run.frame(&mut pipeline, SensorId::FIRST, picture).unwrap();
            if number.is_multiple_of(600) {
                samples.push(resident_kib());
            }
        }
        let recorded = run.recorder.take().unwrap().finish();
        assert_eq!((recorded.frames, recorded.failed), (frames, None));
        // The first minute fills queues and buffers.
        let settled = &samples[6..];
        let (min, max) = (settled.iter().min().unwrap(), settled.iter().max().unwrap());
        println!(
            "{frames} frames, {} MB recorded: {min} to {max} KiB resident after the first minute, {} KiB apart; {} to {} KiB \
             from first to last",
            std::fs::metadata(&path).unwrap().len() / 1_000_000,
            max - min,
            settled[0],
            settled[settled.len() - 1]
        );
        assert!(max - min <= 2_048, "{samples:?} KiB, expected ± 1 MiB");
    }
}

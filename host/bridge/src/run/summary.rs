//! The summary of a run: the last line of `--json`, and the text for people.

use std::fmt::Write as _;

use gripline_protocol::message::Hello;
use serde::Serialize;

use super::capture_to_line::CaptureToLineSummary;

use crate::source::Source;
use gripline_capture::Counts;
use gripline_recording::RecordingSummary;

/// The last line of `--json`.
#[derive(Debug, Serialize)]
pub struct Summary {
    /// Always true: distinguishes this object from those of the frames.
    #[serde(rename = "summary")]
    pub last: bool,
    /// Link to the device, as `--mcu` names it.
    pub mcu: String,
    /// Counts of the pictures of cameras, or of files, all fingertips together.
    pub pictures: Option<Counts>,
    /// One or two.
    pub fingertips: Vec<FingertipSummary>,
    /// Version, commit and board from the handshake.
    pub firmware: Option<String>,
    /// Processed frames, including late ones.
    pub frames: u64,
    /// Seconds, on the run's clock.
    pub seconds: f64,
    /// Frames a second.
    pub frames_per_second: f64,
    /// Processor time of the whole process over wall time: 1 is one core.
    pub cpu_share: Option<f64>,
    /// Frames without contact: an empty map, without the network.
    pub gate_no_contact: u64,
    /// Frames like the last one: its map again, without the network.
    pub gate_unchanged: u64,
    /// Frames with inference.
    pub gate_network: u64,
    /// Frames with an implausible picture: each repeated the last good map, marked.
    pub gate_unhealthy: u64,
    /// Times of each stage.
    pub stages: Vec<StageSummary>,
    /// From a camera's time stamp to the grip-force line; `None` without a camera.
    pub capture_to_line: Option<CaptureToLineSummary>,
    /// From a picture's bytes until the link has its map's last packet, decoding included: median, µs.
    pub frame_to_link_us_median: f64,
    /// 99th percentile of the same, µs.
    pub frame_to_link_us_p99: f64,
    /// 99.9th percentile of the same, µs.
    pub frame_to_link_us_p999: f64,
    /// The same over the frames with inference: median, µs.
    pub network_frame_to_link_us_median: f64,
    /// 99.9th percentile of the same, µs.
    pub network_frame_to_link_us_p999: f64,
    /// Bytes of force maps sent.
    pub wire_bytes: u64,
    /// Answers compared with this host's own detector.
    pub answers_checked: u64,
    /// Answers that differed from it.
    pub shadow_mismatches: u64,
    /// Maps without an answer in their frame.
    pub maps_unanswered: u64,
    /// How many of them the link did not accept: away or busy.
    pub maps_not_taken: u64,
    /// Commands that the device refused.
    pub commands_refused: u64,
    /// Why it refused the last of them.
    pub last_refusal: Option<String>,
    /// Holds and releases that the microcontroller did not confirm.
    pub requests_unconfirmed: u64,
    /// Pictures dropped because they were too old.
    pub pictures_late: u64,
    /// Maps dropped because they were too old.
    pub maps_late: u64,
    /// Frames whose stick ratio was below the threshold.
    pub slip_frames: u64,
    /// Frames in which the whole object slides while it is to be held.
    pub gross_slip_frames: u64,
    /// How far the simulated object slid while it was to be held, mm.
    pub slip_mm: f64,
    /// Lowest force on the line while the gripper held something, N.
    pub line_n_min_holding: f64,
    /// Highest force on the line, N.
    pub line_n_max: f64,
    /// Longest times of the device's stages, cycles.
    pub microcontroller_worst_cycles: [u32; 4],
    /// Restarts of the microcontroller (watchdog, crash, power), each followed by a new handshake and its settings.
    pub microcontroller_restarts: u32,
    /// How often this host's clock jumped against the microcontroller's, or a late first map locked the others out.
    pub clock_jumps: u64,
    /// How often the microcontroller's device went away; the run reconnected when it came back.
    pub link_losses: u32,
    /// Packets that it did not accept, away or busy.
    pub link_packets_lost: u64,
    /// Real-time settings that the system refused; `None` when not requested.
    pub realtime_lacks: Option<Vec<String>>,
    /// Lines, or pictures of the view, whose reader was too slow.
    pub output_dropped: u64,
    /// The recording, if there was one.
    pub recording: Option<RecordingSummary>,
}

/// Counts of one fingertip's pictures.
#[derive(Debug, Clone, Serialize)]
pub struct FingertipSummary {
    /// The configured source.
    pub source: String,
    /// Those of a camera, or of files.
    pub pictures: Option<Counts>,
    /// Processed pictures.
    pub frames: u64,
    /// Maps without an answer in their frame.
    pub maps_unanswered: u64,
    /// Answers compared with this host's own detector.
    pub answers_checked: u64,
    /// Answers that differed from it.
    pub shadow_mismatches: u64,
}

impl FingertipSummary {
    /// Before its first picture.
    pub(super) fn of(source: &Source) -> Self {
        Self {
            source: source.to_string(),
            pictures: None,
            frames: 0,
            maps_unanswered: 0,
            answers_checked: 0,
            shadow_mismatches: 0,
        }
    }
}

/// Times of one stage of the pipeline.
#[derive(Debug, Serialize)]
pub struct StageSummary {
    /// Its name.
    pub stage: &'static str,
    /// Frames in which it ran.
    pub frames: u64,
    /// Median, µs.
    pub median_us: f64,
    /// 99th percentile, µs.
    pub p99_us: f64,
    /// 99.9th percentile, µs.
    pub p999_us: f64,
    /// Its deadline.
    pub deadline_us: f64,
    /// Frames in which it took longer.
    pub late: u64,
}

impl Summary {
    /// For a run that has not begun.
    pub(super) fn of_link(mcu: String, firmware: Option<&Hello>) -> Self {
        Self {
            last: true,
            mcu,
            pictures: None,
            fingertips: Vec::new(),
            firmware: firmware.map(ToString::to_string),
            frames: 0,
            seconds: 0.0,
            frames_per_second: 0.0,
            cpu_share: None,
            gate_no_contact: 0,
            gate_unchanged: 0,
            gate_network: 0,
            gate_unhealthy: 0,
            stages: Vec::new(),
            capture_to_line: None,
            frame_to_link_us_median: 0.0,
            frame_to_link_us_p99: 0.0,
            frame_to_link_us_p999: 0.0,
            network_frame_to_link_us_median: 0.0,
            network_frame_to_link_us_p999: 0.0,
            wire_bytes: 0,
            answers_checked: 0,
            shadow_mismatches: 0,
            maps_unanswered: 0,
            maps_not_taken: 0,
            commands_refused: 0,
            last_refusal: None,
            requests_unconfirmed: 0,
            pictures_late: 0,
            maps_late: 0,
            slip_frames: 0,
            gross_slip_frames: 0,
            slip_mm: 0.0,
            line_n_min_holding: f64::INFINITY,
            line_n_max: 0.0,
            microcontroller_worst_cycles: [0; 4],
            microcontroller_restarts: 0,
            clock_jumps: 0,
            link_losses: 0,
            link_packets_lost: 0,
            realtime_lacks: None,
            output_dropped: 0,
            recording: None,
        }
    }

    /// The losses, as text; empty if there were none.
    #[must_use]
    pub fn losses(&self) -> Vec<String> {
        let mut losses = Vec::new();
        let mut lost = |count: u64, what: &str| {
            if count > 0 {
                losses.push(format!("{count} of {} {what}", self.frames));
            }
        };
        lost(
            self.gate_unhealthy,
            "pictures could not be believed; each gave the last good map again, marked",
        );
        lost(
            self.pictures_late,
            "pictures were too old when their turn came and were dropped: the machine is too slow or busy",
        );
        lost(
            self.maps_late,
            "maps were too old to be sent and were dropped: the machine is too slow or busy",
        );
        lost(
            self.maps_unanswered,
            "maps got no answer from the microcontroller",
        );
        for (place, fingertip) in self.fingertips.iter().enumerate() {
            let of = if place == 0 { "" } else { " (second fingertip)" };
            let pictures = fingertip.pictures.as_ref();
            let lost = pictures.map(losses_of).unwrap_or_default();
            losses.extend(lost.into_iter().map(|loss| format!("{loss}{of}")));
        }
        let mut lost = |count: u64, what: &str| {
            if count > 0 {
                losses.push(format!("{count} of {} {what}", self.frames));
            }
        };
        if let Some(recording) = &self.recording {
            lost(
                recording.pictures_dropped,
                "pictures are not in the recording: the disk was too slow",
            );
            lost(recording.frames_dropped, "frames are not in the recording");
            losses.extend(recording.failed.clone());
        }
        if self.output_dropped > 0 {
            losses.push(format!(
                "{} lines or pictures of the view were not written: the reader or the terminal was too slow",
                self.output_dropped
            ));
        }
        if self.requests_unconfirmed > 0 {
            losses.push(format!(
                "{} times the microcontroller did not confirm that it holds or releases",
                self.requests_unconfirmed
            ));
        }
        if self.link_losses > 0 {
            losses.push(format!(
                "the microcontroller's device went away {} times, {} packets were lost",
                self.link_losses, self.link_packets_lost
            ));
        }
        losses
    }
}

/// The unused pictures, as text.
fn losses_of(pictures: &Counts) -> Vec<String> {
    let absence_s = pictures.longest_absence_s;
    [
        (
            pictures.missed,
            "pictures never came: camera or bus too slow".to_owned(),
        ),
        (
            pictures.overtaken,
            "pictures came too late and were passed over for newer ones".to_owned(),
        ),
        (
            pictures.damaged,
            "pictures were damaged and passed over".to_owned(),
        ),
        (
            pictures.disconnects,
            format!("times the camera went away, for {absence_s:.1} s at most"),
        ),
    ]
    .into_iter()
    .filter(|(count, _)| *count > 0)
    .map(|(count, what)| format!("{count} {what}"))
    .collect()
}

/// The summary for people.
pub(super) fn summary_text(summary: &Summary) -> String {
    let firmware = summary.firmware.as_deref().unwrap_or("unknown");
    let cpu = summary.cpu_share.map_or(String::new(), |share| {
        format!(", {:.1} % of a core", share * 100.0)
    });
    let mut text = format!(
        "{} frames in {:.1} s ({:.1} a second{cpu}) with the {}, firmware {firmware}\n",
        summary.frames, summary.seconds, summary.frames_per_second, summary.mcu
    );
    // Writing to a String cannot fail.
    let _ = writeln!(
        text,
        "gate: {} no contact, {} unchanged, {} to the network",
        summary.gate_no_contact, summary.gate_unchanged, summary.gate_network
    );
    for stage in &summary.stages {
        let _ = writeln!(
            text,
            "{:>12}  median {:7.1} µs  p99 {:7.1} µs  p99.9 {:7.1} µs  {} over {:.0} µs",
            stage.stage, stage.median_us, stage.p99_us, stage.p999_us, stage.late, stage.deadline_us
        );
    }
    if let Some(way) = &summary.capture_to_line {
        for (part, name) in [
            (way.driver, "driver"),
            (way.hand_over, "hand-over"),
            (way.to_link, "all to link"),
            (way.to_line, "all to line"),
        ] {
            let _ = writeln!(text, "{}", part.text(name));
        }
    }
    let _ = writeln!(
        text,
        "frame to link: median {:.0} µs, p99.9 {:.0} µs; with the network {:.0} and {:.0} µs",
        summary.frame_to_link_us_median,
        summary.frame_to_link_us_p999,
        summary.network_frame_to_link_us_median,
        summary.network_frame_to_link_us_p999
    );
    let _ = write!(
        text,
        "line {:.2} to {:.2} N; {} slip frames, {} frames of gross slip ({:.2} mm); {} answers checked, {} wrong, {} maps unanswered",
        summary.line_n_min_holding,
        summary.line_n_max,
        summary.slip_frames,
        summary.gross_slip_frames,
        summary.slip_mm,
        summary.answers_checked,
        summary.shadow_mismatches,
        summary.maps_unanswered
    );
    if let [first, second] = summary.fingertips.as_slice() {
        let _ = write!(
            text,
            "\n{} frames of the first fingertip, {} of the second",
            first.frames, second.frames
        );
    }
    if let Some(recording) = &summary.recording {
        let _ = write!(text, "\n{} frames recorded", recording.frames);
    }
    if let Some(refusal) = &summary.last_refusal {
        let _ = write!(
            text,
            "\n{} commands refused by the microcontroller, the last: {refusal}",
            summary.commands_refused
        );
    }
    if summary.microcontroller_restarts > 0 {
        let _ = write!(
            text,
            "\nthe microcontroller restarted {} times and was met again",
            summary.microcontroller_restarts
        );
    }
    text
}

//! The values of a run in Prometheus' text format. Pure.

use std::fmt::Write as _;

use gripline_protocol::SENSORS;

use gripline_recording::telemetry::{FrameReport, STAGES};

/// Quantiles of the stage times.
pub const QUANTILES: [f64; 3] = [0.5, 0.99, 0.999];

/// The values.
#[derive(Debug, Clone, Default)]
pub struct Values {
    /// The newest frame of each fingertip.
    pub newest: [Option<FrameReport>; SENSORS],
    /// Frames so far.
    pub frames: u64,
    /// Frames by gate decision: without contact, unchanged, through the network, unhealthy.
    pub gate: [u64; 4],
    /// Maps that got no answer.
    pub maps_unanswered: u64,
    /// Answers that differ from the shadow check.
    pub shadow_mismatches: u64,
    /// Frames that came more than a frame too late.
    pub frames_late: u64,
    /// Pictures and frames that the recorder dropped.
    pub record_dropped: [u64; 2],
    /// Pictures that never came, were overtaken by a newer one, or were damaged.
    pub pictures_lost: [u64; 3],
    /// [`QUANTILES`] of every stage, µs.
    pub stages_us: [[f64; 3]; STAGES.len()],
    /// [`QUANTILES`] of every part of [`CAPTURE_PARTS`], µs; 0 without a camera.
    pub capture_us: [[f64; 3]; CAPTURE_PARTS.len()],
}

/// Parts of a camera picture's latency besides the stages: from the driver's time stamp to its bytes, from decoding to the loop,
/// and all from the time stamp to the link.
pub const CAPTURE_PARTS: [&str; 3] = ["driver", "hand_over", "capture_to_link"];

/// Names of the gate's decisions.
const GATES: [&str; 4] = ["no_contact", "unchanged", "network", "unhealthy"];
/// Pictures that no page wanted.
const LOST: [&str; 3] = ["missed", "overtaken", "damaged"];
/// Names of the slip states.
const STATES: [&str; 4] = ["NO_CONTACT", "STICK", "INCIPIENT", "SLIP"];

impl Values {
    /// As Prometheus reads them.
    pub(crate) fn text(&self) -> String {
        let mut page = Page(String::new());
        page.metric(
            "frames_total",
            "counter",
            "Frames processed.",
            &[("", self.frames as f64)],
        );
        let label = |name: &str, value: &str| format!("{{{name}=\"{value}\"}}");
        let gates: Vec<_> = GATES
            .iter()
            .zip(self.gate)
            .map(|(gate, count)| (label("verdict", gate), count as f64))
            .collect();
        page.labelled(
            "gate_total",
            "counter",
            "Frames by what the scene gate said of them.",
            &gates,
        );
        for (name, help, count) in [
            (
                "maps_unanswered_total",
                "Maps without an answer from the microcontroller.",
                self.maps_unanswered,
            ),
            (
                "shadow_mismatches_total",
                "Answers that differ from the host's own.",
                self.shadow_mismatches,
            ),
            (
                "frames_late_total",
                "Pictures and maps that were too old and dropped.",
                self.frames_late,
            ),
            (
                "record_pictures_dropped_total",
                "Pictures left out of the recording.",
                self.record_dropped[0],
            ),
            (
                "record_frames_dropped_total",
                "Frames left out of the recording.",
                self.record_dropped[1],
            ),
        ] {
            page.metric(name, "counter", help, &[("", count as f64)]);
        }
        let lost: Vec<_> = LOST
            .iter()
            .zip(self.pictures_lost)
            .map(|(how, count)| (label("how", how), count as f64))
            .collect();
        page.labelled(
            "pictures_lost_total",
            "counter",
            "Pictures that never came, were overtaken by a newer one, or were damaged.",
            &lost,
        );
        page.labelled(
            "capture_seconds",
            "gauge",
            "From the camera's time stamp on: to the picture's bytes, from decoding to the loop, and the whole way to the link.",
            &seconds("part", &CAPTURE_PARTS, &self.capture_us),
        );
        page.labelled(
            "stage_seconds",
            "gauge",
            "Time of each stage over the run.",
            &seconds("stage", &STAGES, &self.stages_us),
        );
        let of_both: Vec<&FrameReport> = self.newest.iter().flatten().collect();
        // State, line and faults are the gripper's: the newest frame has them.
        if let Some(newest) = of_both.iter().max_by(|one, other| one.t_s.total_cmp(&other.t_s)) {
            page.fingertips(&of_both);
            page.gripper(newest);
        }
        page.0
    }
}

/// Samples of [`QUANTILES`], s, of times in µs, each labelled with the name of what took them.
fn seconds(key: &str, names: &[&str], times_us: &[[f64; 3]]) -> Vec<(String, f64)> {
    let of = |(name, times_us): (&&str, &[f64; 3])| {
        let samples = QUANTILES.iter().zip(times_us);
        samples
            .map(|(quantile, us)| (format!("{{{key}=\"{name}\",quantile=\"{quantile}\"}}"), us / 1e6))
            .collect::<Vec<_>>()
    };
    names.iter().zip(times_us).flat_map(of).collect()
}

struct Page(String);

impl Page {
    fn metric(&mut self, name: &str, kind: &str, help: &str, values: &[(&str, f64)]) {
        let values: Vec<_> = values
            .iter()
            .map(|(label, value)| ((*label).to_owned(), *value))
            .collect();
        self.labelled(name, kind, help, &values);
    }

    fn labelled(&mut self, name: &str, kind: &str, help: &str, values: &[(String, f64)]) {
        // Writing to a String cannot fail.
        let _ = writeln!(
            self.0,
            "# HELP gripline_{name} {help}\n# TYPE gripline_{name} {kind}"
        );
        for (label, value) in values {
            let _ = writeln!(self.0, "gripline_{name}{label} {value}");
        }
    }

    /// Values per fingertip, labelled if there are two.
    fn fingertips(&mut self, frames: &[&FrameReport]) {
        type Of = fn(&FrameReport) -> Option<f64>;
        let values: [(&str, &str, Of); 7] = [
            ("normal_force_newtons", "Total normal force.", |frame| {
                Some(frame.normal_n)
            }),
            ("shear_force_newtons", "Total shear force.", |frame| {
                Some(frame.shear_n)
            }),
            ("moment_newton_millimetres", "Moment about z.", |frame| {
                Some(frame.moment_nmm)
            }),
            ("contact_taxels", "Taxels in contact.", |frame| {
                Some(f64::from(frame.contact))
            }),
            (
                "stick_ratio",
                "Share of them that sticks; missing when nothing touches.",
                |frame| frame.stick_ratio,
            ),
            (
                "slip_evidence",
                "How sure the whole detector is that something slips, 0 to 1.",
                |frame| Some(frame.slip_evidence),
            ),
            ("latency_seconds", "Frame in to map out, newest frame.", |frame| {
                Some(frame.latency_us / 1e6)
            }),
        ];
        for (name, help, of) in values {
            let label = |frame: &FrameReport| match frames.len() {
                1 => String::new(),
                _ => format!("{{fingertip=\"{}\"}}", frame.sensor.number() + 1),
            };
            let there: Vec<_> = frames
                .iter()
                .filter_map(|frame| Some((label(frame), of(frame)?)))
                .collect();
            if !there.is_empty() {
                self.labelled(name, "gauge", help, &there);
            }
        }
    }

    fn gripper(&mut self, frame: &FrameReport) {
        self.metric("line_newtons", "gauge", "Grip-force line.", &[("", frame.line_n)]);
        let states: Vec<_> = STATES
            .iter()
            .map(|state| {
                (
                    format!("{{state=\"{state}\"}}"),
                    f64::from(u8::from(frame.state == *state)),
                )
            })
            .collect();
        self.labelled("slip_state", "gauge", "1 for the present slip state.", &states);
        let faults: Vec<_> = frame
            .faults
            .iter()
            .map(|fault| (format!("{{fault=\"{fault}\"}}"), 1.0))
            .collect();
        self.labelled("fault", "gauge", "Faults that are there or latched.", &faults);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gripline_protocol::SensorId;

    #[test]
    fn every_line_is_a_comment_or_a_metric_with_a_number() {
        let values = Values {
            frames: 7,
            gate: [1, 2, 3, 4],
            capture_us: [[0.0; 3], [0.0; 3], [9_000.0; 3]],
            ..Values::default()
        };
        let text = values.text();
        assert!(
            text.contains("gripline_pictures_lost_total{how=\"overtaken\"} 0\n"),
            "{text}"
        );
        for line in text.lines().filter(|line| !line.starts_with("# ")) {
            let (name, number) = line.rsplit_once(' ').unwrap();
            assert!(
                name.starts_with("gripline_") && number.parse::<f64>().is_ok(),
                "{line}"
            );
        }
        assert!(text.contains("\ngripline_frames_total 7\n"), "{text}");
        assert!(
            text.contains("gripline_capture_seconds{part=\"capture_to_link\",quantile=\"0.5\"} 0.009\n"),
            "{text}"
        );
        assert!(
            text.contains("gripline_gate_total{verdict=\"network\"} 3\n"),
            "{text}"
        );
        assert!(
            text.contains("gripline_stage_seconds{stage=\"network\",quantile=\"0.999\"} 0\n"),
            "{text}"
        );
    }

    #[test]
    fn two_fingertips_are_told_apart_and_the_line_is_one() {
        use crate::sample::report;
        let mut values = Values::default();
        values.newest[0] = Some(report(0));
        assert!(values.text().contains("\ngripline_normal_force_newtons 0\n"));
        values.newest[1] = Some(FrameReport {
            sensor: SensorId::SECOND,
            normal_n: 2.5,
            line_n: 7.0,
            ..report(1)
        });
        let text = values.text();
        for line in [
            "gripline_normal_force_newtons{fingertip=\"1\"} 0",
            "gripline_normal_force_newtons{fingertip=\"2\"} 2.5",
            "gripline_line_newtons 7",
        ] {
            assert!(
                text.lines().any(|found| found == line),
                "{line} is missing in {text}"
            );
        }
    }
}

//! The data of the page, as server-sent events. Pure.
//!
//! `frame`: `report` (as in `/frames`), `limits`, `map` and, ten times a second, `picture` (square, 8 bits grey, row by row, base64);
//! `sent_ms` is the wall clock at which the loop handed it over. `status`: as `/status`.
//!
//! `map` has eight bytes for each taxel with a force (base64, little-endian): the taxel's number with [`IN_CONTACT`] and [`SLIPS`],
//! then fx, fy, fz in 1/4096 N. The flags follow the microcontroller's rule, applied to the quantised force.

use std::time::{SystemTime, UNIX_EPOCH};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use gripline_control::StatusReport;
use gripline_firmware::sums::TaxelRule;
use gripline_protocol::force_map::quantise_component;
use gripline_protocol::message::Configuration;
use gripline_protocol::{TAXELS, TaxelForce};
use gripline_recording::telemetry::{FrameReport, Limits};
use serde::Serialize;

/// In a taxel's number: it is in contact.
const IN_CONTACT: u16 = 1 << 14;
/// In a taxel's number: it is in contact and slips.
const SLIPS: u16 = 1 << 15;

/// What a page shows besides a frame's report.
#[derive(Debug, Clone, Copy)]
pub struct FrameView<'a> {
    /// The map, newtons per taxel, row by row from the lowest y.
    pub newtons: &'a [[f32; 3]; TAXELS],
    /// The picture, square with an even side, 8 bits grey, row by row from the top. It is sent at half its side.
    pub picture: &'a [u8],
    /// The microcontroller's settings: its rule for a taxel, and its limits.
    pub settings: &'a Configuration,
}

/// A copy of a [`FrameView`].
#[derive(Debug, Clone)]
pub(crate) struct Details {
    newtons: Box<[[f32; 3]; TAXELS]>,
    picture: Option<Vec<u8>>,
    rule: TaxelRule,
    limits: Limits,
    sent: SystemTime,
}

impl Details {
    pub(crate) fn of(view: FrameView<'_>, with_picture: bool) -> Self {
        Self {
            newtons: Box::new(*view.newtons),
            picture: with_picture.then(|| view.picture.to_vec()),
            rule: TaxelRule::of(view.settings),
            limits: Limits::of(view.settings),
            sent: SystemTime::now(),
        }
    }
}

#[derive(Serialize)]
struct FrameEvent<'a> {
    report: &'a FrameReport,
    limits: LimitsEvent,
    map: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    picture: Option<String>,
    sent_ms: f64,
}

#[derive(Serialize)]
struct LimitsEvent {
    friction: f64,
    slip_threshold: f64,
    floor_n: f64,
    ceiling_n: f64,
}

/// The event of a frame.
pub(crate) fn frame(report: &FrameReport, details: &Details) -> String {
    let Limits {
        friction,
        slip_threshold,
        floor_n,
        ceiling_n,
        ..
    } = details.limits;
    let event = FrameEvent {
        report,
        limits: LimitsEvent {
            friction,
            slip_threshold,
            floor_n,
            ceiling_n,
        },
        map: STANDARD.encode(packed(&details.newtons, details.rule)),
        picture: details
            .picture
            .as_ref()
            .map(|pixels| STANDARD.encode(halved(pixels))),
        sent_ms: details
            .sent
            .duration_since(UNIX_EPOCH)
            .map_or(0.0, |since| since.as_secs_f64() * 1e3),
    };
    of("frame", &event)
}

/// The event of the gripper's present state.
pub(crate) fn status(status: &StatusReport) -> String {
    of("status", status)
}

fn of(name: &str, data: &impl Serialize) -> String {
    // Numbers, texts and lists: JSON has a place for all of them.
    let data = serde_json::to_string(data).unwrap_or_default();
    format!("event: {name}\ndata: {data}\n\n")
}

/// A square picture at half its side: each pixel is the mean of four.
fn halved(pixels: &[u8]) -> Vec<u8> {
    let side = pixels.len().isqrt();
    let rows = pixels.chunks_exact(side.max(1));
    let pairs = rows.clone().step_by(2).zip(rows.skip(1).step_by(2));
    pairs
        .flat_map(|(upper, lower)| {
            upper
                .chunks_exact(2)
                .zip(lower.chunks_exact(2))
                .map(|(one, other)| {
                    let sum: u16 = [one[0], one[1], other[0], other[1]].map(u16::from).iter().sum();
                    ((sum + 2) / 4) as u8
                })
        })
        .collect()
}

fn packed(newtons: &[[f32; 3]; TAXELS], rule: TaxelRule) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (taxel, force) in (0_u16..).zip(newtons) {
        let [x, y, z] = force.map(|newton| quantise_component(f64::from(newton)).0);
        if (x, y, z) == (0, 0, 0) {
            continue;
        }
        let flags = match rule.decide(TaxelForce { x, y, z }) {
            (false, _) => 0,
            (true, true) => IN_CONTACT,
            (true, false) => IN_CONTACT | SLIPS,
        };
        bytes.extend((taxel | flags).to_le_bytes());
        for component in [x, y, z] {
            bytes.extend(component.to_le_bytes());
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    #[test]
    fn a_map_holds_the_taxels_with_a_force_and_what_they_do() {
        let mut newtons = [[0.0; 3]; TAXELS];
        newtons[3] = [0.0, -0.1, 1.0];
        newtons[399] = [1.0, 0.0, 1.0];
        newtons[7] = [0.0, 0.0, -1.0];
        let rule = TaxelRule::of(&Configuration::DEFAULT);
        let bytes = packed(&newtons, rule);
        let number = |at: usize| i32::from(i16::from_le_bytes([bytes[at], bytes[at + 1]]));
        assert_eq!(bytes.len(), 3 * 8);
        assert_eq!(number(0) as u16, 3 | IN_CONTACT);
        assert_eq!((number(2), number(4), number(6)), (0, -410, 4_096));
        assert_eq!(number(8) as u16, 7);
        assert_eq!(number(16) as u16, 0x018F | IN_CONTACT | SLIPS);
    }

    #[test]
    fn a_halved_picture_has_the_means_of_fours() {
        assert_eq!(
            halved(&[1, 3, 10, 10, 5, 7, 10, 12, 0, 0, 255, 255, 0, 1, 255, 255]),
            [4, 11, 0, 255]
        );
        assert!(halved(&[]).is_empty());
    }

    #[test]
    fn an_event_is_one_line_of_json_with_a_picture_where_it_is_due() {
        let newtons = [[0.0; 3]; TAXELS];
        let picture = [7_u8; 16];
        let view = FrameView {
            newtons: &newtons,
            picture: &picture,
            settings: &Configuration::DEFAULT,
        };
        for with_picture in [true, false] {
            let text = frame(&sample::report(4), &Details::of(view, with_picture));
            let data = text
                .strip_prefix("event: frame\ndata: ")
                .and_then(|rest| rest.strip_suffix("\n\n"))
                .unwrap();
            assert!(!data.contains('\n'));
            let json: serde_json::Value = serde_json::from_str(data).unwrap();
            assert_eq!(json["report"]["frame"], 4);
            assert_eq!(json["map"], "");
            assert_eq!(
                json["limits"]["ceiling_n"].as_f64(),
                Some(Limits::of(&Configuration::DEFAULT).ceiling_n)
            );
            assert_eq!(json["picture"].is_string(), with_picture);
        }
    }
}

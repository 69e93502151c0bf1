//! Chooses which of a camera's modes is used: pure. Frames are 640×480 pixels, or what a sensor in colour needs; rates frames a second.

use std::fmt;
use std::str::FromStr;

use crate::constants::RATE_TOLERANCE;
use crate::error::CaptureError;
use crate::geometry::{FRAME, Size};

/// How a camera encodes its pixels, in the order of preference at equal rate: raw pixels have no artefacts and cost no
/// time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PixelFormat {
    /// 8 bits of grey.
    Grey,
    /// Brightness and colour in turns, 16 bits a pixel (YUYV 4:2:2); the brightness is used.
    Yuyv,
    /// A JPEG file per picture (MJPEG); the brightness is used.
    Mjpeg,
}

impl PixelFormat {
    /// All of them, best first.
    pub const ALL: [Self; 3] = [Self::Grey, Self::Yuyv, Self::Mjpeg];

    /// The driver's names of it, four characters each.
    #[must_use]
    pub const fn codes(self) -> &'static [&'static [u8; 4]] {
        match self {
            Self::Grey => &[b"GREY"],
            Self::Yuyv => &[b"YUYV"],
            Self::Mjpeg => &[b"MJPG", b"JPEG"],
        }
    }

    /// The format that the driver calls by this name.
    #[must_use]
    pub fn of_code(code: [u8; 4]) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|format| format.codes().contains(&&code))
    }
}

impl fmt::Display for PixelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Grey => "grey",
            Self::Yuyv => "yuyv",
            Self::Mjpeg => "mjpeg",
        })
    }
}

impl FromStr for PixelFormat {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|format| format.to_string() == text)
            .ok_or_else(|| format!("found {text}, expected mjpeg, yuyv or grey"))
    }
}

/// A format and size that a camera offers.
#[derive(Debug, Clone, PartialEq)]
pub struct Offer {
    /// The driver's name of the format.
    pub code: [u8; 4],
    /// Columns and rows.
    pub size: Size,
    /// Frames a second at this size, in any order; empty when the driver does not say.
    pub rates: Vec<f64>,
}

/// The mode that was chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    /// Format of the pixels.
    pub format: PixelFormat,
    /// The driver's name of it.
    pub code: [u8; 4],
    /// Columns and rows.
    pub size: Size,
    /// The offered rate to request; `None` when the driver does not list any.
    pub rate: Option<f64>,
}

/// The mode that the configuration asks for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RequestedMode {
    /// `None`: any.
    pub format: Option<PixelFormat>,
    /// Frames a second.
    pub rate: f64,
    /// For colour pictures that are brought to this size: the smallest frames that are not smaller, of about the same shape. `None`:
    /// 640×480.
    pub colour: Option<Size>,
}

/// The sides' ratio may differ by this factor.
const SHAPE: f64 = 1.1;

impl RequestedMode {
    /// Whether pictures of this size and format can be used.
    fn is_usable(self, size: Size) -> bool {
        let Some(wanted) = self.colour else {
            return size == FRAME;
        };
        let shape = |size: Size| size.width as f64 / size.height.max(1) as f64;
        let shape = shape(size) / shape(wanted);
        size.width >= wanted.width && size.height >= wanted.height && (1.0 / SHAPE..=SHAPE).contains(&shape)
    }

    /// Chooses the best of what `camera` offers: first the rate (the lowest that is enough, else the highest), then the format
    /// that needs the least decoding.
    ///
    /// # Errors
    /// [`CaptureError::NoFormat`], which lists what is offered.
    pub fn choose(self, camera: &str, offers: &[Offer]) -> Result<Mode, CaptureError> {
        let usable = offers.iter().filter_map(|offer| {
            let format = PixelFormat::of_code(offer.code)?;
            (self.is_usable(offer.size) && self.format.is_none_or(|wanted| wanted == format)).then(|| Mode {
                format,
                code: offer.code,
                size: offer.size,
                rate: self.nearest(&offer.rates),
            })
        });
        usable
            .min_by(|a, b| {
                let (short_a, short_b) = (self.shortfall(a), self.shortfall(b));
                short_a
                    .total_cmp(&short_b)
                    .then(a.size.pixels().cmp(&b.size.pixels()))
                    .then(self.order(a).cmp(&self.order(b)))
            })
            .ok_or_else(|| CaptureError::NoFormat {
                camera: camera.to_owned(),
                expected: format!(
                    "{} with {}",
                    self.format
                        .map_or_else(|| "mjpeg, yuyv or grey".to_owned(), |f| f.to_string()),
                    self.colour.map_or_else(
                        || format!("{FRAME} pixels"),
                        |size| format!("at least {size} pixels of that shape")
                    )
                ),
                found: list(offers),
            })
    }

    /// Formats in the order of preference: in colour, grey comes last.
    fn order(self, mode: &Mode) -> (bool, PixelFormat) {
        (
            self.colour.is_some() && mode.format == PixelFormat::Grey,
            mode.format,
        )
    }

    /// The lowest offered rate that is enough, else the highest.
    fn nearest(self, rates: &[f64]) -> Option<f64> {
        let enough = rates
            .iter()
            .copied()
            .filter(|rate| *rate * RATE_TOLERANCE >= self.rate);
        enough
            .min_by(f64::total_cmp)
            .or_else(|| rates.iter().copied().max_by(f64::total_cmp))
    }

    /// Frames a second that are missing; an unknown rate counts as enough.
    fn shortfall(self, mode: &Mode) -> f64 {
        let missing = |rate: f64| {
            if rate * RATE_TOLERANCE >= self.rate {
                0.0
            } else {
                self.rate - rate
            }
        };
        mode.rate.map_or(0.0, missing)
    }
}

/// What a camera offers, for people: `MJPG 1280×720 at 30, 60; YUYV 640×480 at 30`.
fn list(offers: &[Offer]) -> String {
    if offers.is_empty() {
        return "no format at all".to_owned();
    }
    let one = |offer: &Offer| {
        let size = offer.size;
        let code = String::from_utf8_lossy(&offer.code);
        let mut rates: Vec<String> = offer.rates.iter().map(|rate| trimmed(*rate)).collect();
        rates.dedup();
        match rates.as_slice() {
            [] => format!("{} {size}", code.trim()),
            rates => format!("{} {size} at {}", code.trim(), rates.join(", ")),
        }
    };
    offers.iter().map(one).collect::<Vec<_>>().join("; ")
}

/// A number with at most two decimals, without trailing zeros.
pub(crate) fn trimmed(number: f64) -> String {
    let text = format!("{number:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn offer(code: [u8; 4], [width, height]: [usize; 2], rates: &[f64]) -> Offer {
        Offer {
            code,
            size: Size::new(width, height),
            rates: rates.to_vec(),
        }
    }

    fn any_at(rate: f64) -> RequestedMode {
        RequestedMode {
            rate,
            ..RequestedMode::default()
        }
    }

    #[test]
    fn mjpeg_is_chosen_where_raw_pixels_are_too_slow() {
        let offers = [
            offer(*b"YUYV", [640, 480], &[30.0, 15.0]),
            offer(*b"MJPG", [1920, 1080], &[30.0]),
            offer(*b"MJPG", [640, 480], &[120.0, 60.0, 30.0]),
        ];
        let mode = any_at(60.0).choose("camera", &offers).unwrap();
        assert_eq!((mode.format, mode.rate), (PixelFormat::Mjpeg, Some(60.0)));
        let mode = any_at(120.0).choose("camera", &offers).unwrap();
        assert_eq!((mode.format, mode.rate), (PixelFormat::Mjpeg, Some(120.0)));
        // Where the rate is enough, raw pixels win.
        let mode = any_at(30.0).choose("camera", &offers).unwrap();
        assert_eq!((mode.format, mode.rate), (PixelFormat::Yuyv, Some(30.0)));
    }

    #[test]
    fn an_ntsc_rate_counts_as_the_whole_number_it_stands_for() {
        let offers = [offer(*b"GREY", [640, 480], &[60_000.0 / 1_001.0, 120.0])];
        let mode = any_at(60.0).choose("camera", &offers).unwrap();
        assert_eq!(mode.rate, Some(60_000.0 / 1_001.0));
    }

    #[test]
    fn a_requested_format_is_chosen_even_when_it_is_slower() {
        let offers = [
            offer(*b"YUYV", [640, 480], &[30.0]),
            offer(*b"MJPG", [640, 480], &[60.0]),
        ];
        let requested = RequestedMode {
            format: Some(PixelFormat::Yuyv),
            rate: 60.0,
            colour: None,
        };
        let mode = requested.choose("camera", &offers).unwrap();
        assert_eq!((mode.format, mode.rate), (PixelFormat::Yuyv, Some(30.0)));
    }

    #[test]
    fn colour_takes_the_smallest_frame_of_the_same_shape_that_is_fast_enough() {
        let offers = [
            offer(*b"MJPG", [3280, 2464], &[25.0]),
            offer(*b"MJPG", [1920, 1080], &[30.0]),
            offer(*b"MJPG", [1640, 1232], &[25.0]),
            offer(*b"YUYV", [800, 600], &[5.0]),
            offer(*b"MJPG", [160, 120], &[60.0]),
        ];
        let requested = RequestedMode {
            rate: 25.0,
            colour: Some(Size::new(320, 240)),
            ..RequestedMode::default()
        };
        let mode = requested.choose("camera", &offers).unwrap();
        assert_eq!(
            (mode.size, mode.format),
            (Size::new(1640, 1232), PixelFormat::Mjpeg)
        );
    }

    #[test]
    fn no_usable_format_lists_what_the_camera_offers() {
        let offers = [
            offer(*b"H264", [640, 480], &[30.0]),
            offer(*b"MJPG", [1280, 720], &[30.0, 29.97]),
            offer(*b"RGB3", [640, 480], &[]),
        ];
        let error = any_at(60.0)
            .choose("/dev/video3", &offers)
            .unwrap_err()
            .to_string();
        for part in [
            "/dev/video3",
            "640×480",
            "mjpeg, yuyv or grey",
            "H264 640×480 at 30",
            "MJPG 1280×720 at 30, 29.97",
            "RGB3 640×480",
        ] {
            assert!(error.contains(part), "{part:?} is missing in: {error}");
        }
        let error = any_at(60.0).choose("/dev/video3", &[]).unwrap_err().to_string();
        assert!(error.contains("no format at all"), "{error}");
    }

    #[test]
    fn formats_are_read_as_they_are_written() {
        for format in PixelFormat::ALL {
            assert_eq!(format.to_string().parse(), Ok(format));
            for code in format.codes() {
                assert_eq!(PixelFormat::of_code(**code), Some(format));
            }
        }
        assert!(
            "rgb"
                .parse::<PixelFormat>()
                .unwrap_err()
                .contains("expected mjpeg")
        );
    }

    proptest! {
        #[test]
        fn the_choice_was_offered_and_no_offer_is_better(
            offers in prop::collection::vec(
                (0_usize..4, prop::bool::ANY, prop::collection::vec(1.0_f64..200.0, 0..4)), 0..6),
            rate in 1.0_f64..200.0,
        ) {
            let codes: [&[u8; 4]; 4] = [b"GREY", b"YUYV", b"MJPG", b"H264"];
            let offers: Vec<Offer> = offers
                .iter()
                .map(|(code, right, rates)| offer(*codes[*code], if *right { [640, 480] } else { [320, 240] }, rates))
                .collect();
            let usable = |offer: &&Offer| offer.size == FRAME && PixelFormat::of_code(offer.code).is_some();
            match any_at(rate).choose("camera", &offers) {
                Err(_) => prop_assert!(!offers.iter().any(|offer| usable(&offer))),
                Ok(mode) => {
                    let from = offers.iter().filter(usable).find(|offer| {
                        offer.code == mode.code && mode.rate.map_or(offer.rates.is_empty(), |r| offer.rates.contains(&r))
                    });
                    prop_assert!(from.is_some());
                    let short = |rate: f64, got: f64| if got * RATE_TOLERANCE >= rate { 0.0 } else { rate - got };
                    let chosen = mode.rate.map_or(0.0, |got| short(rate, got));
                    for offer in offers.iter().filter(usable) {
                        let best = offer.rates.iter().map(|got| short(rate, *got)).fold(f64::INFINITY, f64::min);
                        let best = if offer.rates.is_empty() { 0.0 } else { best };
                        prop_assert!(chosen <= best);
                        if chosen >= best {
                            prop_assert!(mode.format <= PixelFormat::of_code(offer.code).unwrap());
                        }
                    }
                }
            }
        }
    }
}

//! Which of a camera's modes is used: pure. Pictures are 640×480, of which the middle 440×440 is taken.
//! Rates in frames a second.

use std::fmt;
use std::str::FromStr;

use super::constants::{FRAME_HEIGHT, FRAME_WIDTH, RATE_TOLERANCE};
use super::error::CameraError;

/// How a camera writes its pixels. In the order of preference at equal rate: what needs no decoding has no artefacts
/// and costs no time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PixelFormat {
    /// 8 bits of grey.
    Grey,
    /// Brightness and colour in turns, 16 bits a pixel (YUYV 4:2:2); the brightness is taken.
    Yuyv,
    /// A JPEG file a picture (MJPEG); its brightness is decoded.
    Mjpeg,
}

impl PixelFormat {
    /// All of them, best first.
    pub const ALL: [Self; 3] = [Self::Grey, Self::Yuyv, Self::Mjpeg];

    /// The driver's four characters; `JPEG` is a second name of MJPEG.
    pub const fn codes(self) -> &'static [&'static [u8; 4]] {
        match self {
            Self::Grey => &[b"GREY"],
            Self::Yuyv => &[b"YUYV"],
            Self::Mjpeg => &[b"MJPG", b"JPEG"],
        }
    }

    /// The format that the driver calls so.
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

/// One thing that a camera offers.
#[derive(Debug, Clone, PartialEq)]
pub struct Offer {
    /// The driver's four characters.
    pub code: [u8; 4],
    /// Columns and rows.
    pub size: [u32; 2],
    /// Frames a second at this size, in any order; empty when the driver does not say.
    pub rates: Vec<f64>,
}

/// What was chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    pub format: PixelFormat,
    /// The driver's name of it.
    pub code: [u8; 4],
    /// The offered rate to ask for; `None` when the driver does not say what it can.
    pub rate: Option<f64>,
}

/// What was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wanted {
    /// `None`: what needs the least decoding.
    pub format: Option<PixelFormat>,
    /// Frames a second.
    pub rate: f64,
}

impl Wanted {
    /// The best of what `camera` offers: the rate first, as close to the wanted one as there is and not below it where
    /// that can be had, then the format that needs the least decoding.
    ///
    /// # Errors
    /// [`CameraError::NoFormat`], which lists what there is.
    pub fn choose(self, camera: &str, offers: &[Offer]) -> Result<Mode, CameraError> {
        let usable = offers.iter().filter_map(|offer| {
            let format = PixelFormat::of_code(offer.code)?;
            let is_right =
                offer.size == [FRAME_WIDTH, FRAME_HEIGHT] && self.format.is_none_or(|f| f == format);
            is_right.then(|| Mode {
                format,
                code: offer.code,
                rate: self.nearest(&offer.rates),
            })
        });
        usable
            .min_by(|a, b| {
                let (short_a, short_b) = (self.shortfall(a), self.shortfall(b));
                short_a.total_cmp(&short_b).then(a.format.cmp(&b.format))
            })
            .ok_or_else(|| CameraError::NoFormat {
                camera: camera.to_owned(),
                wanted: self
                    .format
                    .map_or_else(|| "mjpeg, yuyv or grey".to_owned(), |f| f.to_string()),
                found: listed(offers),
            })
    }

    /// The least offered rate that is enough, else the greatest.
    fn nearest(self, rates: &[f64]) -> Option<f64> {
        let enough = rates
            .iter()
            .copied()
            .filter(|rate| *rate * RATE_TOLERANCE >= self.rate);
        enough
            .min_by(f64::total_cmp)
            .or_else(|| rates.iter().copied().max_by(f64::total_cmp))
    }

    /// Frames a second that are missing; a rate that nobody knows counts as enough.
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
pub(crate) fn listed(offers: &[Offer]) -> String {
    if offers.is_empty() {
        return "no format at all".to_owned();
    }
    let one = |offer: &Offer| {
        let [width, height] = offer.size;
        let code = String::from_utf8_lossy(&offer.code);
        let mut rates: Vec<String> = offer.rates.iter().map(|rate| shown(*rate)).collect();
        rates.dedup();
        match rates.as_slice() {
            [] => format!("{} {width}×{height}", code.trim()),
            rates => format!("{} {width}×{height} at {}", code.trim(), rates.join(", ")),
        }
    };
    offers.iter().map(one).collect::<Vec<_>>().join("; ")
}

/// A rate without zeros that say nothing.
pub(crate) fn shown(rate: f64) -> String {
    let text = format!("{rate:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn offer(code: [u8; 4], size: [u32; 2], rates: &[f64]) -> Offer {
        Offer {
            code,
            size,
            rates: rates.to_vec(),
        }
    }

    fn wanted(rate: f64) -> Wanted {
        Wanted { format: None, rate }
    }

    #[test]
    fn the_papers_camera_gives_mjpeg_where_raw_pixels_are_too_slow() {
        let offers = [
            offer(*b"YUYV", [640, 480], &[30.0, 15.0]),
            offer(*b"MJPG", [1920, 1080], &[30.0]),
            offer(*b"MJPG", [640, 480], &[120.0, 60.0, 30.0]),
        ];
        let mode = wanted(60.0).choose("camera", &offers).unwrap();
        assert_eq!((mode.format, mode.rate), (PixelFormat::Mjpeg, Some(60.0)));
        let mode = wanted(120.0).choose("camera", &offers).unwrap();
        assert_eq!((mode.format, mode.rate), (PixelFormat::Mjpeg, Some(120.0)));
        // Where the rate is enough, what needs no decoding wins.
        let mode = wanted(30.0).choose("camera", &offers).unwrap();
        assert_eq!((mode.format, mode.rate), (PixelFormat::Yuyv, Some(30.0)));
    }

    #[test]
    fn an_ntsc_rate_counts_as_the_whole_number_it_stands_for() {
        let offers = [offer(*b"GREY", [640, 480], &[60_000.0 / 1_001.0, 120.0])];
        let mode = wanted(60.0).choose("camera", &offers).unwrap();
        assert_eq!(mode.rate, Some(60_000.0 / 1_001.0));
    }

    #[test]
    fn a_format_that_was_asked_for_is_taken_even_when_it_is_slower() {
        let offers = [
            offer(*b"YUYV", [640, 480], &[30.0]),
            offer(*b"MJPG", [640, 480], &[60.0]),
        ];
        let wanted = Wanted {
            format: Some(PixelFormat::Yuyv),
            rate: 60.0,
        };
        let mode = wanted.choose("camera", &offers).unwrap();
        assert_eq!((mode.format, mode.rate), (PixelFormat::Yuyv, Some(30.0)));
    }

    #[test]
    fn no_usable_format_lists_what_the_camera_offers() {
        let offers = [
            offer(*b"H264", [640, 480], &[30.0]),
            offer(*b"MJPG", [1280, 720], &[30.0, 29.97]),
            offer(*b"RGB3", [640, 480], &[]),
        ];
        let error = wanted(60.0)
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
        let error = wanted(60.0).choose("/dev/video3", &[]).unwrap_err().to_string();
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
        fn what_is_chosen_was_offered_and_nothing_offered_is_better(
            offers in prop::collection::vec(
                (0_usize..4, prop::bool::ANY, prop::collection::vec(1.0_f64..200.0, 0..4)), 0..6),
            rate in 1.0_f64..200.0,
        ) {
            let codes: [&[u8; 4]; 4] = [b"GREY", b"YUYV", b"MJPG", b"H264"];
            let offers: Vec<Offer> = offers
                .iter()
                .map(|(code, right, rates)| offer(*codes[*code], if *right { [640, 480] } else { [320, 240] }, rates))
                .collect();
            let usable = |offer: &&Offer| offer.size == [640, 480] && PixelFormat::of_code(offer.code).is_some();
            match wanted(rate).choose("camera", &offers) {
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

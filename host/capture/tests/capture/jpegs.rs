//! JPEG pictures: known pictures through an encoder and back, and every kind of damage.

use std::fs;
use std::path::Path;

use gripline_capture::JpegCrop;
use gripline_capture::geometry::{CROP, CROP_SIDE, FRAME, Size};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use proptest::prelude::*;

use crate::{greatest_difference, middle, smooth_frame};

/// Grey levels that an encoder with the best quality may lose.
const ENCODER_LOSS: u8 = 2;

/// The smooth frame with noise of this many levels up and down.
fn noisy_frame(noise: u8, seed: u64) -> Vec<u8> {
    let mut state = seed | 1;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as i32
    };
    let range = 2 * i32::from(noise) + 1;
    smooth_frame()
        .into_iter()
        .map(|level| (i32::from(level) + random() % range - i32::from(noise)).clamp(0, 255) as u8)
        .collect()
}

/// How a picture is encoded.
#[derive(Debug, Clone, Copy)]
struct Encoding {
    colour: bool,
    sampling: SamplingFactor,
    restart: u16,
    quality: u8,
    /// With Huffman tables of its own.
    optimized: bool,
    progressive: bool,
}

const PLAIN: Encoding = Encoding {
    colour: false,
    sampling: SamplingFactor::F_1_1,
    restart: 0,
    quality: 95,
    optimized: false,
    progressive: false,
};

const SAMPLINGS: [SamplingFactor; 6] = [
    SamplingFactor::F_1_1,
    SamplingFactor::F_2_1,
    SamplingFactor::F_2_2,
    SamplingFactor::F_1_2,
    SamplingFactor::F_4_1,
    SamplingFactor::F_1_4,
];

impl Encoding {
    fn encode(self, grey: &[u8], size: Size) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = Encoder::new(&mut file, self.quality);
        encoder.set_sampling_factor(self.sampling);
        encoder.set_restart_interval(self.restart);
        encoder.set_optimized_huffman_tables(self.optimized);
        encoder.set_progressive(self.progressive);
        let (width, height) = (size.width as u16, size.height as u16);
        if self.colour {
            let colour: Vec<u8> = grey.iter().flat_map(|grey| coloured(*grey)).collect();
            encoder.encode(&colour, width, height, ColorType::Rgb).unwrap();
        } else {
            encoder.encode(grey, width, height, ColorType::Luma).unwrap();
        }
        file
    }

    fn frame(self, grey: &[u8]) -> Vec<u8> {
        self.encode(grey, FRAME)
    }

    /// Whether the file that this wrote can be read; the others are refused.
    fn is_readable(self, file: &[u8]) -> bool {
        let is_tall = matches!(self.sampling, SamplingFactor::F_1_2 | SamplingFactor::F_1_4);
        if self.progressive {
            !self.colour || !is_tall
        } else {
            // The encoder gives each colour a scan where its tables or its sampling are unusual.
            let scan = file.windows(2).position(|pair| pair == [0xff, 0xda]).unwrap();
            file[scan + 4] == if self.colour { 3 } else { 1 }
        }
    }

    fn any() -> impl Strategy<Value = Self> {
        let flags = (any::<bool>(), any::<bool>(), any::<bool>());
        let restart = prop_oneof![Just(0_u16), 1_u16..200];
        (flags, 0..SAMPLINGS.len(), restart, 5_u8..=100).prop_map(|(flags, sampling, restart, quality)| {
            let (colour, optimized, progressive) = flags;
            Self {
                colour,
                sampling: SAMPLINGS[sampling],
                // The encoder fails where both are set.
                restart: if optimized || progressive { 0 } else { restart },
                quality,
                optimized: optimized || progressive,
                progressive,
            }
        })
    }
}

fn coloured(grey: u8) -> [u8; 3] {
    [grey, grey / 2 + 40, 200 - grey / 2]
}

/// Brightness after ITU-R BT.601, as JFIF has it.
fn brightness(colour: [u8; 3]) -> u8 {
    let [red, green, blue] = colour.map(f64::from);
    (0.299 * red + 0.587 * green + 0.114 * blue).round() as u8
}

fn decode(file: &[u8]) -> Result<Vec<u8>, String> {
    let mut crop = Vec::new();
    match JpegCrop::default().decode(file, &mut crop) {
        Ok(()) => {
            assert_eq!(crop.len(), CROP.pixels());
            Ok(crop)
        }
        Err(error) => Err(error.to_string()),
    }
}

/// Where the bits of the first scan begin.
fn bits_at(file: &[u8]) -> usize {
    let scan = file.windows(2).position(|pair| pair == [0xff, 0xda]).unwrap() + 2;
    scan + usize::from(u16::from_be_bytes([file[scan], file[scan + 1]]))
}

/// A file without its segments of this kind.
fn without(file: &[u8], kind: u8) -> Vec<u8> {
    let (mut at, mut kept) = (2, file[..2].to_vec());
    let bits_at = bits_at(file);
    while at < bits_at {
        let length = 2 + usize::from(u16::from_be_bytes([file[at + 2], file[at + 3]]));
        if file[at + 1] != kind {
            kept.extend_from_slice(&file[at..at + length]);
        }
        at += length;
    }
    kept.extend_from_slice(&file[bits_at..]);
    kept
}

#[test]
fn the_crop_is_that_of_the_picture_whatever_its_colours_and_restarts_or_refused() {
    let grey = smooth_frame();
    let bright: Vec<u8> = grey.iter().map(|grey| brightness(coloured(*grey))).collect();
    for sampling in SAMPLINGS {
        for (restart, flags) in [(0, 0), (5, 0), (0, 1), (7, 1), (0, 2), (0, 3), (0, 6), (0, 7)] {
            let encoding = Encoding {
                colour: flags & 1 == 0,
                optimized: flags & 2 != 0,
                progressive: flags & 4 != 0,
                sampling,
                restart,
                ..PLAIN
            };
            let whole = if encoding.colour { &bright } else { &grey };
            let file = encoding.frame(&grey);
            let decoded = decode(&file);
            if encoding.is_readable(&file) {
                let difference = greatest_difference(&decoded.unwrap(), &middle(whole));
                assert!(difference <= ENCODER_LOSS, "{encoding:?}: {difference} levels");
            } else {
                assert!(decoded.unwrap_err().contains("convert it"), "{encoding:?}");
            }
        }
    }
    let small = PLAIN.encode(&middle(&grey), CROP);
    assert!(greatest_difference(&decode(&small).unwrap(), &middle(&grey)) <= ENCODER_LOSS);
}

#[test]
fn huffman_tables_that_a_file_leaves_out_are_the_standards() {
    let colour = Encoding {
        colour: true,
        sampling: SamplingFactor::F_2_1,
        ..PLAIN
    };
    for encoding in [PLAIN, colour] {
        let file = encoding.frame(&noisy_frame(10, 3));
        let bare = without(&file, 0xc4);
        assert!(bare.len() < file.len() - 100);
        assert_eq!(decode(&bare).unwrap(), decode(&file).unwrap());
        // Quantisation tables have no standard.
        assert!(
            decode(&without(&file, 0xdb))
                .unwrap_err()
                .contains("damaged JPEG")
        );
    }
}

#[test]
fn a_decoder_that_has_seen_other_tables_and_damage_reads_the_next_picture_as_a_new_one() {
    let optimized = Encoding {
        optimized: true,
        ..PLAIN
    };
    let files = [
        PLAIN.frame(&noisy_frame(30, 4)),
        optimized.frame(&noisy_frame(60, 5)),
        optimized.frame(&smooth_frame()),
    ];
    let mut decoder = JpegCrop::default();
    let mut crop = Vec::new();
    for number in [0, 1, 0, 2, 1, 1, 0] {
        let file = &files[number];
        decoder.decode(&file[..file.len() / 2], &mut crop).unwrap_err();
        decoder.decode(file, &mut crop).unwrap();
        assert_eq!(crop, decode(file).unwrap());
    }
}

#[test]
fn damaged_jpegs_are_refused_and_not_guessed_at() {
    let good = PLAIN.frame(&smooth_frame());
    let small = PLAIN.encode(&vec![9; 320 * 240], Size::new(320, 240));
    let restarts = Encoding { restart: 7, ..PLAIN }.frame(&smooth_frame());
    let mut swapped = restarts.clone();
    let third = (bits_at(&restarts)..restarts.len()).find(|at| restarts[*at..].starts_with(&[0xff, 0xd2]));
    swapped[third.unwrap() + 1] = 0xd3;
    let mut codes = good.clone();
    let table = codes.windows(2).position(|pair| pair == [0xff, 0xc4]).unwrap();
    // Three codes of one bit, and three fewer of three.
    codes[table + 5] += 3;
    codes[table + 7] -= 3;
    let cases: [(&[u8], &str); 8] = [
        (&[], "does not begin with SOI"),
        (&good[..300], "damaged JPEG"),
        (&good[..good.len() / 2], "damaged JPEG"),
        (&good[2..], "does not begin with SOI"),
        (&small, "found 320×240 pixels, expected 640×480 or 440×440"),
        (&swapped, "a restart is missing"),
        (&codes, "damaged JPEG"),
        (&without(&good, 0xc0), "no frame header"),
    ];
    for (file, expected) in cases {
        let error = decode(file).unwrap_err();
        assert!(error.contains(expected), "{expected:?} is missing in: {error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_file_that_ends_within_the_crop_is_refused(encoding in Encoding::any(), left in 0.0_f64..0.85) {
        let file = encoding.frame(&noisy_frame(9, 2));
        prop_assume!(encoding.is_readable(&file));
        let bits_at = bits_at(&file);
        let end = bits_at + (left * (file.len() - bits_at) as f64) as usize;
        let error = decode(&file[..end]).err();
        prop_assert!(error.is_some_and(|error| error.contains("damaged JPEG")));
    }

    #[test]
    fn a_file_with_any_bytes_overwritten_is_a_picture_or_an_error(
        encoding in Encoding::any(), at in 0.0_f64..1.0, near in any::<bool>(), with in prop::collection::vec(any::<u8>(), 1..40),
    ) {
        let mut file = encoding.frame(&smooth_frame());
        // Most of what can be wrong stands at the beginning.
        let end = if near { 700 } else { file.len() - with.len() };
        let at = (at * end as f64) as usize;
        file[at..at + with.len()].copy_from_slice(&with);
        let _ = decode(&file);
    }

    #[test]
    fn no_bytes_make_the_decoder_panic(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let file: Vec<u8> = [&[0xff, 0xd8][..], &bytes].concat();
        prop_assert!(decode(&file).is_err());
    }
}

#[test]
fn no_mutation_of_a_small_corpus_makes_the_decoder_panic() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/capture/jpeg_corpus");
    let mut paths: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    paths.sort();
    let seeds: Vec<_> = paths.iter().map(|path| fs::read(path).unwrap()).collect();
    assert!(seeds.len() >= 12);
    // xorshift64
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut random = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below.max(1) as u64) as usize
    };
    let mut decoder = JpegCrop::default();
    let mut crop = Vec::new();
    for _ in 0..2_000 {
        let mut input = seeds[random(seeds.len())].clone();
        for _ in 0..=random(4) {
            let at = random(input.len());
            match random(4) {
                0 if !input.is_empty() => input[at] ^= 1 << random(8),
                1 if !input.is_empty() => input[at] = random(256) as u8,
                2 => input.truncate(at),
                _ => input.insert(at.min(input.len()), random(256) as u8),
            }
        }
        if decoder.decode(&input, &mut crop).is_ok() {
            assert_eq!(crop.len(), CROP_SIDE * CROP_SIDE);
        }
    }
}

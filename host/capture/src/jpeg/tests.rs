//! Pictures that are known, through an encoder and back; and the library's decoder as the judge of ours.

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use proptest::prelude::*;

use super::*;

/// Grey levels that an encoder with the best quality may lose.
const LOST: u8 = 2;
/// Grey levels between our decoder and the library's, which rounds more than once.
const APART: u8 = 1;

/// A smooth picture whose every region differs.
fn smooth() -> Vec<u8> {
    (0..WIDTH * HEIGHT)
        .map(|i| {
            let (x, y) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
            (110.0 + 60.0 * (x / 37.0).sin() + 50.0 * (y / 23.0).cos()) as u8
        })
        .collect()
}

/// The same with noise of so many levels up and down: for 255, little else.
fn noisy(noise: u8, seed: u64) -> Vec<u8> {
    let mut state = seed | 1;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as i32
    };
    let range = 2 * i32::from(noise) + 1;
    smooth()
        .into_iter()
        .map(|level| (i32::from(level) + random() % range - i32::from(noise)).clamp(0, 255) as u8)
        .collect()
}

/// The middle of a frame, pixel by pixel.
fn middle(frame: &[u8]) -> Vec<u8> {
    (0..CROP_SIDE * CROP_SIDE)
        .map(|i| frame[(i / CROP_SIDE + CROP_TOP) * WIDTH + i % CROP_SIDE + CROP_LEFT])
        .collect()
}

/// How a picture is encoded.
#[derive(Debug, Clone, Copy)]
struct As {
    colour: bool,
    sampling: SamplingFactor,
    restart: u16,
    quality: u8,
    /// With codes of its own.
    optimized: bool,
    progressive: bool,
}

const PLAIN: As = As {
    colour: false,
    sampling: SamplingFactor::F_1_1,
    restart: 0,
    quality: 95,
    optimized: false,
    progressive: false,
};

/// More brightness down than across for each colour.
fn is_tall(sampling: SamplingFactor) -> bool {
    matches!(sampling, SamplingFactor::F_1_2 | SamplingFactor::F_1_4)
}

const SAMPLINGS: [SamplingFactor; 6] = [
    SamplingFactor::F_1_1,
    SamplingFactor::F_2_1,
    SamplingFactor::F_2_2,
    SamplingFactor::F_1_2,
    SamplingFactor::F_4_1,
    SamplingFactor::F_1_4,
];

impl As {
    fn encode(self, grey: &[u8], [width, height]: [usize; 2]) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = Encoder::new(&mut file, self.quality);
        encoder.set_sampling_factor(self.sampling);
        encoder.set_restart_interval(self.restart);
        encoder.set_optimized_huffman_tables(self.optimized);
        encoder.set_progressive(self.progressive);
        let size = (width as u16, height as u16);
        if self.colour {
            let colour: Vec<u8> = grey.iter().flat_map(|grey| coloured(*grey)).collect();
            encoder.encode(&colour, size.0, size.1, ColorType::Rgb).unwrap();
        } else {
            encoder.encode(grey, size.0, size.1, ColorType::Luma).unwrap();
        }
        file
    }

    fn frame(self, grey: &[u8]) -> Vec<u8> {
        self.encode(grey, [WIDTH, HEIGHT])
    }

    fn any() -> impl Strategy<Value = Self> {
        let flags = (any::<bool>(), any::<bool>(), any::<bool>());
        let restart = prop_oneof![Just(0_u16), 1_u16..200];
        (flags, 0..SAMPLINGS.len(), restart, 5_u8..=100).prop_map(|(flags, sampling, restart, quality)| {
            let (colour, optimized, progressive) = flags;
            Self {
                colour,
                sampling: SAMPLINGS[sampling],
                // The encoder fails where both are asked for.
                restart: if optimized || progressive { 0 } else { restart },
                quality,
                optimized: optimized || progressive,
                progressive: progressive && quality % 4 == 0 && !is_tall(SAMPLINGS[sampling]),
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

fn ours(file: &[u8]) -> Result<Vec<u8>, String> {
    let mut crop = Vec::new();
    JpegCrop::default().decode(file, &mut crop).map(|()| crop)
}

/// Whether the first scan has all components. Where it has not, the library is no judge: it takes the brightness for smaller than
/// it is where the colours are.
fn is_in_one_scan(file: &[u8]) -> bool {
    let frame = (2..file.len()).find(|at| file[*at] == 0xff && [0xc0, 0xc1, 0xc2].contains(&file[at + 1]));
    let header = Header::read(file).unwrap();
    header.components.len() == frame.map_or(0, |at| usize::from(file[at + 9]))
}

/// What the library makes of a file, down to the crop's last row where it can stop there.
fn judges(file: &[u8]) -> Result<Vec<u8>, String> {
    let header = Header::read(file)?;
    let mut crop = Vec::new();
    let window = window(header.pixels)?;
    let mut pixels = header.pixels;
    let mut file = file.to_vec();
    let frame =
        (2..bits_at(&file)).find(|at| [[0xff, 0xc0], [0xff, 0xc1]].contains(&[file[*at], file[at + 1]]));
    if let Some(at) = frame.filter(|_| is_in_one_scan(&file)) {
        pixels[1] = window.from[1] + window.side;
        file[at + 5..at + 7].copy_from_slice(&(pixels[1] as u16).to_be_bytes());
    }
    Whole::default()
        .read(&file, pixels, window, &mut crop)
        .map(|()| crop)
}

/// Greatest difference of two pictures.
fn apart(a: &[u8], b: &[u8]) -> u8 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
}

/// Where the bits begin in a file.
fn bits_at(file: &[u8]) -> usize {
    Header::read(file).unwrap().bits_at
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

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn every_picture_is_the_librarys(form in As::any(), noise in 0_u8..=255, seed in any::<u64>(), small in any::<bool>()) {
        let frame = noisy(noise, seed);
        let file = if small {
            form.encode(&middle(&frame), [CROP_SIDE; 2])
        } else {
            form.frame(&frame)
        };
        prop_assert_eq!(Header::read(&file).unwrap().is_plain, !form.progressive);
        prop_assume!(is_in_one_scan(&file));
        let apart = apart(&ours(&file).unwrap(), &judges(&file).unwrap());
        prop_assert!(apart <= APART, "{apart} levels apart");
    }

    #[test]
    fn bits_that_are_overwritten_are_refused_or_read_as_the_library_reads_them(
        form in As::any(), at in 0.0_f64..0.9, with in prop::collection::vec(any::<u8>(), 1..6),
    ) {
        let mut file = form.frame(&noisy(20, 1));
        prop_assume!(is_in_one_scan(&file) && !form.progressive);
        let bits_at = bits_at(&file);
        let at = bits_at + (at * (file.len() - bits_at) as f64) as usize;
        file[at..at + with.len()].copy_from_slice(&with);
        match (ours(&file), judges(&file)) {
            (Ok(ours), Ok(judges)) => prop_assert!(apart(&ours, &judges) <= APART),
            (Ok(_), Err(judges)) => prop_assert!(false, "taken, though {judges}"),
            // The library guesses at some of what is wrong.
            (Err(_), _) => {}
        }
    }

    #[test]
    fn a_file_with_any_bytes_overwritten_is_a_picture_or_an_error(
        form in As::any(), at in 0.0_f64..1.0, near in any::<bool>(), with in prop::collection::vec(any::<u8>(), 1..40),
    ) {
        let mut file = form.frame(&smooth());
        // Most of what can be wrong stands at the beginning.
        let most = if near { 700 } else { file.len() - with.len() };
        let at = (at * most as f64) as usize;
        file[at..at + with.len()].copy_from_slice(&with);
        if let Ok(crop) = ours(&file) {
            prop_assert_eq!(crop.len(), CROP_SIDE * CROP_SIDE);
        }
    }

    #[test]
    fn a_file_that_ends_within_the_crop_is_refused(form in As::any(), left in 0.0_f64..0.85) {
        let file = form.frame(&noisy(9, 2));
        let bits_at = bits_at(&file).max(2);
        // Brightness may stand first, in a scan of its own.
        let is_end = |at: &usize| file[*at] == 0xff && ![0, 0xd0, 0xd1, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7].contains(&file[at + 1]);
        let scan_end = (bits_at..file.len()).find(is_end).unwrap();
        let end = bits_at + (left * (scan_end - bits_at) as f64) as usize;
        let error = ours(&file[..end]).err();
        prop_assert!(error.is_some_and(|error| error.contains("damaged JPEG")));
    }
}

#[test]
fn the_crop_is_that_of_the_picture_whatever_its_colours_and_restarts() {
    let grey = smooth();
    let bright: Vec<u8> = grey.iter().map(|grey| brightness(coloured(*grey))).collect();
    for sampling in SAMPLINGS {
        for (restart, flags) in [(0, 0), (5, 0), (0, 1), (7, 1), (0, 2), (0, 3), (0, 6), (0, 7)] {
            let form = As {
                colour: flags & 1 == 0,
                optimized: flags & 2 != 0,
                progressive: flags & 4 != 0,
                sampling,
                restart,
                ..PLAIN
            };
            let whole = if form.colour { &bright } else { &grey };
            if form.progressive && form.colour && is_tall(sampling) {
                let error = ours(&form.frame(&grey)).unwrap_err();
                assert!(error.contains("save it as a sequential one"), "{error}");
                continue;
            }
            let apart = apart(&ours(&form.frame(&grey)).unwrap(), &middle(whole));
            assert!(apart <= LOST, "{form:?}: {apart} levels apart");
        }
    }
    let small = PLAIN.encode(&middle(&grey), [CROP_SIDE; 2]);
    assert!(apart(&ours(&small).unwrap(), &middle(&grey)) <= LOST);
}

#[test]
fn codes_that_a_file_leaves_out_are_the_standards() {
    let colour = As {
        colour: true,
        sampling: SamplingFactor::F_2_1,
        ..PLAIN
    };
    for form in [PLAIN, colour] {
        let file = form.frame(&noisy(10, 3));
        let bare = without(&file, 0xc4);
        assert!(bare.len() < file.len() - 100);
        assert_eq!(ours(&bare).unwrap(), ours(&file).unwrap());
        assert!(
            ours(&without(&file, 0xdb))
                .unwrap_err()
                .contains("table of steps"),
            "steps have no standard"
        );
    }
}

#[test]
fn a_decoder_that_has_seen_other_codes_and_damage_reads_the_next_picture_as_a_new_one() {
    let optimized = As {
        optimized: true,
        ..PLAIN
    };
    let files = [
        PLAIN.frame(&noisy(30, 4)),
        optimized.frame(&noisy(60, 5)),
        optimized.frame(&smooth()),
    ];
    let mut decoder = JpegCrop::default();
    let mut crop = Vec::new();
    for number in [0, 1, 0, 2, 1, 1, 0] {
        let file = &files[number];
        decoder.decode(&file[..file.len() / 2], &mut crop).unwrap_err();
        decoder.decode(file, &mut crop).unwrap();
        assert_eq!(crop, ours(file).unwrap());
    }
}

#[test]
fn damaged_jpegs_are_told_and_not_guessed_at() {
    let good = PLAIN.frame(&smooth());
    let small = PLAIN.encode(&vec![9; 320 * 240], [320, 240]);
    let restarts = As { restart: 7, ..PLAIN }.frame(&smooth());
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
        (&good[..good.len() / 2], "it ends too early"),
        (&good[2..], "does not begin with SOI"),
        (&small, "found 320×240 pixels, expected 640×480 or 440×440"),
        (&swapped, "a restart is missing"),
        (&codes, "codes that are too many"),
        (&without(&good, 0xc0), "no frame header"),
    ];
    for (file, expected) in cases {
        let error = ours(file).unwrap_err();
        assert!(error.contains(expected), "{expected:?} is missing in: {error}");
    }
}

//! Raw pixels against a picture that is known, and picture files of every accepted size.

use std::fs::File;

use gripline_capture::convert::Converter;
use gripline_capture::geometry::{CROP_SIDE, Cropping, FRAME, SMALL_SIDE, Size};
use gripline_capture::mode::PixelFormat;
use gripline_capture::picture;
use proptest::prelude::*;

use crate::{middle, smooth_frame};

#[test]
fn grey_and_yuyv_give_the_pixels_of_the_middle() {
    let frame = smooth_frame();
    let yuyv: Vec<u8> = frame.iter().flat_map(|y| [*y, 77]).collect();
    let mut crop = Vec::new();
    Converter::new(PixelFormat::Grey, 0)
        .crop(&frame, &mut crop)
        .unwrap();
    assert_eq!(crop, middle(&frame));
    Converter::new(PixelFormat::Yuyv, 1280)
        .crop(&yuyv, &mut crop)
        .unwrap();
    assert_eq!(crop, middle(&frame));
}

proptest! {
    #[test]
    fn gaps_between_rows_and_pixels_below_the_crop_change_nothing(
        gap in 0_usize..70, cut in 0_usize..20 * FRAME.width, yuyv in any::<bool>(), filler in any::<u8>(),
    ) {
        let frame = smooth_frame();
        let (format, bytes) = if yuyv { (PixelFormat::Yuyv, 2) } else { (PixelFormat::Grey, 1) };
        let mut rows = Vec::new();
        for row in frame.chunks(FRAME.width) {
            rows.extend(row.iter().flat_map(|y| [*y, filler].into_iter().take(bytes)));
            rows.extend(vec![filler; gap]);
        }
        rows.truncate(rows.len() - cut * bytes);
        let mut crop = Vec::new();
        Converter::new(format, FRAME.width * bytes + gap).crop(&rows, &mut crop).unwrap();
        prop_assert_eq!(crop, middle(&frame));
    }

    #[test]
    fn no_bytes_make_a_converter_panic(bytes in prop::collection::vec(any::<u8>(), 0..600), format in 0_usize..3) {
        let _ = Converter::new(PixelFormat::ALL[format], 0).crop(&bytes, &mut Vec::new());
    }
}

#[test]
fn a_frame_that_is_too_short_is_refused() {
    let error = Converter::new(PixelFormat::Yuyv, 0)
        .crop(&[0; 1000], &mut Vec::new())
        .unwrap_err();
    assert_eq!(error.to_string(), "found 1000 bytes, expected at least 588800");
}

#[test]
fn a_small_picture_is_enlarged_so_that_the_means_over_its_blocks_are_itself() {
    let small: Vec<u8> = (0..SMALL_SIDE * SMALL_SIDE).map(|i| (i * 7) as u8).collect();
    let size = Size::new(SMALL_SIDE, SMALL_SIDE);
    let mut crop = Vec::new();
    Cropping::of(size, true).unwrap().apply(&small, &mut crop);
    let block = CROP_SIDE / SMALL_SIDE;
    for (i, level) in crop.iter().enumerate() {
        assert_eq!(
            *level,
            small[i / CROP_SIDE / block * SMALL_SIDE + i % CROP_SIDE / block]
        );
    }
    let error = Cropping::of(size, false).unwrap_err().to_string();
    assert_eq!(error, "found 88×88 pixels, expected 640×480 or 440×440");
}

#[test]
fn a_picture_in_colour_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("colour.png");
    let mut encoder = png::Encoder::new(File::create(&path).unwrap(), 440, 440);
    encoder.set_color(png::ColorType::Rgb);
    encoder
        .write_header()
        .unwrap()
        .write_image_data(&vec![9; 3 * 440 * 440])
        .unwrap();
    let error = picture::crop(&path, false).unwrap_err().to_string();
    for part in ["colour.png: found Rgb of 8 bits", "expected grey of 8 bits"] {
        assert!(error.contains(part), "{part:?} is missing in: {error}");
    }
}

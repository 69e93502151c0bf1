//! Any bytes as a camera's JPEG: a crop of the right size or an error that says what was found, never a panic; and the same
//! whatever the decoder read before.

use gripline_capture::JpegCrop;

/// Panics when something does not hold for this input.
pub fn check(input: &[u8]) {
    let (mut decoder, mut first) = (JpegCrop::default(), Vec::new());
    let result = decoder.decode(input, &mut first);
    match &result {
        Ok(()) => assert_eq!(first.len(), 440 * 440),
        Err(why) => assert!(why.contains("found"), "{why}"),
    }
    let mut crop = vec![7; 3];
    let mut again = |decoder: &mut JpegCrop| {
        assert_eq!(decoder.decode(input, &mut crop), result);
        assert!(result.is_err() || crop == first, "another picture");
    };
    again(&mut decoder);
    // One that has seen its tables and no end of the bits, and one that has seen tables with other symbols.
    let mut other = input.to_vec();
    for at in 21..input.len() {
        // The first symbol behind a table's marker, length, place and counts.
        if input[at - 21..].starts_with(&[0xff, 0xc4]) {
            other[at] ^= 1;
        }
    }
    for before in [&input[..input.len().saturating_sub(9)], &other] {
        let mut decoder = JpegCrop::default();
        let _ = decoder.decode(before, &mut Vec::new());
        again(&mut decoder);
    }
}

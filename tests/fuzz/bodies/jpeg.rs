//! Any bytes as a camera's JPEG: a crop of the right size or an error that says what was found, never a panic; and the same
//! whatever the decoder read before.

use gripline::capture::JpegCrop;

pub(crate) fn check(input: &[u8]) {
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
    // One that has seen a part of its tables, or all and no end of the bits.
    for end in [input.len() / 4, input.len().saturating_sub(9)] {
        let mut decoder = JpegCrop::default();
        let _ = decoder.decode(&input[..end], &mut Vec::new());
        again(&mut decoder);
    }
}

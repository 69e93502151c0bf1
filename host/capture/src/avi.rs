//! Video clips: JPEG pictures one after the other in an AVI file (RIFF), which every player and ffmpeg read and write. Pure
//! but for the reader's source. Of others' files as much is understood as MJPEG needs: the first video stream, its rate,
//! its pictures in their order; sound, indexes and padding are passed over. Limits: 2 GiB a file, 640×480 or 440×440 pixels.

use std::io::{ErrorKind, Read};

/// Four letters that name a part of the file.
type Name = [u8; 4];

/// The largest picture that is believed, bytes: a grey JPEG of 640×480 at its best has 0.3 MB.
const PICTURE_MAX: u32 = 8 << 20;
/// Larger files are not what every reader takes.
const FILE_MAX: usize = 1 << 31;
/// A frame rate is told as so many pictures in so many seconds.
const RATE_SCALE: u32 = 1_000;
/// The flag of a picture that hangs on no other.
const KEY_FRAME: u32 = 0x10;
/// The flag of a file with an index.
const HAS_INDEX: u32 = 0x10;

/// A clip under way, in memory.
#[derive(Debug)]
pub struct Clip {
    bytes: Vec<u8>,
    /// Offset from the list of pictures, and length, of each.
    index: Vec<[u32; 2]>,
    rate: f64,
    size: [u16; 2],
}

/// Bytes of the parts that stand before the pictures.
mod header {
    pub(super) const MAIN: u32 = 56;
    pub(super) const STREAM: u32 = 56;
    pub(super) const FORMAT: u32 = 40;
    /// A name and a length before each.
    pub(super) const CHUNK: u32 = 8;
    /// The list of the stream: its name, and two parts.
    pub(super) const STREAM_LIST: u32 = 4 + CHUNK + STREAM + CHUNK + FORMAT;
    pub(super) const LIST: u32 = 4 + CHUNK + MAIN + CHUNK + STREAM_LIST;
}

impl Clip {
    /// A clip of pictures of `size` (columns, rows), so many a second.
    pub fn new(size: [u16; 2], rate: f64) -> Self {
        Self {
            bytes: Vec::new(),
            index: Vec::new(),
            rate,
            size,
        }
    }

    /// Adds a picture: a JPEG file.
    ///
    /// # Errors
    /// When the clip would get too long.
    pub fn push(&mut self, jpeg: &[u8]) -> Result<(), String> {
        if self.bytes.len() + jpeg.len() > FILE_MAX {
            return Err(format!(
                "found more than 2 GiB of video after {} pictures, expected less: simulate a shorter scene, or take the frames",
                self.index.len()
            ));
        }
        // Offsets count from the list's name.
        self.index.push([4 + self.bytes.len() as u32, jpeg.len() as u32]);
        chunk(&mut self.bytes, *b"00dc", jpeg);
        Ok(())
    }

    /// The file.
    pub fn finish(self) -> Vec<u8> {
        let pictures = self.index.len() as u32;
        let largest = self.index.iter().map(|[_, length]| *length).max().unwrap_or(0);
        let [width, height] = self.size.map(u32::from);
        let mut main = Words::default();
        main.put(&[
            (1e6 / self.rate).round() as u32,
            (f64::from(largest) * self.rate) as u32,
        ]);
        main.put(&[0, HAS_INDEX, pictures, 0, 1, largest, width, height, 0, 0, 0, 0]);
        let mut stream = Words(b"vidsMJPG".to_vec());
        let rate = (self.rate * f64::from(RATE_SCALE)).round() as u32;
        stream.put(&[0, 0, 0, RATE_SCALE, rate, 0, pictures, largest, u32::MAX, 0]);
        // The rectangle that it fills.
        stream.put(&[0, height << 16 | width]);
        let mut format = Words::default();
        format.put(&[header::FORMAT, width, height, 24 << 16 | 1]);
        format.0.extend_from_slice(b"MJPG");
        format.put(&[width * height * 3, 0, 0, 0, 0]);
        let mut index = Words::default();
        for [offset, length] in &self.index {
            index.0.extend_from_slice(b"00dc");
            index.put(&[KEY_FRAME, *offset, *length]);
        }

        let mut list = b"hdrl".to_vec();
        chunk(&mut list, *b"avih", &main.0);
        let mut stream_list = b"strl".to_vec();
        chunk(&mut stream_list, *b"strh", &stream.0);
        chunk(&mut stream_list, *b"strf", &format.0);
        debug_assert_eq!(stream_list.len() as u32, header::STREAM_LIST);
        chunk(&mut list, *b"LIST", &stream_list);
        debug_assert_eq!(list.len() as u32, header::LIST);
        let mut body = b"AVI ".to_vec();
        chunk(&mut body, *b"LIST", &list);
        let mut movie = b"movi".to_vec();
        movie.extend_from_slice(&self.bytes);
        chunk(&mut body, *b"LIST", &movie);
        chunk(&mut body, *b"idx1", &index.0);
        let mut file = Vec::with_capacity(body.len() + 8);
        chunk(&mut file, *b"RIFF", &body);
        file
    }
}

/// Little-endian words.
#[derive(Default)]
struct Words(Vec<u8>);

impl Words {
    fn put(&mut self, words: &[u32]) {
        self.0.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    }
}

/// Name, length, content, and a byte more where the length is odd.
fn chunk(out: &mut Vec<u8>, name: Name, content: &[u8]) {
    out.extend_from_slice(&name);
    out.extend_from_slice(&(content.len() as u32).to_le_bytes());
    out.extend_from_slice(content);
    out.resize(out.len() + content.len() % 2, 0);
}

/// What a clip has next.
#[derive(Debug, PartialEq, Eq)]
pub enum Next {
    /// A JPEG file.
    Picture(Vec<u8>),
    /// Nothing: it was all.
    End,
    /// Nothing, though there should be more: why.
    Cut(String),
}

/// A clip that is being read.
#[derive(Debug)]
pub struct ClipReader<R> {
    source: R,
    /// Pictures a second.
    pub rate: f64,
    /// Bytes of the list of pictures that are left; `None` where its writer did not say.
    left: Option<u64>,
    pictures: u64,
    is_over: bool,
}

impl<R: Read> ClipReader<R> {
    /// Reads up to the first picture.
    ///
    /// # Errors
    /// What was found, what was expected, and what to do.
    pub fn new(mut source: R) -> Result<Self, String> {
        let mut head = [0; 12];
        let is_avi =
            source.read_exact(&mut head).is_ok() && head.starts_with(b"RIFF") && head.ends_with(b"AVI ");
        if !is_avi {
            return Err(
                "found no AVI file, expected a clip of `gripline simulate --video` or another AVI with MJPEG; convert it: ffmpeg -i \
                 IN -c:v mjpeg -q:v 2 OUT.avi"
                    .to_owned(),
            );
        }
        let no_pictures = || "found an AVI file that ends before its pictures, expected some".to_owned();
        let mut rate = None;
        loop {
            let (name, length) = chunk_head(&mut source).ok_or_else(no_pictures)?;
            match &name {
                b"LIST" => {
                    let mut kind = [0; 4];
                    source.read_exact(&mut kind).map_err(|_| no_pictures())?;
                    match &kind {
                        // What is in them comes next.
                        b"hdrl" | b"strl" => {}
                        b"movi" => {
                            return Ok(Self {
                                source,
                                rate: rate.ok_or("found an AVI file without a video stream, expected one")?,
                                left: (length > 4).then(|| u64::from(length) - 4),
                                pictures: 0,
                                is_over: false,
                            });
                        }
                        _ => skip(&mut source, u64::from(length).saturating_sub(4)),
                    }
                }
                b"strh" if rate.is_none() => {
                    let mut stream = vec![0; (length as usize).min(1 << 10)];
                    source.read_exact(&mut stream).map_err(|_| no_pictures())?;
                    rate = rate_of(&stream)?;
                    skip(&mut source, u64::from(length % 2));
                }
                _ => skip(&mut source, u64::from(length) + u64::from(length % 2)),
            }
        }
    }

    /// The next picture.
    pub fn next(&mut self) -> Next {
        while !self.is_over {
            match self.step() {
                Ok(None) => {}
                Ok(Some(jpeg)) => {
                    self.pictures += 1;
                    return Next::Picture(jpeg);
                }
                Err(next) => {
                    self.is_over = true;
                    return next;
                }
            }
        }
        Next::End
    }

    /// One part of the list of pictures; none where it is no picture.
    fn step(&mut self) -> Result<Option<Vec<u8>>, Next> {
        if self.left == Some(0) {
            return Err(Next::End);
        }
        let cut = |found: &str| Next::Cut(format!("{found} after {} pictures", self.pictures));
        let Some((name, length)) = chunk_head(&mut self.source) else {
            return Err(if self.left.is_some() {
                cut("the file ends")
            } else {
                Next::End
            });
        };
        let padded = u64::from(length) + u64::from(length % 2);
        let mut passed = 8;
        let mut picture = None;
        match &name {
            // A list of pictures that belong together: they come next.
            b"LIST" => {
                skip(&mut self.source, 4);
                passed += 4;
            }
            b"idx1" => return Err(Next::End),
            [b'0'..=b'9', b'0'..=b'9', b'd', b'b' | b'c'] => {
                if length > PICTURE_MAX {
                    return Err(cut(&format!("a picture of {length} bytes stands")));
                }
                let mut jpeg = vec![0; length as usize];
                self.source
                    .read_exact(&mut jpeg)
                    .map_err(|_| cut("the file ends in a picture"))?;
                skip(&mut self.source, u64::from(length % 2));
                passed += padded;
                // One that is empty says: as before.
                picture = (!jpeg.is_empty()).then_some(jpeg);
            }
            _ => {
                skip(&mut self.source, padded);
                passed += padded;
            }
        }
        self.left = self.left.map(|left| left.saturating_sub(passed));
        Ok(picture)
    }
}

/// Pictures a second of a video stream's header; `None` of another stream's.
fn rate_of(stream: &[u8]) -> Result<Option<f64>, String> {
    let word = |at: usize| {
        let bytes = stream.get(at..at + 4).and_then(|bytes| bytes.try_into().ok());
        bytes.map_or(0, u32::from_le_bytes)
    };
    if !stream.starts_with(b"vids") {
        return Ok(None);
    }
    let coded = stream.get(4..8).unwrap_or_default();
    if !coded.eq_ignore_ascii_case(b"MJPG") {
        return Err(format!(
            "found video coded as {}, expected MJPG; convert it: ffmpeg -i IN -c:v mjpeg -q:v 2 OUT.avi",
            String::from_utf8_lossy(coded)
        ));
    }
    let (scale, rate) = (f64::from(word(20)), f64::from(word(24)));
    let per_second = rate / scale;
    if (0.1..=10_000.0).contains(&per_second) {
        return Ok(Some(per_second));
    }
    Err(format!(
        "found {rate} pictures in {scale} s, expected 0.1 to 10000 a second"
    ))
}

/// Name and length of the next part; `None` where there is no whole one.
fn chunk_head(source: &mut impl Read) -> Option<(Name, u32)> {
    let mut head = [0; 8];
    source.read_exact(&mut head).ok()?;
    let [a, b, c, d, length @ ..] = head;
    Some(([a, b, c, d], u32::from_le_bytes(length)))
}

/// Passes over so many bytes; an end shows with the next part.
fn skip(source: &mut impl Read, bytes: u64) {
    let mut rest = source.take(bytes);
    let mut nowhere = [0; 4_096];
    loop {
        match rest.read(&mut nowhere) {
            Ok(0) => return,
            Err(error) if error.kind() != ErrorKind::Interrupted => return,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn clip(pictures: &[Vec<u8>], rate: f64) -> Vec<u8> {
        let mut clip = Clip::new([440, 440], rate);
        for picture in pictures {
            clip.push(picture).unwrap();
        }
        clip.finish()
    }

    fn pictures(bytes: &[u8]) -> (Vec<Vec<u8>>, Next) {
        let mut reader = ClipReader::new(bytes).unwrap();
        let mut all = Vec::new();
        loop {
            match reader.next() {
                Next::Picture(picture) => all.push(picture),
                end => return (all, end),
            }
        }
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back_and_a_cut_file_to_its_last_whole_picture(
            all in prop::collection::vec(prop::collection::vec(any::<u8>(), 1..60), 1..12),
            rate in 1.0..240.0,
            cut in any::<prop::sample::Index>(),
        ) {
            let bytes = clip(&all, rate);
            prop_assert_eq!(bytes.len() % 2, 0);
            let reader = ClipReader::new(&bytes[..]).unwrap();
            prop_assert!((reader.rate - rate).abs() < 0.001);
            prop_assert_eq!(pictures(&bytes), (all.clone(), Next::End));
            // Anywhere within the pictures.
            let begin = bytes.windows(4).position(|name| name == b"movi").unwrap() + 4;
            let end = bytes.windows(4).rposition(|name| name == b"idx1").unwrap();
            let at = begin + cut.index(end - begin);
            let (found, ending) = pictures(&bytes[..at]);
            prop_assert!(found.len() < all.len() || at + 1 >= end);
            prop_assert_eq!(&found[..], &all[..found.len()]);
            let is_cut = matches!(ending, Next::Cut(_));
            prop_assert!(is_cut || found.len() == all.len(), "{:?}", ending);
        }

        #[test]
        fn no_bytes_make_the_reader_panic(bytes in prop::collection::vec(any::<u8>(), 0..400), place in 0_usize..300) {
            let _ = ClipReader::new(&bytes[..]).map(|mut reader| while let Next::Picture(_) = reader.next() {});
            // And a good file with anything in its middle.
            let mut good = clip(&[vec![1; 40], vec![2; 41]], 60.0);
            for (to, from) in good.iter_mut().skip(place).zip(&bytes) {
                *to = *from;
            }
            let _ = ClipReader::new(&good[..]).map(|mut reader| while let Next::Picture(_) = reader.next() {});
        }
    }

    #[test]
    fn other_files_are_refused_with_what_to_do() {
        let good = clip(&[vec![7; 9]], 60.0);
        let said = |bytes: &[u8]| ClipReader::new(bytes).unwrap_err();
        assert!(said(b"GIF89a, and no more than that").contains("found no AVI file"));
        assert!(said(&[]).contains("found no AVI file"));
        assert!(said(&good[..40]).contains("ends before its pictures"));
        let at = good.windows(8).position(|name| name == b"vidsMJPG").unwrap();
        let mut other = good.clone();
        other[at + 4..at + 8].copy_from_slice(b"H264");
        assert!(said(&other).contains("found video coded as H264, expected MJPG"));
        let mut still = good.clone();
        still[at + 20..at + 24].fill(0);
        assert!(said(&still).contains("expected 0.1 to 10000 a second"));
        other[at..at + 4].copy_from_slice(b"auds");
        assert!(said(&other).contains("without a video stream"));
    }
}

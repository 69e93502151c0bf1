//! Topics of a recording, and what its Foxglove messages share.

use std::borrow::Cow;

use foxglove::Encode;
use foxglove::messages::Timestamp;

/// Topic of the pictures without contact, before anything else.
pub(crate) const REST: &str = "/rest";
/// Topic of the camera's pictures.
pub(crate) const PICTURE: &str = "/picture";
/// Topic of the force maps.
pub(crate) const FORCE_MAP: &str = "/force_map";
/// Topic of the frames' reports; a frame is whole when its status is there.
pub(crate) const STATUS: &str = "/status";
/// Topic of changes of state, faults and losses.
pub(crate) const EVENTS: &str = "/events";

/// Prefix of the second fingertip's topics.
const SECOND: &str = "/second";

/// The topic of fingertip `sensor`.
pub(crate) fn topic_of(topic: &'static str, sensor: usize) -> Cow<'static, str> {
    match sensor {
        0 => topic.into(),
        _ => format!("{SECOND}{topic}").into(),
    }
}

/// A topic without its prefix, and the fingertip's number.
pub(crate) fn fingertip_of(topic: &str) -> (&str, usize) {
    match topic.strip_prefix(SECOND) {
        Some(name) => (name, 1),
        None => (topic, 0),
    }
}

/// The coordinate frame of pictures and maps.
pub(crate) const FRAME_ID: &str = "fingertip";

/// A time after 1970 as Foxglove's messages have it.
pub(crate) fn timestamp(ns: u64) -> Timestamp {
    Timestamp::new((ns / 1_000_000_000) as u32, (ns % 1_000_000_000) as u32)
}

/// A message as protocol buffers.
pub(crate) fn encoded(message: &impl Encode) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(message.encoded_len().unwrap_or_default());
    // The only error is a full buffer, and a vector grows.
    let _ = message.encode(&mut bytes);
    bytes
}

//! What the walk cannot see in the image: how often loops run, where calls through registers lead, what a path never comes
//! to; each with its reason. Runs check the loops (`measure`), and an entry that names nothing in the image is a finding.

use gripline_protocol::SENSORS;
use gripline_protocol::constants::{
    BITMAP_BYTES, CRC_BYTES, PACKET_HEADER, PACKET_MAX, TAXEL_BYTES, TAXELS_PER_PACKET,
};
use gripline_protocol::line::LINE_POINTS;
use gripline_protocol::message::Message;

/// Words of the longest packet.
const WORDS: u32 = PACKET_MAX as u32 / 4;
/// Fingertips.
const TIPS: u32 = SENSORS as u32;
/// Straight pieces of the calibration.
const PIECES: u32 = LINE_POINTS as u32 - 1;
/// Words of a message, the largest thing that is copied with the path blocked; four of them a round.
const COPIED: u32 = size_of::<Message>() as u32 / 4 / 4 + 1;

/// Taxels of the longest last packet.
pub const TAIL_TAXELS: u32 = TAXELS_PER_PACKET as u32 - 1;

/// Bytes of a last packet before its own CRC, which the map's CRC is over.
const fn tail(taxels: u32) -> u32 {
    PACKET_HEADER as u32 + taxels * TAXEL_BYTES as u32
}

/// Words of a last packet.
const fn tail_words(taxels: u32) -> u32 {
    (tail(taxels) + CRC_BYTES as u32).div_ceil(4)
}

/// How often a loop's first instruction runs at most.
#[derive(Debug, Clone, Copy)]
pub struct Rounds {
    /// Anywhere.
    pub most: u32,
    /// On the path of a map's last packet, by its taxels.
    pub of_tail: fn(u32) -> u32,
}

/// Rounds anywhere and on the path.
const fn rounds(most: u32, of_tail: fn(u32) -> u32) -> Rounds {
    Rounds { most, of_tail }
}

/// (text of a line of the loop's source, or, for functions without one, part of the name and of an instruction; its rounds; why). The
/// first that fits counts.
pub const LOOPS: &[(&str, Rounds, &str)] = &[
    (
        "for block in blocks",
        rounds(WORDS / 4, |taxels| tail_words(taxels) / 4),
        "FIFO, four words a round of a packet",
    ),
    (
        " in blocks {",
        rounds(WORDS / 4, |taxels| tail(taxels) / 16),
        "CRC, four words a round of a packet",
    ),
    (
        "for word in rest",
        rounds(3, |taxels| tail_words(taxels) % 4),
        "FIFO, what four words a round leave",
    ),
    (
        "for &word in words",
        rounds(3, |taxels| tail(taxels) / 4 % 4),
        "CRC, what four words a round leave",
    ),
    (
        "for &byte in rest",
        rounds(3, |taxels| tail(taxels) % 4),
        "CRC, what words leave; taxels are of six bytes",
    ),
    (
        "dsp::add_pairs @ ldm",
        rounds(TAXELS_PER_PACKET as u32 / 2, |taxels| taxels / 2),
        "pairs of taxels in a packet",
    ),
    ("for tip in", rounds(TIPS, |_| TIPS), "fingertips"),
    (".fold(Health::GOOD", rounds(TIPS, |_| TIPS), "fingertips"),
    (".any(|tip| older(", rounds(TIPS, |_| TIPS), "fingertips"),
    (
        "while place < LINE_POINTS",
        rounds(PIECES, |_| PIECES),
        "straight pieces of the calibration",
    ),
    (
        "for place in 0..2",
        rounds(2, |_| 2),
        "copies of the line that survive a reset",
    ),
    // Before the loop inside it, whose lines it has too.
    (
        " in &self.bytes {",
        rounds(BITMAP_BYTES as u32, |_| 0),
        "a map's bitmap",
    ),
    (
        "for nibble in [",
        rounds(2, |_| 0),
        "halves of a byte of a map's bitmap",
    ),
    (
        "in places.iter().zip(bytes)",
        rounds(TAXELS_PER_PACKET as u32, |_| 0),
        "taxels of a packet over the UART",
    ),
    (
        "for &byte in bytes {",
        rounds(PACKET_MAX as u32, |_| 0),
        "bytes of a packet over the UART",
    ),
    (
        "mem @ ldrb",
        rounds(4, |_| 0),
        "bytes before and behind words, four a round",
    ),
    (
        "mem @ ldr",
        rounds(COPIED, |_| 0),
        "words of the largest thing that is copied",
    ),
    (
        "mem @ str",
        rounds(COPIED, |_| 0),
        "words of the largest thing that is cleared; the path clears none",
    ),
    (
        "mem @ stm",
        rounds(COPIED, |_| 0),
        "words of the largest thing that is cleared; the path clears none",
    ),
];

/// (part of the name of the function that calls, names of those it may call, why).
pub const CALLS: &[(&str, &[&str], &str)] = &[];

/// For which paths something is left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Left {
    /// For all.
    Always,
    /// For that of a map's last packet.
    Tail,
    /// For that of a full packet.
    Taxels,
    /// for what blocks the path.
    Blocked,
}

/// (part of a function's name, for which paths, why they never come to it).
pub const LEFT_OUT: &[(&str, Left, &str)] = &[
    (
        "Program<K>::head",
        Left::Tail,
        "a map's first packet is never its last",
    ),
    (
        "Program<K>::taxels",
        Left::Tail,
        "a full packet is never a map's last",
    ),
    ("Program<K>::head", Left::Taxels, "a full packet is no first one"),
    ("Program<K>::tail", Left::Taxels, "a full packet is no last one"),
    (
        "dsp::portable",
        Left::Taxels,
        "packets of the USB path lie at addresses that words may have",
    ),
    (
        "RunningCrc::update_bytes",
        Left::Taxels,
        "packets of the USB path lie at addresses that words may have",
    ),
    (
        "dsp::portable",
        Left::Tail,
        "packets of the USB path lie at addresses that words may have",
    ),
    (
        "RunningCrc::update_bytes",
        Left::Tail,
        "packets of the USB path lie at addresses that words may have",
    ),
];

/// (part of a stretch's name, why it blocks no line that grips).
pub const RELEASED: &[(&str, &str)] = &[(
    "Control::settings_to_store",
    "settings go to flash only when released, with the line at zero",
)];

/// Why what masks the interrupt of the path alone is no part of the bound.
pub const BOTH_LINKS: &str =
    "a packet of a map over the UART; a host that sends maps over both links at once waits so much longer";

/// (part of a function's name, why its blocking does not count).
pub const SKIPPED: &[(&str, &str)] = &[
    ("gripline_panic", "a panic ends in a reset"),
    ("cortex_m_rt_main", "before the start"),
];

/// The functions that do a map's sums.
pub const KERNEL: &[&str] = &["dsp::add_pair", "kernel::Dsp"];

/// The function that a map's way ends with, in the walk and in the measurement.
pub const WRITE_LINE: &str = "control::Control::write_line";

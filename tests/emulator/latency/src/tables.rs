//! What the walk cannot see in the image: how often loops run, where calls through registers lead, what a path never comes
//! to; each with its reason. Runs check the loops (`measure`), and an entry that names nothing in the image is a finding.

use gripline_protocol::SENSORS;
use gripline_protocol::constants::{PACKET_HEADER, PACKET_MAX, TAXEL_BYTES, TAXELS_PER_PACKET};
use gripline_protocol::line::LINE_POINTS;
use gripline_protocol::message::Message;

/// Words of the longest packet.
const WORDS: u32 = PACKET_MAX as u32 / 4;
/// Bytes of the longest last packet that its CRC is over.
const TAIL: u32 = (PACKET_HEADER + (TAXELS_PER_PACKET - 1) * TAXEL_BYTES) as u32;
/// Fingertips.
const TIPS: u32 = SENSORS as u32;
/// Straight pieces of the calibration.
const PIECES: u32 = LINE_POINTS as u32 - 1;
/// Words of a message, the largest thing that is copied with the path blocked; four of them a round.
const COPIED: u32 = size_of::<Message>() as u32 / 4 / 4 + 1;

/// Rounds in which the path clears anything: since the load is looked at outside it, nothing is.
const CLEARED: u32 = 0;

/// (text of a line of the loop's source, or, for functions without one, part of the name and of an instruction; how often
/// the loop's first instruction runs at most; the same on the path of a map's last packet; why). The first that fits counts.
pub const LOOPS: &[(&str, u32, u32, &str)] = &[
    (
        "for block in blocks",
        WORDS / 4,
        WORDS / 4,
        "FIFO, four words a round of a packet",
    ),
    (
        " in blocks {",
        WORDS / 4,
        TAIL / 16,
        "CRC, four words a round of a packet",
    ),
    ("for word in rest", 3, 3, "FIFO, what four words a round leave"),
    ("for &word in words", 3, 3, "CRC, what four words a round leave"),
    (
        "for &byte in rest",
        3,
        TAIL % 4,
        "CRC, what words leave; taxels are of six bytes",
    ),
    (
        "dsp::add_pairs @ ldm",
        TAXELS_PER_PACKET as u32 / 2,
        (TAXELS_PER_PACKET as u32 - 1) / 2,
        "pairs of taxels in a packet",
    ),
    ("for tip in", TIPS, TIPS, "fingertips"),
    (".fold(Health::GOOD", TIPS, TIPS, "fingertips"),
    (".any(|tip| older(", TIPS, TIPS, "fingertips"),
    (
        "while place < LINE_POINTS",
        PIECES,
        PIECES,
        "straight pieces of the calibration",
    ),
    (
        "for place in 0..2",
        2,
        2,
        "copies of the line that survive a reset",
    ),
    ("mem @ ldrb", 4, 0, "bytes before and behind words, four a round"),
    (
        "mem @ ldr",
        COPIED,
        0,
        "words of the largest thing that is copied",
    ),
    (
        "mem @ str",
        COPIED,
        CLEARED,
        "words of the largest thing that is cleared",
    ),
    (
        "mem @ stm",
        COPIED,
        CLEARED,
        "words of the largest thing that is cleared",
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

/// (part of a function's name, why its blocking does not count).
pub const SKIPPED: &[(&str, &str)] = &[
    ("gripline_panic", "a panic ends in a reset"),
    ("cortex_m_rt_main", "before the start"),
];

/// The functions that do a map's sums.
pub const KERNEL: &[&str] = &["dsp::add_pair", "kernel::Dsp"];

/// The function that a map's way ends with, in the walk and in the measurement.
pub const WRITE_LINE: &str = "control::Control::write_line";

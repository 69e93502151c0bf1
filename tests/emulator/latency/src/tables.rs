//! What the walk cannot see in the image: how often loops of machine instructions run, where calls through registers lead, what a path never comes
//! to; each with its reason. Runs check the loops (`measure`), and an entry that names nothing in the image is a finding.

use gripline_protocol::constants::{CRC_BYTES, PACKET_HEADER, PACKET_MAX, TAXEL_BYTES, TAXELS_PER_PACKET};
use gripline_protocol::message::Message;

/// Words of the longest packet.
const WORDS: u32 = PACKET_MAX as u32 / 4;
/// Part of the names of the functions that copy; the third argument is how many bytes.
pub const COPY: &str = "memcpy";
/// Words of a message, the largest thing that is copied with the path blocked; four of them a round. Where the caller says how much, that counts.
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

/// A loop that says how often it runs at most (`gripline_protocol::rounds`), and runs less often on the path of a map's last packet.
#[derive(Debug, Clone, Copy)]
pub struct TailLoop {
    /// Part of the name of the function it stands in.
    pub function: &'static str,
    /// The rounds that it says, which tell it from other loops of that function.
    pub says: u32,
    /// Its rounds for a last packet of so many taxels.
    pub rounds: fn(u32) -> u32,
    /// Why.
    pub why: &'static str,
}

/// All of them.
pub const OF_TAIL: &[TailLoop] = &[
    TailLoop {
        function: "usb_interrupt::read_words",
        says: WORDS / 4,
        rounds: |taxels| tail_words(taxels) / 4,
        why: "four words a round",
    },
    TailLoop {
        function: "usb_interrupt::read_words",
        says: 3,
        rounds: |taxels| tail_words(taxels) % 4,
        why: "what four words a round leave",
    },
    TailLoop {
        function: "RunningCrc::update",
        says: WORDS / 4,
        rounds: |taxels| tail(taxels) / 16,
        why: "four words a round",
    },
    TailLoop {
        function: "RunningCrc::update",
        says: 3,
        rounds: |taxels| (tail(taxels) / 4 % 4).max(tail(taxels) % 4),
        why: "what four words a round leave, and what words leave; taxels are of six bytes",
    },
];

/// A loop in machine instructions, which cannot say so.
#[derive(Debug, Clone, Copy)]
pub struct MachineLoop {
    /// Part of the function's name.
    pub function: &'static str,
    /// The beginning of one of its instructions.
    pub instruction: &'static str,
    /// How often its first instruction runs at most.
    pub most: u32,
    /// The same on the path of a map's last packet, by its taxels.
    pub of_tail: fn(u32) -> u32,
    /// The same when it copies so many bytes; what is copied has words only from 16 bytes on.
    pub of_copy: fn(u32) -> u32,
    /// Why no more.
    pub why: &'static str,
}

const fn machine(
    function: &'static str,
    instruction: &'static str,
    most: u32,
    of_tail: fn(u32) -> u32,
    of_copy: fn(u32) -> u32,
    why: &'static str,
) -> MachineLoop {
    MachineLoop {
        function,
        instruction,
        most,
        of_tail,
        of_copy,
        why,
    }
}

/// The first that fits counts.
pub const MACHINE_LOOPS: &[MachineLoop] = &[
    machine(
        "dsp::add_pairs",
        "ldm",
        TAXELS_PER_PACKET as u32 / 2,
        |taxels| taxels / 2,
        |_| 0,
        "pairs of taxels in a packet",
    ),
    machine(
        "mem",
        "ldrb",
        4,
        |_| 0,
        |bytes| if bytes < 16 { bytes / 4 } else { 0 },
        "bytes before and behind words, four a round",
    ),
    machine(
        "mem",
        "ldr",
        COPIED,
        |_| 0,
        |bytes| if bytes < 16 { 0 } else { bytes / 16 + 1 },
        "words of the largest thing that is copied",
    ),
    machine(
        "mem",
        "str",
        COPIED,
        |_| 0,
        |_| 0,
        "words of the largest thing that is cleared; the path clears none",
    ),
    machine(
        "mem",
        "stm",
        COPIED,
        |_| 0,
        |_| 0,
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
    /// For that of a map's first packet over the UART.
    Head,
    /// For that of a byte of the UART that ends no packet.
    Byte,
    /// For an interrupt of the link whose maps do not count.
    Foreign,
    /// For what blocks the path.
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
        "Program<K>::begin",
        Left::Tail,
        "a map's first packet is never its last",
    ),
    (
        "Receiver::list_places",
        Left::Tail,
        "a map's last byte ends a frame, and has no places to list",
    ),
    ("Program<K>::begin", Left::Taxels, "a full packet is no first one"),
    ("Receiver::list_places", Left::Taxels, ENDS),
    ("Program<K>::taxels", Left::Head, "a first packet is no full one"),
    ("Program<K>::tail", Left::Head, "a first packet is no last one"),
    ("Receiver::list_places", Left::Head, ENDS),
    ("Program<K>::taxels", Left::Byte, INSIDE),
    ("Program<K>::tail", Left::Byte, INSIDE),
    ("Program<K>::begin", Left::Byte, INSIDE),
    ("Control::unknown_packet", Left::Byte, INSIDE),
    ("Program<K>::head", Left::Foreign, FOREIGN),
    ("Program<K>::begin", Left::Foreign, FOREIGN),
    ("Receiver::list_places", Left::Foreign, FOREIGN),
    ("Program<K>::taxels", Left::Foreign, FOREIGN),
    ("Program<K>::tail", Left::Foreign, FOREIGN),
    (
        "dsp::portable",
        Left::Always,
        "packets lie at addresses that words may have",
    ),
    (
        "RunningCrc::update_bytes",
        Left::Always,
        "packets lie at addresses that words may have",
    ),
];

/// Why a packet's last byte lists no places.
const ENDS: &str = "a byte that ends a frame has no places to list";
/// Why a byte inside a packet does nothing with it.
const INSIDE: &str = "only a packet's last byte leads into the program";

/// Why one link's packets never meet those of the other in the program.
const FOREIGN: &str = "maps of one link count at a time; those of the other are refused before their sums";

/// (part of a stretch's name, why it blocks no map that the bound is about).
pub const EXCEPTED: &[(&str, &str)] = &[
    (
        "Control::settings_to_store",
        "settings go to flash only when released, with the line at zero",
    ),
    (
        "USART1",
        "while maps over the UART count, none over USB does; otherwise it takes what its interrupt does for the other link",
    ),
    (
        "Control::map_packet",
        "a packet of a map behind one of the control endpoint, outside of the bound; maps of the other link do not count then",
    ),
];

/// (part of a function's name, why its blocking does not count).
pub const SKIPPED: &[(&str, &str)] = &[
    ("gripline_panic", "a panic ends in a reset"),
    ("cortex_m_rt_main", "before the start"),
];

/// The functions that do a map's sums.
pub const KERNEL: &[&str] = &["dsp::add_pair", "kernel::Dsp"];

/// The function that a map's way ends with, in the walk and in the measurement.
pub const WRITE_LINE: &str = "control::Control::write_line";

/// The function that takes a byte of the UART while the interrupt works on the one before.
pub const TAKE_AHEAD: &str = "uart::take_ahead";

//! Commands, configuration, status and handshake: everything on the wire that is not a force map.
//!
//! A message is: schema version u16 (little-endian), class u8, then a postcard body. The handshake ([`Hello`]) has a
//! frozen layout, so that two builds with different schemas can still tell each other which they are; everything else
//! is refused unless both schema versions agree. Units: forces in 1/4096 N, ratios and friction in 1/10000.

use core::fmt;

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

pub use crate::configuration::{Configuration, FingertipGeometry, OutOfRange};
use crate::constants::{CRC_BYTES, MESSAGE_FRAGMENTS_MAX, MESSAGE_MAX, PACKET_HEADER, PACKET_MAX};
pub use crate::line::{LineKind, LinePoint, LineSettings};
use crate::packet::{Header, Kind, RunningCrc};

/// Version of everything in this module but [`Hello`]; raised with every change of a message's layout.
pub const SCHEMA_VERSION: u16 = 3;
/// Hash over the layouts of all messages, so that a forgotten version number is noticed too.
pub const SCHEMA_HASH: u32 = {
    let command = postcard_schema::key::Key::for_path::<Command>("command").to_bytes();
    let report = postcard_schema::key::Key::for_path::<Report>("report").to_bytes();
    let (mut hash, mut i) = (0_u32, 0);
    while i < 8 {
        hash = hash.rotate_left(5) ^ command[i] as u32 ^ (report[i] as u32) << 16;
        i += 1;
    }
    hash
};

/// The commit that a build was made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Revision {
    /// The first eight hexadecimal digits of the commit's hash.
    pub commit: u32,
    /// Files that the build is made from differed from that commit.
    pub dirty: bool,
}

impl fmt::Display for Revision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let dirty = if self.dirty { ", changed since" } else { "" };
        write!(f, "{:08x}{dirty}", self.commit)
    }
}

/// Who is speaking. Frozen layout: 16 bytes after the class byte, never to change; what a flag in the last but one of
/// them announces comes behind, where an older reader does not look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Hello {
    /// [`SCHEMA_VERSION`] of the speaker.
    pub schema_version: u16,
    /// [`SCHEMA_HASH`] of the speaker.
    pub schema_hash: u32,
    /// Version of the speaker's build: major, minor, patch.
    pub build: [u8; 3],
    /// Which board speaks, its place in [`BOARDS`].
    pub board: u8,
    /// A random number per start, so that a restart is noticed.
    pub session: u32,
    /// The commit that the speaker was built from, where it is known: firmware images of a repository.
    pub revision: Option<Revision>,
}

const HELLO_BYTES: usize = 16;
/// With the commit behind it.
const HELLO_BYTES_MAX: usize = HELLO_BYTES + 4;
/// Flags in byte 14: a commit follows; it was changed since.
const HAS_COMMIT: u8 = 1;
const IS_DIRTY: u8 = 1 << 1;

/// Names of the boards, by the number that [`Hello::board`] gives.
pub const BOARDS: [&str; 3] = ["host", "stm32f405rg", "stm32f427vi"];

impl Hello {
    /// What this build says of itself; whoever knows its commit adds it.
    #[must_use]
    pub const fn of_this_build(board: u8, session: u32) -> Self {
        Self {
            schema_version: SCHEMA_VERSION,
            schema_hash: SCHEMA_HASH,
            build: BUILD,
            board,
            session,
            revision: None,
        }
    }

    /// Whether the other side speaks the same schema.
    ///
    /// # Errors
    /// [`SchemaMismatch`] with both sides' versions.
    pub const fn check(&self) -> Result<(), SchemaMismatch> {
        if self.schema_version == SCHEMA_VERSION && self.schema_hash == SCHEMA_HASH {
            Ok(())
        } else {
            Err(SchemaMismatch {
                found: (self.schema_version, self.schema_hash),
                build: self.build,
            })
        }
    }

    /// Writes it and returns its length.
    fn write(self, bytes: &mut [u8]) -> usize {
        bytes[0..2].copy_from_slice(&self.schema_version.to_le_bytes());
        bytes[2..6].copy_from_slice(&self.schema_hash.to_le_bytes());
        bytes[6..9].copy_from_slice(&self.build);
        bytes[9] = self.board;
        bytes[10..14].copy_from_slice(&self.session.to_le_bytes());
        let Some(Revision { commit, dirty }) = self.revision else {
            return HELLO_BYTES;
        };
        bytes[14] = HAS_COMMIT | if dirty { IS_DIRTY } else { 0 };
        bytes[HELLO_BYTES..HELLO_BYTES_MAX].copy_from_slice(&commit.to_le_bytes());
        HELLO_BYTES_MAX
    }

    /// Reads it; `None` when it is too short.
    fn read(body: &[u8]) -> Option<Self> {
        let (fixed, rest) = body.split_first_chunk::<HELLO_BYTES>()?;
        let [
            v0,
            v1,
            h0,
            h1,
            h2,
            h3,
            major,
            minor,
            patch,
            board,
            s0,
            s1,
            s2,
            s3,
            flags,
            _,
        ] = *fixed;
        let revision = if flags & HAS_COMMIT == 0 {
            None
        } else {
            Some(Revision {
                commit: u32::from_le_bytes(*rest.first_chunk()?),
                dirty: flags & IS_DIRTY != 0,
            })
        };
        Some(Self {
            schema_version: u16::from_le_bytes([v0, v1]),
            schema_hash: u32::from_le_bytes([h0, h1, h2, h3]),
            build: [major, minor, patch],
            board,
            session: u32::from_le_bytes([s0, s1, s2, s3]),
            revision,
        })
    }
}

/// "0.1.0 (1a2b3c4d) on stm32f405rg".
impl fmt::Display for Hello {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [major, minor, patch] = self.build;
        write!(f, "{major}.{minor}.{patch}")?;
        if let Some(revision) = self.revision {
            write!(f, " ({revision})")?;
        }
        match BOARDS.get(usize::from(self.board)) {
            Some(board) => write!(f, " on {board}"),
            None => write!(f, " on board {}", self.board),
        }
    }
}

const BUILD: [u8; 3] = [
    decimal(env!("CARGO_PKG_VERSION_MAJOR")),
    decimal(env!("CARGO_PKG_VERSION_MINOR")),
    decimal(env!("CARGO_PKG_VERSION_PATCH")),
];

const fn decimal(text: &str) -> u8 {
    let (bytes, mut value, mut i) = (text.as_bytes(), 0, 0);
    while i < bytes.len() {
        value = value * 10 + (bytes[i] - b'0');
        i += 1;
    }
    value
}

/// The two sides do not speak the same messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SchemaMismatch {
    /// The other side's schema version and hash.
    pub found: (u16, u32),
    /// The other side's build.
    pub build: [u8; 3],
}

impl fmt::Display for SchemaMismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([major, minor, patch], (version, hash)) = (self.build, self.found);
        write!(
            f,
            "the other side (build {major}.{minor}.{patch}) speaks schema {version} ({hash:08x}), this side schema \
             {SCHEMA_VERSION} ({SCHEMA_HASH:08x}): flash the firmware of this host's version, or install the host of \
             that firmware's"
        )
    }
}

impl core::error::Error for SchemaMismatch {}

/// What the host asks of the microcontroller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Command {
    /// Take these settings; refused whole when one is out of range.
    Configure(Configuration),
    /// Say which settings are in force.
    ReadConfiguration,
    /// Keep the settings in force in flash. Writing it stops the processor for up to half a second, so only a
    /// gripper that is released, with the line at 0 N, does it.
    Store,
    /// Close to the floor force and hold what is there.
    Hold,
    /// Let go, slowly: the only way to less than the floor force.
    Release,
    /// A person has looked at these latched faults (bits of the fault numbers): clear them.
    Acknowledge {
        /// Bit n stands for fault number n.
        faults: u32,
    },
    /// Send a status now.
    ReadStatus,
}

/// What the microcontroller tells the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Report {
    /// After every map, on request, and ten times a second.
    Status(Status),
    /// The settings in force: the answer to `Configure` and `ReadConfiguration`.
    Configuration(Configuration),
    /// The settings lie in flash and were read back: the answer to `Store`.
    Stored {
        /// How often settings were stored since the chip was new.
        writes: u32,
    },
    /// A command that was understood but not carried out.
    Refused(Refusal),
}

/// Why a command was not carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// A setting is out of its range: its place in [`Configuration::FIELDS`], what was found, what is allowed.
    OutOfRange(OutOfRange),
    /// The message could not be read: another schema or damaged at its source.
    Unreadable,
    /// No handshake yet, or one with another schema.
    NoHandshake,
    /// `Release` while a latched fault waits for `Acknowledge`: a person must look first.
    Latched,
    /// `Store` while holding, or before the line is back at 0 N: `Release` first.
    Holding,
    /// `Store` did not work: the flash would not take it. The settings that were stored before are still there.
    FlashFailed,
}

/// Where the contact stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SlipState {
    /// Nothing touches: there is no stick ratio.
    #[default]
    NoContact,
    /// The contact holds.
    Stick,
    /// The contact still holds but is on its way to slip.
    Incipient,
    /// The stick ratio is below the threshold.
    Slip,
}

impl SlipState {
    /// The name that people read.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoContact => "NO_CONTACT",
            Self::Stick => "STICK",
            Self::Incipient => "INCIPIENT",
            Self::Slip => "SLIP",
        }
    }
}

/// What the gripper is told to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum GripMode {
    /// Let go, or never closed.
    #[default]
    Released,
    /// Holding.
    Hold,
}

/// What one map said, in the wire's units.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MapSums {
    /// Taxels in contact: normal force above `contact_min`.
    pub contact: u16,
    /// Taxels in contact that stick: fx² + fy² ≤ μ² fz².
    pub stick: u16,
    /// Sums over the whole map of fx, fy, fz, 1/4096 N.
    pub force: [i32; 3],
    /// Moment about z at the map's centre, Σ(x fy − y fx), in 1/4096 N × half a taxel pitch.
    pub moment: i32,
    /// Σ x fz and Σ y fz, in 1/4096 N × half a taxel pitch: the centre of pressure is this over Σ fz.
    pub pressure: [i32; 2],
    /// Σ (x² + y²)/2 fz about the map's centre, in 1/4096 N × half a taxel pitch squared: how far the pressure reaches.
    pub spread: i32,
}

/// Places in [`Status::worst_cycles`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Stage {
    /// One packet of a map taken in.
    Packet = 0,
    /// The last packet of a map: sums, CRC, decision, control.
    Decide = 1,
    /// The line written.
    Line = 2,
    /// The 1 kHz safety tick.
    Tick = 3,
}

/// Number of [`Stage`]s.
pub const STAGES: usize = 4;

/// The state of the microcontroller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Status {
    /// Milliseconds since start; wraps after 49 days.
    pub uptime_ms: u32,
    /// Sensor of the last accepted map.
    pub sensor: u8,
    /// Sequence number of the last accepted map.
    pub sequence: u32,
    /// What that map said.
    pub sums: MapSums,
    /// Whether F_T > μ F_N in that map: the Coulomb baseline.
    pub coulomb_slip: bool,
    /// Slip state over all fingertips: the worst.
    pub state: SlipState,
    /// Estimated time to slip, ms; none while the stick ratio does not fall.
    pub time_to_slip_ms: Option<u16>,
    /// What the gripper is told to do.
    pub mode: GripMode,
    /// Grip-force line, 1/4096 N.
    pub line: i32,
    /// Faults now, bit n for fault number n.
    pub faults: u32,
    /// Latched faults that wait for `Acknowledge`.
    pub latched: u32,
    /// Maps accepted since start; wraps.
    pub maps: u32,
    /// Maps refused since start (CRC, order, sequence); wraps.
    pub maps_refused: u32,
    /// Packets refused since start; wraps.
    pub packets_refused: u32,
    /// Worst stage times since start, core cycles; see [`Stage`].
    pub worst_cycles: [u32; STAGES],
}

/// A message in either direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Message {
    /// Handshake, either way.
    Hello(Hello),
    /// Host to microcontroller.
    Command(Command),
    /// Microcontroller to host.
    Report(Report),
}

/// Why a message that arrived whole could not be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MessageError {
    /// Its schema version is not ours.
    Schema {
        /// The version found; [`SCHEMA_VERSION`] was expected.
        found: u16,
    },
    /// Not a class of this schema.
    Class {
        /// The class byte found; 0 to 2 were expected.
        found: u8,
    },
    /// The body is not what its class demands.
    Body,
    /// Longer than [`MESSAGE_MAX`].
    TooLong,
}

impl fmt::Display for MessageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Schema { found } => write!(
                f,
                "message of schema {found}, expected schema {SCHEMA_VERSION}: flash the firmware of this host's version"
            ),
            Self::Class { found } => write!(f, "message class {found}, expected 0 to 2"),
            Self::Body => f.write_str("message body cannot be read"),
            Self::TooLong => write!(f, "message longer than {MESSAGE_MAX} bytes"),
        }
    }
}

impl core::error::Error for MessageError {}

const CLASS_HELLO: u8 = 0;
const CLASS_COMMAND: u8 = 1;
const CLASS_REPORT: u8 = 2;
const ENVELOPE: usize = 3;

impl Message {
    /// Reads the bytes of [`crate::Event::Message`].
    ///
    /// # Errors
    /// [`MessageError`] when another schema wrote it or its body is damaged at its source.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, MessageError> {
        let Some((&[v0, v1, class], body)) = bytes.split_first_chunk::<ENVELOPE>() else {
            return Err(MessageError::Body);
        };
        if class == CLASS_HELLO {
            return Hello::read(body).map(Self::Hello).ok_or(MessageError::Body);
        }
        let found = u16::from_le_bytes([v0, v1]);
        if found != SCHEMA_VERSION {
            return Err(MessageError::Schema { found });
        }
        match class {
            CLASS_COMMAND => exactly(body).map(Self::Command),
            CLASS_REPORT => exactly(body).map(Self::Report),
            found => Err(MessageError::Class { found }),
        }
    }

    /// Writes the message without its CRC and returns its length.
    fn write(&self, buffer: &mut [u8; MESSAGE_MAX - CRC_BYTES]) -> Result<usize, MessageError> {
        let (envelope, body) = buffer.split_at_mut(ENVELOPE);
        envelope[..2].copy_from_slice(&SCHEMA_VERSION.to_le_bytes());
        let (class, length) = match self {
            Self::Hello(hello) => (CLASS_HELLO, Ok(hello.write(body))),
            Self::Command(command) => (
                CLASS_COMMAND,
                postcard::to_slice(command, body).map(|used| used.len()),
            ),
            Self::Report(report) => (
                CLASS_REPORT,
                postcard::to_slice(report, body).map(|used| used.len()),
            ),
        };
        envelope[2] = class;
        length
            .map(|length| length + ENVELOPE)
            .map_err(|_| MessageError::TooLong)
    }
}

/// A postcard body with nothing behind it but the zeros that keep the CRC in one packet.
fn exactly<'a, T: Deserialize<'a>>(body: &'a [u8]) -> Result<T, MessageError> {
    match postcard::take_from_bytes(body) {
        Ok((value, rest)) if rest.len() < CRC_BYTES && rest.iter().all(|&byte| byte == 0) => Ok(value),
        _ => Err(MessageError::Body),
    }
}

/// A message cut into packets of at most 64 bytes.
#[derive(Debug, Clone)]
pub struct MessagePackets {
    buffer: [u8; MESSAGE_MAX],
    length: usize,
    id: u8,
    fragments: u8,
    next: u8,
}

impl MessagePackets {
    const PAYLOAD: usize = PACKET_MAX - PACKET_HEADER;

    /// Encodes a message; `id` must differ from the one before on the same link.
    ///
    /// # Errors
    /// [`MessageError::TooLong`] when it does not fit [`MESSAGE_MAX`] (no message of this module is that long).
    pub fn new(message: &Message, id: u8) -> Result<Self, MessageError> {
        let mut body = [0; MESSAGE_MAX - CRC_BYTES];
        let mut length = message.write(&mut body)?;
        // The CRC lies whole in the last packet: when it would be torn, up to three zeros fill the packet before.
        let room = Self::PAYLOAD - length % Self::PAYLOAD;
        if room < CRC_BYTES {
            length += room;
        }
        let fragments = (length + CRC_BYTES).div_ceil(Self::PAYLOAD);
        if fragments > MESSAGE_FRAGMENTS_MAX {
            return Err(MessageError::TooLong);
        }
        let mut buffer = [0; MESSAGE_MAX];
        let written = length.min(body.len());
        buffer[..written].copy_from_slice(&body[..written]);
        length += CRC_BYTES;
        let mut packets = Self {
            buffer,
            length,
            id,
            fragments: fragments as u8,
            next: 0,
        };
        let mut crc = RunningCrc::new();
        for index in 0..packets.fragments {
            crc.update(&packets.header(index));
            let (start, end) = packets.span(index);
            crc.update(&packets.buffer[start..end.min(length - CRC_BYTES)]);
        }
        packets.buffer[length - CRC_BYTES..length].copy_from_slice(&crc.finish().to_le_bytes());
        Ok(packets)
    }

    const fn header(&self, index: u8) -> [u8; PACKET_HEADER] {
        Header {
            kind: Kind::Message,
            owner: self.id,
            sequence: self.fragments,
            index,
        }
        .to_bytes()
    }

    fn span(&self, index: u8) -> (usize, usize) {
        let start = usize::from(index) * Self::PAYLOAD;
        (start, (start + Self::PAYLOAD).min(self.length))
    }

    /// The next packet and its length, or `None` after the last.
    pub fn next_packet(&mut self, packet: &mut [u8; PACKET_MAX]) -> Option<usize> {
        if self.next >= self.fragments {
            return None;
        }
        let (start, end) = self.span(self.next);
        packet[..PACKET_HEADER].copy_from_slice(&self.header(self.next));
        packet[PACKET_HEADER..PACKET_HEADER + end - start].copy_from_slice(&self.buffer[start..end]);
        self.next += 1;
        Some(PACKET_HEADER + end - start)
    }
}

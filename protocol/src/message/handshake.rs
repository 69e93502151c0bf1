//! The handshake: who speaks, and which schema. Its layout is frozen, so that two builds with different schemas can still
//! name each other's.

use core::fmt;

use super::command::Command;
use super::report::Report;

/// Version of all messages but [`Hello`]. Raise it with every change of a message's layout.
pub const SCHEMA_VERSION: u16 = 4;
/// Hash over the layouts of all messages: notices a forgotten version number.
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

/// Who is speaking. Frozen layout of 16 bytes after the class byte. Byte 14 flags trailing fields, which older readers
/// ignore.
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
    /// The commit that the speaker was built from; only firmware images know it.
    pub revision: Option<Revision>,
}

const HELLO_BYTES: usize = 16;
/// With the commit after it.
const HELLO_BYTES_MAX: usize = HELLO_BYTES + 4;
/// Flags in byte 14: a commit follows; it was changed since.
const HAS_COMMIT: u8 = 1;
const IS_DIRTY: u8 = 1 << 1;

/// What the identity block of a firmware image starts with.
pub const IMAGE_MARK: [u8; 8] = *b"GRIPLINE";
/// Length of that block, bytes.
pub const IMAGE_IDENTITY_BYTES: usize = IMAGE_MARK.len() + HELLO_BYTES_MAX;
/// Where it lies, seen from the start of the flash: behind the interrupt vectors.
pub const IMAGE_IDENTITY_AT: usize = 0x200;

/// Names of the boards, by the number that [`Hello::board`] gives.
pub const BOARDS: [&str; 3] = ["host", "stm32f405rg", "stm32f427vi"];

impl Hello {
    /// What this build says of itself; the program that knows its commit adds it.
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

    /// The identity block of a firmware image that is built from this: [`IMAGE_MARK`], then the layout of the handshake with a
    /// commit. The linker puts the image's length in bytes (`u32`) behind it.
    #[must_use]
    pub const fn to_image(self) -> [u8; IMAGE_IDENTITY_BYTES] {
        let (mut block, body, mut at) = ([0; IMAGE_IDENTITY_BYTES], self.layout(), 0);
        while at < IMAGE_IDENTITY_BYTES {
            block[at] = if at < IMAGE_MARK.len() {
                IMAGE_MARK[at]
            } else {
                body[at - IMAGE_MARK.len()]
            };
            at += 1;
        }
        block
    }

    /// Reads an identity block; `None` when it is none.
    #[must_use]
    pub fn from_image(block: &[u8]) -> Option<Self> {
        Self::read(block.strip_prefix(&IMAGE_MARK)?)
    }

    const fn layout(self) -> [u8; HELLO_BYTES_MAX] {
        let [v0, v1] = self.schema_version.to_le_bytes();
        let [h0, h1, h2, h3] = self.schema_hash.to_le_bytes();
        let [major, minor, patch] = self.build;
        let [s0, s1, s2, s3] = self.session.to_le_bytes();
        let (flags, commit) = match self.revision {
            None => (0, 0),
            Some(Revision { commit, dirty }) => (HAS_COMMIT | if dirty { IS_DIRTY } else { 0 }, commit),
        };
        let [c0, c1, c2, c3] = commit.to_le_bytes();
        [
            v0, v1, h0, h1, h2, h3, major, minor, patch, self.board, s0, s1, s2, s3, flags, 0, c0, c1, c2, c3,
        ]
    }

    /// Writes it into at least 20 bytes and returns its length.
    pub(super) fn write(self, bytes: &mut [u8]) -> usize {
        bytes[..HELLO_BYTES_MAX].copy_from_slice(&self.layout());
        if self.revision.is_some() {
            HELLO_BYTES_MAX
        } else {
            HELLO_BYTES
        }
    }

    /// Reads it; `None` when it is too short.
    pub(super) fn read(body: &[u8]) -> Option<Self> {
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

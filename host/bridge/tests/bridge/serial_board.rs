//! The firmware library at the far end of a serial line, in real time: what a board on a serial port is to a run.

use std::io::{Read as _, Write as _};
use std::os::fd::AsFd as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use gripline_firmware::{Device, Start};
use gripline_protocol::cobs::{CobsDecoder, FRAME_MAX, Frame, encode_packet};
use nix::fcntl::OFlag;
use nix::poll::{PollFd, PollFlags, poll};
use nix::pty::{PtyMaster, grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};
use tempfile::TempDir;

/// A serial line: its far end, and the name of the port at its near end. Dropping it pulls the plug: the name is gone first, so that
/// no program finds another test's line under it, and no program that another test starts inherits the far end.
pub(crate) struct Line {
    far: PtyMaster,
    name: PathBuf,
    /// Kept as long as the line.
    folder: Option<TempDir>,
}

impl Line {
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let mut line = Self::plug(&folder.path().join("port"));
        line.folder = Some(folder);
        line
    }

    /// A new line under this name.
    pub(crate) fn plug(name: &Path) -> Self {
        // What nobody reads is lost, and holds nobody up.
        let flags = OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_CLOEXEC | OFlag::O_NONBLOCK;
        let far = posix_openpt(flags).expect("a pseudo terminal");
        grantpt(&far).expect("it is ours");
        unlockpt(&far).expect("it is ours");
        let mut settings = tcgetattr(&far).expect("it is a terminal");
        cfmakeraw(&mut settings);
        tcsetattr(&far, SetArg::TCSANOW, &settings).expect("it can be raw");
        let near = ptsname_r(&far).expect("it has a name");
        std::os::unix::fs::symlink(near, name).expect("the name is free");
        Self {
            far,
            name: name.to_owned(),
            folder: None,
        }
    }

    pub(crate) fn name(&self) -> String {
        self.name.display().to_string()
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.name);
    }
}

/// The firmware library at the far end of a serial line, with a clock that runs on.
pub(crate) struct SerialBoard {
    pub(crate) device: Device,
    start: Instant,
    next_tick_us: u64,
    /// So many of a thousand packets are lost, either way.
    lost_per_mille: u64,
    seed: u64,
}

impl SerialBoard {
    pub(crate) fn new(lost_per_mille: u64) -> Self {
        Self {
            lost_per_mille,
            seed: 1,
            device: Device::new(Start::default()),
            start: Instant::now(),
            next_tick_us: 0,
        }
    }

    fn now_us(&self) -> u64 {
        self.start.elapsed().as_micros() as u64
    }

    pub(crate) fn serve(&mut self, line: &mut Line, is_over: impl Fn(&Self) -> bool) {
        let (mut frames, mut bytes) = (CobsDecoder::new(), [0; 4096]);
        while !is_over(self) {
            let mut events = [PollFd::new(line.far.as_fd(), PollFlags::POLLIN)];
            let ready = poll(&mut events, 1_u8).unwrap_or(0);
            let length = if ready == 0 {
                0
            } else {
                // Reading fails while nobody has the other end open.
                line.far.read(&mut bytes).unwrap_or_else(|_| {
                    std::thread::sleep(Duration::from_millis(1));
                    0
                })
            };
            for &byte in &bytes[..length] {
                if let Some(Frame::Packet(packet)) = frames.push(byte) {
                    let now_us = self.now_us();
                    if !is_lost(&mut self.seed, self.lost_per_mille) {
                        let _ = self.device.packet(packet, now_us);
                    }
                }
            }
            self.live();
            let mut frame = [0; FRAME_MAX];
            while let Some(packet) = self.device.next_packet() {
                if is_lost(&mut self.seed, self.lost_per_mille) {
                    continue;
                }
                let length = encode_packet(&packet, &mut frame);
                let _ = line.far.write_all(&frame[..length]);
            }
        }
    }

    pub(crate) fn live(&mut self) {
        while self.next_tick_us < self.now_us() {
            let _ = self.device.tick(self.next_tick_us);
            self.next_tick_us += 1_000;
        }
    }
}

/// Whether the next packet is lost: always the same ones (a linear congruential generator).
fn is_lost(seed: &mut u64, per_mille: u64) -> bool {
    *seed = seed
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 33) % 1_000 < per_mille
}

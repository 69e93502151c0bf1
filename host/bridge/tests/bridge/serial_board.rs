//! The board of all host tests at the far end of a serial line, in real time: what a board on a serial port is to a run.

use std::io::{Read as _, Write as _};
use std::os::fd::AsFd as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use gripline_firmware::Start;
use gripline_protocol::cobs::{CobsDecoder, FRAME_MAX, Frame, encode_packet};
use gripline_test_board::TestBoard;
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

/// The board at the far end of a serial line, with a clock that runs on.
pub(crate) struct SerialBoard {
    pub(crate) board: TestBoard,
    start: Instant,
    /// So many of a thousand packets are lost, either way.
    lost_per_mille: u64,
    seed: u64,
}

impl SerialBoard {
    pub(crate) fn new(lost_per_mille: u64) -> Self {
        Self {
            lost_per_mille,
            seed: 1,
            board: TestBoard::new(Start::default()),
            start: Instant::now(),
        }
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
                if let Some(Frame::Packet(packet)) = frames.push(byte)
                    && !is_lost(&mut self.seed, self.lost_per_mille)
                {
                    let now_us = self.start.elapsed().as_micros() as u64;
                    self.board.pass_to(now_us, |_, _| {});
                    let _ = self.board.packet(packet);
                }
            }
            self.live();
            let mut frame = [0; FRAME_MAX];
            while let Some(packet) = self.board.replies.pop_front() {
                if is_lost(&mut self.seed, self.lost_per_mille) {
                    continue;
                }
                let length = encode_packet(&packet, &mut frame);
                let _ = line.far.write_all(&frame[..length]);
            }
        }
    }

    pub(crate) fn live(&mut self) {
        let now_us = self.start.elapsed().as_micros() as u64;
        self.board.pass_to(now_us, |_, _| {});
    }
}

/// Whether the next packet is lost: always the same ones (a linear congruential generator).
fn is_lost(seed: &mut u64, per_mille: u64) -> bool {
    *seed = seed
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 33) % 1_000 < per_mille
}

//! The firmware library at the far end of a serial line, in real time: what a board on a serial port is to a run.

use std::io::{Read as _, Write as _};
use std::os::fd::AsFd as _;
use std::time::{Duration, Instant};

use gripline_firmware::{Device, Start};
use gripline_protocol::cobs::{CobsDecoder, FRAME_MAX, Frame, encode_packet};
use nix::fcntl::OFlag;
use nix::poll::{PollFd, PollFlags, poll};
use nix::pty::{PtyMaster, grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};

/// A line whose near end is a serial port of this name. Programs that other tests start meanwhile do not inherit the far end, so
/// that dropping it is a pulled plug.
pub(crate) fn pseudo_terminal() -> (PtyMaster, String) {
    // What nobody reads is lost, and holds nobody up.
    let flags = OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_CLOEXEC | OFlag::O_NONBLOCK;
    let far = posix_openpt(flags).expect("a pseudo terminal");
    grantpt(&far).expect("it is ours");
    unlockpt(&far).expect("it is ours");
    let mut settings = tcgetattr(&far).expect("it is a terminal");
    cfmakeraw(&mut settings);
    tcsetattr(&far, SetArg::TCSANOW, &settings).expect("it can be raw");
    let name = ptsname_r(&far).expect("it has a name");
    (far, name)
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

    pub(crate) fn serve(&mut self, far: &mut PtyMaster, is_over: impl Fn(&Self) -> bool) {
        let (mut frames, mut bytes) = (CobsDecoder::new(), [0; 4096]);
        while !is_over(self) {
            let mut events = [PollFd::new(far.as_fd(), PollFlags::POLLIN)];
            let ready = poll(&mut events, 1_u8).unwrap_or(0);
            let length = if ready == 0 {
                0
            } else {
                // Reading fails while nobody has the other end open.
                far.read(&mut bytes).unwrap_or_else(|_| {
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
                let _ = far.write_all(&frame[..length]);
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

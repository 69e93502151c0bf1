//! The program and the line it drives: what the interrupts of USB and UART and the task `control` share.
//!
//! The interrupts of the USB core (`usb_interrupt`) and the host's UART (`uart`) take it by [`from_isr`] for packets of maps. The task
//! (`control_task`) takes it by [`from_task`], which blocks these interrupts, for less than a tick's work at a time.
//! Units: microseconds, cycles of 168 MHz.

use core::cell::UnsafeCell;

use cortex_m::peripheral::DWT;
use embassy_time::Instant;
use gripline_firmware::line::GripLine;
use gripline_firmware::program::{Learnt, Lesson, MessageEvent};
use gripline_firmware::{Action, FaultSet, GripForce, LinkId, Program};
use gripline_protocol::message::{Configuration, Message, Stage};
use gripline_protocol::packet::Kind;

use crate::dsp::Dsp;
use crate::gripper_bus::BusLine;
use crate::line::{self, AnalogLine};
use crate::outbox::{self, Outbox};
use crate::priority::{self, block_path};
use crate::watchdog;

/// The bus counts as free for messages to the host when no packet came for so long, microseconds: at full speed a packet of
/// a map comes every 51 µs and needs every turn of the bus.
const QUIET_US: u64 = 200;

/// The longest that messages wait for a free bus, microseconds. Of those that come up meanwhile only the newest is sent.
const MESSAGE_WAIT_MAX_US: u64 = 25_000;

/// Starts the counter that the stage times are read from.
pub(crate) fn start_cycle_counter() {
    // SAFETY: start-up, before any task; nothing else in this program uses the core's trace peripherals.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
}

/// The program, once it runs.
struct Shared(UnsafeCell<Option<Control>>);

// SAFETY: reached by two interrupts of one level and, with these blocked, by the task `control`: never by two at once.
unsafe impl Sync for Shared {}

static CONTROL: Shared = Shared(UnsafeCell::new(None));

/// Starts the program: from now on the interrupts and the task `control` find it.
pub(crate) fn start(program: &'static mut Program<Dsp>, line: AnalogLine) {
    let control = Control {
        program,
        line,
        reply_to: None,
        packet_us: 0,
        message_us: 0,
        requested: 0,
    };
    // SAFETY: all other users are blocked.
    block_path(|| unsafe { *CONTROL.0.get() = Some(control) });
}

/// The program for the interrupts of the USB core and the UART; none before it runs.
///
/// # Safety
/// Called by these two, which do not interrupt each other and must not keep it.
#[inline]
pub(crate) unsafe fn from_isr() -> Option<&'static mut Control> {
    // SAFETY: these interrupts are the highest of the users of `CONTROL`, on one level.
    unsafe { &mut *CONTROL.0.get() }.as_mut()
}

/// Works on the program from the task `control`, with the path's interrupts blocked, and all interrupts below it. The time that
/// `work` takes is part of the path's worst-case bound; this function lies in SRAM with it, unlike the task.
#[inline(never)]
pub(crate) fn from_task<T>(work: impl FnOnce(&mut Control) -> T) -> Option<T> {
    // SAFETY: the interrupts are blocked, no other task calls this, and `work` does not.
    block_path(|| unsafe { &mut *CONTROL.0.get() }.as_mut().map(work))
}

/// One packet of a map over USB that came to the task `control` by the HAL's driver, because it lay behind one of the control endpoint.
pub(crate) fn map_packet_from_task(packet: &[u8]) {
    from_task(|control| control.map_packet(packet));
}

/// What the board watches beside maps and messages.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) struct BoardWatch {
    /// The board's faults that are present.
    pub(crate) faults: FaultSet,
    /// The robot's input says so.
    pub(crate) is_release_inhibited: bool,
}

/// The program, the line it drives, and the host it answers.
pub(crate) struct Control {
    program: &'static mut Program<Dsp>,
    line: AnalogLine,
    /// The link that spoke last; none until a host spoke.
    reply_to: Option<LinkId>,
    /// When the last packet came, and when messages were last sent, microseconds.
    packet_us: u64,
    message_us: u64,
    /// Since when the packet under way may have waited, cycles.
    requested: u32,
}

impl Control {
    /// One packet of a map that came to the task.
    #[inline(never)]
    fn map_packet(&mut self, packet: &[u8]) {
        let started = cycles();
        self.requested = started;
        match Kind::of(packet) {
            Some(Kind::MapTail) => self.map_tail(packet, LinkId::Usb, started, || {}),
            Some(Kind::MapTaxels) => self.map_taxels(packet, LinkId::Usb, started),
            Some(Kind::MapHead) => self.map_head(packet, LinkId::Usb, started),
            Some(Kind::Message) | None => self.unknown_packet(packet, LinkId::Usb, started),
        }
    }

    /// An interrupt of the path has begun, and may have been pending since then, cycles.
    #[inline]
    pub(crate) fn note_request(&mut self, requested: u32) {
        self.requested = requested;
    }

    /// The last packet of a map; `entered` is the cycle count when its interrupt began. Half-way through it does `meanwhile`. Each kind of
    /// packet has a function, so that the interrupt looks at the kind once.
    #[inline]
    pub(crate) fn map_tail(&mut self, packet: &[u8], link: LinkId, entered: u32, meanwhile: impl FnOnce()) {
        self.heard(link);
        let is_new = self.program.end_map(packet, link, self.packet_us);
        meanwhile();
        let action = self.program.decide(is_new);
        if action.decided {
            self.act(action, entered);
        } else {
            self.note_packet(entered);
        }
    }

    /// A packet in the middle of a map.
    #[inline]
    pub(crate) fn map_taxels(&mut self, packet: &[u8], link: LinkId, entered: u32) {
        self.heard(link);
        let _ = self.program.map_taxels(packet, link, self.packet_us);
        self.note_packet(entered);
    }

    /// The first packet of a map.
    #[inline]
    pub(crate) fn map_head(&mut self, packet: &[u8], link: LinkId, entered: u32) {
        self.heard(link);
        let _ = self.program.map_head(packet, link, self.packet_us);
        priority::let_uart(self.program.counts_maps_of(LinkId::Uart));
        self.note_packet(entered);
    }

    /// As [`Self::map_head`], for a link that brings byte by byte.
    #[inline]
    pub(crate) fn map_begins(&mut self, packet: &[u8], link: LinkId, entered: u32) {
        self.heard(link);
        let _ = self.program.map_begins(packet, link, self.packet_us);
        priority::let_uart(self.program.counts_maps_of(LinkId::Uart));
        self.note_packet(entered);
    }

    /// What [`Self::map_begins`] has left: with each of the next bytes.
    #[inline]
    pub(crate) fn list_places(&mut self, link: LinkId) {
        self.program.list_places(link);
    }

    /// A packet of no kind that we know.
    #[inline(never)]
    pub(crate) fn unknown_packet(&mut self, packet: &[u8], link: LinkId, entered: u32) {
        self.heard(link);
        let _ = self.program.unknown_packet(packet, link, self.packet_us);
        self.note_packet(entered);
    }

    /// A packet came over a link.
    #[inline]
    fn heard(&mut self, link: LinkId) {
        self.reply_to = Some(link);
        self.packet_us = now_us();
    }

    /// Takes what a packet of a message came to.
    #[inline(never)]
    pub(crate) fn message_packet(&mut self, event: &MessageEvent, link: LinkId) {
        self.heard(link);
        self.program.message(event, link, self.packet_us);
    }

    /// The next message for the host.
    #[inline(never)]
    pub(crate) fn message(&mut self, message: &mut Option<Message>) {
        *message = self.program.poll_message();
    }

    /// What a new map has to teach.
    #[inline(never)]
    pub(crate) fn lesson(&mut self, lesson: &mut Option<Lesson>) {
        self.program.lesson(lesson);
    }

    /// Takes what a lesson came to.
    #[inline(never)]
    pub(crate) fn learn(&mut self, learnt: &Learnt) {
        self.program.learn(learnt);
    }

    /// The first part of the safety tick.
    #[inline(never)]
    pub(crate) fn age(&mut self, now_us: u64) {
        self.program.age(now_us);
    }

    /// The second part.
    #[inline(never)]
    pub(crate) fn teach_grip(&mut self) {
        self.program.teach_grip();
    }

    /// The third part.
    #[inline(never)]
    pub(crate) fn watch_object(&mut self) {
        self.program.note_line(BusLine.health());
        if self.program.take_release() {
            BusLine.release();
        }
        self.program.watch_object();
    }

    /// The fourth part: the line moves on. It is written in the last part, so that a packet waits for one of the two only.
    #[inline(never)]
    pub(crate) fn advance(&mut self, now_us: u64) {
        let _ = self.program.advance(now_us);
    }

    /// The last part: writes the program's newest line, which may be that of a map that came since [`Self::advance`]. Tells the
    /// active faults, and whether the robot must know of one; `started` is when the tick moved the line, cycles. Returns where messages
    /// go, when there are some and the bus is free for them.
    #[inline(never)]
    pub(crate) fn tick(
        &mut self,
        now_us: u64,
        started: u32,
        faults: &mut FaultSet,
        is_at_fault: &mut bool,
    ) -> Option<&'static Outbox> {
        *faults = self.program.faults();
        *is_at_fault = self.program.is_at_fault();
        let decided = cycles();
        self.write_line(self.program.line());
        self.note_line(decided);
        self.program
            .note_cycles(Stage::Tick, decided.wrapping_sub(started));
        watchdog::count_tick();
        let is_quiet = now_us.saturating_sub(self.packet_us) >= QUIET_US;
        let is_late = now_us.saturating_sub(self.message_us) >= MESSAGE_WAIT_MAX_US;
        if !self.program.has_messages() || !(is_quiet || is_late) {
            return None;
        }
        self.message_us = now_us;
        self.reply_to.map(outbox::of)
    }

    /// Takes what the board found about itself.
    #[inline(never)]
    pub(crate) fn note_board(&mut self, watch: BoardWatch) {
        self.program.note_board(watch.faults);
        self.program.inhibit_release(watch.is_release_inhibited);
    }

    /// The settings that have to be written to flash, if any.
    #[inline(never)]
    pub(crate) fn settings_to_store(&mut self, settings: &mut Option<Configuration>) {
        *settings = self.program.take_store();
    }

    /// Whether the chip restarts in its bootloader now.
    #[inline(never)]
    pub(crate) fn take_bootloader(&mut self) -> bool {
        self.program.take_bootloader()
    }

    /// The settings were written to flash so many times, or could not be.
    pub(crate) fn stored(&mut self, writes: Option<u32>) {
        self.program.stored(writes);
    }

    /// The UART brought a frame that could not be decoded.
    pub(crate) fn malformed_frame(&mut self) {
        self.program.refuse_packet(LinkId::Uart);
    }

    /// Notes the cycles that a packet took which ends no map, and so moves no line.
    #[inline]
    fn note_packet(&mut self, entered: u32) {
        self.program
            .note_cycles(Stage::Packet, cycles().wrapping_sub(entered));
    }

    /// Writes the line, then notes the cycles that the decision and the write took. The deadline counts until the DAC has the
    /// value.
    #[inline]
    fn act(&mut self, action: Action, started: u32) {
        let decided = cycles();
        self.write_line(action.line);
        let written = self.note_line(decided);
        self.note_decision(started, decided, written);
    }

    /// Puts a force on the line. The path's bound and its measurement end with the return of this function.
    #[inline(never)]
    fn write_line(&mut self, force: GripForce) {
        let (Ok(()), Ok(())) = (self.line.write(force), BusLine.write(force));
    }

    /// Notes the cycles that the write took since `decided`. Returns the count now.
    #[inline(never)]
    fn note_line(&mut self, decided: u32) -> u32 {
        // Answered when the DAC has the value: its bus does one thing after the other.
        line::wait_until_shown();
        let written = cycles();
        self.program
            .note_cycles(Stage::Line, written.wrapping_sub(decided));
        written
    }

    #[inline(never)]
    fn note_decision(&mut self, started: u32, decided: u32, written: u32) {
        self.program
            .note_map_to_line(written.wrapping_sub(self.requested));
        self.program
            .note_cycles(Stage::Decide, decided.wrapping_sub(started));
    }
}

/// The core's cycle counter.
#[inline]
pub(crate) fn cycles() -> u32 {
    DWT::cycle_count()
}

/// Time now, microseconds.
pub(crate) fn now_us() -> u64 {
    Instant::now().as_micros()
}

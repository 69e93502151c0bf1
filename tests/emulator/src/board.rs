//! The emulated board: boot an image, put bytes on its UART and packets on its USB, let virtual time pass, read its DAC line.
//! Times are virtual nanoseconds since power-on and advance by the caller's steps alone. What the firmware does depends
//! on the image and on which bytes were put on the line when: never on the machine, the wall clock, or how the time
//! between was cut into steps. rigless runs a firmware in one call, so that call sits on a thread of its own and meets
//! the caller at each stop.

use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use rigless::device::ResetCause;
use rigless::emulator::{self, Access, AccessKind, Driver, Host, Settled, Start, Stop};
use rigless::image::Image;
use rigless::mcu::Operate as _;
use rigless::session::Session;
use rigless::soc::Width;
use rigless::symbols::Symbols;
use rigless::time::VirtualNanos;

use crate::constants::{
    BUS_DRIVER_PIN, DAC_BASE, DAC_BYTES, FLASH_BASE, FLASH_CR, GPIOA_BSRR, GPIOA_ODR, LOG_PERIOD_NS,
    PREDICATE_STEP_NS, RAM, SETTINGS_BASE, SYSTEM_MEMORY_BASE,
};
use crate::dac::{CHANNELS, DacWrite};
use crate::flash::FlashArray;
use crate::hardware::Hardware;
use gripline_emulator_wire::{Disturbance, FaultInjection, USB_PACKET_MAX};

use crate::fault_injection::{Injector, PANIC};
use crate::rtt;
use crate::trace::{self, Event};
use crate::uart::UartByte;
use crate::usb::{self, Cable, ControlTransfer, Setup, UsbCounters, UsbPacket, UsbState};

/// Why a board could not be booted or run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EmulatorError {
    /// The image does not start as an ELF file does.
    #[error(
        "image: expected an ELF file (first bytes 7f 45 4c 46), found {found}; build it with `cargo xtask firmware`"
    )]
    NotElf {
        /// The first bytes, or what else is there.
        found: String,
    },
    /// Nothing of the image lies where the core looks for its vector table.
    #[error(
        "image: expected a segment at {FLASH_BASE:#010x} (start of FLASH, the vector table), found {found}; \
         link it with the memory.x of the firmware"
    )]
    NoFlash {
        /// The segments that are there.
        found: String,
    },
    /// The image is an ELF file that cannot be placed in this part.
    #[error("image: {0}")]
    Image(#[from] rigless::image::Error),
    /// The emulator refused to run, or failed on its way.
    #[error("emulator: {0}")]
    Emulator(#[from] emulator::Error),
    /// The emulator's thread could not be started.
    #[error("emulator thread: {0}")]
    Thread(#[from] std::io::Error),
    /// The emulator's thread ended without saying why; its panic stands on standard error.
    #[error("emulator: its thread ended unexpectedly")]
    Ended,
}

/// A restart of the part after power-on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reset {
    /// Virtual time since power-on, nanoseconds.
    pub at_ns: u64,
    /// What asked for it: `IWDG`, `software` or `pin`.
    pub cause: &'static str,
}

/// An emulated STM32F427 board running an image, standing still between calls.
#[derive(Debug)]
pub struct Board {
    commands: Option<SyncSender<Command>>,
    reports: Receiver<Result<Report, EmulatorError>>,
    thread: Option<JoinHandle<()>>,
    /// The instant asked for last. A stop comes up to one instruction later, and steps must not add that up.
    until_ns: u64,
    outbox: Vec<u8>,
    bus_outbox: Vec<u8>,
    usb_commands: Vec<usb::Command>,
    fault: Option<(FaultInjection, u32)>,
    disturbances: Vec<Disturbance>,
    fault_output: bool,
    settings: Option<Vec<u8>>,
    now_ns: u64,
    instructions: u64,
    resets: Vec<Reset>,
    dac_codes: [Option<u16>; CHANNELS],
    dac_writes: Vec<DacWrite>,
    uart_bytes: Vec<UartByte>,
    uart_taken: usize,
    bus_bytes: Vec<UartByte>,
    bus_driver: Vec<(u64, bool)>,
    usb: UsbNow,
    usb_packets: Vec<UsbPacket>,
    usb_transfers: Vec<ControlTransfer>,
    usb_deliveries_ns: Vec<u64>,
    log: Vec<u8>,
    gaps: Vec<String>,
    trace: Vec<Event>,
    memory: Vec<u8>,
}

impl Board {
    /// A board out of power-on with `elf`, the bytes of an ELF file, in its flash; no instruction has run.
    ///
    /// # Errors
    /// An image that is no ELF file, has nothing at the start of FLASH, is built for another machine or does not
    /// fit the part's memory.
    pub fn boot(elf: &[u8]) -> Result<Self, EmulatorError> {
        Self::boot_as(elf, Vec::new(), &[])
    }

    /// The same with these bytes where the firmware keeps its settings, as [`Self::take_settings`] gave them before the
    /// power went.
    ///
    /// # Errors
    /// As [`Self::boot`].
    pub fn boot_with_settings(elf: &[u8], settings: &[u8]) -> Result<Self, EmulatorError> {
        let settings = (!settings.is_empty()).then_some((SETTINGS_BASE, settings));
        Self::boot_as(elf, settings.into_iter().collect(), &[])
    }

    /// The same as [`Self::boot_traced`] with this program in the system memory, in place of the chip's own bootloader.
    ///
    /// # Errors
    /// As [`Self::boot`].
    pub fn boot_with_bootloader(
        elf: &[u8],
        bootloader: &[u8],
        addresses: &[u32],
    ) -> Result<Self, EmulatorError> {
        Self::boot_as(elf, vec![(SYSTEM_MEMORY_BASE, bootloader)], addresses)
    }

    /// The same for a board that records every arrival at an instruction at one of `addresses`, and in between what
    /// [`Event`] lists. It changes nothing in the run but its speed.
    ///
    /// # Errors
    /// As [`Board::boot`].
    pub fn boot_traced(elf: &[u8], addresses: &[u32]) -> Result<Self, EmulatorError> {
        Self::boot_as(elf, Vec::new(), addresses)
    }

    /// `beside`: addresses and bytes of what lies in the memory beside the image.
    fn boot_as(elf: &[u8], beside: Vec<(u64, &[u8])>, traced: &[u32]) -> Result<Self, EmulatorError> {
        let traced = traced.to_vec();
        let mut images = vec![image_of(elf)?];
        for (base, bytes) in beside {
            images.push(Image::new(
                Path::new("beside the image"),
                bytes.to_vec(),
                Some(base),
            )?);
        }
        let symbols = Symbols::read(elf, rigless::cpu::armv7m::code_address).ok();
        let symbol = |name| symbols.as_ref().and_then(|symbols| symbols.get(name).ok());
        let log_block = symbol(rtt::SYMBOL);
        let panics_at = symbol(PANIC).map(|address| address as u32);
        // One message each way at a time: the two sides take turns.
        let (commands, inbox) = sync_channel(1);
        let (outbox, reports) = sync_channel(1);
        let thread = std::thread::Builder::new()
            .name("emulated board".into())
            .spawn(move || {
                if let Err(error) = run(&images, log_block, panics_at, traced, inbox, outbox.clone()) {
                    // The caller may be gone; then nobody is left to tell.
                    let _ = outbox.send(Err(error));
                }
            })?;
        let mut board = Self {
            commands: Some(commands),
            reports,
            thread: Some(thread),
            until_ns: 0,
            outbox: Vec::new(),
            bus_outbox: Vec::new(),
            usb_commands: Vec::new(),
            fault: None,
            disturbances: Vec::new(),
            fault_output: false,
            settings: None,
            now_ns: 0,
            instructions: 0,
            resets: Vec::new(),
            dac_codes: [None; CHANNELS],
            dac_writes: Vec::new(),
            uart_bytes: Vec::new(),
            uart_taken: 0,
            bus_bytes: Vec::new(),
            bus_driver: Vec::new(),
            usb: UsbNow::default(),
            usb_packets: Vec::new(),
            usb_transfers: Vec::new(),
            usb_deliveries_ns: Vec::new(),
            log: Vec::new(),
            gaps: Vec::new(),
            trace: Vec::new(),
            memory: Vec::new(),
        };
        board.take_report()?;
        Ok(board)
    }

    /// Puts `bytes` on the firmware's UART line. They go from the start of the next run, back to back at the baud
    /// rate that the firmware set, after those that still wait; with the receiver off they wait for it.
    pub fn uart_send(&mut self, bytes: &[u8]) {
        self.outbox.extend_from_slice(bytes);
    }

    /// Puts `bytes` on the gripper's bus, as [`Self::uart_send`] does on the line.
    pub fn bus_send(&mut self, bytes: &[u8]) {
        self.bus_outbox.extend_from_slice(bytes);
    }

    /// Every byte the firmware put on the gripper's bus since power-on, oldest first.
    #[must_use]
    pub fn bus_bytes(&self) -> &[UartByte] {
        &self.bus_bytes
    }

    /// When the firmware wrote the pin that enables the bus's driver, and to what: (virtual nanoseconds, on).
    #[must_use]
    pub fn bus_driver(&self) -> &[(u64, bool)] {
        &self.bus_driver
    }

    /// The bytes the firmware sent that no call has taken yet.
    pub fn uart_take(&mut self) -> Vec<u8> {
        let bytes = self.uart_bytes[self.uart_taken..]
            .iter()
            .map(|sent| sent.byte)
            .collect();
        self.uart_taken = self.uart_bytes.len();
        bytes
    }

    /// Every byte the firmware has sent since power-on, with its time.
    #[must_use]
    pub fn uart_bytes(&self) -> &[UartByte] {
        &self.uart_bytes
    }

    /// Plugs the USB cable in, pulls it out, or lets the host behind it sleep, at the start of the next run. A board
    /// comes up with the cable out.
    pub fn usb_cable(&mut self, cable: Cable) {
        self.usb_commands.push(usb::Command::Cable(cable));
    }

    /// Hands the USB host a bulk packet for the firmware. It goes behind those that wait, from the start of the next
    /// run and once the device is configured; a cable that is pulled out takes the waiting ones with it.
    ///
    /// # Panics
    /// For a packet longer than full speed allows, 64 bytes.
    pub fn usb_send(&mut self, packet: &[u8]) {
        assert!(
            packet.len() <= USB_PACKET_MAX,
            "{} bytes in a packet",
            packet.len()
        );
        self.usb_commands.push(usb::Command::Send(packet.to_vec()));
    }

    /// Has the USB host make a control transfer, with `data` for the firmware if it is one that writes. Bulk packets
    /// go on in between. What comes of it is in [`Board::usb_transfers`].
    pub fn usb_control(&mut self, setup: Setup, data: &[u8]) {
        self.usb_commands
            .push(usb::Command::Control(setup, data.to_vec(), None));
    }

    /// The same for a transfer that the host breaks off after `packets` acknowledged packets, the SETUP counted.
    pub fn usb_control_abandoned(&mut self, setup: Setup, packets: u32) {
        self.usb_commands
            .push(usb::Command::Control(setup, Vec::new(), Some(packets)));
    }

    /// Whether the USB host reads what the firmware has to say on bulk; it does until it is told otherwise.
    pub fn usb_listen(&mut self, listens: bool) {
        self.usb_commands.push(usb::Command::Listen(listens));
    }

    /// How far the USB host has come with the firmware.
    #[must_use]
    pub fn usb_state(&self) -> UsbState {
        self.usb.state
    }

    /// How often the USB host has made the firmware's device ready.
    #[must_use]
    pub fn usb_enumerations(&self) -> u64 {
        self.usb.enumerations
    }

    /// Bulk packets that the firmware has not taken yet.
    #[must_use]
    pub fn usb_waiting(&self) -> usize {
        self.usb.waiting
            + self
                .usb_commands
                .iter()
                .filter(|command| command.is_packet())
                .count()
    }

    /// What the USB host counted.
    #[must_use]
    pub fn usb_counters(&self) -> UsbCounters {
        self.usb.counters
    }

    /// Every bulk packet from the firmware, oldest first.
    #[must_use]
    pub fn usb_packets(&self) -> &[UsbPacket] {
        &self.usb_packets
    }

    /// Every control transfer that is over, those that made the device ready among them, oldest first.
    #[must_use]
    pub fn usb_transfers(&self) -> &[ControlTransfer] {
        &self.usb_transfers
    }

    /// For every bulk packet that the firmware's core took, when it lay in the receive FIFO, ready to be read.
    #[must_use]
    pub fn usb_deliveries_ns(&self) -> &[u64] {
        &self.usb_deliveries_ns
    }

    /// From the next run on, `fault` befalls the instruction that next touches `address` when it comes again: a task, or
    /// an interrupt, that fails. The next reset heals it.
    pub fn inject_fault(&mut self, fault: FaultInjection, address: u32) {
        self.fault = Some((fault, address));
    }

    /// What happens to the board at the start of the next run, behind what was asked for before.
    pub fn disturb(&mut self, disturbance: Disturbance) {
        self.disturbances.push(disturbance);
    }

    /// The level of the fault output: high (true) says that there is no fault. Unless the firmware drives it, the resistor on
    /// the board holds it low.
    #[must_use]
    pub fn fault_output(&self) -> bool {
        self.fault_output
    }

    /// What lies where the firmware keeps its settings, when that has changed since the last call.
    pub fn take_settings(&mut self) -> Option<Vec<u8>> {
        self.settings.take()
    }

    /// Lets `ns` nanoseconds of virtual time pass; the stop comes at most one instruction later.
    ///
    /// # Errors
    /// What stopped the emulator itself; nothing that the firmware does.
    pub fn run_for(&mut self, ns: u64) -> Result<(), EmulatorError> {
        self.until_ns = self.until_ns.saturating_add(ns);
        if ns == 0 {
            return Ok(());
        }
        let command = Command {
            until_ns: self.until_ns,
            uart: std::mem::take(&mut self.outbox),
            bus: std::mem::take(&mut self.bus_outbox),
            usb: std::mem::take(&mut self.usb_commands),
            fault: self.fault.take(),
            disturbances: std::mem::take(&mut self.disturbances),
            read: None,
        };
        self.command(command)
    }

    /// What lies in the memory now, as a debug probe reads it; a register may change by being read.
    ///
    /// # Errors
    /// As [`Board::run_for`].
    pub fn read_memory(&mut self, address: u32, bytes: u32) -> Result<Vec<u8>, EmulatorError> {
        self.command(Command {
            until_ns: self.now_ns,
            uart: Vec::new(),
            bus: Vec::new(),
            usb: Vec::new(),
            fault: None,
            disturbances: Vec::new(),
            read: Some((address, bytes)),
        })?;
        Ok(std::mem::take(&mut self.memory))
    }

    fn command(&mut self, command: Command) -> Result<(), EmulatorError> {
        // A thread that is gone takes no command; why it went is what its last report says.
        if let Some(commands) = &self.commands {
            let _ = commands.send(command);
        }
        self.take_report()
    }

    /// Lets time pass until `reached` holds, looked at every [`PREDICATE_STEP_NS`], or `limit_ns` have passed.
    /// Answers whether it came to hold.
    ///
    /// # Errors
    /// As [`Board::run_for`].
    pub fn run_until(
        &mut self,
        mut reached: impl FnMut(&Self) -> bool,
        limit_ns: u64,
    ) -> Result<bool, EmulatorError> {
        let end_ns = self.until_ns.saturating_add(limit_ns);
        while !reached(self) {
            let left_ns = end_ns - self.until_ns;
            if left_ns == 0 {
                return Ok(false);
            }
            self.run_for(left_ns.min(PREDICATE_STEP_NS))?;
        }
        Ok(true)
    }

    /// Virtual time since power-on, nanoseconds.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Instructions the core has retired since power-on.
    #[must_use]
    pub fn instructions(&self) -> u64 {
        self.instructions
    }

    /// Every restart since power-on, the watchdog's among them.
    #[must_use]
    pub fn resets(&self) -> &[Reset] {
        &self.resets
    }

    /// Every code that appeared on a DAC pin since power-on, oldest first.
    #[must_use]
    pub fn dac_writes(&self) -> &[DacWrite] {
        &self.dac_writes
    }

    /// The code on `channel`'s pin now (1 or 2), or `None` while that pin is not driven.
    ///
    /// # Panics
    /// For any other channel.
    #[must_use]
    pub fn dac_code(&self, channel: u8) -> Option<u16> {
        self.dac_codes[usize::from(channel) - 1]
    }

    /// The raw log bytes (defmt frames) the firmware wrote over RTT, as a probe takes them every millisecond.
    #[must_use]
    pub fn log(&self) -> &[u8] {
        &self.log
    }

    /// Where the emulated part could not stand in for the real one so far, a line each: registers without a model,
    /// peripherals used with their clock off, addresses with nothing behind them.
    #[must_use]
    pub fn gaps(&self) -> &[String] {
        &self.gaps
    }

    /// What a traced board recorded since this was last asked.
    pub fn take_trace(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.trace)
    }

    fn take_report(&mut self) -> Result<(), EmulatorError> {
        let report = self.reports.recv().unwrap_or(Err(EmulatorError::Ended))?;
        self.now_ns = report.now_ns;
        self.instructions = report.instructions;
        self.resets.extend(report.resets);
        self.dac_codes = report.dac_codes;
        self.dac_writes.extend(report.dac_writes);
        self.uart_bytes.extend(report.uart_bytes);
        self.bus_bytes.extend(report.bus_bytes);
        self.bus_driver.extend(report.bus_driver);
        self.usb = report.usb;
        self.usb_packets.extend(report.usb_packets);
        self.usb_transfers.extend(report.usb_transfers);
        self.usb_deliveries_ns.extend(report.usb_deliveries_ns);
        self.fault_output = report.fault_output;
        if report.settings.is_some() {
            self.settings = report.settings;
        }
        self.log.extend(report.log);
        self.gaps.extend(report.gaps);
        self.trace.extend(report.trace);
        self.memory = report.memory;
        Ok(())
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        // The thread ends when nobody can command it any more.
        self.commands = None;
        if let Some(thread) = self.thread.take() {
            // A panic there has been printed where it happened.
            let _ = thread.join();
        }
    }
}

/// The image in `elf`, once it is one this part can start from.
fn image_of(elf: &[u8]) -> Result<Image, EmulatorError> {
    if !elf.starts_with(b"\x7fELF") {
        let found = if elf.is_empty() {
            "an empty file".into()
        } else {
            format!("{:02x?}", &elf[..elf.len().min(4)])
        };
        return Err(EmulatorError::NotElf { found });
    }
    let image = Image::new(Path::new("file"), elf.to_vec(), None)?;
    let spans: Vec<(u64, u64)> = image
        .segments()
        .map(|(at, bytes)| (at, at + bytes.len() as u64))
        .collect();
    if !spans
        .iter()
        .any(|&(start, end)| (start..end).contains(&FLASH_BASE))
    {
        let list: Vec<String> = spans
            .iter()
            .map(|(start, end)| format!("{start:#010x}..{end:#010x}"))
            .collect();
        let found = if list.is_empty() {
            "no segment at all".into()
        } else {
            list.join(", ")
        };
        return Err(EmulatorError::NoFlash { found });
    }
    Ok(image)
}

/// What the caller asks of the emulator's thread: put bytes on the line, then run.
#[derive(Debug)]
struct Command {
    until_ns: u64,
    uart: Vec<u8>,
    bus: Vec<u8>,
    usb: Vec<usb::Command>,
    fault: Option<(FaultInjection, u32)>,
    disturbances: Vec<Disturbance>,
    /// Address and length of memory that the next report shows.
    read: Option<(u32, u32)>,
}

/// The USB port as it stands.
#[derive(Debug, Clone, Copy, Default)]
struct UsbNow {
    state: UsbState,
    enumerations: u64,
    waiting: usize,
    counters: UsbCounters,
}

/// What a run came to; lists hold what is new since the report before.
#[derive(Debug)]
struct Report {
    now_ns: u64,
    instructions: u64,
    resets: Vec<Reset>,
    dac_codes: [Option<u16>; CHANNELS],
    dac_writes: Vec<DacWrite>,
    uart_bytes: Vec<UartByte>,
    bus_bytes: Vec<UartByte>,
    bus_driver: Vec<(u64, bool)>,
    usb: UsbNow,
    usb_packets: Vec<UsbPacket>,
    usb_transfers: Vec<ControlTransfer>,
    usb_deliveries_ns: Vec<u64>,
    fault_output: bool,
    settings: Option<Vec<u8>>,
    log: Vec<u8>,
    gaps: Vec<String>,
    trace: Vec<Event>,
    memory: Vec<u8>,
}

/// Runs `images` until nobody commands any more.
fn run(
    images: &[Image],
    log_block: Option<u64>,
    panics_at: Option<u32>,
    traced: Vec<u32>,
    commands: Receiver<Command>,
    reports: SyncSender<Result<Report, EmulatorError>>,
) -> Result<(), EmulatorError> {
    let hardware = Hardware::new().map_err(emulator::Error::from)?;
    let mut session = Session::new(Box::new(hardware), 0, VirtualNanos(0))?;
    let log_at = log_block.map(|_| VirtualNanos(LOG_PERIOD_NS));
    session.pause_at(log_at);
    let puppet = Puppet {
        commands,
        reports,
        log_block,
        flash: FlashArray::default(),
        injector: Injector::new(panics_at),
        log: Vec::new(),
        log_at,
        dac_wait_ns: 0,
        held_until: None,
        bus_driver: Vec::new(),
        resets_reported: 0,
        gaps_reported: Vec::new(),
        tracer: trace::Tracer::new(traced),
        read: None,
    };
    emulator::run(session, &Start::new(images), puppet)?;
    Ok(())
}

/// Runs from stop to stop as the caller commands.
struct Puppet {
    commands: Receiver<Command>,
    reports: SyncSender<Result<Report, EmulatorError>>,
    log_block: Option<u64>,
    flash: FlashArray,
    injector: Injector,
    log: Vec<u8>,
    /// When the log is drained next.
    log_at: Option<VirtualNanos>,
    /// How much longer the core waits for every access to the DAC.
    dac_wait_ns: u64,
    /// Until when the core waits for the access that it made last.
    held_until: Option<VirtualNanos>,
    bus_driver: Vec<(u64, bool)>,
    resets_reported: usize,
    gaps_reported: Vec<String>,
    tracer: trace::Tracer,
    read: Option<(u32, u32)>,
}

impl Puppet {
    fn report(&mut self, session: &mut Session<Hardware>, stop: Stop, host: &mut dyn Host) -> Report {
        let resets = session.resets()[self.resets_reported..]
            .iter()
            .map(reset_of)
            .collect();
        self.resets_reported = session.resets().len();
        let gaps: Vec<String> = gaps_of(session)
            .into_iter()
            .filter(|gap| !self.gaps_reported.contains(gap))
            .collect();
        self.gaps_reported.extend(gaps.iter().cloned());
        let memory = self.read.take().map_or_else(Vec::new, |(address, bytes)| {
            (address..address + bytes)
                .map(|at| {
                    let byte = host.read(at.into(), Width::W8).ok();
                    let register = || session.mcu().read(stop.at, at.into(), Width::W8).ok();
                    byte.or_else(register).unwrap_or_default() as u8
                })
                .collect()
        });
        let hardware = session.board_mut();
        Report {
            now_ns: stop.at.0,
            instructions: stop.instruction_count,
            resets,
            dac_codes: std::array::from_fn(|channel| hardware.dac().code(channel)),
            dac_writes: hardware.dac().take_writes(),
            uart_bytes: hardware.far_end().take_heard(),
            bus_bytes: hardware.bus_end().take_heard(),
            bus_driver: std::mem::take(&mut self.bus_driver),
            usb: UsbNow {
                state: hardware.usb().state(),
                enumerations: hardware.usb().enumerations(),
                waiting: hardware.usb().waiting(),
                counters: hardware.usb().counters(),
            },
            usb_packets: hardware.usb().take_packets(),
            usb_transfers: hardware.usb().take_transfers(),
            usb_deliveries_ns: hardware.usb().take_deliveries(),
            fault_output: hardware.part().fault_output(),
            settings: self.flash.take_changed_settings(host),
            log: std::mem::take(&mut self.log),
            gaps,
            trace: self.tracer.take(),
            memory,
        }
    }
}

impl Puppet {
    /// Asks for the next pause: to drain the log, or to let the core go on.
    fn pause(&self, session: &mut Session<Hardware>) {
        session.pause_at(self.log_at.into_iter().chain(self.held_until).min());
    }

    /// Does what a pause was for. The models never hear of one, so draining changes nothing but the room in the firmware's log
    /// buffer, and that at the same instants however the caller cuts the time.
    fn paused(&mut self, session: &mut Session<Hardware>, stop: Stop, host: &mut dyn Host) {
        let is_due = |at: Option<VirtualNanos>| at.is_some_and(|at| stop.at >= at);
        if let Some(block) = self.log_block.filter(|_| is_due(self.log_at)) {
            self.log.extend(rtt::drain(host, block));
            self.log_at = Some(VirtualNanos((stop.at.0 / LOG_PERIOD_NS + 1) * LOG_PERIOD_NS));
        }
        if is_due(self.held_until) {
            self.held_until = None;
            host.hold(false);
        }
        self.pause(session);
    }

    fn disturb(
        &mut self,
        disturbance: Disturbance,
        session: &mut Session<Hardware>,
        stop: Stop,
        host: &mut dyn Host,
    ) {
        match disturbance {
            Disturbance::BrownOut { forgets } => {
                if forgets {
                    forget(host);
                }
                session.board_mut().part().note_brown_out();
                session.reset_by_pin(stop.at, stop.instruction_count, host);
                self.injector.restarted(session.resets().len(), host);
            }
            Disturbance::Supply(millivolts) => {
                session.board_mut().part().set_supply(millivolts);
                session.board_mut().couple_line();
            }
            Disturbance::Line(wiring) => session.board_mut().wire_line(wiring),
            Disturbance::ReleaseInhibit(level) => session.board_mut().part().inhibit_release(stop.at, level),
            Disturbance::BrownOutLevel(level) => session.board_mut().part().set_brown_out_level(level),
            Disturbance::BusClockStops => session.board_mut().part().stop_bus_clock(stop.at),
            Disturbance::SlowDac(ns) => self.dac_wait_ns = ns.into(),
            Disturbance::UartOpen(is_open) => session.board_mut().part().open_link(is_open),
        }
    }
}

/// RAM after a supply that was too low for it.
fn forget(host: &mut dyn Host) {
    const NOISE: u64 = 0x9E37_79B9;
    for (start, bytes) in RAM {
        for at in (start..start + bytes).step_by(4) {
            // Every word of these regions is writable.
            let _ = host.write(at, Width::W32, at.wrapping_mul(NOISE) & 0xFFFF_FFFF);
        }
    }
}

impl Driver<Hardware> for Puppet {
    fn on_settled(&mut self, session: &mut Session<Hardware>, host: &mut dyn Host, settled: Settled) {
        if let Settled::Access { access, value } = settled {
            if let Some(on) = driver_written(&access) {
                self.bus_driver.push((access.virtual_time.0, on));
            }
            let mut control = || {
                let read = session.mcu().read(access.virtual_time, FLASH_CR, Width::W32);
                read.unwrap_or_default()
            };
            self.flash.settled(&access, value, &mut control, host);
            self.injector.settled(&access, host);
            if (DAC_BASE..DAC_BASE + DAC_BYTES).contains(&access.address) {
                if access.kind == AccessKind::Write {
                    session.board_mut().couple_line();
                }
                if self.dac_wait_ns > 0 && access.program_counter.is_some() {
                    self.held_until = Some(VirtualNanos(access.virtual_time.0 + self.dac_wait_ns));
                    host.hold(true);
                    self.pause(session);
                }
            }
        } else {
            self.injector.restarted(session.resets().len(), host);
        }
        self.tracer.settled(session.board_mut(), host, settled);
        if let Settled::Stop(stop) = settled {
            self.paused(session, stop, host);
        }
    }

    fn on_stop(
        &mut self,
        session: &mut Session<Hardware>,
        stop: Stop,
        host: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        let report = self.report(session, stop, host);
        self.reports.send(Ok(report)).ok()?;
        let command = self.commands.recv().ok()?;
        self.read = command.read;
        session.board_mut().far_end().send(&command.uart);
        session.board_mut().bus_end().send(&command.bus);
        if let Some((fault, address)) = command.fault {
            self.injector.ask(fault, address);
        }
        for command in command.usb {
            session.board_mut().usb().command(command);
        }
        for disturbance in command.disturbances {
            self.disturb(disturbance, session, stop, host);
        }
        Some(VirtualNanos(command.until_ns))
    }
}

/// What a write makes of the pin that enables the bus's driver.
fn driver_written(access: &Access) -> Option<bool> {
    let bit = |number: u32| access.value >> number & 1 == 1;
    match (access.kind, access.address) {
        (AccessKind::Write, GPIOA_BSRR) if bit(BUS_DRIVER_PIN) => Some(true),
        (AccessKind::Write, GPIOA_BSRR) if bit(BUS_DRIVER_PIN + 16) => Some(false),
        (AccessKind::Write, GPIOA_ODR) => Some(bit(BUS_DRIVER_PIN)),
        _ => None,
    }
}

fn reset_of(reset: &rigless::session::Reset) -> Reset {
    let cause = match reset.cause {
        ResetCause::Core => "software",
        ResetCause::Model(instance) => instance,
        ResetCause::Pin => "pin",
        ResetCause::PowerOn => "power",
        _ => "unknown",
    };
    Reset {
        at_ns: reset.at.0,
        cause,
    }
}

/// A line for each place where the part's models end.
fn gaps_of(session: &Session<Hardware>) -> Vec<String> {
    let unmapped = session.unmapped().into_iter().map(|gap| gap.to_string());
    let refused = session
        .refused()
        .values()
        .map(|fault| format!("refused: {fault}"));
    let unimplemented = session.unimplemented().values().map(|gap| {
        format!(
            "no model: {}.{} from pc={:#010x}",
            gap.instance, gap.register, gap.program_counter
        )
    });
    let complaints = session.told().map(|complaint| {
        format!(
            "{}.{}: {}",
            complaint.instance, complaint.register, complaint.reason
        )
    });
    unmapped
        .chain(refused)
        .chain(unimplemented)
        .chain(complaints)
        .collect()
}

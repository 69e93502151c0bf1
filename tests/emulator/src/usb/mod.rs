//! The USB port of the board: the device core in the part (`core`), a host at the other end of a cable (`host`), and the
//! time that packets take between them. Times are virtual nanoseconds.
//! Full speed: frames of 1 ms, SOF first, at most 19 bulk packets of 64 bytes each; one transaction at a time, none
//! across the end of a frame. Limits: no bit errors, no hub, no remote wake-up, no bit stuffing.

mod core;
mod host;
mod registers;

use std::collections::{BTreeSet, VecDeque};

use gripline_emulator_wire::USB_PACKET_MAX;
use rigless::chip::parallel::Peer;
use rigless::device::{DeviceContext, Level};
use rigless::snapshot::Store;
use rigless::soc::Width;
use rigless::time::{EventId, VirtualNanos};

use self::core::{Answer, Core};
pub use self::host::UsbCounters;
use self::host::{Host, Outcome, Transaction, Wish};
use crate::constants::{
    USB_DATA_BYTES, USB_DEBOUNCE_NS, USB_EOF_BYTES, USB_FRAME_BYTES, USB_FRAME_NS, USB_GAP_BYTES,
    USB_HANDSHAKE_BYTES, USB_RESET_NS, USB_RESET_RECOVERY_NS, USB_RESUME_NS, USB_RESUME_RECOVERY_NS,
    USB_SOF_BYTES, USB_SUSPEND_NS, USB_TOKEN_BYTES,
};
pub use gripline_emulator_wire::{Cable, ControlOutcome, ControlTransfer, Setup, UsbPacket, UsbState};

/// What the caller asks of the port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Command {
    Cable(Cable),
    /// A bulk OUT packet.
    Send(Vec<u8>),
    /// A control transfer, broken off after so many packets if given.
    Control(Setup, Vec<u8>, Option<u32>),
    /// Whether the host reads bulk IN.
    Listen(bool),
}

impl Command {
    pub(crate) fn is_packet(&self) -> bool {
        matches!(self, Self::Send(_))
    }
}

/// What stands between an unplugged port and one that carries packets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Detached,
    Debounce,
    Reset,
    Recovery,
    Running,
    Suspended,
    Resuming,
    ResumeRecovery,
}

/// What happens next to the packet on the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// The token is over: the device decides.
    Token,
    /// The data packet of a SETUP or OUT is in the device.
    Data,
    /// The handshake is over.
    End,
}

/// A transaction on the bus.
#[derive(Debug)]
struct Flight {
    transaction: Transaction,
    step: Step,
    due_ns: u64,
    outcome: Outcome,
}

/// The port.
#[derive(Debug)]
pub(crate) struct Port {
    core: Core,
    host: Host,
    cable: Cable,
    phase: Phase,
    is_pulled_up: bool,
    /// When the phase ends.
    phase_ns: Option<u64>,
    /// When the device takes the bus for suspended.
    quiet_ns: Option<u64>,
    frame_start_ns: u64,
    /// When the next frame begins.
    frame_ns: Option<u64>,
    flight: Option<Flight>,
    /// When the host, having nothing to do, looks again.
    look_ns: Option<u64>,
    wake: Option<(u64, EventId)>,
    is_raised: bool,
    commands: VecDeque<Command>,
    reported: BTreeSet<core::Complaint>,
    deliveries: Vec<u64>,
}

impl Default for Port {
    fn default() -> Self {
        Self {
            core: Core::new(false),
            host: Host::default(),
            cable: Cable::Out,
            phase: Phase::Detached,
            is_pulled_up: false,
            phase_ns: None,
            quiet_ns: None,
            frame_start_ns: 0,
            frame_ns: None,
            flight: None,
            look_ns: None,
            wake: None,
            is_raised: false,
            commands: VecDeque::new(),
            reported: BTreeSet::new(),
            deliveries: Vec::new(),
        }
    }
}

/// How long so many byte times of full speed take, nanoseconds.
const fn byte_times_ns(bytes: u64) -> u64 {
    bytes * USB_FRAME_NS / USB_FRAME_BYTES
}

impl Port {
    /// Does `command` when the board runs next.
    pub(crate) fn command(&mut self, command: Command) {
        self.commands.push_back(command);
    }

    pub(crate) fn state(&self) -> UsbState {
        match self.phase {
            Phase::Detached => UsbState::Detached,
            Phase::Suspended => UsbState::Suspended,
            _ => self.host.state(),
        }
    }

    pub(crate) fn waiting(&self) -> usize {
        self.host.waiting()
    }

    pub(crate) fn enumerations(&self) -> u64 {
        self.host.enumerations()
    }

    pub(crate) fn counters(&self) -> UsbCounters {
        self.host.counters
    }

    pub(crate) fn take_packets(&mut self) -> Vec<UsbPacket> {
        std::mem::take(&mut self.host.packets)
    }

    pub(crate) fn take_transfers(&mut self) -> Vec<ControlTransfer> {
        std::mem::take(&mut self.host.transfers)
    }

    /// Instants at which bulk OUT packets lay in the receive FIFO, ready to be read, since the last call.
    /// Packets that ever lay in the receive FIFO and no call has taken yet.
    pub(crate) fn deliveries(&self) -> usize {
        self.deliveries.len()
    }

    pub(crate) fn take_deliveries(&mut self) -> Vec<u64> {
        std::mem::take(&mut self.deliveries)
    }

    fn is_attached(&self) -> bool {
        self.cable != Cable::Out && self.is_pulled_up
    }

    /// After anything the firmware or the caller did.
    fn settle(&mut self, context: &mut DeviceContext<'_>) {
        let now_ns = context.now().0;
        let was_attached = self.is_attached();
        let pulled_up = self.core.is_pulled_up();
        if pulled_up != self.is_pulled_up {
            self.is_pulled_up = pulled_up;
            self.quiet_ns = pulled_up.then_some(now_ns + USB_SUSPEND_NS);
        }
        self.attach_or_detach(was_attached, now_ns);
        self.update(context);
    }

    fn attach_or_detach(&mut self, was_attached: bool, now_ns: u64) {
        match (was_attached, self.is_attached()) {
            (false, true) => self.enter(Phase::Debounce, Some(now_ns + USB_DEBOUNCE_NS)),
            (true, false) => {
                self.host.detached(now_ns);
                let was_running = self.phase == Phase::Running;
                self.enter(Phase::Detached, None);
                if was_running && self.is_pulled_up {
                    self.quiet_ns = Some(now_ns + USB_SUSPEND_NS);
                }
            }
            _ => {}
        }
    }

    fn enter(&mut self, phase: Phase, until_ns: Option<u64>) {
        self.phase = phase;
        self.phase_ns = until_ns;
        if !matches!(phase, Phase::Running | Phase::Recovery | Phase::ResumeRecovery) {
            self.flight = None;
            self.frame_ns = None;
            self.look_ns = None;
        }
    }

    fn plug(&mut self, cable: Cable, now_ns: u64) {
        let was_attached = self.is_attached();
        if (self.cable == Cable::Out) != (cable == Cable::Out) {
            self.core.set_vbus(cable != Cable::Out);
        }
        self.cable = cable;
        self.attach_or_detach(was_attached, now_ns);
        if cable == Cable::In && self.phase == Phase::Suspended {
            self.quiet_ns = None;
            self.core.resume();
            self.enter(Phase::Resuming, Some(now_ns + USB_RESUME_NS));
        }
    }

    fn reset_bus(&mut self, now_ns: u64) {
        self.quiet_ns = None;
        self.core.bus_reset();
        self.host.was_reset();
        self.enter(Phase::Reset, Some(now_ns + USB_RESET_NS));
    }

    /// What the clock brings at `now_ns`, in a fixed order.
    fn advance(&mut self, now_ns: u64) {
        if self.phase_ns.is_some_and(|due_ns| due_ns <= now_ns) {
            self.end_phase(now_ns);
        }
        if self.quiet_ns.is_some_and(|due_ns| due_ns <= now_ns) {
            self.quiet_ns = None;
            self.core.suspend();
        }
        if self.flight.as_ref().is_some_and(|flight| flight.due_ns <= now_ns) {
            self.fly(now_ns);
        }
        if self.frame_ns.is_some_and(|due_ns| due_ns <= now_ns) {
            self.start_frame(now_ns);
        }
        if self.look_ns.is_some_and(|due_ns| due_ns <= now_ns) {
            self.look(now_ns);
        }
    }

    fn end_phase(&mut self, now_ns: u64) {
        self.phase_ns = None;
        match self.phase {
            Phase::Debounce => {
                self.host.attached();
                self.reset_bus(now_ns);
            }
            Phase::Reset => {
                self.core.enumeration_done();
                self.enter(Phase::Recovery, Some(now_ns + USB_RESET_RECOVERY_NS));
                self.start_frame(now_ns);
            }
            Phase::Resuming => {
                self.enter(Phase::ResumeRecovery, Some(now_ns + USB_RESUME_RECOVERY_NS));
                self.start_frame(now_ns);
            }
            Phase::Recovery | Phase::ResumeRecovery => {
                self.phase = Phase::Running;
                self.look_ns = Some(now_ns);
            }
            Phase::Detached | Phase::Running | Phase::Suspended => {}
        }
    }

    fn start_frame(&mut self, now_ns: u64) {
        if self.cable == Cable::Asleep && self.host.state() == UsbState::Configured {
            // The host stops between two frames; the device notices later.
            self.quiet_ns = Some(now_ns + USB_SUSPEND_NS);
            return self.enter(Phase::Suspended, None);
        }
        self.core.start_of_frame();
        self.frame_start_ns = now_ns;
        self.frame_ns = Some(now_ns + USB_FRAME_NS);
        if self.phase == Phase::Running && self.flight.is_none() {
            self.look_ns = Some(now_ns + byte_times_ns(USB_SOF_BYTES));
        }
    }

    /// Lets the host choose, if its choice still fits into the frame.
    fn look(&mut self, now_ns: u64) {
        self.look_ns = None;
        if self.phase != Phase::Running || self.flight.is_some() {
            return;
        }
        let first_ns = self.frame_start_ns + byte_times_ns(USB_SOF_BYTES);
        if now_ns < first_ns {
            self.look_ns = Some(first_ns);
            return;
        }
        let end_ns = self.frame_start_ns + byte_times_ns(USB_FRAME_BYTES - USB_EOF_BYTES + USB_GAP_BYTES);
        let longest_ns = |bytes: usize| {
            byte_times_ns(USB_TOKEN_BYTES + USB_DATA_BYTES + bytes as u64 + USB_HANDSHAKE_BYTES)
        };
        match self.host.next(now_ns, |transaction| {
            let bytes = match transaction {
                Transaction::Setup(setup) => setup.len(),
                Transaction::Out { data, .. } => data.len(),
                // What the device will send is not known before it does.
                Transaction::In { .. } => USB_PACKET_MAX,
            };
            now_ns + longest_ns(bytes) <= end_ns
        }) {
            Wish::Transaction(transaction) => {
                self.flight = Some(Flight {
                    transaction,
                    step: Step::Token,
                    due_ns: now_ns + byte_times_ns(USB_TOKEN_BYTES),
                    outcome: Outcome::Silence,
                });
            }
            Wish::Reset => self.reset_bus(now_ns),
            Wish::Wait(until_ns) if until_ns < self.frame_ns.unwrap_or(0) => self.look_ns = Some(until_ns),
            // The next frame looks by itself.
            Wish::Wait(_) | Wish::NextFrame => {}
        }
    }

    /// The next step of the transaction on the bus.
    fn fly(&mut self, now_ns: u64) {
        let Some(mut flight) = self.flight.take() else {
            return;
        };
        match flight.step {
            Step::Token => self.token(&mut flight, now_ns),
            Step::Data => {
                match &flight.transaction {
                    Transaction::Setup(setup) => self.core.setup(*setup),
                    Transaction::Out {
                        endpoint,
                        toggle,
                        data,
                    } => {
                        let is_new = self.core.out_data(usize::from(*endpoint), *toggle, data);
                        if is_new && *endpoint != 0 {
                            self.deliveries.push(now_ns);
                        }
                    }
                    Transaction::In { .. } => {}
                }
                flight.step = Step::End;
                flight.due_ns = now_ns + byte_times_ns(USB_HANDSHAKE_BYTES);
            }
            Step::End => {
                if let (Transaction::In { endpoint }, Outcome::Data(_, data)) =
                    (&flight.transaction, &flight.outcome)
                {
                    self.core.in_acknowledged(usize::from(*endpoint), data.len());
                }
                self.host.done(now_ns, &flight.transaction, flight.outcome);
                self.look_ns = Some(now_ns);
                return;
            }
        }
        self.flight = Some(flight);
    }

    fn token(&mut self, flight: &mut Flight, now_ns: u64) {
        let address = self.host.address();
        // What is on the bus after the token, before the handshake.
        let data_bytes = match &flight.transaction {
            Transaction::Setup(setup) => {
                let answer = self.core.setup_token(address);
                flight.outcome = outcome(answer);
                flight.step = if answer == Answer::Ack {
                    Step::Data
                } else {
                    Step::End
                };
                Some(setup.len())
            }
            Transaction::Out { endpoint, data, .. } => {
                let answer = self.core.out_token(address, usize::from(*endpoint), data.len());
                flight.outcome = outcome(answer);
                flight.step = if answer == Answer::Ack {
                    Step::Data
                } else {
                    Step::End
                };
                Some(data.len())
            }
            Transaction::In { endpoint } => {
                let (sent, bytes): (Outcome, Option<usize>) =
                    match self.core.in_token(address, usize::from(*endpoint)) {
                        Ok((toggle, data)) => {
                            let bytes = data.len();
                            (Outcome::Data(toggle, data), Some(bytes))
                        }
                        Err(answer) => (outcome(answer), None),
                    };
                flight.outcome = sent;
                flight.step = Step::End;
                bytes
            }
        };
        let data = data_bytes.map_or(0, |bytes| USB_DATA_BYTES + bytes as u64);
        let handshake = if flight.step == Step::Data {
            0
        } else {
            USB_HANDSHAKE_BYTES
        };
        flight.due_ns = now_ns + byte_times_ns(data + handshake);
    }

    /// The interrupt line, complaints and the next event.
    fn update(&mut self, context: &mut DeviceContext<'_>) {
        let raised = self.core.interrupt();
        if raised != self.is_raised {
            self.is_raised = raised;
            context.interrupt(0, if raised { Level::High } else { Level::Low });
        }
        for complaint in self.core.take_complaints() {
            if self.reported.insert(complaint) {
                context.tell(complaint.0, complaint.1);
            }
        }
        let flight_ns = self.flight.as_ref().map(|flight| flight.due_ns);
        let due = [
            self.phase_ns,
            self.quiet_ns,
            self.frame_ns,
            self.look_ns,
            flight_ns,
        ];
        let Some(due_ns) = due.into_iter().flatten().min() else {
            self.wake = None;
            return;
        };
        if self.wake.is_none_or(|(at_ns, _)| at_ns != due_ns) {
            self.wake = Some((due_ns, context.schedule(VirtualNanos(due_ns))));
        }
    }
}

fn outcome(answer: Answer) -> Outcome {
    match answer {
        Answer::Ack => Outcome::Taken,
        Answer::Nak => Outcome::Nak,
        Answer::Stall => Outcome::Stall,
        Answer::Silence => Outcome::Silence,
    }
}

impl Store for Port {}

impl Peer for Port {
    fn read(&mut self, offset: u64, width: Width, context: &mut DeviceContext<'_>) -> u64 {
        if width != Width::W32 {
            context.tell("any", "registers take whole words only (RM0090 section 34.16)");
        }
        let value = self.core.read(offset);
        self.update(context);
        u64::from(value)
    }

    fn write(&mut self, offset: u64, width: Width, value: u64, context: &mut DeviceContext<'_>) {
        if width != Width::W32 {
            context.tell("any", "registers take whole words only (RM0090 section 34.16)");
        }
        self.core.write(offset, value as u32);
        self.settle(context);
    }

    fn on_event(&mut self, event: EventId, context: &mut DeviceContext<'_>) {
        if self.wake.is_some_and(|(_, id)| id == event) {
            self.wake = None;
            self.advance(context.now().0);
            self.update(context);
        }
    }

    /// Takes what the caller asked for since the last stop; does nothing at any other.
    fn poll(&mut self, context: &mut DeviceContext<'_>) {
        if self.commands.is_empty() {
            return;
        }
        let now_ns = context.now().0;
        for command in std::mem::take(&mut self.commands) {
            match command {
                Command::Cable(cable) => self.plug(cable, now_ns),
                Command::Send(packet) => self.host.send(packet),
                Command::Control(setup, data, packets) => self.host.ask(setup, data, packets),
                Command::Listen(listens) => self.host.listen(listens),
            }
        }
        if self.phase == Phase::Running && self.flight.is_none() {
            self.look_ns = Some(now_ns);
        }
        self.settle(context);
    }

    /// The part restarted, and its pull-up went with it: the host sees the device leave.
    fn reset(&mut self) {
        let was_attached = self.is_attached();
        let now_ns = self.frame_start_ns;
        self.core = Core::new(self.cable != Cable::Out);
        self.is_pulled_up = false;
        self.quiet_ns = None;
        self.wake = None;
        self.is_raised = false;
        self.attach_or_detach(was_attached, now_ns);
    }
}

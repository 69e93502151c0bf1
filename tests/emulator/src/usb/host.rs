//! A small full-speed USB host: it enumerates the device behind its one port, keeps reading bulk IN, sends bulk OUT
//! packets with retries and makes the control transfers it is asked for. It only decides what comes next on the bus;
//! the time that takes is [`super::Port`]'s. Times are virtual nanoseconds. Limits: one device, one configuration, one
//! bulk pair, one transfer on the control pipe at a time; packets of 64 bytes at most.

use std::collections::VecDeque;

use gripline_emulator_wire::{ControlOutcome, ControlTransfer, Setup, USB_PACKET_MAX, UsbPacket, UsbState};

use super::core::Toggle;
use crate::constants::{
    USB_ADDRESS_RECOVERY_NS, USB_CONTROL_RETRY_NS, USB_CONTROL_TIMEOUT_NS, USB_ENUMERATION_TRIES,
    USB_IN_RETRY_NS, USB_TRIES,
};

/// Standard requests and descriptor types (USB 2.0 tables 9-4 and 9-5).
mod standard {
    pub(super) const SET_ADDRESS: u8 = 5;
    pub(super) const GET_DESCRIPTOR: u8 = 6;
    pub(super) const SET_CONFIGURATION: u8 = 9;
    pub(super) const SET_INTERFACE: u8 = 11;
    pub(super) const CLEAR_FEATURE: u8 = 1;
    pub(super) const DEVICE: u8 = 1;
    pub(super) const CONFIGURATION: u8 = 2;
    pub(super) const STRING: u8 = 3;
    pub(super) const ENDPOINT: u8 = 5;
    pub(super) const DEVICE_QUALIFIER: u8 = 6;
    pub(super) const BOS: u8 = 15;
    pub(super) const ENGLISH_US: u16 = 0x0409;
}

/// What the host counted since power-on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct UsbCounters {
    /// Bulk OUT packets that the device took.
    pub out_packets: u64,
    /// Bulk OUT packets that it refused for the moment, each one time on the bus.
    pub out_naks: u64,
    /// Bulk OUT packets that were given up because the device left or did not answer.
    pub out_dropped: u64,
    /// Bulk IN packets received.
    pub in_packets: u64,
    /// Times the device had nothing to send.
    pub in_naks: u64,
    /// Bulk IN packets with the data toggle of the one before, which a host discards.
    pub in_repeats: u64,
    /// Resets that the host drove.
    pub resets: u64,
    /// Times a bulk endpoint answered with STALL.
    pub stalls: u64,
}

/// What goes over the bus next.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Transaction {
    Setup(Setup),
    Out {
        endpoint: u8,
        toggle: Toggle,
        data: Vec<u8>,
    },
    In {
        endpoint: u8,
    },
}

/// What came of a transaction.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Outcome {
    /// Acknowledged by the device.
    Taken,
    /// The device sent this.
    Data(Toggle, Vec<u8>),
    Nak,
    Stall,
    Silence,
}

/// What the host wants of its port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Wish {
    Transaction(Transaction),
    Reset,
    /// Nothing before this instant.
    Wait(u64),
    /// Nothing that still fits into this frame.
    NextFrame,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Setup,
    DataIn,
    DataOut,
    StatusIn,
    StatusOut,
}

/// A control transfer under way.
#[derive(Debug, Clone)]
struct Control {
    setup: Setup,
    stage: Stage,
    data: Vec<u8>,
    sent: usize,
    toggle: Toggle,
    give_up_ns: u64,
    tries: u32,
    /// Broken off after this many acknowledged packets.
    packets_left: Option<u32>,
    is_enumeration: bool,
}

impl Control {
    fn length(&self) -> usize {
        usize::from(u16::from_le_bytes([self.setup[6], self.setup[7]]))
    }
}

/// One step of making a device ready.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    Request(Setup),
    Address,
    Configure,
    Reset,
    Wait(u64),
}

/// The host.
#[expect(
    clippy::struct_excessive_bools,
    reason = "flags of parts that know nothing of each other"
)]
#[derive(Debug, Default)]
pub(super) struct Host {
    plan: VecDeque<Step>,
    plan_tries: u32,
    is_ready: bool,
    is_failed: bool,
    not_before_ns: u64,
    enumerations: u64,
    next_address: u8,
    address: u8,
    packet_max_0: usize,
    configuration: u8,
    bulk_out: u8,
    bulk_in: u8,
    out_toggle: Toggle,
    in_toggle: Toggle,
    control: Option<Control>,
    control_not_before_ns: u64,
    asked: VecDeque<(Setup, Vec<u8>, Option<u32>)>,
    outgoing: VecDeque<Vec<u8>>,
    out_tries: u32,
    is_deaf: bool,
    in_not_before_ns: u64,
    was_out: bool,
    pub(super) transfers: Vec<ControlTransfer>,
    pub(super) packets: Vec<UsbPacket>,
    pub(super) counters: UsbCounters,
}

const fn request(kind: u8, request: u8, value: u16, index: u16, length: u16) -> Setup {
    let (value, index, length) = (value.to_le_bytes(), index.to_le_bytes(), length.to_le_bytes());
    [
        kind, request, value[0], value[1], index[0], index[1], length[0], length[1],
    ]
}

const fn descriptor(kind: u8, index: u8, language: u16, length: u16) -> Step {
    let value = u16::from_le_bytes([index, kind]);
    Step::Request(request(0x80, standard::GET_DESCRIPTOR, value, language, length))
}

impl Host {
    /// The device was seen and its port reset for the first time.
    pub(super) fn attached(&mut self) {
        self.plan_tries = 0;
        // Until it says otherwise: a packet shorter than this ends the first answer.
        self.packet_max_0 = USB_PACKET_MAX;
        self.start_over();
    }

    fn start_over(&mut self) {
        self.plan_tries += 1;
        self.is_failed = self.plan_tries > USB_ENUMERATION_TRIES;
        self.is_ready = false;
        self.control = None;
        self.plan = if self.is_failed {
            VecDeque::new()
        } else {
            // As common hosts do: one look at the size of endpoint 0, another reset, then everything.
            VecDeque::from([
                descriptor(standard::DEVICE, 0, 0, 64),
                Step::Reset,
                Step::Address,
                Step::Wait(USB_ADDRESS_RECOVERY_NS),
                descriptor(standard::DEVICE, 0, 0, 18),
                descriptor(standard::CONFIGURATION, 0, 0, 9),
                descriptor(standard::DEVICE_QUALIFIER, 0, 0, 10),
                descriptor(standard::STRING, 0, 0, 255),
                Step::Configure,
            ])
        };
    }

    /// The port was reset.
    pub(super) fn was_reset(&mut self) {
        self.counters.resets += 1;
        self.address = 0;
    }

    /// The device is gone: what was under way is lost.
    pub(super) fn detached(&mut self, now_ns: u64) {
        if let Some(control) = self.control.take() {
            self.end(control, ControlOutcome::NoAnswer, now_ns);
        }
        for (setup, data, _) in std::mem::take(&mut self.asked) {
            self.transfers.push(ControlTransfer {
                at_ns: now_ns,
                setup,
                data,
                outcome: ControlOutcome::NoAnswer,
            });
        }
        self.counters.out_dropped += self.outgoing.len() as u64;
        self.outgoing.clear();
        self.plan.clear();
        self.is_ready = false;
        self.is_failed = false;
        self.address = 0;
    }

    pub(super) fn state(&self) -> UsbState {
        match (self.is_ready, self.is_failed) {
            (true, _) => UsbState::Configured,
            (false, true) => UsbState::Failed,
            (false, false) => UsbState::Enumerating,
        }
    }

    pub(super) fn address(&self) -> u8 {
        self.address
    }

    /// Times a device was made ready since power-on.
    pub(super) fn enumerations(&self) -> u64 {
        self.enumerations
    }

    /// Bulk OUT packets that no device has taken yet.
    pub(super) fn waiting(&self) -> usize {
        self.outgoing.len()
    }

    pub(super) fn send(&mut self, packet: Vec<u8>) {
        self.outgoing.push_back(packet);
    }

    /// Asks for a control transfer; it is broken off after `packets` acknowledged ones, if given.
    pub(super) fn ask(&mut self, setup: Setup, data: Vec<u8>, packets: Option<u32>) {
        self.asked.push_back((setup, data, packets));
    }

    /// Whether bulk IN is read.
    pub(super) fn listen(&mut self, listens: bool) {
        self.is_deaf = !listens;
    }

    /// What comes next at `now_ns`, of what still `fits` into the frame.
    pub(super) fn next(&mut self, now_ns: u64, fits: impl Fn(&Transaction) -> bool) -> Wish {
        if self.control.is_none() && now_ns < self.not_before_ns {
            return Wish::Wait(self.not_before_ns);
        }
        if self.control.is_none()
            && let Some(wish) = self.next_control(now_ns)
        {
            return wish;
        }
        let mut wait_ns = u64::MAX;
        if let Some(control) = &self.control {
            if self.control_not_before_ns <= now_ns {
                let transaction = control_transaction(control);
                return if fits(&transaction) {
                    Wish::Transaction(transaction)
                } else {
                    Wish::NextFrame
                };
            }
            wait_ns = self.control_not_before_ns;
        }
        if !self.is_ready {
            return Wish::Wait(wait_ns);
        }
        let out = self.outgoing.front().map(|data| Transaction::Out {
            endpoint: self.bulk_out,
            toggle: self.out_toggle,
            data: data.clone(),
        });
        let input = Transaction::In {
            endpoint: self.bulk_in,
        };
        let input = (!self.is_deaf).then_some(input);
        let (is_out_due, is_in_due) = (out.is_some(), input.is_some() && self.in_not_before_ns <= now_ns);
        // In turns while both want the bus; a short packet may still fit where the other one does not.
        let out = out.filter(&fits);
        let input_now = input.clone().filter(|input| is_in_due && fits(input));
        let choice = match (out, input_now) {
            (Some(_), Some(input)) if self.was_out => Some(input),
            (Some(out), _) => Some(out),
            (None, input) => input,
        };
        if let Some(transaction) = choice {
            self.was_out = matches!(transaction, Transaction::Out { .. });
            return Wish::Transaction(transaction);
        }
        if is_out_due || is_in_due {
            return Wish::NextFrame;
        }
        if input.is_some() {
            wait_ns = wait_ns.min(self.in_not_before_ns);
        }
        Wish::Wait(wait_ns)
    }

    /// Begins the next control transfer of the plan or of those asked for; or what else the plan says.
    fn next_control(&mut self, now_ns: u64) -> Option<Wish> {
        let (setup, data, packets_left) = match self.plan.front().copied() {
            Some(Step::Reset) => {
                self.plan.pop_front();
                return Some(Wish::Reset);
            }
            Some(Step::Wait(ns)) => {
                self.plan.pop_front();
                self.not_before_ns = now_ns + ns;
                return Some(Wish::Wait(self.not_before_ns));
            }
            Some(Step::Request(setup)) => (setup, Vec::new(), None),
            Some(Step::Address) => {
                self.next_address = self.next_address % 127 + 1;
                let value = u16::from(self.next_address);
                (request(0, standard::SET_ADDRESS, value, 0, 0), Vec::new(), None)
            }
            Some(Step::Configure) => {
                let value = u16::from(self.configuration);
                (
                    request(0, standard::SET_CONFIGURATION, value, 0, 0),
                    Vec::new(),
                    None,
                )
            }
            None if self.is_ready => self.asked.pop_front()?,
            None => return None,
        };
        self.control_not_before_ns = now_ns;
        self.control = Some(Control {
            setup,
            stage: Stage::Setup,
            data,
            sent: 0,
            toggle: true,
            give_up_ns: now_ns + USB_CONTROL_TIMEOUT_NS,
            tries: 0,
            packets_left,
            is_enumeration: !self.is_ready,
        });
        None
    }

    /// `transaction` ended at `now_ns` with `outcome`.
    pub(super) fn done(&mut self, now_ns: u64, transaction: &Transaction, outcome: Outcome) {
        match transaction {
            Transaction::Setup(_)
            | Transaction::Out { endpoint: 0, .. }
            | Transaction::In { endpoint: 0 } => self.control_done(now_ns, outcome),
            Transaction::Out { .. } => self.out_done(&outcome),
            Transaction::In { .. } => self.in_done(now_ns, outcome),
        }
    }

    fn out_done(&mut self, outcome: &Outcome) {
        match outcome {
            Outcome::Nak => self.counters.out_naks += 1,
            Outcome::Taken => {
                self.counters.out_packets += 1;
                self.out_toggle = !self.out_toggle;
                self.out_tries = 0;
                self.outgoing.pop_front();
            }
            Outcome::Stall | Outcome::Silence | Outcome::Data(..) => {
                let is_halted = *outcome == Outcome::Stall;
                self.counters.stalls += u64::from(is_halted);
                self.out_tries += 1;
                if is_halted || self.out_tries >= USB_TRIES {
                    self.out_tries = 0;
                    self.counters.out_dropped += 1;
                    self.outgoing.pop_front();
                }
            }
        }
    }

    fn in_done(&mut self, now_ns: u64, outcome: Outcome) {
        match outcome {
            Outcome::Data(toggle, bytes) if toggle == self.in_toggle => {
                self.in_toggle = !self.in_toggle;
                self.counters.in_packets += 1;
                self.packets.push(UsbPacket { at_ns: now_ns, bytes });
            }
            Outcome::Data(..) => self.counters.in_repeats += 1,
            Outcome::Nak | Outcome::Stall | Outcome::Silence | Outcome::Taken => {
                self.counters.in_naks += u64::from(outcome == Outcome::Nak);
                self.counters.stalls += u64::from(outcome == Outcome::Stall);
                self.in_not_before_ns = now_ns + USB_IN_RETRY_NS;
            }
        }
    }

    fn control_done(&mut self, now_ns: u64, outcome: Outcome) {
        let Some(mut control) = self.control.take() else {
            return;
        };
        match outcome {
            Outcome::Nak if now_ns >= control.give_up_ns => {
                return self.end(control, ControlOutcome::TimedOut, now_ns);
            }
            Outcome::Nak => {
                self.control_not_before_ns = now_ns + USB_CONTROL_RETRY_NS;
                self.control = Some(control);
                return;
            }
            Outcome::Stall => return self.end(control, ControlOutcome::Stalled, now_ns),
            Outcome::Silence => {
                control.tries += 1;
                if control.tries >= USB_TRIES {
                    return self.end(control, ControlOutcome::NoAnswer, now_ns);
                }
                self.control_not_before_ns = now_ns + USB_CONTROL_RETRY_NS;
                self.control = Some(control);
                return;
            }
            Outcome::Taken | Outcome::Data(..) => control.tries = 0,
        }
        if let Some(packets) = &mut control.packets_left {
            *packets = packets.saturating_sub(1);
            if *packets == 0 {
                return self.end(control, ControlOutcome::Abandoned, now_ns);
            }
        }
        let is_read = control.setup[0] & 0x80 != 0;
        let length = control.length();
        control.stage = match (control.stage, outcome) {
            (Stage::Setup, _) if length == 0 => Stage::StatusIn,
            (Stage::Setup, _) if is_read => Stage::DataIn,
            (Stage::Setup, _) => Stage::DataOut,
            (Stage::DataIn, Outcome::Data(toggle, bytes)) if toggle == control.toggle => {
                control.toggle = !toggle;
                let is_short = bytes.len() < self.packet_max_0;
                control.data.extend(bytes);
                if is_short || control.data.len() >= length {
                    Stage::StatusOut
                } else {
                    Stage::DataIn
                }
            }
            (Stage::DataOut, _) => {
                control.toggle = !control.toggle;
                control.sent += (control.data.len() - control.sent).min(self.packet_max_0);
                if control.sent >= control.data.len() {
                    Stage::StatusIn
                } else {
                    Stage::DataOut
                }
            }
            (Stage::StatusIn | Stage::StatusOut, _) => {
                return self.end(control, ControlOutcome::Done, now_ns);
            }
            (stage, _) => stage,
        };
        self.control = Some(control);
    }

    fn end(&mut self, control: Control, outcome: ControlOutcome, now_ns: u64) {
        let is_enumeration = control.is_enumeration;
        let transfer = ControlTransfer {
            at_ns: now_ns,
            setup: control.setup,
            data: control.data,
            outcome,
        };
        if outcome == ControlOutcome::Done {
            self.reset_toggles(transfer.setup);
        }
        if is_enumeration && !self.plan.is_empty() {
            self.learn(&transfer);
        }
        self.transfers.push(transfer);
    }

    /// What the device and this host must both do to their toggles after some requests (USB 2.0 section 9.1.1.5).
    fn reset_toggles(&mut self, setup: Setup) {
        match (setup[0], setup[1]) {
            (0, standard::SET_CONFIGURATION) | (1, standard::SET_INTERFACE) => {
                self.out_toggle = false;
                self.in_toggle = false;
            }
            (2, standard::CLEAR_FEATURE) if setup[4] == self.bulk_out => self.out_toggle = false,
            (2, standard::CLEAR_FEATURE) if setup[4] == 0x80 | self.bulk_in => self.in_toggle = false,
            _ => {}
        }
    }

    /// Takes a step of the plan as done and adds those that follow from it.
    fn learn(&mut self, transfer: &ControlTransfer) {
        let step = self.plan.pop_front();
        let [_, kind_of_request, index, kind, ..] = transfer.setup;
        let is_done = transfer.outcome == ControlOutcome::Done;
        let is_descriptor = kind_of_request == standard::GET_DESCRIPTOR && transfer.setup[0] == 0x80;
        // A device may refuse the qualifier and strings, nothing else that was asked for.
        let may_fail = is_descriptor && matches!(kind, standard::DEVICE_QUALIFIER | standard::STRING);
        let is_stalled = transfer.outcome == ControlOutcome::Stalled;
        if !(is_done || may_fail && is_stalled) {
            self.start_over();
            if !self.plan.is_empty() {
                self.plan.push_front(Step::Reset);
            }
            return;
        }
        match step {
            Some(Step::Address) => self.address = self.next_address,
            Some(Step::Configure) => {
                self.is_ready = true;
                self.enumerations += 1;
                self.plan_tries = 0;
            }
            _ => {}
        }
        if !is_done || !is_descriptor {
            return;
        }
        let data = &transfer.data;
        match kind {
            standard::DEVICE => self.learn_device(data),
            standard::CONFIGURATION if data.len() == 9 => {
                let total = u16::from_le_bytes([data[2], data[3]]);
                self.plan.push_front(descriptor(kind, index, 0, total));
            }
            standard::CONFIGURATION => self.learn_configuration(data),
            standard::BOS if data.len() == 5 => {
                let total = u16::from_le_bytes([data[2], data[3]]);
                self.plan.push_front(descriptor(kind, index, 0, total));
            }
            standard::BOS => {
                if let Some((code, length)) = microsoft_set(data) {
                    self.plan
                        .push_front(Step::Request(request(0xC0, code, 0, 7, length)));
                }
            }
            _ => {}
        }
    }

    fn learn_device(&mut self, data: &[u8]) {
        if data.len() < 18 {
            self.packet_max_0 = data.get(7).map_or(8, |&size| usize::from(size));
            return;
        }
        self.packet_max_0 = usize::from(data[7]);
        if self.address == 0 {
            return;
        }
        if u16::from_le_bytes([data[2], data[3]]) >= 0x0201 {
            self.plan.push_front(descriptor(standard::BOS, 0, 0, 5));
        }
        let configure = self.plan.pop_back();
        for &index in data[14..17].iter().filter(|&&index| index != 0) {
            self.plan
                .push_back(descriptor(standard::STRING, index, standard::ENGLISH_US, 255));
        }
        self.plan.extend(configure);
    }

    fn learn_configuration(&mut self, data: &[u8]) {
        self.configuration = data.get(5).copied().unwrap_or(0);
        let mut rest = data;
        while let Some(&length) = rest.first().filter(|&&length| length >= 2) {
            let (this, after) = rest.split_at(usize::from(length).min(rest.len()));
            if this.len() >= 7 && this[1] == standard::ENDPOINT && this[3] & 0b11 == 2 {
                if this[2] & 0x80 == 0 {
                    self.bulk_out = this[2];
                } else {
                    self.bulk_in = this[2] & 0xF;
                }
            }
            rest = after;
        }
    }
}

/// The transaction that a transfer's stage asks for.
fn control_transaction(control: &Control) -> Transaction {
    match control.stage {
        Stage::Setup => Transaction::Setup(control.setup),
        Stage::DataIn | Stage::StatusIn => Transaction::In { endpoint: 0 },
        Stage::DataOut => {
            let rest = &control.data[control.sent..];
            Transaction::Out {
                endpoint: 0,
                toggle: control.toggle,
                data: rest[..rest.len().min(USB_PACKET_MAX)].to_vec(),
            }
        }
        Stage::StatusOut => Transaction::Out {
            endpoint: 0,
            toggle: true,
            data: Vec::new(),
        },
    }
}

/// Platform capability of MS OS 2.0: D8DD60DF-4589-4CC7-9CD2-659D9E648A9F.
const MICROSOFT_OS_2: [u8; 16] = [
    0xDF, 0x60, 0xDD, 0xD8, 0x89, 0x45, 0xC7, 0x4C, 0x9C, 0xD2, 0x65, 0x9D, 0x9E, 0x64, 0x8A, 0x9F,
];
/// Device capability type of a platform (USB 3.1 table 9-14).
const PLATFORM: u8 = 5;

/// The request code and the length of the Microsoft OS 2.0 set that a BOS descriptor promises.
fn microsoft_set(bos: &[u8]) -> Option<(u8, u16)> {
    let capability = split(bos.get(5..)?)
        .find(|this| this.len() >= 28 && this[2] == PLATFORM && this[4..20] == MICROSOFT_OS_2)?;
    Some((capability[26], word(capability, 24)))
}

/// Two bytes at `at`, little-endian; zero past the end.
fn word(bytes: &[u8], at: usize) -> u16 {
    let byte = |at| bytes.get(at).copied().unwrap_or(0);
    u16::from_le_bytes([byte(at), byte(at + 1)])
}

/// Descriptors one after the other, each as long as its first byte says; the last may be cut short.
fn split(mut bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    std::iter::from_fn(move || {
        let length = usize::from(*bytes.first()?).max(1);
        let (this, after) = bytes.split_at(length.min(bytes.len()));
        bytes = after;
        Some(this)
    })
}

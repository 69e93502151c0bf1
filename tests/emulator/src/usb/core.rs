//! The STM32's USB OTG full-speed core as a device, in FIFO mode: registers on one side, packets on the other, no time.
//! Source: RM0090 chapter 34; where it is silent, what drivers found on silicon (each place says so). Units: bytes,
//! 32-bit FIFO words. Limits: control and bulk endpoints (interrupt ones alike), no isochronous ones, no DMA, no host
//! mode; `EPDIS` and flushes take effect at once; an OUT endpoint takes packets by its NAK bit alone, `EPENA` or not,
//! because the silicon does and embassy's driver relies on it.

use std::collections::VecDeque;

#[allow(
    clippy::wildcard_imports,
    reason = "the manual's list of names; the lint does not fire in test builds"
)]
use super::registers::*;
use crate::constants::{OTG_ENDPOINTS, OTG_FIFO_WORDS, OTG_SETUP_RESERVE_WORDS};

/// What is wrong with how the firmware uses the core, in words for the list of gaps: (register, reason).
pub(super) type Complaint = (&'static str, &'static str);

/// The device's answer to a token.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Answer {
    /// It takes or has the data.
    Ack,
    Nak,
    Stall,
    /// Nothing: the host sees a time-out.
    Silence,
}

/// The toggle of a data packet: `false` is DATA0.
pub(super) type Toggle = bool;

#[derive(Debug, Default)]
struct Endpoint {
    ctl: u32,
    int: u32,
    tsiz: u32,
    /// The toggle of the next data packet.
    toggle: Toggle,
    /// IN only.
    fifo: VecDeque<u32>,
}

impl Endpoint {
    fn packets(&self) -> u32 {
        (self.tsiz & tsiz::PKTCNT) >> tsiz::PKTCNT_SHIFT
    }

    /// One packet of `bytes` went; answers how many are left of the transfer.
    fn count(&mut self, bytes: usize) -> u32 {
        let left = (self.tsiz & tsiz::XFRSIZ).saturating_sub(bytes as u32);
        let packets = self.packets().saturating_sub(1);
        self.tsiz = self.tsiz & tsiz::STUPCNT | packets << tsiz::PKTCNT_SHIFT | left;
        packets
    }

    fn is(&self, bits: u32) -> bool {
        self.ctl & bits != 0
    }

    /// Largest packet, bytes; endpoint 0 has a code of its own.
    fn packet_max(&self, number: usize) -> usize {
        if number == 0 {
            64 >> (self.ctl & 0b11)
        } else {
            (self.ctl & ctl::MPSIZ) as usize
        }
    }

    fn write_control(&mut self, value: u32, number: usize) {
        // EPENA is set by writing one and cleared by the core alone: it outlives a zero, and every reset of the bus
        // (found on silicon by the authors of tinyusb and embassy).
        self.ctl = value & ctl::PLAIN | self.ctl & (ctl::NAKSTS | ctl::EPENA);
        if number == 0 {
            self.ctl |= ctl::USBAEP;
        }
        if value & ctl::SNAK != 0 {
            self.ctl |= ctl::NAKSTS;
        } else if value & ctl::CNAK != 0 {
            self.ctl &= !ctl::NAKSTS;
        }
        if number != 0 && value & ctl::SD0PID != 0 {
            self.toggle = false;
        }
        if number != 0 && value & ctl::SD1PID != 0 {
            self.toggle = true;
        }
        if value & ctl::EPENA != 0 {
            self.ctl |= ctl::EPENA;
        }
        if value & ctl::EPDIS != 0 && self.is(ctl::EPENA) {
            self.ctl &= !ctl::EPENA;
            self.int |= int::EPDISD;
        }
    }

    fn control(&self) -> u32 {
        self.ctl | if self.toggle { ctl::DPID } else { 0 }
    }
}

/// An entry of the receive FIFO: a status word and what follows it.
#[derive(Debug)]
struct Received {
    status: u32,
    words: Vec<u32>,
}

/// The core.
#[expect(
    clippy::struct_excessive_bools,
    reason = "flags of parts that know nothing of each other"
)]
#[derive(Debug)]
pub(super) struct Core {
    gotgint: u32,
    gahbcfg: u32,
    gusbcfg: u32,
    flushed: u32,
    /// Bits of `GINTSTS` that stay until software clears them.
    pending: u32,
    gintmsk: u32,
    grxfsiz: u32,
    dieptxf: [u32; OTG_ENDPOINTS],
    gccfg: u32,
    dcfg: u32,
    /// The address that packets are compared with: a new one counts after the status stage.
    address: u8,
    dctl: u32,
    diepmsk: u32,
    doepmsk: u32,
    daintmsk: u32,
    diepempmsk: u32,
    pcgcctl: u32,
    ins: [Endpoint; OTG_ENDPOINTS],
    outs: [Endpoint; OTG_ENDPOINTS],
    received: VecDeque<Received>,
    /// Words of the entry whose status was popped last.
    popped: VecDeque<u32>,
    /// The SETUP phase ends with the token after the SETUP.
    in_setup_phase: bool,
    vbus: bool,
    is_suspended: bool,
    frame: u32,
    is_layout_checked: bool,
    complaints: Vec<Complaint>,
}

impl Core {
    /// Out of reset; `vbus` says whether a cable supplies it.
    pub(super) fn new(vbus: bool) -> Self {
        Self {
            gotgint: 0,
            gahbcfg: 0,
            gusbcfg: 0x0A00,
            flushed: 0,
            pending: 0,
            gintmsk: 0,
            grxfsiz: 0x200,
            dieptxf: [0x0200_0200; OTG_ENDPOINTS],
            gccfg: 0,
            dcfg: 0x0220_0000,
            address: 0,
            dctl: 0,
            diepmsk: 0,
            doepmsk: 0,
            daintmsk: 0,
            diepempmsk: 0,
            pcgcctl: 0,
            ins: Default::default(),
            outs: Default::default(),
            received: VecDeque::new(),
            popped: VecDeque::new(),
            in_setup_phase: false,
            vbus,
            is_suspended: false,
            frame: 0,
            is_layout_checked: false,
            complaints: Vec::new(),
        }
    }

    /// The word at `offset`; reading `GRXSTSP` and the FIFOs takes what was read away.
    pub(super) fn read(&mut self, offset: u64) -> u32 {
        match offset {
            GOTGCTL => gotgctl::CIDSTS | if self.in_session() { gotgctl::BSVLD } else { 0 },
            GOTGINT => self.gotgint,
            GAHBCFG => self.gahbcfg,
            GUSBCFG => self.gusbcfg,
            GRSTCTL => grstctl::AHBIDL | self.flushed << grstctl::TXFNUM_SHIFT,
            GINTSTS => self.interrupts(),
            GINTMSK => self.gintmsk,
            GRXSTSR => self.received.front().map_or(0, |entry| entry.status),
            GRXSTSP => self.pop(),
            GRXFSIZ => self.grxfsiz,
            DIEPTXF0 => self.dieptxf[0],
            DIEPTXF1..=DIEPTXF3 => self.dieptxf[1 + (offset - DIEPTXF1) as usize / 4],
            GCCFG => self.gccfg,
            CID => CID_VALUE,
            DCFG => self.dcfg,
            DCTL => self.dctl,
            DSTS => {
                let suspended = if self.is_suspended { dsts::SUSPSTS } else { 0 };
                suspended | dsts::ENUMSPD_FULL | self.frame << dsts::FNSOF_SHIFT
            }
            DIEPMSK => self.diepmsk,
            DOEPMSK => self.doepmsk,
            DAINT => self.endpoint_interrupts(),
            DAINTMSK => self.daintmsk,
            DIEPEMPMSK => self.diepempmsk,
            IN_ENDPOINTS..OUT_ENDPOINTS => self.read_in(offset - IN_ENDPOINTS),
            OUT_ENDPOINTS..PCGCCTL => self.read_out(offset - OUT_ENDPOINTS),
            PCGCCTL => self.pcgcctl,
            FIFOS.. => self.popped.pop_front().unwrap_or_else(|| {
                self.complain("FIFO", "read past the packet whose status was popped");
                0
            }),
            HWCFG4 => 0,
            _ => {
                self.complain("any", "read of a register that the model does not have");
                0
            }
        }
    }

    fn read_in(&self, offset: u64) -> u32 {
        let Some(endpoint) = self.ins.get((offset / ENDPOINT_BYTES) as usize) else {
            return 0;
        };
        match offset % ENDPOINT_BYTES {
            endpoint::CTL => endpoint.control(),
            endpoint::INT => endpoint.int | self.fifo_empty((offset / ENDPOINT_BYTES) as usize),
            endpoint::TSIZ => endpoint.tsiz,
            endpoint::TXFSTS => self.room((offset / ENDPOINT_BYTES) as usize),
            _ => 0,
        }
    }

    fn read_out(&self, offset: u64) -> u32 {
        let Some(endpoint) = self.outs.get((offset / ENDPOINT_BYTES) as usize) else {
            return 0;
        };
        match offset % ENDPOINT_BYTES {
            endpoint::CTL => endpoint.control(),
            endpoint::INT => endpoint.int,
            endpoint::TSIZ => endpoint.tsiz,
            _ => 0,
        }
    }

    /// Writes the word at `offset`.
    pub(super) fn write(&mut self, offset: u64, value: u32) {
        match offset {
            GOTGINT => {
                self.gotgint &= !value;
                if self.gotgint == 0 {
                    self.pending &= !gint::OTGINT;
                }
            }
            GAHBCFG => self.gahbcfg = value,
            GUSBCFG => self.gusbcfg = value,
            GRSTCTL => self.write_reset(value),
            GINTSTS => self.pending &= !(value & gint::WRITE_CLEARS),
            GINTMSK => self.gintmsk = value,
            GRXFSIZ => self.grxfsiz = value & 0xFFFF,
            DIEPTXF0 => self.dieptxf[0] = value,
            DIEPTXF1..=DIEPTXF3 => self.dieptxf[1 + (offset - DIEPTXF1) as usize / 4] = value,
            GCCFG => {
                let had_session = self.in_session();
                self.gccfg = value;
                self.session_changed(had_session);
            }
            DCFG => {
                self.dcfg = value;
                // Zero counts at once; another address after the status stage that carries its acknowledgement.
                if value & dcfg::DAD == 0 {
                    self.address = 0;
                }
            }
            DCTL => self.write_device_control(value),
            DIEPMSK => self.diepmsk = value,
            DOEPMSK => self.doepmsk = value,
            DAINTMSK => self.daintmsk = value,
            DIEPEMPMSK => self.diepempmsk = value,
            IN_ENDPOINTS..OUT_ENDPOINTS => self.write_in(offset - IN_ENDPOINTS, value),
            OUT_ENDPOINTS..PCGCCTL => self.write_out(offset - OUT_ENDPOINTS, value),
            PCGCCTL => self.pcgcctl = value,
            FIFOS.. => self.fill(((offset - FIFOS) / FIFO_BYTES) as usize, value),
            _ => self.complain("any", "write to a register that the model does not have"),
        }
    }

    fn write_reset(&mut self, value: u32) {
        self.flushed = value >> grstctl::TXFNUM_SHIFT & grstctl::TXFNUM;
        if value & grstctl::CSRST != 0 {
            *self = Self {
                gusbcfg: self.gusbcfg,
                gccfg: self.gccfg,
                is_suspended: self.is_suspended,
                frame: self.frame,
                complaints: std::mem::take(&mut self.complaints),
                ..Self::new(self.vbus)
            };
        }
        if value & grstctl::TXFFLSH != 0 {
            for (number, endpoint) in self.ins.iter_mut().enumerate() {
                if self.flushed == grstctl::ALL_FIFOS || self.flushed as usize == number {
                    endpoint.fifo.clear();
                }
            }
        }
        if value & grstctl::RXFFLSH != 0 {
            self.received.clear();
            self.popped.clear();
        }
    }

    fn write_device_control(&mut self, value: u32) {
        let mut status = self.dctl & dctl::STATUS;
        if value & dctl::SGINAK != 0 {
            status |= dctl::GINSTS;
            self.pending |= gint::GINAKEFF;
        }
        if value & dctl::CGINAK != 0 {
            status &= !dctl::GINSTS;
            self.pending &= !gint::GINAKEFF;
        }
        if value & dctl::SGONAK != 0 && status & dctl::GONSTS == 0 {
            status |= dctl::GONSTS;
            self.push(0, pktsts::GLOBAL_OUT_NAK, &[]);
        }
        if value & dctl::CGONAK != 0 {
            status &= !dctl::GONSTS;
            self.pending &= !gint::GONAKEFF;
        }
        self.dctl = value & !dctl::COMMANDS & !dctl::STATUS | status;
    }

    fn write_in(&mut self, offset: u64, value: u32) {
        let number = (offset / ENDPOINT_BYTES) as usize;
        let Some(endpoint) = self.ins.get_mut(number) else {
            return;
        };
        match offset % ENDPOINT_BYTES {
            endpoint::CTL => {
                endpoint.write_control(value, number);
                if value & ctl::SNAK != 0 {
                    endpoint.int |= int::INEPNE;
                }
            }
            endpoint::INT => endpoint.int &= !value,
            endpoint::TSIZ => endpoint.tsiz = value & !tsiz::STUPCNT,
            _ => {}
        }
    }

    fn write_out(&mut self, offset: u64, value: u32) {
        let number = (offset / ENDPOINT_BYTES) as usize;
        let Some(endpoint) = self.outs.get_mut(number) else {
            return;
        };
        match offset % ENDPOINT_BYTES {
            endpoint::CTL => {
                let done = number as u32 | pktsts::OUT_DONE << 17;
                if value & (ctl::CNAK | ctl::SNAK) == ctl::CNAK
                    && endpoint.is(ctl::NAKSTS)
                    && self.received.iter().any(|entry| entry.status == done)
                {
                    self.complain(
                        "DOEPCTL",
                        "NAK cleared before the end of the transfer was popped: cores of this id may lose a word then \
                         (libopencm3 issue 873)",
                    );
                }
                self.outs[number].write_control(value, number);
            }
            endpoint::INT => endpoint.int &= !value,
            endpoint::TSIZ => endpoint.tsiz = value,
            _ => {}
        }
    }

    fn fill(&mut self, number: usize, word: u32) {
        if number < OTG_ENDPOINTS && self.room(number) > 0 {
            self.ins[number].fifo.push_back(word);
        } else {
            self.complain("FIFO", "a transmit FIFO was filled past its end");
        }
    }

    /// Words that still fit into the transmit FIFO of `number`.
    fn room(&self, number: usize) -> u32 {
        (self.dieptxf[number] >> 16).saturating_sub(self.ins[number].fifo.len() as u32)
    }

    /// `TXFE` when the transmit FIFO of `number` is empty, or half empty where software asks for that.
    fn fifo_empty(&self, number: usize) -> u32 {
        let limit = if self.gahbcfg & gahbcfg::TXFELVL == 0 {
            (self.dieptxf[number] >> 16) / 2
        } else {
            0
        };
        if self.ins[number].fifo.len() as u32 <= limit {
            int::TXFE
        } else {
            0
        }
    }

    fn endpoint_interrupts(&self) -> u32 {
        let mut bits = 0;
        for number in 0..OTG_ENDPOINTS {
            let mut raised = self.ins[number].int & self.diepmsk;
            if self.diepempmsk >> number & 1 != 0 {
                raised |= self.fifo_empty(number);
            }
            bits |= u32::from(raised != 0) << number;
            bits |= u32::from(self.outs[number].int & self.doepmsk != 0) << (16 + number);
        }
        bits
    }

    fn interrupts(&self) -> u32 {
        let endpoints = self.endpoint_interrupts() & self.daintmsk;
        let mut bits = self.pending;
        if !self.received.is_empty() && self.popped.is_empty() {
            bits |= gint::RXFLVL;
        }
        if endpoints & 0xFFFF != 0 {
            bits |= gint::IEPINT;
        }
        if endpoints >> 16 != 0 {
            bits |= gint::OEPINT;
        }
        bits
    }

    /// The level of the core's interrupt line.
    pub(super) fn interrupt(&self) -> bool {
        self.gahbcfg & gahbcfg::GINTMSK != 0 && self.interrupts() & self.gintmsk != 0
    }

    /// What the firmware did that the core cannot stand, since the last call.
    pub(super) fn take_complaints(&mut self) -> Vec<Complaint> {
        std::mem::take(&mut self.complaints)
    }

    fn complain(&mut self, register: &'static str, reason: &'static str) {
        self.complaints.push((register, reason));
    }

    // The receive FIFO.

    fn pop(&mut self) -> u32 {
        let Some(entry) = self.received.pop_front() else {
            return 0;
        };
        if !self.popped.is_empty() {
            self.complain(
                "GRXSTSP",
                "popped with words of the packet before still in the FIFO",
            );
        }
        self.popped = entry.words.into();
        let endpoint = &mut self.outs[(entry.status & 0xF) as usize];
        match entry.status >> 17 & 0xF {
            pktsts::OUT_DONE => {
                endpoint.int |= int::XFRC;
                endpoint.ctl &= !ctl::EPENA;
            }
            pktsts::SETUP_DONE => endpoint.int |= int::STUP,
            pktsts::GLOBAL_OUT_NAK => self.pending |= gint::GONAKEFF,
            _ => {}
        }
        entry.status
    }

    fn push(&mut self, number: usize, state: u32, data: &[u8]) {
        let words = data
            .chunks(4)
            .map(|chunk| {
                let mut word = [0; 4];
                word[..chunk.len()].copy_from_slice(chunk);
                u32::from_le_bytes(word)
            })
            .collect();
        let status = number as u32 | (data.len() as u32) << 4 | state << 17;
        self.received.push_back(Received { status, words });
    }

    /// Words of the receive FIFO that are free.
    fn free_words(&self) -> usize {
        let used: usize = self.received.iter().map(|entry| 1 + entry.words.len()).sum();
        (self.grxfsiz as usize).saturating_sub(used + self.popped.len())
    }

    // The bus.

    /// Whether the pull-up on D+ is on: transceiver powered, in a session, not told to be away.
    pub(super) fn is_pulled_up(&self) -> bool {
        self.gccfg & gccfg::PWRDWN != 0 && self.in_session() && self.dctl & dctl::SDIS == 0
    }

    /// Whether the core believes that a host supplies the bus.
    fn in_session(&self) -> bool {
        self.gccfg & gccfg::NOVBUSSENS != 0 || self.gccfg & gccfg::VBUSBSEN != 0 && self.vbus
    }

    fn session_changed(&mut self, had_session: bool) {
        match (had_session, self.in_session()) {
            (false, true) => self.pending |= gint::SRQINT,
            (true, false) => {
                self.gotgint |= gotgint::SEDET;
                self.pending |= gint::OTGINT;
            }
            _ => {}
        }
    }

    /// A cable came or went.
    pub(super) fn set_vbus(&mut self, vbus: bool) {
        let had_session = self.in_session();
        self.vbus = vbus;
        self.session_changed(had_session);
    }

    /// The host drives a reset.
    pub(super) fn bus_reset(&mut self) {
        for number in 1..OTG_ENDPOINTS {
            self.ins[number].ctl &= !ctl::USBAEP;
            self.outs[number].ctl &= !ctl::USBAEP;
        }
        for endpoint in [&mut self.ins[0], &mut self.outs[0]] {
            endpoint.ctl = endpoint.ctl & !ctl::STALL | ctl::NAKSTS | ctl::USBAEP;
        }
        self.dcfg &= !dcfg::DAD;
        self.address = 0;
        self.is_suspended = false;
        self.in_setup_phase = false;
        self.is_layout_checked = false;
        self.pending |= gint::USBRST;
    }

    /// The host's reset is over and the speed is known.
    pub(super) fn enumeration_done(&mut self) {
        self.pending |= gint::ENUMDNE;
    }

    /// Nothing happened on the bus for 3 ms.
    pub(super) fn suspend(&mut self) {
        self.is_suspended = true;
        self.pending |= gint::ESUSP | gint::USBSUSP;
    }

    /// The host drives the bus again.
    pub(super) fn resume(&mut self) {
        self.is_suspended = false;
        self.pending |= gint::WKUPINT;
    }

    /// A frame begins.
    pub(super) fn start_of_frame(&mut self) {
        self.frame = (self.frame + 1) & dsts::FNSOF;
        self.pending |= gint::SOF | gint::EOPF;
    }

    /// A SETUP token: the core takes it whatever its endpoint's bits say.
    pub(super) fn setup_token(&self, address: u8) -> Answer {
        if address == self.address && self.free_words() >= 3 {
            Answer::Ack
        } else {
            Answer::Silence
        }
    }

    /// The data packet after a SETUP token that was answered with [`Answer::Ack`].
    pub(super) fn setup(&mut self, data: [u8; 8]) {
        self.check_layout();
        let left = (self.outs[0].tsiz & tsiz::STUPCNT) >> tsiz::STUPCNT_SHIFT;
        let left = left.saturating_sub(1) << tsiz::STUPCNT_SHIFT;
        self.outs[0].tsiz = self.outs[0].tsiz & !tsiz::STUPCNT | left;
        for endpoint in [&mut self.ins[0], &mut self.outs[0]] {
            endpoint.ctl = endpoint.ctl & !ctl::STALL | ctl::NAKSTS;
            endpoint.toggle = true;
        }
        self.push(0, pktsts::SETUP_DATA, &data);
        self.in_setup_phase = true;
    }

    fn end_setup_phase(&mut self, number: usize) {
        if number == 0 && std::mem::take(&mut self.in_setup_phase) {
            self.push(0, pktsts::SETUP_DONE, &[]);
        }
    }

    /// An OUT token for a packet of `bytes`: whether its data will be taken, decided before they come.
    pub(super) fn out_token(&mut self, address: u8, number: usize, bytes: usize) -> Answer {
        if address != self.address {
            return Answer::Silence;
        }
        self.end_setup_phase(number);
        let needed = 2 + bytes.div_ceil(4) + OTG_SETUP_RESERVE_WORDS;
        match self.outs.get(number) {
            Some(endpoint) if endpoint.is(ctl::USBAEP) => {
                if endpoint.is(ctl::STALL) {
                    Answer::Stall
                } else if endpoint.is(ctl::NAKSTS)
                    || self.dctl & dctl::GONSTS != 0
                    || self.free_words() < needed
                {
                    Answer::Nak
                } else {
                    Answer::Ack
                }
            }
            _ => Answer::Silence,
        }
    }

    /// The data packet after an OUT token that was answered with [`Answer::Ack`]. Answers whether it was new.
    pub(super) fn out_data(&mut self, number: usize, toggle: Toggle, data: &[u8]) -> bool {
        let endpoint = &mut self.outs[number];
        if endpoint.toggle != toggle {
            // The host sent it again because it did not hear the acknowledgement.
            return false;
        }
        endpoint.toggle = !toggle;
        let is_last = endpoint.count(data.len()) == 0 || data.len() < endpoint.packet_max(number);
        if is_last || number == 0 {
            endpoint.ctl |= ctl::NAKSTS;
        }
        self.push(number, pktsts::OUT_DATA, data);
        if is_last {
            self.push(number, pktsts::OUT_DONE, &[]);
        }
        true
    }

    /// An IN token: the packet that the device sends, or its handshake.
    pub(super) fn in_token(&mut self, address: u8, number: usize) -> Result<(Toggle, Vec<u8>), Answer> {
        if address != self.address {
            return Err(Answer::Silence);
        }
        self.end_setup_phase(number);
        let endpoint = match self.ins.get_mut(number) {
            Some(endpoint) if endpoint.is(ctl::USBAEP) => endpoint,
            _ => return Err(Answer::Silence),
        };
        if endpoint.is(ctl::STALL) {
            return Err(Answer::Stall);
        }
        if endpoint.is(ctl::NAKSTS) || self.dctl & dctl::GINSTS != 0 {
            return Err(Answer::Nak);
        }
        let bytes = ((endpoint.tsiz & tsiz::XFRSIZ) as usize).min(endpoint.packet_max(number));
        if !endpoint.is(ctl::EPENA) || endpoint.fifo.len() < bytes.div_ceil(4) {
            if endpoint.fifo.is_empty() {
                endpoint.int |= int::ITTXFE;
            }
            return Err(Answer::Nak);
        }
        let words = endpoint.fifo.iter().take(bytes.div_ceil(4));
        let mut data: Vec<u8> = words.flat_map(|word| word.to_le_bytes()).collect();
        data.truncate(bytes);
        Ok((endpoint.toggle, data))
    }

    /// The host acknowledged the packet of `bytes` that [`Core::in_token`] gave.
    pub(super) fn in_acknowledged(&mut self, number: usize, bytes: usize) {
        let endpoint = &mut self.ins[number];
        let words = bytes.div_ceil(4).min(endpoint.fifo.len());
        endpoint.fifo.drain(..words);
        endpoint.toggle = !endpoint.toggle;
        if endpoint.count(bytes) == 0 {
            endpoint.ctl = endpoint.ctl & !ctl::EPENA | ctl::NAKSTS;
            endpoint.int |= int::XFRC;
        }
        if number == 0 {
            self.address = (self.dcfg >> dcfg::DAD_SHIFT & 0x7F) as u8;
        }
    }

    /// The FIFOs must lie side by side in the core's memory; looked at with the first SETUP after a reset.
    fn check_layout(&mut self) {
        if std::mem::replace(&mut self.is_layout_checked, true) {
            return;
        }
        let mut areas = vec![(0, self.grxfsiz)];
        for (number, words) in self.dieptxf.iter().enumerate() {
            if self.daintmsk >> number & 1 != 0 {
                areas.push((words & 0xFFFF, words >> 16));
            }
        }
        areas.sort_unstable();
        let overlap = areas.windows(2).any(|pair| pair[0].0 + pair[0].1 > pair[1].0);
        let is_outside = areas.iter().any(|(start, words)| start + words > OTG_FIFO_WORDS);
        if overlap || is_outside {
            self.complain("DIEPTXF", "FIFOs overlap or reach past the core's 320 words");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OUT_1: u64 = OUT_ENDPOINTS + ENDPOINT_BYTES;
    const IN_1: u64 = IN_ENDPOINTS + ENDPOINT_BYTES;

    /// A core as a driver leaves it: FIFOs in place, endpoint 1 open both ways and ready for one packet.
    fn ready() -> Core {
        let mut core = Core::new(true);
        core.write(GCCFG, gccfg::PWRDWN | gccfg::NOVBUSSENS);
        core.write(GRXFSIZ, 62);
        core.write(DIEPTXF0, area(16, 62));
        core.write(DIEPTXF1, area(16, 78));
        core.bus_reset();
        core.write(DAINTMSK, 0x0003_0003);
        core.write(GAHBCFG, gahbcfg::GINTMSK);
        core.write(GINTSTS, u32::MAX);
        core.write(
            IN_1,
            64 | ctl::USBAEP | 2 << 18 | 1 << 22 | ctl::SNAK | ctl::SD0PID,
        );
        arm(&mut core);
        core.take_complaints();
        core
    }

    /// A transmit FIFO of so many words from this one on.
    fn area(words: u32, start: u32) -> u32 {
        words << 16 | start
    }

    fn arm(core: &mut Core) {
        core.write(OUT_1 + endpoint::TSIZ, 1 << tsiz::PKTCNT_SHIFT | 64);
        core.write(OUT_1, 64 | ctl::USBAEP | 2 << 18 | ctl::CNAK);
    }

    fn load(core: &mut Core, data: &[u8]) {
        core.write(IN_1 + endpoint::TSIZ, 1 << tsiz::PKTCNT_SHIFT | data.len() as u32);
        core.write(
            IN_1,
            64 | ctl::USBAEP | 2 << 18 | 1 << 22 | ctl::CNAK | ctl::EPENA,
        );
        for chunk in data.chunks(4) {
            let mut word = [0; 4];
            word[..chunk.len()].copy_from_slice(chunk);
            core.write(FIFOS + FIFO_BYTES, u32::from_le_bytes(word));
        }
    }

    #[test]
    fn an_out_packet_lies_in_the_fifo_as_status_words_and_end() {
        let mut core = ready();
        core.write(GINTMSK, gint::RXFLVL);
        assert!(!core.interrupt());
        assert_eq!(core.out_token(0, 1, 5), Answer::Ack);
        assert!(core.out_data(1, false, &[1, 2, 3, 4, 5]));
        assert!(core.interrupt());
        // RM0090 section 34.16.2: endpoint, byte count, data PID left out, packet status.
        assert_eq!(core.read(GRXSTSP), 1 | 5 << 4 | 2 << 17);
        assert!(!core.interrupt(), "the words come first");
        assert_eq!((core.read(FIFOS), core.read(FIFOS)), (0x0403_0201, 0x05));
        assert_eq!(core.out_token(0, 1, 5), Answer::Nak, "one packet was asked for");
        assert_eq!(core.read(OUT_1 + endpoint::INT) & int::XFRC, 0);
        assert_eq!(core.read(GRXSTSP), 1 | 3 << 17);
        assert_eq!(core.read(OUT_1 + endpoint::INT), int::XFRC);
        assert_eq!(core.read(OUT_1 + endpoint::TSIZ), 59, "bytes that did not come");
        arm(&mut core);
        assert_eq!(core.out_token(0, 1, 64), Answer::Ack);
        assert!(
            !core.out_data(1, false, &[1, 2, 3, 4, 5]),
            "a repetition is no packet"
        );
        assert!(core.out_data(1, true, &[]));
        assert_eq!(core.take_complaints(), []);
    }

    #[test]
    fn clearing_nak_before_the_end_was_popped_is_reported() {
        let mut core = ready();
        core.out_data(1, false, &[1]);
        core.read(GRXSTSP);
        core.read(FIFOS);
        arm(&mut core);
        assert!(core.take_complaints()[0].1.contains("873"));
    }

    #[test]
    fn a_full_receive_fifo_puts_the_host_off_and_still_takes_a_setup() {
        let mut core = ready();
        // 62 words hold one packet and its end; with the ten for SETUPs there is no room for three.
        for packets in 0..3 {
            arm(&mut core);
            let expected = if packets < 2 { Answer::Ack } else { Answer::Nak };
            assert_eq!(core.out_token(0, 1, 64), expected, "after {packets}");
            if expected == Answer::Ack {
                core.out_data(1, packets % 2 == 1, &[0; 64]);
            }
        }
        assert_eq!(core.setup_token(0), Answer::Ack);
    }

    #[test]
    fn a_setup_is_taken_whatever_the_endpoint_says_and_ends_with_the_next_token() {
        let mut core = ready();
        core.write(OUT_ENDPOINTS, ctl::STALL | ctl::SNAK);
        core.write(OUT_ENDPOINTS + endpoint::TSIZ, 3 << tsiz::STUPCNT_SHIFT);
        assert_eq!(core.setup_token(1), Answer::Silence, "for another address");
        assert_eq!(core.setup_token(0), Answer::Ack);
        core.setup([1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(core.read(OUT_ENDPOINTS) & ctl::STALL, 0);
        assert_eq!(
            core.read(OUT_ENDPOINTS + endpoint::TSIZ) >> tsiz::STUPCNT_SHIFT,
            2
        );
        assert_eq!(core.read(GRXSTSP), 8 << 4 | 6 << 17);
        assert_eq!((core.read(FIFOS), core.read(FIFOS)), (0x0403_0201, 0x0807_0605));
        assert_eq!(core.read(GRXSTSP), 0, "the stage is not over");
        assert_eq!(core.in_token(0, 0), Err(Answer::Nak));
        assert_eq!(core.read(GRXSTSP), 4 << 17);
        assert_eq!(core.read(OUT_ENDPOINTS + endpoint::INT), int::STUP);
    }

    #[test]
    fn an_in_packet_goes_when_it_is_whole_and_toggles_when_it_was_heard() {
        let mut core = ready();
        assert_eq!(core.in_token(0, 1), Err(Answer::Nak));
        load(&mut core, &[1, 2, 3, 4, 5]);
        assert_eq!(core.in_token(0, 1), Ok((false, vec![1, 2, 3, 4, 5])));
        assert_eq!(
            core.in_token(0, 1),
            Ok((false, vec![1, 2, 3, 4, 5])),
            "it was not acknowledged"
        );
        core.in_acknowledged(1, 5);
        assert_eq!(core.read(IN_1) & (ctl::EPENA | ctl::DPID), ctl::DPID);
        assert_eq!(core.read(IN_1 + endpoint::INT) & int::XFRC, int::XFRC);
        load(&mut core, &[]);
        assert_eq!(core.in_token(0, 1), Ok((true, vec![])), "a packet of nothing");
    }

    #[test]
    fn a_loaded_endpoint_stays_enabled_through_a_reset_until_it_is_disabled() {
        let mut core = ready();
        load(&mut core, &[1]);
        core.bus_reset();
        core.write(IN_1, 64 | 2 << 18 | 1 << 22 | ctl::SNAK);
        assert_eq!(core.read(IN_1) & (ctl::EPENA | ctl::USBAEP), ctl::EPENA);
        core.write(IN_1, 64 | ctl::EPDIS | ctl::SNAK);
        assert_eq!(core.read(IN_1) & ctl::EPENA, 0);
        assert_eq!(core.read(IN_1 + endpoint::INT) & int::EPDISD, int::EPDISD);
    }

    #[test]
    fn a_new_address_counts_after_the_status_stage() {
        let mut core = ready();
        core.setup([0, 5, 9, 0, 0, 0, 0, 0]);
        core.write(DCFG, 9 << dcfg::DAD_SHIFT);
        core.write(IN_ENDPOINTS + endpoint::TSIZ, 1 << tsiz::PKTCNT_SHIFT);
        core.write(IN_ENDPOINTS, ctl::CNAK | ctl::EPENA);
        assert_eq!(core.in_token(9, 0), Err(Answer::Silence));
        assert_eq!(core.in_token(0, 0), Ok((true, vec![])));
        core.in_acknowledged(0, 0);
        assert_eq!(
            (core.setup_token(0), core.setup_token(9)),
            (Answer::Silence, Answer::Ack)
        );
    }

    #[test]
    fn fifos_that_overlap_are_reported() {
        let mut core = ready();
        core.write(DIEPTXF1, area(16, 77));
        core.setup([0; 8]);
        assert!(core.take_complaints()[0].1.contains("overlap"));
    }

    #[test]
    fn the_pull_up_follows_power_session_and_soft_disconnect() {
        let mut core = Core::new(false);
        core.write(GCCFG, gccfg::PWRDWN | gccfg::VBUSBSEN);
        assert!(!core.is_pulled_up(), "no supply from a cable");
        core.set_vbus(true);
        assert!(core.is_pulled_up());
        assert_eq!(core.read(GINTSTS) & gint::SRQINT, gint::SRQINT);
        core.write(DCTL, dctl::SDIS);
        assert!(!core.is_pulled_up());
        core.set_vbus(false);
        assert_eq!(core.read(GOTGINT), gotgint::SEDET);
        core.write(GCCFG, gccfg::PWRDWN | gccfg::NOVBUSSENS);
        core.write(DCTL, 0);
        assert!(core.is_pulled_up(), "the supply is not looked at");
    }
}

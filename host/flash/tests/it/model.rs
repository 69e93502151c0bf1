//! A chip in ST's bootloader, after AN3156 and DFU 1.1: its states, its flash of an STM32F405 (erased in sectors, programmed from ones
//! to zeros), and what goes wrong with it.

use gripline_flash::dfu::{Wire, WireError};
use gripline_flash::image::FLASH;
use gripline_flash::layout::{Sector, sectors};

/// The longest block of the STM32F4's bootloader.
pub(crate) const TRANSFER_BYTES: u16 = 2_048;
pub(crate) const LAYOUT: &str = "@Internal Flash  /0x08000000/04*016Kg,01*064Kg,07*128Kg";
const FLASH_BYTES: usize = 1 << 20;

const IDLE: u8 = 2;
const DOWNLOAD_SYNC: u8 = 3;
const DOWNLOAD_BUSY: u8 = 4;
const DOWNLOAD_IDLE: u8 = 5;
const MANIFEST: u8 = 7;
const UPLOAD_IDLE: u8 = 9;
const ERROR: u8 = 10;

const ERR_TARGET: u8 = 0x01;
const ERR_ERASE: u8 = 0x04;
const ERR_PROGRAM: u8 = 0x06;
const ERR_ADDRESS: u8 = 0x08;
const ERR_STALLED: u8 = 0x0F;

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum InjectedFault {
    None,
    /// The power goes at this request; what it was to do is done to this many bytes.
    PowerCut {
        at_request: usize,
        bytes: usize,
    },
    /// This erasure fails.
    EraseFails {
        number: usize,
    },
    /// This block of data cannot be programmed.
    WriteFails {
        number: usize,
    },
    /// One bit of this block of data is programmed otherwise.
    BitFlips {
        number: usize,
    },
    /// It does nothing but be busy from this erasure on.
    Hangs {
        number: usize,
    },
}

/// What a command or block is to do once the host asks for the status.
#[derive(Debug, Clone)]
enum Work {
    Nothing,
    Erase(u32),
    Program(u32, Vec<u8>),
}

#[derive(Debug)]
pub(crate) struct Chip {
    pub(crate) flash: Vec<u8>,
    sectors: Vec<Sector>,
    state: u8,
    code: u8,
    address: u32,
    work: Work,
    busy_polls: u32,
    pub(crate) fault: InjectedFault,
    pub(crate) requests: usize,
    erasures: usize,
    blocks: usize,
    is_gone: bool,
    /// Where the host had it start.
    pub(crate) started: Option<u32>,
    pub(crate) waited_ms: u64,
    /// Sectors erased, in order.
    pub(crate) erased: Vec<u32>,
}

impl Chip {
    pub(crate) fn new(flash: Vec<u8>) -> Self {
        assert_eq!(flash.len(), FLASH_BYTES);
        Self {
            flash,
            sectors: sectors(LAYOUT).unwrap(),
            state: IDLE,
            code: 0,
            address: FLASH,
            work: Work::Nothing,
            busy_polls: 0,
            fault: InjectedFault::None,
            requests: 0,
            erasures: 0,
            blocks: 0,
            is_gone: false,
            started: None,
            waited_ms: 0,
            erased: Vec::new(),
        }
    }

    /// As it comes from the factory.
    pub(crate) fn empty() -> Self {
        Self::new(vec![0xFF; FLASH_BYTES])
    }

    /// Power goes and comes back with BOOT0 high: the flash stays.
    pub(crate) fn power_cycled(self) -> Self {
        Self::new(self.flash)
    }

    /// Left in the middle of something by another program.
    pub(crate) fn left_in_error(mut self) -> Self {
        self.state = ERROR;
        self.code = ERR_STALLED;
        self
    }

    /// Whether a reset starts a program: a stack pointer in RAM and a reset vector into flash.
    pub(crate) fn starts(&self) -> bool {
        let word = |at: usize| u32::from_le_bytes(self.flash[at..at + 4].try_into().unwrap());
        (0x1000_0000..0x2002_0001).contains(&word(0))
            && (FLASH..FLASH + FLASH_BYTES as u32).contains(&word(4))
    }

    fn refuse(&mut self, code: u8) -> WireError {
        self.state = ERROR;
        self.code = code;
        WireError::Stalled
    }

    /// Counts a request; the device may be gone, or go now.
    fn is_there(&mut self) -> Result<bool, WireError> {
        if self.is_gone {
            return Err(WireError::Gone("no such device".to_owned()));
        }
        let cut =
            matches!(self.fault, InjectedFault::PowerCut { at_request, .. } if at_request == self.requests);
        self.requests += 1;
        self.is_gone = cut;
        Ok(!cut)
    }

    fn sector_of(&self, address: u32) -> Option<Sector> {
        let found = self
            .sectors
            .iter()
            .find(|one| (one.address..one.end()).contains(&address));
        found.copied()
    }

    fn begin(&mut self) {
        self.state = DOWNLOAD_BUSY;
        self.busy_polls = 2;
        match self.work.clone() {
            Work::Nothing => self.busy_polls = 1,
            Work::Erase(address) => {
                let number = self.erasures;
                self.erasures += 1;
                if matches!(self.fault, InjectedFault::Hangs { number: at } if at <= number) {
                    self.busy_polls = u32::MAX;
                }
                if self.fault == (InjectedFault::EraseFails { number }) {
                    self.state = ERROR;
                    self.code = ERR_ERASE;
                    return;
                }
                self.erase(address, usize::MAX);
            }
            Work::Program(address, data) => {
                let number = self.blocks;
                self.blocks += 1;
                if self.fault == (InjectedFault::WriteFails { number }) {
                    self.program(address, &data[..data.len() / 2]);
                    self.state = ERROR;
                    self.code = ERR_PROGRAM;
                    return;
                }
                self.program(address, &data);
                if self.fault == (InjectedFault::BitFlips { number }) {
                    self.flash[(address - FLASH) as usize + data.len() / 2] ^= 1;
                }
            }
        }
    }

    /// At most this many bytes of the sector.
    fn erase(&mut self, address: u32, bytes: usize) {
        let sector = self.sector_of(address).expect("it was checked");
        self.erased.push(sector.address);
        let from = (sector.address - FLASH) as usize;
        let to = from + bytes.min(sector.bytes as usize);
        self.flash[from..to].fill(0xFF);
    }

    fn program(&mut self, address: u32, data: &[u8]) {
        for (at, byte) in ((address - FLASH) as usize..).zip(data) {
            self.flash[at] &= byte;
        }
    }
}

impl Wire for Chip {
    fn send(&mut self, request: u8, value: u16, data: &[u8]) -> Result<(), WireError> {
        if !self.is_there()? {
            return Err(WireError::Gone("no such device".to_owned()));
        }
        assert!(data.len() <= usize::from(TRANSFER_BYTES));
        match (request, self.state) {
            (1, IDLE | DOWNLOAD_IDLE) => {
                self.work = match (value, data) {
                    (0, []) => {
                        // Leave.
                        self.started = Some(self.address);
                        self.state = MANIFEST;
                        return Ok(());
                    }
                    (0, [0x21, address @ ..]) if address.len() == 4 => {
                        let address = u32::from_le_bytes(address.try_into().unwrap());
                        if self.sector_of(address).is_none() {
                            return Err(self.refuse(ERR_ADDRESS));
                        }
                        self.address = address;
                        Work::Nothing
                    }
                    (0, [0x41, address @ ..]) if address.len() == 4 => {
                        let address = u32::from_le_bytes(address.try_into().unwrap());
                        if self.sector_of(address).is_none() {
                            return Err(self.refuse(ERR_ADDRESS));
                        }
                        Work::Erase(address)
                    }
                    (2.., data) => {
                        let address = self.address + u32::from(value - 2) * u32::from(TRANSFER_BYTES);
                        let last = address + data.len() as u32 - 1;
                        if self.sector_of(address).is_none() || self.sector_of(last).is_none() {
                            return Err(self.refuse(ERR_ADDRESS));
                        }
                        Work::Program(address, data.to_vec())
                    }
                    _ => return Err(self.refuse(ERR_TARGET)),
                };
                self.state = DOWNLOAD_SYNC;
                Ok(())
            }
            (4, ERROR) => {
                self.state = IDLE;
                self.code = 0;
                Ok(())
            }
            (6, IDLE | DOWNLOAD_SYNC | DOWNLOAD_IDLE | UPLOAD_IDLE) => {
                self.state = IDLE;
                Ok(())
            }
            _ => Err(self.refuse(ERR_STALLED)),
        }
    }

    fn ask(&mut self, request: u8, value: u16, length: u16) -> Result<Vec<u8>, WireError> {
        if !self.is_there()? {
            // The work that this question begins is cut off.
            let InjectedFault::PowerCut { bytes, .. } = self.fault else {
                unreachable!("nothing else takes it away")
            };
            if self.state == DOWNLOAD_SYNC {
                match self.work.clone() {
                    Work::Nothing => {}
                    Work::Erase(address) => self.erase(address, bytes),
                    Work::Program(address, data) => self.program(address, &data[..bytes.min(data.len())]),
                }
            }
            return Err(WireError::Gone("no such device".to_owned()));
        }
        match (request, self.state) {
            (3, MANIFEST) => {
                self.is_gone = true;
                Ok(vec![0, 0, 0, 0, MANIFEST, 0])
            }
            (3, _) => {
                match self.state {
                    DOWNLOAD_SYNC => self.begin(),
                    DOWNLOAD_BUSY => {
                        self.busy_polls = self.busy_polls.saturating_sub(1);
                        if self.busy_polls == 0 {
                            self.state = DOWNLOAD_IDLE;
                        }
                    }
                    _ => {}
                }
                Ok(vec![self.code, 50, 0, 0, self.state, 0])
            }
            (2, IDLE | UPLOAD_IDLE) if value >= 2 => {
                let from =
                    (self.address - FLASH) as usize + usize::from(value - 2) * usize::from(TRANSFER_BYTES);
                let Some(data) = self.flash.get(from..from + usize::from(length)) else {
                    return Err(self.refuse(ERR_ADDRESS));
                };
                self.state = UPLOAD_IDLE;
                Ok(data.to_vec())
            }
            _ => Err(self.refuse(ERR_STALLED)),
        }
    }

    fn wait(&mut self, ms: u32) {
        self.waited_ms += u64::from(ms);
    }
}

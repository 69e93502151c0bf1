//! Offsets and bits of the USB OTG FS registers in device mode (RM0090 section 34.16), only what the model acts on.

pub(super) const GOTGCTL: u64 = 0x000;
pub(super) const GOTGINT: u64 = 0x004;
pub(super) const GAHBCFG: u64 = 0x008;
pub(super) const GUSBCFG: u64 = 0x00C;
pub(super) const GRSTCTL: u64 = 0x010;
pub(super) const GINTSTS: u64 = 0x014;
pub(super) const GINTMSK: u64 = 0x018;
pub(super) const GRXSTSR: u64 = 0x01C;
pub(super) const GRXSTSP: u64 = 0x020;
pub(super) const GRXFSIZ: u64 = 0x024;
pub(super) const DIEPTXF0: u64 = 0x028;
pub(super) const GCCFG: u64 = 0x038;
pub(super) const CID: u64 = 0x03C;
/// Not in this part's manual; drivers for the whole family read it.
pub(super) const HWCFG4: u64 = 0x050;
pub(super) const DIEPTXF1: u64 = 0x104;
pub(super) const DIEPTXF3: u64 = 0x10C;
pub(super) const DCFG: u64 = 0x800;
pub(super) const DCTL: u64 = 0x804;
pub(super) const DSTS: u64 = 0x808;
pub(super) const DIEPMSK: u64 = 0x810;
pub(super) const DOEPMSK: u64 = 0x814;
pub(super) const DAINT: u64 = 0x818;
pub(super) const DAINTMSK: u64 = 0x81C;
pub(super) const DIEPEMPMSK: u64 = 0x834;
pub(super) const IN_ENDPOINTS: u64 = 0x900;
pub(super) const OUT_ENDPOINTS: u64 = 0xB00;
/// Bytes from one endpoint's registers to the next one's.
pub(super) const ENDPOINT_BYTES: u64 = 0x20;
pub(super) const PCGCCTL: u64 = 0xE00;
pub(super) const FIFOS: u64 = 0x1000;
/// Bytes of address space of one FIFO.
pub(super) const FIFO_BYTES: u64 = 0x1000;

/// Registers of one endpoint, from its first.
pub(super) mod endpoint {
    pub(in super::super) const CTL: u64 = 0x00;
    pub(in super::super) const INT: u64 = 0x08;
    pub(in super::super) const TSIZ: u64 = 0x10;
    /// IN only.
    pub(in super::super) const TXFSTS: u64 = 0x18;
}

/// Core identification of the STM32F405 and F427 families.
pub(super) const CID_VALUE: u32 = 0x1200;

pub(super) mod gotgctl {
    pub(in super::super) const CIDSTS: u32 = 1 << 16;
    pub(in super::super) const BSVLD: u32 = 1 << 19;
}
pub(super) mod gotgint {
    pub(in super::super) const SEDET: u32 = 1 << 2;
}
pub(super) mod gahbcfg {
    pub(in super::super) const GINTMSK: u32 = 1;
    pub(in super::super) const TXFELVL: u32 = 1 << 7;
}
pub(super) mod grstctl {
    pub(in super::super) const CSRST: u32 = 1;
    pub(in super::super) const RXFFLSH: u32 = 1 << 4;
    pub(in super::super) const TXFFLSH: u32 = 1 << 5;
    pub(in super::super) const TXFNUM_SHIFT: u32 = 6;
    pub(in super::super) const TXFNUM: u32 = 0x1F;
    pub(in super::super) const ALL_FIFOS: u32 = 0x10;
    pub(in super::super) const AHBIDL: u32 = 1 << 31;
}
pub(super) mod gint {
    pub(in super::super) const OTGINT: u32 = 1 << 2;
    pub(in super::super) const SOF: u32 = 1 << 3;
    pub(in super::super) const RXFLVL: u32 = 1 << 4;
    pub(in super::super) const GINAKEFF: u32 = 1 << 6;
    pub(in super::super) const GONAKEFF: u32 = 1 << 7;
    pub(in super::super) const ESUSP: u32 = 1 << 10;
    pub(in super::super) const USBSUSP: u32 = 1 << 11;
    pub(in super::super) const USBRST: u32 = 1 << 12;
    pub(in super::super) const ENUMDNE: u32 = 1 << 13;
    pub(in super::super) const EOPF: u32 = 1 << 15;
    pub(in super::super) const IEPINT: u32 = 1 << 18;
    pub(in super::super) const OEPINT: u32 = 1 << 19;
    pub(in super::super) const SRQINT: u32 = 1 << 30;
    pub(in super::super) const WKUPINT: u32 = 1 << 31;
    /// Bits that software clears by writing one to them.
    pub(in super::super) const WRITE_CLEARS: u32 = 0xF030_FC0A;
}
pub(super) mod gccfg {
    pub(in super::super) const PWRDWN: u32 = 1 << 16;
    pub(in super::super) const VBUSBSEN: u32 = 1 << 19;
    pub(in super::super) const NOVBUSSENS: u32 = 1 << 21;
}
pub(super) mod dcfg {
    pub(in super::super) const DAD_SHIFT: u32 = 4;
    pub(in super::super) const DAD: u32 = 0x7F << DAD_SHIFT;
}
pub(super) mod dctl {
    pub(in super::super) const SDIS: u32 = 1 << 1;
    pub(in super::super) const GINSTS: u32 = 1 << 2;
    pub(in super::super) const GONSTS: u32 = 1 << 3;
    pub(in super::super) const SGINAK: u32 = 1 << 7;
    pub(in super::super) const CGINAK: u32 = 1 << 8;
    pub(in super::super) const SGONAK: u32 = 1 << 9;
    pub(in super::super) const CGONAK: u32 = 1 << 10;
    pub(in super::super) const STATUS: u32 = GINSTS | GONSTS;
    pub(in super::super) const COMMANDS: u32 = SGINAK | CGINAK | SGONAK | CGONAK;
}
pub(super) mod dsts {
    pub(in super::super) const SUSPSTS: u32 = 1;
    /// Full speed on the internal 48 MHz transceiver.
    pub(in super::super) const ENUMSPD_FULL: u32 = 3 << 1;
    pub(in super::super) const FNSOF_SHIFT: u32 = 8;
    pub(in super::super) const FNSOF: u32 = 0x3FFF;
}
/// Bits of `DIEPCTLx` and `DOEPCTLx`.
pub(super) mod ctl {
    pub(in super::super) const MPSIZ: u32 = 0x7FF;
    pub(in super::super) const USBAEP: u32 = 1 << 15;
    pub(in super::super) const DPID: u32 = 1 << 16;
    pub(in super::super) const NAKSTS: u32 = 1 << 17;
    pub(in super::super) const EPTYP: u32 = 0b11 << 18;
    pub(in super::super) const STALL: u32 = 1 << 21;
    pub(in super::super) const TXFNUM: u32 = 0xF << 22;
    pub(in super::super) const CNAK: u32 = 1 << 26;
    pub(in super::super) const SNAK: u32 = 1 << 27;
    pub(in super::super) const SD0PID: u32 = 1 << 28;
    pub(in super::super) const SD1PID: u32 = 1 << 29;
    pub(in super::super) const EPDIS: u32 = 1 << 30;
    pub(in super::super) const EPENA: u32 = 1 << 31;
    /// What software writes plainly.
    pub(in super::super) const PLAIN: u32 = MPSIZ | USBAEP | EPTYP | STALL | TXFNUM;
}
/// Bits of `DIEPINTx` and `DOEPINTx`.
pub(super) mod int {
    pub(in super::super) const XFRC: u32 = 1;
    pub(in super::super) const EPDISD: u32 = 1 << 1;
    pub(in super::super) const STUP: u32 = 1 << 3;
    pub(in super::super) const ITTXFE: u32 = 1 << 4;
    pub(in super::super) const INEPNE: u32 = 1 << 6;
    pub(in super::super) const TXFE: u32 = 1 << 7;
}
/// Fields of `DIEPTSIZx` and `DOEPTSIZx`.
pub(super) mod tsiz {
    pub(in super::super) const XFRSIZ: u32 = 0x7_FFFF;
    pub(in super::super) const PKTCNT_SHIFT: u32 = 19;
    pub(in super::super) const PKTCNT: u32 = 0x3FF << PKTCNT_SHIFT;
    /// `DOEPTSIZ0` only: SETUP packets that may still come back to back.
    pub(in super::super) const STUPCNT_SHIFT: u32 = 29;
    pub(in super::super) const STUPCNT: u32 = 0b11 << STUPCNT_SHIFT;
}
/// Packet states of `GRXSTSP` in device mode.
pub(super) mod pktsts {
    pub(in super::super) const GLOBAL_OUT_NAK: u32 = 1;
    pub(in super::super) const OUT_DATA: u32 = 2;
    pub(in super::super) const OUT_DONE: u32 = 3;
    pub(in super::super) const SETUP_DONE: u32 = 4;
    pub(in super::super) const SETUP_DATA: u32 = 6;
}

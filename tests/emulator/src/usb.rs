//! The USB OTG full-speed core with no host attached: registers keep what is written and nothing ever happens.
//! Enough for a firmware's USB driver to initialise and wait for a cable; the place where a device core model goes.
//! Limits: no interrupts, no endpoints, FIFOs read zero.

use std::collections::BTreeMap;

use rigless::chip::parallel::Peer;
use rigless::device::DeviceContext;
use rigless::snapshot::Store;
use rigless::soc::Width;

/// Reset control: reads "master idle, every flush and reset done", which drivers wait for (RM0090 section 34.16.2).
const GRSTCTL: u64 = 0x010;
const GRSTCTL_AHBIDL: u32 = 1 << 31;
/// Interrupt status: nothing is pending, and device mode reads zero.
const GINTSTS: u64 = 0x014;
/// Core identification: the value of this family, by which drivers pick their variant.
const CID: u64 = 0x03C;
const CID_STM32F4: u32 = 0x1200;
/// Past the last control register come the FIFOs.
const FIFOS: u64 = 0x1000;

/// The core as a firmware sees it with no cable plugged in.
#[derive(Debug, Default)]
pub(crate) struct UnattachedUsb {
    registers: BTreeMap<u64, u32>,
}

impl Store for UnattachedUsb {}

impl Peer for UnattachedUsb {
    fn read(&mut self, offset: u64, _: Width, _: &mut DeviceContext<'_>) -> u64 {
        u64::from(match offset {
            GRSTCTL => GRSTCTL_AHBIDL,
            GINTSTS => 0,
            CID => CID_STM32F4,
            _ => self.registers.get(&offset).copied().unwrap_or(0),
        })
    }

    fn write(&mut self, offset: u64, _: Width, value: u64, _: &mut DeviceContext<'_>) {
        if offset < FIFOS {
            self.registers.insert(offset, value as u32);
        }
    }

    fn reset(&mut self) {
        self.registers.clear();
    }
}

//! The board as rigless runs it: the part, our models wired into its address map, and the core's description.
//! Limits: one instruction takes one cycle of a fixed 168 MHz, whatever the firmware sets the clock tree to; timers
//! and serial ports follow the clock tree.

use std::num::{NonZeroU32, NonZeroU64};

use rigless::cpu::armv7m::windows;
use rigless::machine::armv7m::{Core, Fpu, MpuRegions, Variant};
use rigless::machine::{Board, Target};
use rigless::mcu::{Mcu, Operate, Wired};
use rigless::snapshot::Store;
use rigless::soc::{Error, Gate, Window};

use gripline_emulator_wire::LineWiring;

use crate::analog::line_millivolts;
use crate::constants::{
    BUS_PORT, CORE_HZ, DAC_BASE, DAC_BYTES, LINK_PORT, OTG_FS_BASE, OTG_FS_BYTES, OTG_FS_INTERRUPT,
};
use crate::dac::Dac;
use crate::part::Part;
use crate::uart::FarEnd;
use crate::usb::Port;

const MCU: &str = "stm32f427";
/// The part's NVIC keeps four priority bits, and its SysTick can run on an eighth of the core clock (PM0214).
const PRIORITY_BITS: u8 = 4;
const REFCLK_DIVIDER: NonZeroU32 = nonzero(8);

/// The board: everything that a run steps.
#[derive(Debug)]
pub(crate) struct Hardware {
    mcu: Wired<Wired<Part, Dac>, Port>,
    line: LineWiring,
}

impl Hardware {
    /// The board out of power-on.
    pub(crate) fn new() -> Result<Self, Error> {
        let dac =
            Window::new("DAC", DAC_BASE, nonzero64(DAC_BYTES)).gated(Gate::by("RCC", "APB1ENR", "DACEN"));
        let usb = Window::new("OTG_FS", OTG_FS_BASE, nonzero64(OTG_FS_BYTES))
            .gated(Gate::by("RCC", "AHB2ENR", "OTGFSEN"))
            .raising(&[OTG_FS_INTERRUPT]);
        let with_dac = Wired::new(Part::new()?, dac, Dac::default())?;
        let mut hardware = Self {
            mcu: Wired::new(with_dac, usb, Port::default())?,
            line: LineWiring::default(),
        };
        hardware.couple_line();
        Ok(hardware)
    }

    pub(crate) fn dac(&mut self) -> &mut Dac {
        self.mcu.part.chip_mut()
    }

    pub(crate) fn part(&mut self) -> &mut Part {
        &mut self.mcu.part.part
    }

    /// The analog line's wiring from now on.
    pub(crate) fn wire_line(&mut self, wiring: LineWiring) {
        self.line = wiring;
        self.couple_line();
    }

    /// Puts what the DAC shows on the pin of the converter that reads the line back.
    pub(crate) fn couple_line(&mut self) {
        let (code, wiring) = (self.dac().code(0), self.line);
        let part = self.part();
        part.set_line(line_millivolts(code, wiring, part.supply()));
    }

    pub(crate) fn usb(&mut self) -> &mut Port {
        self.mcu.chip_mut()
    }

    /// The other end of the host's line.
    pub(crate) fn far_end(&mut self) -> &mut FarEnd {
        self.mcu.part.part.far_end(LINK_PORT)
    }

    /// The gripper's end of its bus.
    pub(crate) fn bus_end(&mut self) -> &mut FarEnd {
        self.mcu.part.part.far_end(BUS_PORT)
    }
}

impl Store for Hardware {}

impl Board for Hardware {
    fn name(&self) -> &'static str {
        "gripline"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec![MCU]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.mcu)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let core = Core {
            variant: Variant::M4,
            clock_hz: nonzero64(CORE_HZ),
            interrupt_lines: nonzero(u32::from(self.mcu.cpu().interrupt_lines)),
            priority_bits: PRIORITY_BITS,
            refclk_divider: REFCLK_DIVIDER,
            instructions_per_second: nonzero64(CORE_HZ),
            boot: "flash",
        };
        let spec = core.spec_with_parts(&windows(self.mcu.bus()), Fpu::FpV4Sp, MpuRegions::Eight);
        vec![Target::new(MCU, &mut self.mcu, spec)]
    }
}

const fn nonzero(value: u32) -> NonZeroU32 {
    NonZeroU32::new(value).expect("a count of the board's own")
}

const fn nonzero64(value: u64) -> NonZeroU64 {
    NonZeroU64::new(value).expect("a size or rate of the board's own")
}

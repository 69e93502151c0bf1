//! An STM32F427 with room for our own DAC and USB models.
//! rigless's part answers for the whole address map and offers no way to take an instance out, so this one has a bus
//! of its own: the stock description read back from the stock part, less what we replace, with the stock models
//! behind it. Limits: the reset bits of the RCC (`xxxRST`) do nothing; gates of clock enables hold.

use std::sync::LazyLock;

use rigless::device::{ErasedDevice, Level, ResetCause};
use rigless::mcu::{Mcu, Operate};
use rigless::snapshot::Store;
use rigless::soc::stm32f427::generated::{gpioa, rcc as rcc_registers};
use rigless::soc::stm32f427::peripherals::{
    ADC_COMMON, ADVANCED_TIMERS, CONTROLLERS, CONVERTERS, PORTS, SERIAL_PORTS, adc, gpio, rcc,
};
use rigless::soc::stm32f427::{CPU, MEMORY, SERIAL_INTERFACES, Stm32f427};
use rigless::soc::{Bus, Error, Fault, Gate, Peripheral, Region, Width};
use rigless::time::VirtualNanos;

use crate::constants::{
    BORRSTF, BROWN_OUT_LEVEL_3, BUS_PORT, CONTROL_PORT, CRYSTAL_HZ, FAULT_PIN, INHIBIT_PIN, LINE_CHANNEL,
    LINK_INPUT_PIN, LINK_PINS, LINK_PORT, RCC_APB1ENR, SUPPLY_MV, USART2EN,
};
use crate::uart::FarEnd;

/// The instances whose addresses are ours. ST's tables cut the one USB core into four.
const REPLACED: [&str; 5] = [
    "DAC",
    "OTG_FS_GLOBAL",
    "OTG_FS_HOST",
    "OTG_FS_DEVICE",
    "OTG_FS_PWRCLK",
];

/// The stock memory, with a flash that its controller writes: what that leaves is [`crate::flash`]'s.
static WRITABLE: LazyLock<[Region; MEMORY.len()]> = LazyLock::new(|| {
    MEMORY.map(|region| match region.name {
        "flash" => region.programmed_by("FLASH"),
        _ => region,
    })
});

/// The part, without the instances of [`REPLACED`]: what takes their place is wired around it.
#[derive(Debug)]
pub(crate) struct Part {
    stock: Stm32f427,
    bus: Bus,
    /// For every slot of our bus the slot of the same instance in the stock part.
    stock_slots: Vec<usize>,
    /// The slots of the serial ports that have a far end.
    wired_slots: [usize; 2],
    /// What something outside drives the release-inhibit input to; none while nothing is wired to it.
    inhibit: Option<Level>,
}

impl Part {
    /// A part out of reset with a crystal, a supply and a far end each on its link port and its bus port.
    pub(crate) fn new() -> Result<Self, Error> {
        let mut stock = Stm32f427::new()?;
        stock.rcc.attach_crystals(CRYSTAL_HZ, 0);
        stock.set_supply(SUPPLY_MV);
        stock.usart[LINK_PORT].attach(FarEnd::default());
        stock.usart[BUS_PORT].attach(FarEnd::default());
        let bus = bus_of(&stock)?;
        let stock_slots = bus
            .peripherals()
            .map(|ours| stock.bus().slot(ours.name))
            .collect::<Result<_, _>>()?;
        let wired_slots = [
            bus.slot(SERIAL_PORTS[LINK_PORT].instance)?,
            bus.slot(SERIAL_PORTS[BUS_PORT].instance)?,
        ];
        let mut part = Self {
            stock,
            bus,
            stock_slots,
            wired_slots,
            inhibit: None,
        };
        part.check()?;
        part.set_brown_out_level(BROWN_OUT_LEVEL_3);
        Ok(part)
    }

    /// The supply from now on, millivolts: what the voltage detector and the converters' reference see.
    pub(crate) fn set_supply(&mut self, millivolts: u32) {
        let slot = self.slot("PWR");
        let registers = self.bus.slot_mut(slot).registers_mut();
        self.stock.pwr.set_supply(millivolts, registers);
        for converter in &mut self.stock.adc {
            converter.set_reference(millivolts);
        }
    }

    /// The supply, millivolts.
    pub(crate) fn supply(&self) -> u32 {
        self.stock.pwr.supply()
    }

    /// The voltage on the pin that reads the analog line back, millivolts.
    pub(crate) fn set_line(&mut self, millivolts: u32) {
        let channel = adc::Channel::new(LINE_CHANNEL).expect("a channel with a pin");
        self.stock.adc[0].set_input(channel, millivolts);
    }

    /// The next reset is the brown-out detector's: its flag stands in `RCC_CSR` then.
    pub(crate) fn note_brown_out(&mut self) {
        let slot = self.slot("RCC");
        let registers = self.bus.slot_mut(slot).registers_mut();
        let flags = registers.get(rcc_registers::Register::Csr);
        registers.set(rcc_registers::Register::Csr, flags | BORRSTF);
    }

    /// The brown-out level of the option bytes, as `FLASH_OPTCR` counts it.
    pub(crate) fn set_brown_out_level(&mut self, level: u8) {
        const PLACE: u32 = 2;
        let (options, more) = self.stock.flash.committed_options();
        let options = options & !(0b11 << PLACE) | u64::from(level & 0b11) << PLACE;
        let slot = self.slot("FLASH");
        let registers = self.bus.slot_mut(slot).registers_mut();
        self.stock.flash.keep_options(options, more, registers);
    }

    /// The level that something outside drives the release-inhibit input to.
    pub(crate) fn inhibit_release(&mut self, now: VirtualNanos, level: bool) {
        self.inhibit = Some(if level { Level::High } else { Level::Low });
        self.drive_inputs(now);
    }

    fn drive_inputs(&mut self, now: VirtualNanos) {
        let pin = gpio::Pin::new(INHIBIT_PIN).expect("a pin of the port");
        let slot = self.slot(PORTS[CONTROL_PORT]);
        let (registers, mut context) = self.bus.drive(now, slot);
        self.stock.gpio[CONTROL_PORT].drive(pin, self.inhibit, registers, &mut context);
    }

    /// The level of the fault output. While the firmware does not drive the pin, the resistor on the board holds it low.
    pub(crate) fn fault_output(&self) -> bool {
        let slot = self.slot(PORTS[CONTROL_PORT]);
        let registers = self.bus.slots()[slot].registers();
        let pin = gpio::Pin::new(FAULT_PIN).expect("a pin of the port");
        let mode = registers.get(gpioa::Register::Moder) >> (2 * FAULT_PIN) & 0b11;
        mode == 0b01 && self.stock.gpio[CONTROL_PORT].level(pin, registers) == Level::High
    }

    /// Opens the wire to the link port's input, or closes it.
    pub(crate) fn open_link(&mut self, is_open: bool) {
        self.far_end(LINK_PORT).set_open(is_open);
    }

    /// The level on the link port's input while nothing outside drives it: what the pin's own resistor makes of it.
    fn undriven_link_level(&self) -> Level {
        let slot = self.slot(PORTS[LINK_PINS]);
        let pin = gpio::Pin::new(LINK_INPUT_PIN).expect("a pin of the port");
        self.stock.gpio[LINK_PINS].level(pin, self.bus.slots()[slot].registers())
    }

    /// Stops the clock of the gripper's UART.
    pub(crate) fn stop_bus_clock(&mut self, now: VirtualNanos) {
        let enables = self
            .read(now, RCC_APB1ENR, Width::W32)
            .expect("the clock controller answers");
        self.write(now, RCC_APB1ENR, Width::W32, enables & !USART2EN)
            .expect("the clock controller takes it");
    }

    fn slot(&self, instance: &'static str) -> usize {
        self.bus.slot(instance).expect("an instance of the part")
    }

    /// What hangs on a port that has a far end.
    pub(crate) fn far_end(&mut self, port: usize) -> &mut FarEnd {
        self.stock.usart[port]
            .chip_mut()
            .expect("attached when the part was built")
    }
}

impl Store for Part {}

impl Mcu for Part {
    fn bus(&self) -> &Bus {
        &self.bus
    }

    fn bus_mut(&mut self) -> &mut Bus {
        &mut self.bus
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let model = self
            .stock_slots
            .get(slot)
            .and_then(|&stock| self.stock.split(stock).1);
        (&mut self.bus, model)
    }

    /// The stock part decides what survives a reset by reading its own bus, so it gets the registers of ours before
    /// and ours is built anew from what it leaves.
    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        for (slot, &stock) in self.bus.slots().iter().zip(&self.stock_slots) {
            *self.stock.bus_mut().slot_mut(stock).registers_mut() = slot.registers().clone();
        }
        self.stock.reset(at, cause);
        let mut fresh = bus_of(&self.stock).expect("a part that was built once builds again");
        fresh.keep_added(&self.bus).expect("the description is the same");
        self.bus = fresh;
        self.drive_inputs(at);
    }

    /// Only the ports with a far end have anything outside to look at.
    fn poll(&mut self, now: VirtualNanos) {
        let is_low = self.undriven_link_level() == Level::Low;
        self.far_end(LINK_PORT).set_undriven_level(is_low);
        for slot in self.wired_slots {
            let model = self
                .stock
                .split(self.stock_slots[slot])
                .1
                .expect("a port with a model");
            let (registers, mut context) = self.bus.drive(now, slot);
            model.poll(registers, &mut context);
        }
    }
}

/// The bus of `stock` without [`REPLACED`], its registers holding what those of `stock` hold.
fn bus_of(stock: &Stm32f427) -> Result<Bus, Error> {
    // A part straight out of reset, whose clocks are all off, names by its refusals the enable each instance needs.
    let mut refusing = Stm32f427::new()?;
    let kept = || {
        stock
            .bus()
            .peripherals()
            .filter(|peripheral| !REPLACED.contains(&peripheral.name))
            .copied()
    };
    let mut builder = Bus::builder(CPU, &*WRITABLE, kept());
    // ST's tables leave these two enables out.
    for field in [&rcc::GPIOJEN, &rcc::GPIOKEN] {
        builder = builder.declare("RCC", "AHB1ENR", field);
    }
    for peripheral in kept() {
        if let Some(gate) = enable_of(&peripheral, &mut refusing) {
            builder = builder.gate(peripheral.name, gate);
        }
        if let Some(clock) = stock.bus().clock_of(peripheral.name) {
            builder = builder.clocked_by(peripheral.name, clock);
        }
    }
    // The backup domain is write-protected until PWR says otherwise (RM0090 section 5.5.1).
    let unprotected = Gate::by("PWR", "CR", "DBP");
    builder = builder
        .gate_writes("RCC", &["BDCR"], unprotected)
        .gate_writes("RTC", &[], unprotected);
    // Who listens to other instances' request lines, in the stock part's order.
    let listeners = std::iter::once("RTC")
        .chain(SERIAL_INTERFACES)
        .chain(ADVANCED_TIMERS.map(|timer| timer.instance))
        .chain(["RCC", ADC_COMMON, CONVERTERS[0]])
        .chain(CONTROLLERS.iter().map(|controller| controller.instance));
    for listener in listeners {
        builder = builder.reads_requests(listener);
    }
    let mut bus = builder.build()?;
    // A register file carries its corrections (reset values, write rules, fields) along with its values.
    for slot in 0..bus.slots().len() {
        let name = bus.slots()[slot].peripheral().name;
        let stock_slot = stock.bus().slot(name)?;
        *bus.slot_mut(slot).registers_mut() = stock.bus().slots()[stock_slot].registers().clone();
    }
    Ok(bus)
}

/// The clock enable that `peripheral` answers behind, if it has one.
fn enable_of(peripheral: &Peripheral, refusing: &mut Stm32f427) -> Option<Gate> {
    let readable = peripheral
        .registers
        .iter()
        .find(|register| register.access.is_readable())?;
    match refusing.read(
        VirtualNanos(0),
        peripheral.base + u64::from(readable.offset),
        Width::W32,
    ) {
        Err(Fault::Gated { by, .. }) => Some(by),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_of_the_stock_description_is_lost_but_what_we_replace() {
        let stock = Stm32f427::new().unwrap();
        let part = Part::new().unwrap();
        for peripheral in stock.bus().peripherals() {
            let ours = part.bus.peripheral(peripheral.name);
            if REPLACED.contains(&peripheral.name) {
                assert_eq!(ours, None, "{}", peripheral.name);
            } else {
                assert_eq!(ours, Some(peripheral));
                assert_eq!(
                    part.bus.clock_of(peripheral.name),
                    stock.bus().clock_of(peripheral.name)
                );
            }
        }
    }

    #[test]
    fn every_access_to_a_part_out_of_reset_answers_as_the_stock_part_does() {
        let mut stock = Stm32f427::new().unwrap();
        stock.set_supply(SUPPLY_MV);
        let mut part = Part::new().unwrap();
        // As a chip comes from the factory; ours was flashed.
        part.set_brown_out_level(0b11);
        let mut gated = 0;
        let peripherals: Vec<Peripheral> = part.bus.peripherals().copied().collect();
        for peripheral in peripherals {
            for register in peripheral.registers {
                let address = peripheral.base + u64::from(register.offset);
                let expected = stock.read(VirtualNanos(0), address, Width::W32);
                gated += usize::from(matches!(expected, Err(Fault::Gated { .. })));
                assert_eq!(
                    part.read(VirtualNanos(0), address, Width::W32),
                    expected,
                    "{address:#x}"
                );
                let expected = stock.write(VirtualNanos(0), address, Width::W32, 0);
                assert_eq!(
                    part.write(VirtualNanos(0), address, Width::W32, 0),
                    expected,
                    "{address:#x}"
                );
            }
        }
        assert!(
            gated > 500,
            "only {gated} accesses were refused for a clock that is off"
        );
    }

    #[test]
    fn a_reset_keeps_the_backup_domain_and_clears_the_rest() {
        const RCC_AHB1ENR: u64 = 0x4002_3830;
        const RCC_APB1ENR: u64 = 0x4002_3840;
        const RCC_CSR: u64 = 0x4002_3874;
        const PWR_CR: u64 = 0x4000_7000;
        const RTC_BKP19R: u64 = 0x4000_289C;
        const GPIOA_ODR: u64 = 0x4002_0014;
        const WDGRSTF: u64 = 1 << 29;
        let at = VirtualNanos(0);
        let mut part = Part::new().unwrap();
        let refused = part.write(at, PWR_CR, Width::W32, 1 << 8);
        assert!(
            matches!(refused, Err(Fault::Gated { .. })),
            "PWR answers with its clock off"
        );
        let writes = [
            (RCC_APB1ENR, 1 << 28), // PWREN
            (PWR_CR, 1 << 8),       // DBP
            (RTC_BKP19R, 0x1234_5678),
            (RCC_AHB1ENR, 1), // GPIOAEN
            (GPIOA_ODR, 0xFFFF),
        ];
        for (address, value) in writes {
            part.write(at, address, Width::W32, value).unwrap();
        }
        part.reset(at, ResetCause::Model("IWDG"));
        assert_eq!(part.read(at, RTC_BKP19R, Width::W32), Ok(0x1234_5678));
        let causes = part.read(at, RCC_CSR, Width::W32).unwrap();
        assert_ne!(causes & WDGRSTF, 0, "RCC_CSR reads {causes:#x}");
        part.write(at, RCC_AHB1ENR, Width::W32, 1).unwrap();
        assert_eq!(part.read(at, GPIOA_ODR, Width::W32), Ok(0));
    }
}

//! Every number of the emulated board: addresses, clocks, limits, each with its unit and source.

/// First address of the flash, where the vector table of an image must lie (RM0090 section 2.3).
pub const FLASH_BASE: u64 = 0x0800_0000;
/// First address of the DAC's registers (RM0090 table 1).
pub const DAC_BASE: u64 = 0x4000_7400;
/// Bytes of address space the DAC takes (RM0090 table 1).
pub const DAC_BYTES: u64 = 0x400;
/// First address of the USB OTG FS core (RM0090 table 1).
pub const OTG_FS_BASE: u64 = 0x5000_0000;
/// Bytes of address space the USB OTG FS core takes, FIFOs included (RM0090 table 1).
pub const OTG_FS_BYTES: u64 = 0x4_0000;
/// The interrupt line of the USB OTG FS core (RM0090 table 63).
pub const OTG_FS_INTERRUPT: u16 = 67;

/// The crystal, hertz: what the firmware's clock set-up expects.
pub const CRYSTAL_HZ: u64 = 8_000_000;
/// The supply, millivolts: flash wait states are checked against it.
pub const SUPPLY_MV: u32 = 3300;
/// The core clock, hertz, and the instructions retired a second: one a cycle. Real code needs more cycles than
/// instructions (flash wait states, multi-cycle loads), so emulated times are optimistic.
pub const CORE_HZ: u64 = 168_000_000;

/// Which of the part's serial ports carries the host link, by its place in rigless's list: 0 is USART1, PA9/PA10.
pub const LINK_PORT: usize = 0;

/// How finely [`crate::Board::run_until`] looks at its predicate, nanoseconds.
pub const PREDICATE_STEP_NS: u64 = 20_000;
/// How often the debug probe empties the log buffer, nanoseconds: at whole milliseconds, however a run is sliced.
pub const LOG_PERIOD_NS: u64 = 1_000_000;
/// The longest advance one request of the pipe may ask for, nanoseconds: a minute, seconds of real time when busy.
pub const MAX_ADVANCE_NS: u64 = 60_000_000_000;
/// The most UART bytes one request of the pipe may carry.
pub const MAX_UART_BYTES: u32 = 65_536;

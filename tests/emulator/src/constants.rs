//! Every number of the emulated board: addresses, clocks, limits, each with its unit and source.

/// First address of the flash, where the vector table of an image must lie (RM0090 section 2.3).
pub const FLASH_BASE: u64 = 0x0800_0000;
/// Bytes of the flash (RM0090 table 6).
pub const FLASH_BYTES: u64 = 2 << 20;
/// Status and control register of the flash controller (RM0090 sections 2.3, 3.9.6 and 3.9.8).
pub const FLASH_SR: u64 = 0x4002_3C0C;
/// See [`FLASH_SR`].
pub const FLASH_CR: u64 = 0x4002_3C10;
/// Where the firmware keeps its settings: sectors 1 and 2 (its memory.x).
pub const SETTINGS_BASE: u64 = 0x0800_4000;
/// Bytes of that.
pub const SETTINGS_BYTES: u64 = 0x8000;
/// First address of the system memory, where the chip's own bootloader lies (RM0090 section 2.4).
pub const SYSTEM_MEMORY_BASE: u64 = 0x1FFF_0000;
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

/// Endpoints of the USB OTG FS core in each direction (RM0090 section 34.1).
pub const OTG_ENDPOINTS: usize = 4;
/// Words of the core's packet memory, all FIFOs together: 1.25 KiB (RM0090 section 34.1).
pub const OTG_FIFO_WORDS: u32 = 320;
/// Words of the receive FIFO that the core keeps free for SETUP packets (RM0090 section 34.11.1).
pub const OTG_SETUP_RESERVE_WORDS: usize = 10;

/// How long the bus is quiet until a device counts as suspended, nanoseconds (USB 2.0 section 7.1.7.6).
pub const USB_SUSPEND_NS: u64 = 3_000_000;
/// How long a host waits after it saw a device, nanoseconds (USB 2.0 table 7-14, TATTDB).
pub const USB_DEBOUNCE_NS: u64 = 100_000_000;
/// How long a host drives a reset, nanoseconds (USB 2.0 table 7-14, TDRSTR at a root port).
pub const USB_RESET_NS: u64 = 50_000_000;
/// How long a device may take to recover from a reset, nanoseconds (USB 2.0 table 7-14, TRSTRCY).
pub const USB_RESET_RECOVERY_NS: u64 = 10_000_000;
/// How long a host drives a resume, nanoseconds (USB 2.0 table 7-14, TDRSMDN).
pub const USB_RESUME_NS: u64 = 20_000_000;
/// How long a device may take to recover from a resume, nanoseconds (USB 2.0 table 7-14, TRSMRCY).
pub const USB_RESUME_RECOVERY_NS: u64 = 10_000_000;
/// How long a device may take to listen to a new address, nanoseconds (USB 2.0 section 9.2.6.3).
pub const USB_ADDRESS_RECOVERY_NS: u64 = 2_000_000;
/// How long a device may take for a control transfer without data, and for the first data of one with, before this
/// host gives it up, nanoseconds (USB 2.0 section 9.2.6.4: 50 ms and 500 ms; hosts give the longer of the two).
pub const USB_CONTROL_TIMEOUT_NS: u64 = 500_000_000;

/// A full-speed frame, nanoseconds.
pub const USB_FRAME_NS: u64 = 1_000_000;
/// Byte times of a full-speed frame: 1 ms at 12 Mbit/s.
pub const USB_FRAME_BYTES: u64 = 1_500;
/// Byte times at the start of a frame for its SOF packet (35 bits) and the gap after it.
pub const USB_SOF_BYTES: u64 = 5;
/// Byte times at the end of a frame in which nothing may be sent: EOF1 at 32 bits (USB 2.0 section 11.2.5).
pub const USB_EOF_BYTES: u64 = 4;
/// Byte times of the gap that closes a transaction.
pub const USB_GAP_BYTES: u64 = 1;
/// Byte times of a token packet: SYNC, PID, address with endpoint and CRC.
pub const USB_TOKEN_BYTES: u64 = 4;
/// Byte times from a token's end to the end of a data packet without its data: a gap, SYNC, PID, CRC.
pub const USB_DATA_BYTES: u64 = 5;
/// Byte times from the end of a data packet, or of the token that is refused, to the next token: gap, SYNC, PID, gap.
/// With the two above, the 13 bytes that table 5-9 of USB 2.0 counts for a bulk transaction: 19 of 64 bytes a frame.
/// Bit stuffing is not counted, there as here.
pub const USB_HANDSHAKE_BYTES: u64 = 4;
/// How long the host lets a control endpoint be after a NAK, nanoseconds: its own choice.
pub const USB_CONTROL_RETRY_NS: u64 = 100_000;
/// How long the host lets a bulk IN endpoint be after a NAK, nanoseconds: its own choice; one question a frame leaves
/// room for 19 packets of 64 bytes and a short one the other way. A bulk OUT packet is offered again at once.
pub const USB_IN_RETRY_NS: u64 = 1_000_000;
/// How often a host repeats a transaction that nobody answers (USB 2.0 section 10.2.6).
pub const USB_TRIES: u32 = 3;
/// How often the host resets a device that it cannot enumerate before it gives up: its own choice.
pub const USB_ENUMERATION_TRIES: u32 = 3;

/// The crystal, hertz: what the firmware's clock set-up expects.
pub const CRYSTAL_HZ: u64 = 8_000_000;
/// The supply, millivolts: flash wait states are checked against it.
pub const SUPPLY_MV: u32 = 3300;
/// The core clock, hertz, and the instructions retired a second: one a cycle. Real code needs more cycles than
/// instructions (flash wait states, multi-cycle loads), so emulated times are optimistic.
pub const CORE_HZ: u64 = 168_000_000;

/// Which of the part's serial ports carries the host link, by its place in rigless's list: 0 is USART1, PA9/PA10.
pub const LINK_PORT: usize = 0;
/// Port A in rigless's list of ports, and the link port's input in it: PA10.
pub const LINK_PINS: usize = 0;
/// See [`LINK_PINS`].
pub const LINK_INPUT_PIN: u8 = 10;
/// Which of them carries the gripper's bus: 1 is USART2, PA2/PA3.
pub const BUS_PORT: usize = 1;
/// Output data and bit set/reset registers of GPIOA (RM0090 table 1, section 8.4), and the pin in it that enables the
/// driver of the bus: PA1.
pub const GPIOA_ODR: u64 = 0x4002_0014;
/// See [`GPIOA_ODR`].
pub const GPIOA_BSRR: u64 = 0x4002_0018;
/// See [`GPIOA_ODR`].
pub const BUS_DRIVER_PIN: u32 = 1;

/// The converter and its channel that measures the analog line, and its pin: ADC1, PA6.
pub const LINE_CHANNEL: u8 = 6;
/// The voltage that the divider at the op-amp's input holds while nothing drives it, millivolts, and the supply that it
/// divides: 6.8 MΩ of 16.8 MΩ at 3.3 V (docs/wiring.md).
pub const DIVIDER_PER_MILLE: u32 = 405;
/// Port B in rigless's list of ports, and its pins: the fault output PB0 and the release-inhibit input PB1.
pub const CONTROL_PORT: usize = 1;
/// See [`CONTROL_PORT`].
pub const FAULT_PIN: u8 = 0;
/// See [`CONTROL_PORT`].
pub const INHIBIT_PIN: u8 = 1;
/// The clock enables of the 42 MHz bus, and that of USART2 among them (RM0090 section 6.3.13).
pub const RCC_APB1ENR: u64 = 0x4002_3840;
/// See [`RCC_APB1ENR`].
pub const USART2EN: u64 = 1 << 17;
/// The brown-out flag of RCC_CSR (RM0090 section 6.3.21).
pub const BORRSTF: u64 = 1 << 25;
/// The brown-out level in the option bytes of a chip that was flashed as docs/wiring.md says: 0 is level 3 (RM0090 section 3.9.10).
pub const BROWN_OUT_LEVEL_3: u8 = 0;
/// First address and bytes of the RAM that keeps its content over a reset: core-coupled memory and SRAM (RM0090 section 2.3.1).
pub const RAM: [(u64, u64); 2] = [(0x1000_0000, 0x1_0000), (0x2000_0000, 0x3_0000)];

/// How finely [`crate::Board::run_until`] looks at its predicate, nanoseconds.
pub const PREDICATE_STEP_NS: u64 = 20_000;
/// How often the debug probe empties the log buffer, nanoseconds: at whole milliseconds, however a run is sliced.
pub const LOG_PERIOD_NS: u64 = 1_000_000;

//! The whole emulated board running tiny hand-assembled images: what the DAC line, the UART, the watchdog and the
//! clock do. `GRIPLINE_IMAGE` names a real firmware image for the tests that need one.

mod common;

use common::{FLASH, elf_at};
use gripline_emulator::{Board, DacWrite, Disturbance, EmulatorError, Reset};

/// One UART frame (start, eight data, stop bit) at the 1 Mbaud that [`ECHO`] sets.
const FRAME_NS: u64 = 10_000;

/// Counts up on DAC channel 1, a code about every 2.4 µs.
const RAMP: &[u16] = &[
    0x4806, 0x4907, 0x6001, //  ldr r0, =RCC_APB1ENR; ldr r1, =DACEN; str r1, [r0]
    0x4807, 0x2101, 0x6001, //  ldr r0, =DAC; movs r1, #EN1; str r1, [r0]
    0x2200, //                  movs r2, #0
    0x6082, 0x3201, //       0: str r2, [r0, #DHR12R1]; adds r2, #1
    0x23C8, 0x3B01, 0xD1FD, //  movs r3, #200; 1: subs r3, #1; bne 1b
    0xE7F9, 0xBF00, //          b 0b; nop
    0x3840, 0x4002, 0x0000, 0x2000, 0x7400, 0x4000,
];

/// Puts every byte that arrives on USART1, times 16, on DAC channel 1 and sends the byte plus one back.
const ECHO: &[u16] = &[
    0x480A, 0x490B, 0x6001, 0x2110, 0x6041, // RCC_APB1ENR = DACEN; RCC_APB2ENR (4 further) = USART1EN
    0x4C0A, 0x2101, 0x6021, //                 ldr r4, =DAC; CR = EN1
    0x4D09, 0x2110, 0x60A9, //                 ldr r5, =USART1; BRR = 16: 16 MHz / 16 = 1 Mbaud
    0x4909, 0x60E9, //                         CR1 = UE | TE | RE
    0x6829, 0x0689, 0xD5FC, //              0: ldr r1, [r5, #SR]; lsls r1, r1, #26 (RXNE); bpl 0b
    0x686A, 0x0113,
    0x60A3, //                 ldr r2, [r5, #DR]; lsls r3, r2, #4; str r3, [r4, #DHR12R1]
    0x3201, 0x606A, 0xE7F6, //                 adds r2, #1; str r2, [r5, #DR]; b 0b
    0x3840, 0x4002, 0x0000, 0x2000, 0x7400, 0x4000, 0x1000, 0x4001, 0x200C, 0x0000,
];

/// Counts its starts in RAM, shows the count on DAC channel 1, starts a watchdog of 4 ms and never feeds it again.
const WATCHDOG: &[u16] = &[
    0x480B, 0x6801, 0x3101,
    0x6001, //         ldr r0, =0x20000000; ldr r1, [r0]; adds r1, #1; str r1, [r0]
    0x4A0A, 0x4B0B, 0x6013, //                 RCC_APB1ENR = DACEN
    0x4A0B, 0x2301, 0x6013, 0x6091, //         ldr r2, =DAC; CR = EN1; DHR12R1 = r1
    0x480A, 0x490A, 0x6001, 0x490A, 0x6001, // ldr r0, =IWDG; KR = 0xCCCC (start); KR = 0x5555 (unlock)
    0x211F, 0x6081, //                         RLR = 31: 32 periods of 32 kHz / 4
    0x68C1, 0x2900, 0xD1FC, //              0: ldr r1, [r0, #SR]; cmp r1, #0; bne 0b
    0x4908, 0x6001, 0xE7FE, //                 KR = 0xAAAA (feed); 1: b 1b
    0x0000, 0x2000, 0x3840, 0x4002, 0x0000, 0x2000, 0x7400, 0x4000, 0x3000, 0x4000, 0xCCCC, 0x0000, 0x5555,
    0x0000, 0xAAAA, 0x0000,
];

/// Sleeps for ever.
const SLEEP: &[u16] = &[0xBF30, 0xE7FD]; // 0: wfi; b 0b

/// Writes DAC channel 1 without having turned its clock on, then sleeps.
const NO_CLOCK: &[u16] = &[
    0x4802, 0x2101, 0x6001, // ldr r0, =DAC; movs r1, #EN1; str r1, [r0]
    0xBF30, 0xE7FD, //      0: wfi; b 0b
    0xBF00, 0x7400, 0x4000,
];

fn boot(code: &[u16]) -> Board {
    Board::boot(&elf_at(FLASH, code)).unwrap()
}

#[test]
fn a_board_out_of_power_on_has_run_nothing() {
    let board = boot(RAMP);
    assert_eq!(
        (
            board.now_ns(),
            board.instructions(),
            board.resets(),
            board.dac_writes()
        ),
        (0, 0, &[][..], &[][..])
    );
    assert_eq!((board.dac_code(1), board.dac_code(2)), (None, None));
}

#[test]
fn every_code_on_the_line_is_recorded_with_its_instant() {
    let mut board = boot(RAMP);
    board.run_for(1_000_000).unwrap();
    let writes = board.dac_writes();
    // The first record is the zero that appears as the channel is turned on; then comes a loop of
    // 3 + 2 * 200 + 1 instructions of 1/168 µs each.
    assert_eq!(writes[0].code, 0);
    let (codes, times): (Vec<u16>, Vec<u64>) =
        writes[1..].iter().map(|write| (write.code, write.at_ns)).unzip();
    assert_eq!(codes, (0..codes.len() as u16).collect::<Vec<_>>());
    let period_ns = 404.0 * 1000.0 / 168.0;
    for pair in times.windows(2) {
        let step_ns = (pair[1] - pair[0]) as f64;
        assert!(
            (step_ns - period_ns).abs() <= 1.0,
            "{step_ns} ns from code to code, expected {period_ns}"
        );
    }
    assert_eq!(codes.len(), (1_000_000.0 / period_ns).ceil() as usize);
    assert_eq!(board.dac_code(1), codes.last().copied());
}

#[test]
fn bytes_cross_the_line_both_ways_at_its_baud_rate() {
    let mut board = boot(ECHO);
    board.run_for(100_000).unwrap();
    let start_ns = board.now_ns();
    board.uart_send(&[0x10, 0x20, 0x30]);
    assert!(
        board
            .run_until(|board| board.uart_bytes().len() == 3, 1_000_000)
            .unwrap()
    );
    assert_eq!(board.uart_take(), [0x11, 0x21, 0x31]);
    assert_eq!(board.uart_take(), [], "they were taken");
    let codes: Vec<u16> = board.dac_writes()[1..].iter().map(|write| write.code).collect();
    assert_eq!(codes, [0x100, 0x200, 0x300]);
    for (n, (write, sent)) in board.dac_writes()[1..].iter().zip(board.uart_bytes()).enumerate() {
        // A byte is there at the end of its stop bit; the answer takes another frame. The loop takes < 0.2 µs.
        let arrived_ns = start_ns + (n as u64 + 1) * FRAME_NS;
        assert!(
            (arrived_ns..arrived_ns + 200).contains(&write.at_ns),
            "byte {n}: {write:?} after {arrived_ns}"
        );
        let answered_ns = arrived_ns + FRAME_NS;
        assert!(
            (answered_ns..answered_ns + 200).contains(&sent.at_ns),
            "byte {n}: {sent:?} after {answered_ns}"
        );
    }
}

/// A step of the ramp accesses the DAC once.
#[test]
fn a_slow_dac_keeps_the_core_waiting_for_every_access_until_it_is_fast_again() {
    const WAIT_NS: u32 = 26_000;
    let mut board = boot(RAMP);
    board.run_for(1_000_000).unwrap();
    let steps = |board: &Board, from: usize| -> Vec<u64> {
        let times: Vec<u64> = board.dac_writes()[from..]
            .iter()
            .map(|write| write.at_ns)
            .collect();
        times.windows(2).map(|pair| pair[1] - pair[0]).collect()
    };
    let before = board.dac_writes().len();
    let instructions = board.instructions();
    board.disturb(Disturbance::SlowDac(WAIT_NS));
    board.run_for(1_000_000).unwrap();
    let slow = steps(&board, before);
    let period_ns = 404 * 1000 / 168;
    assert_eq!(
        slow.len(),
        (1_000_000 / (period_ns + u64::from(WAIT_NS))) as usize
    );
    for step in slow {
        let waited = step - period_ns;
        assert!(
            waited.abs_diff(WAIT_NS.into()) <= 2,
            "{step} ns from code to code"
        );
    }
    assert!(
        board.instructions() - instructions < 404 * 40,
        "none while it waits"
    );
    board.disturb(Disturbance::SlowDac(0));
    board.run_for(100_000).unwrap();
    let before = board.dac_writes().len();
    board.run_for(1_000_000).unwrap();
    assert!(
        steps(&board, before)
            .iter()
            .all(|step| step.abs_diff(period_ns) <= 1)
    );
}

/// The echo leaves its input without a resistor: an undriven pin at zero, which reads as one byte of zeros after the other.
#[test]
fn an_open_uart_line_without_a_pull_up_reads_as_zeros() {
    let mut board = boot(ECHO);
    board.run_for(1_000_000).unwrap();
    assert_eq!(
        board.uart_take(),
        [],
        "a whole line that nobody speaks on is idle"
    );
    board.disturb(Disturbance::UartOpen(true));
    board.uart_send(&[7]);
    board.run_for(1_000_000).unwrap();
    let heard = board.uart_take();
    assert!(heard.len() > 90, "{} bytes", heard.len());
    assert!(
        heard.iter().all(|byte| *byte == 1),
        "zero and one, of none that was sent"
    );
    board.disturb(Disturbance::UartOpen(false));
    board.run_for(100_000).unwrap();
    board.uart_take();
    board.uart_send(&[7]);
    board.run_for(1_000_000).unwrap();
    assert_eq!(board.uart_take(), [8]);
}

#[test]
fn a_watchdog_that_is_not_fed_restarts_the_part_and_memory_survives() {
    let mut board = boot(WATCHDOG);
    board.run_for(13_000_000).unwrap();
    let causes: Vec<&str> = board.resets().iter().map(|reset| reset.cause).collect();
    assert_eq!(causes, ["IWDG"; 3]);
    let codes: Vec<u16> = board
        .dac_writes()
        .iter()
        .map(|write| write.code)
        .filter(|&code| code != 0)
        .collect();
    assert_eq!(codes, [1, 2, 3, 4], "the count of starts lives in RAM");
    for (n, Reset { at_ns, .. }) in board.resets().iter().enumerate() {
        let expected_ns = (n as u64 + 1) * 4_000_000;
        assert!(at_ns.abs_diff(expected_ns) < 500_000, "reset {n} at {at_ns} ns");
    }
}

#[test]
fn a_reset_releases_the_line_until_the_firmware_drives_it_again() {
    let mut board = boot(WATCHDOG);
    board.run_for(1_000_000).unwrap();
    assert_eq!(board.dac_code(1), Some(1));
    assert!(
        board
            .run_until(|board| !board.resets().is_empty(), 10_000_000)
            .unwrap()
    );
    board.run_for(1_000_000).unwrap();
    assert_eq!(board.dac_code(1), Some(2));
    let reset_ns = board.resets()[0].at_ns;
    let after: Vec<&DacWrite> = board
        .dac_writes()
        .iter()
        .filter(|write| write.at_ns >= reset_ns)
        .collect();
    assert_eq!(
        after.iter().map(|write| write.code).collect::<Vec<_>>(),
        [0, 2],
        "turned on at zero, then written"
    );
}

#[test]
fn a_peripheral_used_with_its_clock_off_does_nothing_and_is_listed() {
    let mut board = boot(NO_CLOCK);
    board.run_for(10_000).unwrap();
    assert_eq!((board.dac_code(1), board.dac_writes()), (None, &[][..]));
    assert!(
        board
            .gaps()
            .iter()
            .any(|gap| gap.contains("DAC") && gap.contains("DACEN")),
        "{:?}",
        board.gaps()
    );
}

#[test]
fn an_idle_core_retires_no_instructions_while_time_passes() {
    let mut board = boot(SLEEP);
    board.run_for(1_000_000_000).unwrap();
    assert!(
        (1_000_000_000..1_000_000_100).contains(&board.now_ns()),
        "{}",
        board.now_ns()
    );
    assert!(board.instructions() < 10_000, "{}", board.instructions());
}

#[test]
fn a_predicate_that_never_holds_ends_at_its_limit() {
    let mut board = boot(SLEEP);
    assert!(!board.run_until(|_| false, 1_010_000).unwrap());
    assert!(
        (1_010_000..1_010_100).contains(&board.now_ns()),
        "{}",
        board.now_ns()
    );
}

/// What a script of sends and runs leads to: DAC record, bytes with times, resets, instructions.
type Outcome = (Vec<DacWrite>, Vec<gripline_emulator::UartByte>, Vec<Reset>, u64);

/// Runs `elf` with bytes sent at 1, 2 and 3 ms, cutting the time between into steps of `step_ns`.
fn outcome(elf: &[u8], step_ns: u64) -> Outcome {
    let mut board = Board::boot(elf).unwrap();
    for byte in 1..=3 {
        for _ in 0..1_000_000 / step_ns {
            board.run_for(step_ns).unwrap();
        }
        board.uart_send(&[byte, byte + 3, byte + 6]);
    }
    for _ in 0..12_000_000 / step_ns {
        board.run_for(step_ns).unwrap();
    }
    let outcome = (
        board.dac_writes().to_vec(),
        board.uart_bytes().to_vec(),
        board.resets().to_vec(),
    );
    (outcome.0, outcome.1, outcome.2, board.instructions())
}

#[test]
fn the_same_script_gives_the_same_record_however_the_time_is_cut() {
    for code in [RAMP, ECHO, WATCHDOG] {
        let elf = elf_at(FLASH, code);
        let once = outcome(&elf, 1_000_000);
        assert!(!once.0.is_empty());
        assert_eq!(once, outcome(&elf, 1_000_000), "a second run");
        assert_eq!(once, outcome(&elf, 50_000), "twenty times as many steps");
    }
}

#[test]
fn an_image_that_cannot_boot_is_refused_by_what_it_lacks() {
    let refusal = |bytes: &[u8]| Board::boot(bytes).unwrap_err();
    assert!(matches!(refusal(b""), EmulatorError::NotElf { found } if found == "an empty file"));
    assert!(
        matches!(refusal(b"MZ\x90\0\x03"), EmulatorError::NotElf { found } if found == "[4d, 5a, 90, 00]")
    );
    let in_ram = refusal(&elf_at(0x2000_0000, SLEEP));
    assert!(
        matches!(&in_ram, EmulatorError::NoFlash { found } if found.starts_with("0x20000000..")),
        "{in_ram}"
    );
    let mut for_x86 = elf_at(FLASH, SLEEP);
    for_x86[18] = 3;
    let text = refusal(&for_x86).to_string();
    assert!(
        text.contains("built for ELF machine 3") && text.contains("ELF machine 40"),
        "{text}"
    );
    let mut short = elf_at(FLASH, SLEEP);
    short.truncate(80);
    let text = refusal(&short).to_string();
    assert!(
        text.starts_with("image: ") && text.contains("ends before"),
        "{text}"
    );
}

/// The image that `GRIPLINE_IMAGE` names.
fn real_image() -> Vec<u8> {
    let path = std::env::var_os("GRIPLINE_IMAGE").expect("GRIPLINE_IMAGE names an image for the STM32F427");
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
#[ignore = "needs GRIPLINE_IMAGE, which `cargo xtask test` sets"]
fn the_firmware_boots_drives_its_line_logs_and_feeds_its_watchdog() {
    let mut board = Board::boot(&real_image()).unwrap();
    board.run_for(3_000_000_000).unwrap();
    assert_eq!(board.resets(), []);
    assert!(
        board.dac_code(1).is_some_and(|code| code > 0),
        "{:?}",
        board.dac_code(1)
    );
    assert_ne!(board.log(), [0_u8; 0]);
}

/// PA10 is its alternate function's, and pulled up (RM0090, sections 8.4.1 and 8.4.4).
#[test]
#[ignore = "needs GRIPLINE_IMAGE, which `cargo xtask test` sets"]
fn the_firmware_pulls_the_input_of_its_uart_up() {
    const GPIOA_MODER: u32 = 0x4002_0000;
    const GPIOA_PUPDR: u32 = 0x4002_000C;
    const PIN: u32 = 10;
    let mut board = Board::boot(&real_image()).unwrap();
    board.run_for(100_000_000).unwrap();
    let field = |board: &mut Board, register| {
        let bytes = board.read_memory(register, 4).unwrap();
        u32::from_le_bytes(bytes.try_into().unwrap()) >> (2 * PIN) & 0b11
    };
    assert_eq!(field(&mut board, GPIOA_MODER), 0b10, "alternate function");
    assert_eq!(field(&mut board, GPIOA_PUPDR), 0b01, "pull-up");
}

#[test]
#[ignore = "needs GRIPLINE_IMAGE, which `cargo xtask test` sets"]
fn the_firmware_does_the_same_however_the_time_is_cut() {
    let elf = real_image();
    assert_eq!(outcome(&elf, 1_000_000), outcome(&elf, 125_000));
}

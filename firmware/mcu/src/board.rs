//! What differs between boards: the chip, its clocks, its number in the handshake.
//!
//! Both boards: 8 MHz crystal, 168 MHz core, grip-force line on PA4, UART on PA9 (out) and PA10 (in), USB on PA11
//! and PA12, gripper on RS-485 on PA1 (driver enable), PA2 (out) and PA3 (in), the line read back on PA6, fault output on PB0,
//! release-inhibit input on PB1.
//! Limits: the STM32F427 could run at 180 MHz; at 168 one worst-case bound holds for both.

use embassy_stm32::Config;
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv, PllSource, Sysclk,
    mux,
};
use embassy_stm32::time::Hertz;
use gripline_protocol::message::{BOARDS, Hello, IMAGE_IDENTITY_BYTES, Revision};

use crate::priority;

/// This board's number in the handshake.
pub(crate) const BOARD: u8 = if cfg!(feature = "stm32f405rg") { 1 } else { 2 };
/// This board's name in logs.
pub(crate) const NAME: &str = BOARDS[BOARD as usize];

/// The commit that the image was built from, as the build script found it.
pub(crate) const REVISION: Option<Revision> = match u32::from_str_radix(env!("GRIPLINE_COMMIT"), 16) {
    Ok(commit) => Some(Revision {
        commit,
        dirty: !matches!(env!("GRIPLINE_CLEAN").as_bytes(), b"1"),
    }),
    Err(_) => None,
};

/// The identity block of this image, which hosts read before they flash it (identity.x).
#[used]
#[unsafe(link_section = ".gripline_identity")]
static IDENTITY: [u8; IMAGE_IDENTITY_BYTES] = Hello {
    revision: REVISION,
    ..Hello::of_this_build(BOARD, 0)
}
.to_image();

/// The crystal of both boards, hertz.
const CRYSTAL: Hertz = Hertz(8_000_000);

/// 8 MHz / 4 = 2 MHz into the PLL, × 168 = 336 MHz inside, / 2 = 168 MHz core, / 7 = 48 MHz USB;
/// the slow bus at 42 MHz (DAC, TIM5 at twice that), the fast one at 84 MHz (USART1).
pub(crate) fn clocks() -> Config {
    let mut config = Config::default();
    config.rcc.hse = Some(Hse {
        freq: CRYSTAL,
        mode: HseMode::Oscillator,
    });
    config.rcc.pll_src = PllSource::HSE;
    config.rcc.pll = Some(Pll {
        prediv: PllPreDiv::DIV4,
        mul: PllMul::MUL168,
        divp: Some(PllPDiv::DIV2),
        divq: Some(PllQDiv::DIV7),
        divr: None,
    });
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV1;
    config.rcc.apb1_pre = APBPrescaler::DIV4;
    config.rcc.apb2_pre = APBPrescaler::DIV2;
    config.rcc.mux.clk48sel = mux::Clk48sel::PLL1_Q;
    // DMA is not used, but the HAL enables its interrupts: none may lie above the critical sections.
    config.dma_interrupt_priority = priority::OTHERS;
    config
}

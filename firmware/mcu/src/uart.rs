//! The second transport: USART1 on PA9 (out) and PA10 (in), 921,600 baud, 8N1, packets framed with COBS.
//!
//! A byte takes 10.9 µs, a packet of 64 bytes 720 µs; a dense map takes about 30 ms.
//! Limits: no flow control. A byte is lost when maps over USB or a critical section block the receiver for longer than a byte
//! time. The CRC then refuses the frame, and the next map is accepted.

use embassy_stm32::gpio::Pull;
use embassy_stm32::usart::{BufferedInterruptHandler, BufferedUart, BufferedUartRx, BufferedUartTx, Config};
use embassy_stm32::{Peri, bind_interrupts, peripherals};
use embedded_io_async::Write;
use gripline_protocol::cobs::{FRAME_MAX, encode_packet};
use static_cell::StaticCell;

use crate::outbox;

/// Symbols a second: what common USB adapters and the chip both make exactly enough (84 MHz / 91.125, error 0.02 %).
const BAUD: u32 = 921_600;
/// Bytes that may wait on the way in: 2.8 ms.
const IN_BYTES: usize = 256;
/// Bytes that may wait on the way out: one frame, because `transmit` hands over one at a time.
const OUT_BYTES: usize = FRAME_MAX + 1;

bind_interrupts!(struct Interrupts {
    USART1 => BufferedInterruptHandler<peripherals::USART1>;
});

/// Opens the UART; the halves go to `control` and to [`transmit`].
pub(crate) fn open(
    uart: Peri<'static, peripherals::USART1>,
    input: Peri<'static, peripherals::PA10>,
    output: Peri<'static, peripherals::PA9>,
) -> (BufferedUartRx<'static>, BufferedUartTx<'static>) {
    static IN: StaticCell<[u8; IN_BYTES]> = StaticCell::new();
    static OUT: StaticCell<[u8; OUT_BYTES]> = StaticCell::new();
    let mut config = Config::default();
    config.baudrate = BAUD;
    // A line that nothing drives reads as idle, not as noise.
    config.rx_pull = Pull::Up;
    let out = OUT.init([0; OUT_BYTES]);
    let uart = BufferedUart::new(
        uart,
        input,
        output,
        out,
        IN.init([0; IN_BYTES]),
        Interrupts,
        config,
    )
    .expect("84 MHz makes this baud rate");
    let (output, input) = uart.split();
    (input, output)
}

/// Sends the packets of the outbox.
///
/// Deadline: none, the host waits. Budget: a copy of 66 bytes a packet. Miss: the outbox fills, and the library keeps only
/// the newest status.
#[embassy_executor::task]
pub(crate) async fn transmit(mut uart: BufferedUartTx<'static>) {
    let mut frame = [0; FRAME_MAX];
    loop {
        let packet = outbox::UART.receive().await;
        let length = encode_packet(&packet, &mut frame);
        // One frame at a time: the driver registers no waker when only part of a frame fits. It reports no errors on this
        // path.
        let _ = uart.flush().await;
        let _ = uart.write_all(&frame[..length]).await;
    }
}

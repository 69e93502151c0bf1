//! The gripper on the bus: USART2 on PA2 (out) and PA3 (in), 115,200 baud, 8N1, an RS-485 transceiver whose driver is
//! enabled by PA1 for as long as a request takes.
//!
//! [`talk`] moves the bytes of the library's [`Robotiq`]; `control` leaves the force in a word and finds the health in
//! another, so that the way from map to line has one store more and waits for nothing.
//! Limits: the line is asked for its newest force every 5 ms, as often as the gripper listens.

use core::convert::Infallible;
use core::sync::atomic::{AtomicI32, AtomicU8, Ordering};

use embassy_futures::select::{Either, select};
use embassy_stm32::gpio::{Level, Output, Pull, Speed};
use embassy_stm32::usart::{BufferedInterruptHandler, BufferedUart, BufferedUartRx, BufferedUartTx, Config};
use embassy_stm32::{Peri, bind_interrupts, peripherals};
use embassy_time::{Instant, Timer};
use embedded_io_async::{Read, Write};
use gripline_firmware::GripForce;
use gripline_firmware::constants::MODBUS_BAUD;
use gripline_firmware::line::{GripLine, LineHealth};
use gripline_firmware::modbus::{ANSWER_MAX, REQUEST_MAX};
use gripline_firmware::robotiq::Robotiq;
use static_cell::StaticCell;

/// What `control` wants of the gripper, 1/4096 N.
static WANTED: AtomicI32 = AtomicI32::new(0);
/// What [`talk`] knows of it, as a number of [`LineHealth`]; good while there is no gripper on the bus.
static HEALTH: AtomicU8 = AtomicU8::new(LineHealth::Good as u8);

/// The end of the line that `control` holds.
pub(crate) struct BusLine;

impl GripLine for BusLine {
    type Error = Infallible;

    #[inline]
    fn write(&mut self, force: GripForce) -> Result<(), Infallible> {
        WANTED.store(force.lsb(), Ordering::Relaxed);
        Ok(())
    }

    fn health(&self) -> LineHealth {
        let number = usize::from(HEALTH.load(Ordering::Relaxed));
        LineHealth::ALL
            .get(number)
            .copied()
            .unwrap_or(LineHealth::NoAnswer)
    }
}

bind_interrupts!(struct Interrupts {
    USART2 => BufferedInterruptHandler<peripherals::USART2>;
});

/// The bus, ready to talk.
pub(crate) struct Bus {
    input: BufferedUartRx<'static>,
    output: BufferedUartTx<'static>,
    driver: Output<'static>,
}

/// Opens the bus: listening, the driver off.
pub(crate) fn open(
    uart: Peri<'static, peripherals::USART2>,
    input: Peri<'static, peripherals::PA3>,
    output: Peri<'static, peripherals::PA2>,
    driver: Peri<'static, peripherals::PA1>,
) -> Bus {
    static IN: StaticCell<[u8; 2 * ANSWER_MAX]> = StaticCell::new();
    static OUT: StaticCell<[u8; REQUEST_MAX + 1]> = StaticCell::new();
    let driver = Output::new(driver, Level::Low, Speed::Low);
    HEALTH.store(LineHealth::Starting as u8, Ordering::Relaxed);
    let mut config = Config::default();
    config.baudrate = MODBUS_BAUD;
    // The transceiver lets go of the wire while it sends.
    config.rx_pull = Pull::Up;
    let out = OUT.init([0; REQUEST_MAX + 1]);
    let uart = BufferedUart::new(
        uart,
        input,
        output,
        out,
        IN.init([0; 2 * ANSWER_MAX]),
        Interrupts,
        config,
    )
    .expect("42 MHz makes this baud rate");
    let (output, input) = uart.split();
    Bus {
        input,
        output,
        driver,
    }
}

/// Asks and orders. Deadline: the driver off before the gripper answers, 1.75 ms after the request; budget: some
/// microseconds every 5 ms, in the gaps of everything else. Miss: the answer is lost, and asked for again after 35 ms.
#[embassy_executor::task]
pub(crate) async fn talk(mut bus: Bus) {
    let mut line = Robotiq::new(now_us());
    let mut told = line.health();
    loop {
        let Ok(()) = line.write(GripForce::from_lsb(WANTED.load(Ordering::Relaxed)));
        if let Some(request) = line.poll_transmit(now_us()) {
            bus.driver.set_high();
            // This driver reports no errors on this path; `flush` waits for the last stop bit.
            let _ = bus.output.write_all(&request).await;
            let _ = bus.output.flush().await;
            bus.driver.set_low();
        }
        let health = line.health();
        HEALTH.store(health as u8, Ordering::Relaxed);
        if health != told {
            told = health;
            defmt::info!("gripper: {}, {}", health, line.status());
        }
        let mut answer = [0; ANSWER_MAX];
        let wake = Timer::at(Instant::from_micros(line.wake_us()));
        if let Either::First(Ok(length)) = select(bus.input.read(&mut answer), wake).await {
            line.receive(&answer[..length], now_us());
        }
    }
}

fn now_us() -> u64 {
    Instant::now().as_micros()
}

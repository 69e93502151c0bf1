//! The gripper on the bus: USART2 on PA2 (out) and PA3 (in), 115,200 baud, 8N1, an RS-485 transceiver whose driver is
//! enabled by PA1 for as long as a request takes.
//!
//! The task [`talk`] moves the bytes of the library's [`Robotiq`]. `control` exchanges words with it, force and release for
//! health: the path from map to line has one store more and waits for nothing.
//! Limits: the newest force goes out every 5 ms, as often as the gripper listens.

use core::convert::Infallible;
use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU8, Ordering};

use embassy_futures::select::{Either, select};
use embassy_stm32::gpio::{Level, Output, Pull, Speed};
use embassy_stm32::usart::{BufferedInterruptHandler, BufferedUart, BufferedUartRx, BufferedUartTx, Config};
use embassy_stm32::{Peri, bind_interrupts, peripherals};
use embassy_time::{Duration, Instant, Timer, with_timeout};
use embedded_io_async::Read;
use gripline_firmware::GripForce;
use gripline_firmware::constants::{MODBUS_BAUD, MODBUS_SEND_US};
use gripline_firmware::line::{GripLine, LineHealth};
use gripline_firmware::modbus::{ANSWER_MAX, REQUEST_MAX};
use gripline_firmware::robotiq::Robotiq;
use gripline_firmware::rs485::Transceiver;
use static_cell::StaticCell;

/// The force that `control` requests, 1/4096 N.
static REQUESTED: AtomicI32 = AtomicI32::new(0);
/// A person let go since the task last looked.
static IS_RELEASED: AtomicBool = AtomicBool::new(false);
/// The gripper's health, as a number of [`LineHealth`]; good while there is no gripper on the bus.
static HEALTH: AtomicU8 = AtomicU8::new(LineHealth::Good as u8);

/// The end of the line that `control` holds.
pub(crate) struct BusLine;

impl GripLine for BusLine {
    type Error = Infallible;

    #[inline]
    fn write(&mut self, force: GripForce) -> Result<(), Infallible> {
        REQUESTED.store(force.lsb(), Ordering::Relaxed);
        Ok(())
    }

    fn release(&mut self) {
        IS_RELEASED.store(true, Ordering::Relaxed);
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
    output: Transceiver<BufferedUartTx<'static>, Output<'static>>,
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
    // While it sends, the transceiver leaves this wire floating.
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
    let Ok(output) = Transceiver::new(output, driver);
    Bus { input, output }
}

/// Sends the gripper requests and takes its answers.
///
/// Deadline: the driver off before the gripper answers, 1.75 ms after the request. Budget: some microseconds every 5 ms, below
/// all interrupts. Miss: the answer is lost, and the request is repeated after 35 ms. Nothing waits longer than it may: a request
/// that does not go out is given up, and a gripper that stays silent is LINE FAILED.
#[embassy_executor::task]
pub(crate) async fn talk(mut bus: Bus) {
    let mut line = Robotiq::new(now_us());
    let mut logged = line.health();
    loop {
        if IS_RELEASED.swap(false, Ordering::Relaxed) {
            line.release();
        }
        let Ok(()) = line.write(GripForce::from_lsb(REQUESTED.load(Ordering::Relaxed)));
        if let Some(request) = line.poll_transmit(now_us()) {
            let sending = with_timeout(Duration::from_micros(MODBUS_SEND_US), bus.output.send(&request));
            // A request that was not sent gets no answer, which the line notices.
            if sending.await.is_err() {
                let Ok(()) = bus.output.disable_driver();
            }
        }
        let health = line.health();
        HEALTH.store(health as u8, Ordering::Relaxed);
        if health != logged {
            logged = health;
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

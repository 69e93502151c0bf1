//! An RS-485 transceiver on any UART of embedded-io and any pin of embedded-hal.
//!
//! The pin enables the driver only while a request is sent, so that the other end can answer. Limits: half duplex.

use embedded_hal::digital::OutputPin;
use embedded_io_async::Write;

/// What can go wrong while sending.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SendError<U, P> {
    /// The UART failed.
    Uart(U),
    /// The pin that enables the driver failed.
    Pin(P),
}

/// The sending end of the bus.
#[derive(Debug)]
pub struct Transceiver<U, P> {
    uart: U,
    driver_enable: P,
}

impl<U: Write, P: OutputPin> Transceiver<U, P> {
    /// Starts with the driver off.
    ///
    /// # Errors
    /// The pin's.
    pub fn new(uart: U, mut driver_enable: P) -> Result<Self, P::Error> {
        driver_enable.set_low()?;
        Ok(Self { uart, driver_enable })
    }

    /// Turns the driver off: after a [`send`](Self::send) that was given up half-way.
    ///
    /// # Errors
    /// The pin's.
    pub fn disable_driver(&mut self) -> Result<(), P::Error> {
        self.driver_enable.set_low()
    }

    /// Sends a request and returns after its last stop bit, with the driver off again even when the UART failed.
    ///
    /// # Errors
    /// [`SendError`].
    pub async fn send(&mut self, request: &[u8]) -> Result<(), SendError<U::Error, P::Error>> {
        self.driver_enable.set_high().map_err(SendError::Pin)?;
        let sent = match self.uart.write_all(request).await {
            Ok(()) => self.uart.flush().await,
            Err(error) => Err(error),
        };
        self.driver_enable.set_low().map_err(SendError::Pin)?;
        sent.map_err(SendError::Uart)
    }
}

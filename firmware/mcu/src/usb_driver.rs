//! The HAL's USB driver, mended from outside. Found on the emulated board; 1, 4 and 5 are known to embassy's authors too,
//! who mended them in a later driver that this HAL cannot take yet. `tests/emulator/tests/usb.rs` tests the mends.
//!
//! 1. A reset of the bus leaves a loaded IN endpoint enabled, for ever: nothing is sent after a replug.
//! 2. A host that breaks a control transfer off leaves its handler waiting: no request is answered any more.
//! 3. A request about an endpoint that the chip does not have panics.
//! 4. A new configuration or a cleared halt leaves the data toggle: every second packet is taken for a repetition.
//! 5. A suspend noticed before a reset is reported after it: requests wait for a resume that never comes.
//! 6. A full-speed device must refuse the device qualifier (USB 2.0 section 9.6.2); requests without data end with a
//!    status stage whichever way they point (9.3.1); a device that powers itself says so (9.4.5).
//!
//! Limits: bulk and control endpoints; one interface.

use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::Poll;

use embassy_stm32::pac::USB_OTG_FS as REGISTERS;
use embassy_stm32::peripherals::USB_OTG_FS;
use embassy_stm32::usb;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_usb::driver::{
    Bus, ControlPipe, Direction, Driver, EndpointAddress, EndpointAllocError, EndpointError, EndpointType,
    Event, Unsupported,
};
use gripline_protocol::PACKET_MAX;

use crate::priority::hold_off;

type Inner = usb::Driver<'static, USB_OTG_FS>;

/// Endpoints in each direction: the control endpoint and one pair.
const ENDPOINTS: usize = 2;
/// How often a register is looked at for what the core does at once, or after the packet on the bus (52 µs).
const LOOKS_MAX: usize = 2_000;
/// SETUP packets that the core may take in a row (`DOEPTSIZ0`); fewer are left while one waits to be handled.
const SETUPS: u8 = 3;

/// Raised when a reset of the bus has taken away whatever waited to be sent.
pub(crate) static RESET: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// The driver.
pub(crate) struct MendedDriver(pub(crate) Inner);

impl Driver<'static> for MendedDriver {
    type EndpointOut = <Inner as Driver<'static>>::EndpointOut;
    type EndpointIn = <Inner as Driver<'static>>::EndpointIn;
    type ControlPipe = MendedControl;
    type Bus = MendedBus;

    fn alloc_endpoint_out(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        packet_max: u16,
        interval_ms: u8,
    ) -> Result<Self::EndpointOut, EndpointAllocError> {
        self.0.alloc_endpoint_out(kind, address, packet_max, interval_ms)
    }

    fn alloc_endpoint_in(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        packet_max: u16,
        interval_ms: u8,
    ) -> Result<Self::EndpointIn, EndpointAllocError> {
        self.0.alloc_endpoint_in(kind, address, packet_max, interval_ms)
    }

    fn start(self, control_packet_max: u16) -> (MendedBus, MendedControl) {
        let (bus, control) = self.0.start(control_packet_max);
        (MendedBus(bus), MendedControl(control))
    }
}

/// The bus, with mends 1, 4 and 5.
pub(crate) struct MendedBus(<Inner as Driver<'static>>::Bus);

impl Bus for MendedBus {
    async fn enable(&mut self) {
        self.0.enable().await;
    }

    async fn disable(&mut self) {
        self.0.disable().await;
    }

    async fn poll(&mut self) -> Event {
        loop {
            match self.0.poll().await {
                Event::Reset => {
                    (0..ENDPOINTS).for_each(stop_in);
                    RESET.signal(());
                    return Event::Reset;
                }
                Event::Suspend if !REGISTERS.dsts().read().suspsts() => {}
                event => return event,
            }
        }
    }

    fn endpoint_set_enabled(&mut self, address: EndpointAddress, enabled: bool) {
        if address.direction() == Direction::In {
            stop_in(address.index());
        }
        self.0.endpoint_set_enabled(address, enabled);
        if enabled {
            start_with_data0(address);
        }
    }

    fn endpoint_set_stalled(&mut self, address: EndpointAddress, stalled: bool) {
        if stalled && address.direction() == Direction::In {
            stop_in(address.index());
        }
        self.0.endpoint_set_stalled(address, stalled);
        if !stalled {
            start_with_data0(address);
        }
    }

    fn endpoint_is_stalled(&mut self, address: EndpointAddress) -> bool {
        self.0.endpoint_is_stalled(address)
    }

    async fn remote_wakeup(&mut self) -> Result<(), Unsupported> {
        self.0.remote_wakeup().await
    }
}

/// Takes back what an IN endpoint was given to send. Only tasks without priority touch these registers; the interrupt
/// handler may clear what is waited for, so the end of the transfer counts as well.
fn stop_in(index: usize) {
    let (control, interrupts) = (REGISTERS.diepctl(index), REGISTERS.diepint(index));
    if !control.read().epena() {
        return;
    }
    control.modify(|set| set.set_snak(true));
    look_for(|| interrupts.read().inepne());
    control.modify(|set| {
        set.set_snak(true);
        set.set_epdis(true);
    });
    look_for(|| interrupts.read().epdisd() || !control.read().epena());
    interrupts.write(|clear| clear.set_epdisd(true));
    REGISTERS.grstctl().write(|flush| {
        flush.set_txfflsh(true);
        flush.set_txfnum(index as u8);
    });
    look_for(|| !REGISTERS.grstctl().read().txfflsh());
}

/// Waits for what the core does within a packet's time, and no longer.
fn look_for(mut seen: impl FnMut() -> bool) {
    let _ = (0..LOOKS_MAX).find(|_| seen());
}

/// The next data packet of a bulk endpoint has toggle DATA0, here as at the host.
fn start_with_data0(address: EndpointAddress) {
    // Never more (`sort`), which the compiler need not take on trust.
    let index = address.index().min(ENDPOINTS - 1);
    match address.direction() {
        _ if index == 0 => {}
        Direction::In => REGISTERS
            .diepctl(index)
            .modify(|set| set.set_sd0pid_sevnfrm(true)),
        // `usb_interrupt` changes the same register at a higher priority.
        Direction::Out => hold_off(|| {
            REGISTERS
                .doepctl(index)
                .modify(|set| set.set_sd0pid_sevnfrm(true));
        }),
    }
}

/// The control endpoint, with mends 2, 3 and 6.
pub(crate) struct MendedControl(<Inner as Driver<'static>>::ControlPipe);

/// What to do with a request.
enum Request {
    /// It is the USB stack's.
    Pass,
    Refuse,
    /// Nothing to say, but the host waits for a status stage.
    Acknowledge,
    /// Answer with the state of the device: it powers itself and does not wake its host.
    Status,
}

/// Sorts out what the USB stack would answer wrongly (USB 2.0 tables 9-3 and 9-4).
fn sort(setup: [u8; 8]) -> Request {
    const GET_STATUS: u8 = 0;
    const GET_DESCRIPTOR: u8 = 6;
    const DEVICE_QUALIFIER: u8 = 6;
    let [kind, request, _, value_high, index, _, length_low, length_high] = setup;
    let is_empty = [length_low, length_high] == [0, 0];
    let is_endpoint = kind & 0x7F == 2;
    if is_endpoint && usize::from(index & 0x7F) >= ENDPOINTS {
        return Request::Refuse;
    }
    match (kind, request) {
        (0x80, GET_DESCRIPTOR) if value_high == DEVICE_QUALIFIER => Request::Refuse,
        (0x80..=0xFF, _) if is_empty => Request::Acknowledge,
        (0x80, GET_STATUS) => Request::Status,
        _ => Request::Pass,
    }
}

impl MendedControl {
    /// Empties the driver's buffer: a packet of a transfer that was broken off would be taken for the next one's.
    async fn drop_stale_packet(&mut self) {
        let mut packet = [0; PACKET_MAX];
        let mut read = pin!(self.0.data_out(&mut packet, false, false));
        poll_fn(|context| {
            let _ = read.as_mut().poll(context);
            Poll::Ready(())
        })
        .await;
    }

    /// Works on a transfer until it is done or the host has begun another one.
    async fn unless_broken_off<T>(
        work: impl Future<Output = Result<T, EndpointError>>,
    ) -> Result<T, EndpointError> {
        let mut work = pin!(work);
        // The driver wakes this task for every SETUP and every reset.
        let done = poll_fn(|context| match work.as_mut().poll(context) {
            Poll::Pending if is_broken_off() => Poll::Ready(Err(EndpointError::Disabled)),
            other => other,
        })
        .await;
        if done.is_err() {
            stop_in(0);
        }
        done
    }
}

/// Whether a SETUP or a reset of the bus waits to be handled.
fn is_broken_off() -> bool {
    let events = REGISTERS.gintsts().read();
    events.usbrst() || events.enumdne() || REGISTERS.doeptsiz(0).read().rxdpid_stupcnt() < SETUPS
}

impl ControlPipe for MendedControl {
    fn max_packet_size(&self) -> usize {
        self.0.max_packet_size()
    }

    async fn setup(&mut self) -> [u8; 8] {
        loop {
            let setup = self.0.setup().await;
            stop_in(0);
            self.drop_stale_packet().await;
            match sort(setup) {
                Request::Pass => return setup,
                Request::Refuse => self.0.reject().await,
                Request::Acknowledge => self.accept().await,
                Request::Status => {
                    let length = usize::from(u16::from_le_bytes([setup[6], setup[7]])).min(2);
                    // A host that left has no use for an answer.
                    let _ = self.data_in(&[1, 0][..length], true, true).await;
                }
            }
        }
    }

    async fn data_out(&mut self, buffer: &mut [u8], first: bool, last: bool) -> Result<usize, EndpointError> {
        Self::unless_broken_off(self.0.data_out(buffer, first, last)).await
    }

    async fn data_in(&mut self, data: &[u8], first: bool, last: bool) -> Result<(), EndpointError> {
        Self::unless_broken_off(self.0.data_in(data, first, last)).await
    }

    async fn accept(&mut self) {
        let accepted = async {
            self.0.accept().await;
            Ok(())
        };
        // Broken off is as good as accepted: the stack has done what was asked.
        let _ = Self::unless_broken_off(accepted).await;
    }

    async fn reject(&mut self) {
        self.0.reject().await;
    }

    async fn accept_set_address(&mut self, address: u8) {
        let accepted = async {
            self.0.accept_set_address(address).await;
            Ok(())
        };
        let _ = Self::unless_broken_off(accepted).await;
    }
}

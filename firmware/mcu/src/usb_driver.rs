//! The HAL's USB driver with six faults worked around from outside; `tests/emulator/tests/usb.rs` tests each.
//!
//! 1. A bus reset leaves a loaded IN endpoint enabled: nothing is sent after a replug.
//! 2. A host that aborts a control transfer leaves its handler waiting: no request is answered any more.
//! 3. A request about an endpoint that the chip does not have panics.
//! 4. A new configuration or a cleared halt keeps the data toggle: every second packet is dropped as a repetition.
//! 5. A suspend latched before a reset is reported after it: enumeration waits for a resume that never comes.
//! 6. A full-speed device must refuse the device qualifier (USB 2.0, 9.6.2); a request without data ends with a status stage in
//!    either direction (9.3.1); a self-powered device says so before it is configured (9.4.5).
//!
//! Upstream fixed 1, 4 and 5 in <https://github.com/embassy-rs/embassy/pull/6687>, the qualifier of 6 after
//! <https://github.com/embassy-rs/embassy/issues/4318>; neither is in a release that embassy-stm32 0.6 takes. A patched copy of
//! embassy-usb-synopsys-otg 0.3 would be 8,200 lines here and still need 2, 3 and half of 6: these 300 lines are less.
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

use crate::priority::block_path;

type Inner = usb::Driver<'static, USB_OTG_FS>;

/// Endpoints in each direction: the control endpoint and one pair.
const ENDPOINTS: usize = 2;
/// Reads of a register until the core has done what it does at once, or after the packet on the bus (52 µs).
const READS_MAX: usize = 2_000;
/// SETUP packets that the core may take in a row (`DOEPTSIZ0`); the count is lower while one waits to be handled.
const SETUPS: u8 = 3;

/// Signals a bus reset, which has discarded what waited to be sent.
pub(crate) static RESET: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// The driver.
pub(crate) struct PatchedDriver(pub(crate) Inner);

impl Driver<'static> for PatchedDriver {
    type EndpointOut = <Inner as Driver<'static>>::EndpointOut;
    type EndpointIn = <Inner as Driver<'static>>::EndpointIn;
    type ControlPipe = PatchedControl;
    type Bus = PatchedBus;

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

    fn start(self, control_packet_max: u16) -> (PatchedBus, PatchedControl) {
        let (bus, control) = self.0.start(control_packet_max);
        (PatchedBus(bus), PatchedControl(control))
    }
}

/// The bus, with faults 1, 4 and 5 worked around.
pub(crate) struct PatchedBus(<Inner as Driver<'static>>::Bus);

impl Bus for PatchedBus {
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

/// Discards what an IN endpoint has to send. Only thread-level tasks touch these registers. The interrupt handler may clear
/// the flag that this waits for, so the end of the transfer counts too.
fn stop_in(index: usize) {
    let (control, interrupts) = (REGISTERS.diepctl(index), REGISTERS.diepint(index));
    if !control.read().epena() {
        return;
    }
    control.modify(|set| set.set_snak(true));
    wait_for(|| interrupts.read().inepne());
    control.modify(|set| {
        set.set_snak(true);
        set.set_epdis(true);
    });
    wait_for(|| interrupts.read().epdisd() || !control.read().epena());
    interrupts.write(|clear| clear.set_epdisd(true));
    REGISTERS.grstctl().write(|flush| {
        flush.set_txfflsh(true);
        flush.set_txfnum(index as u8);
    });
    wait_for(|| !REGISTERS.grstctl().read().txfflsh());
}

/// Waits until `seen`, a packet's time at most.
fn wait_for(mut seen: impl FnMut() -> bool) {
    let _ = (0..READS_MAX).find(|_| seen());
}

/// Resets the data toggle of a bulk endpoint to DATA0, as the host does.
fn start_with_data0(address: EndpointAddress) {
    // `classify` refuses larger ones; this also tells the compiler.
    let index = address.index().min(ENDPOINTS - 1);
    match address.direction() {
        _ if index == 0 => {}
        Direction::In => REGISTERS
            .diepctl(index)
            .modify(|set| set.set_sd0pid_sevnfrm(true)),
        // `usb_interrupt` changes the same register at a higher priority.
        Direction::Out => block_path(|| {
            REGISTERS
                .doepctl(index)
                .modify(|set| set.set_sd0pid_sevnfrm(true));
        }),
    }
}

/// The control endpoint, with faults 2, 3 and 6 worked around.
pub(crate) struct PatchedControl(<Inner as Driver<'static>>::ControlPipe);

/// What to do with a request.
enum Request {
    /// The USB stack answers it.
    Pass,
    Refuse,
    /// No data, but the host waits for a status stage.
    Acknowledge,
    /// Answer with the state of the device: self-powered, no remote wake-up.
    Status,
}

/// Finds the requests that the USB stack would answer wrongly (USB 2.0 tables 9-3 and 9-4).
fn classify(setup: [u8; 8]) -> Request {
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

impl PatchedControl {
    /// Empties the driver's buffer: a packet of an aborted transfer would count for the next one.
    async fn drop_stale_packet(&mut self) {
        let mut packet = [0; PACKET_MAX];
        let mut read = pin!(self.0.data_out(&mut packet, false, false));
        poll_fn(|context| {
            let _ = read.as_mut().poll(context);
            Poll::Ready(())
        })
        .await;
    }

    /// Works on a transfer until it is done or the host begins another one.
    async fn unless_aborted<T>(
        work: impl Future<Output = Result<T, EndpointError>>,
    ) -> Result<T, EndpointError> {
        let mut work = pin!(work);
        // The driver wakes this task for every SETUP and every reset.
        let done = poll_fn(|context| match work.as_mut().poll(context) {
            Poll::Pending if is_aborted() => Poll::Ready(Err(EndpointError::Disabled)),
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
fn is_aborted() -> bool {
    let events = REGISTERS.gintsts().read();
    events.usbrst() || events.enumdne() || REGISTERS.doeptsiz(0).read().rxdpid_stupcnt() < SETUPS
}

impl ControlPipe for PatchedControl {
    fn max_packet_size(&self) -> usize {
        self.0.max_packet_size()
    }

    async fn setup(&mut self) -> [u8; 8] {
        loop {
            let setup = self.0.setup().await;
            stop_in(0);
            self.drop_stale_packet().await;
            match classify(setup) {
                Request::Pass => return setup,
                Request::Refuse => self.0.reject().await,
                Request::Acknowledge => self.accept().await,
                Request::Status => {
                    let length = usize::from(u16::from_le_bytes([setup[6], setup[7]])).min(2);
                    // An error means that the host has left.
                    let _ = self.data_in(&[1, 0][..length], true, true).await;
                }
            }
        }
    }

    async fn data_out(&mut self, buffer: &mut [u8], first: bool, last: bool) -> Result<usize, EndpointError> {
        Self::unless_aborted(self.0.data_out(buffer, first, last)).await
    }

    async fn data_in(&mut self, data: &[u8], first: bool, last: bool) -> Result<(), EndpointError> {
        Self::unless_aborted(self.0.data_in(data, first, last)).await
    }

    async fn accept(&mut self) {
        let accepted = async {
            self.0.accept().await;
            Ok(())
        };
        // Aborted is as good as accepted: the stack has done what was asked.
        let _ = Self::unless_aborted(accepted).await;
    }

    async fn reject(&mut self) {
        self.0.reject().await;
    }

    async fn accept_set_address(&mut self, address: u8) {
        let accepted = async {
            self.0.accept_set_address(address).await;
            Ok(())
        };
        let _ = Self::unless_aborted(accepted).await;
    }
}

//! The first transport: USB full speed, one vendor-specific interface, bulk in and out, 64 bytes; driverless on
//! Windows through Microsoft OS 2.0 descriptors. Every packet is one transfer, in both directions.
//!
//! Limits: the id is the public test id 0x1209/0x0001 until the project has its own. The cable's supply voltage is not
//! sensed (PA9 belongs to the UART), so the pull-up is always on.

use embassy_futures::select::select;
use embassy_stm32::{Peri, peripherals, uid, usb};
use embassy_usb::driver::{Driver, Endpoint, EndpointIn};
use embassy_usb::msos::{self, windows_version};
use embassy_usb::{Builder, Config, UsbDevice};
use gripline_protocol::PACKET_MAX;
use static_cell::StaticCell;

use crate::outbox;
use crate::usb_driver::{self, PatchedDriver};
use crate::usb_interrupt::Interrupts;

/// Test id of the pid.codes register.
const VENDOR: u16 = 0x1209;
/// Test id of the pid.codes register.
const PRODUCT: u16 = 0x0001;
/// Class, subclass and protocol of an interface that only its own host knows.
const VENDOR_SPECIFIC: u8 = 0xFF;
/// The request that Windows makes for the descriptors below; any number that no other request uses.
const WINDOWS_REQUEST: u8 = 0x47;
/// By this a Windows program finds the device among those of the same driver; made once for Gripline.
const WINDOWS_INTERFACE: &str = "{5F1C3A52-8E0B-4B7E-9D61-2A64C7F0B3E9}";

/// Bytes of the memory for packets from the host: control endpoint and bulk endpoint.
const OUT_BYTES: usize = 2 * PACKET_MAX;

/// Packets from the host.
pub(crate) type HostToMcu = <PatchedDriver as Driver<'static>>::EndpointOut;
/// Packets to the host.
pub(crate) type McuToHost = <PatchedDriver as Driver<'static>>::EndpointIn;

/// Describes the device; the parts go to [`device`], `control` and [`transmit`].
pub(crate) fn open(
    otg: Peri<'static, peripherals::USB_OTG_FS>,
    plus: Peri<'static, peripherals::PA12>,
    minus: Peri<'static, peripherals::PA11>,
) -> (UsbDevice<'static, PatchedDriver>, HostToMcu, McuToHost) {
    static OUT: StaticCell<[u8; OUT_BYTES]> = StaticCell::new();
    static CONFIGURATION: StaticCell<[u8; 64]> = StaticCell::new();
    static CAPABILITIES: StaticCell<[u8; 64]> = StaticCell::new();
    static WINDOWS: StaticCell<[u8; 192]> = StaticCell::new();
    static CONTROL: StaticCell<[u8; 64]> = StaticCell::new();

    let mut electrical = usb::Config::default();
    electrical.vbus_detection = false;
    let driver = usb::Driver::new_fs(otg, Interrupts, plus, minus, OUT.init([0; OUT_BYTES]), electrical);

    let mut config = Config::new(VENDOR, PRODUCT);
    config.manufacturer = Some("Gripline");
    config.product = Some("Gripline MCU");
    config.serial_number = Some(uid::uid_hex());
    config.self_powered = true;
    config.max_power = 100;
    // One function: the device leaves its class to the interface.
    config.composite_with_iads = false;
    config.device_class = 0;
    config.device_sub_class = 0;
    config.device_protocol = 0;

    let mut builder = Builder::new(
        PatchedDriver(driver),
        config,
        CONFIGURATION.init([0; 64]),
        CAPABILITIES.init([0; 64]),
        WINDOWS.init([0; 192]),
        CONTROL.init([0; 64]),
    );
    builder.msos_descriptor(windows_version::WIN8_1, WINDOWS_REQUEST);
    builder.msos_feature(msos::CompatibleIdFeatureDescriptor::new("WINUSB", ""));
    builder.msos_feature(msos::RegistryPropertyFeatureDescriptor::new(
        "DeviceInterfaceGUIDs",
        msos::PropertyData::RegMultiSz(&[WINDOWS_INTERFACE]),
    ));
    let mut function = builder.function(VENDOR_SPECIFIC, 0, 0);
    let mut interface = function.interface();
    let mut setting = interface.alt_setting(VENDOR_SPECIFIC, 0, 0, None);
    let from_host = setting.endpoint_bulk_out(None, PACKET_MAX as u16);
    let to_host = setting.endpoint_bulk_in(None, PACKET_MAX as u16);
    drop(function);
    (builder.build(), from_host, to_host)
}

/// Answers the host's requests on the control endpoint and follows bus resets.
///
/// Deadline: the 50 ms that USB gives for a request. Budget: about a millisecond at plug-in, nothing afterwards. Miss: the
/// host enumerates again.
#[embassy_executor::task]
pub(crate) async fn device(mut device: UsbDevice<'static, PatchedDriver>) -> ! {
    device.run().await
}

/// Sends the packets of the outbox.
///
/// Deadline: none, the host waits. Budget: a copy of 64 bytes a packet. Miss: the outbox fills, and the library keeps only
/// the newest status.
#[embassy_executor::task]
pub(crate) async fn transmit(mut endpoint: McuToHost) {
    loop {
        usb_driver::RESET.reset();
        endpoint.wait_enabled().await;
        // Packets for a host that has left are not for the next one.
        outbox::USB.clear();
        defmt::info!("USB: configured by a host");
        let send = async {
            loop {
                let packet = outbox::USB.receive().await;
                if endpoint.write(&packet).await.is_err() {
                    break;
                }
            }
        };
        select(send, usb_driver::RESET.wait()).await;
        defmt::info!("USB: the host has left");
    }
}

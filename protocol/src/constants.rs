//! Every number of the wire format: unit, value, and why it is that value.

/// Taxels along one side of a force map.
pub const SIDE: usize = 20;
/// Taxels in a force map, row-major.
pub const TAXELS: usize = SIDE * SIDE;
/// Distance between taxel centres, millimetres: 32 mm of gel surface over 20 taxels.
pub const TAXEL_PITCH_MM: f64 = 1.6;
/// Force steps per newton. i16 then spans ±8 N a taxel; at 20 N total the peak is about 3 N.
pub const LSB_PER_NEWTON: i32 = 4096;
/// Fingertips per microcontroller.
pub const SENSORS: usize = 2;

/// Longest packet, bytes: one full-speed USB bulk transaction.
pub const PACKET_MAX: usize = 64;
/// Bytes before every packet's payload: version and kind, sensor or message id, sequence, index.
pub const PACKET_HEADER: usize = 4;
/// Version of the packet layout, in the upper half of a packet's first byte.
pub const WIRE_VERSION: u8 = 2;
/// Bytes of one taxel on the wire: three little-endian i16.
pub const TAXEL_BYTES: usize = 6;
/// Taxels in a full packet: (64 − 4) / 6.
pub const TAXELS_PER_PACKET: usize = (PACKET_MAX - PACKET_HEADER) / TAXEL_BYTES;
/// Bytes of the bitmap of a map's taxels.
pub const BITMAP_BYTES: usize = TAXELS / 8;
/// Bytes of the CRC-32 (ISO-HDLC, as in Ethernet and zip) that ends a map or a message.
pub const CRC_BYTES: usize = 4;
/// Maximum number of packets per message.
pub const MESSAGE_FRAGMENTS_MAX: usize = 4;
/// Longest message, bytes, its CRC included.
pub const MESSAGE_MAX: usize = MESSAGE_FRAGMENTS_MAX * (PACKET_MAX - PACKET_HEADER);

/// Denominator of friction coefficients and ratios on the wire: parts per ten thousand, so that 0.45 is exact.
pub const PER_UNIT: u32 = 10_000;

//! The detector once more, plainly, in floating point: what `cargo xtask latency` counts beside the real one. Not part of
//! any image.
//!
//! The same work as the kernel's: forty packets of ten taxels, each at its place; contact, stick, total force, moment about
//! the centre, centre and spread of pressure. Units: newtons, millimetres. Limits: one dense map, then it stops.
#![no_std]
#![no_main]

use core::hint::black_box;

use defmt_rtt as _;
use embassy_stm32 as _;
use gripline_protocol::constants::{LSB_PER_NEWTON, SIDE, TAXEL_PITCH_MM, TAXELS, TAXELS_PER_PACKET};
use gripline_protocol::{Place, TaxelForce};

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    done()
}

/// For the interrupts that the chip's library brings; none is ever let in.
struct Section;
critical_section::set_impl!(Section);

// SAFETY: one thread and no interrupts.
unsafe impl critical_section::Impl for Section {
    unsafe fn acquire() -> critical_section::RawRestoreState {
        0
    }

    unsafe fn release(_: critical_section::RawRestoreState) {}
}

/// What a map comes to.
#[derive(Clone, Copy, Default)]
struct Sums {
    contact: u32,
    stick: u32,
    force_n: [f32; 3],
    moment_nmm: f32,
    pressure_nmm: [f32; 2],
    spread_nmm2: f32,
}

const FRICTION: f32 = 0.45;
const CONTACT_MIN_N: f32 = 0.0;

/// A taxel as it stands in a packet.
type Bytes = [u8; 6];

impl Sums {
    #[inline]
    fn add(&mut self, place: Place, bytes: Bytes) {
        let centre = (SIDE as f32 - 1.0) / 2.0;
        let pitch_mm = TAXEL_PITCH_MM as f32;
        let x_mm = (f32::from(place.column()) - centre) * pitch_mm;
        let y_mm = (f32::from(place.row()) - centre) * pitch_mm;
        let force = TaxelForce::from_le_bytes(bytes);
        let newtons = |steps: i16| f32::from(steps) / LSB_PER_NEWTON as f32;
        let (x, y, z) = (newtons(force.x), newtons(force.y), newtons(force.z));
        self.force_n[0] += x;
        self.force_n[1] += y;
        self.force_n[2] += z;
        self.moment_nmm += x_mm * y - y_mm * x;
        self.pressure_nmm[0] += x_mm * z;
        self.pressure_nmm[1] += y_mm * z;
        self.spread_nmm2 += (x_mm * x_mm + y_mm * y_mm) * z;
        if z > CONTACT_MIN_N {
            self.contact += 1;
            if x * x + y * y <= FRICTION * FRICTION * z * z {
                self.stick += 1;
            }
        }
    }
}

/// A packet's taxels.
#[inline(never)]
fn packet(sums: &mut Sums, places: &[Place], taxels: &[Bytes]) {
    for (place, bytes) in places.iter().zip(taxels) {
        sums.add(*place, *bytes);
    }
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn dense_map(sums: &mut Sums, places: &[Place; TAXELS], taxels: &[Bytes; TAXELS]) {
    for (places, taxels) in places
        .chunks(TAXELS_PER_PACKET)
        .zip(taxels.chunks(TAXELS_PER_PACKET))
    {
        packet(sums, places, taxels);
    }
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn done() -> ! {
    loop {
        black_box(());
    }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let places = core::array::from_fn(|n| Place::new((n % SIDE) as u16, (n / SIDE) as u16));
    // Half of them slip.
    let taxels = core::array::from_fn(|n| {
        TaxelForce {
            x: if n % 2 == 0 { 900 } else { 100 },
            y: -50,
            z: 1_000 + n as i16,
        }
        .to_le_bytes()
    });
    let mut sums = Sums::default();
    dense_map(&mut sums, black_box(&places), black_box(&taxels));
    black_box((
        sums.contact,
        sums.stick,
        sums.force_n,
        sums.moment_nmm,
        sums.pressure_nmm,
        sums.spread_nmm2,
    ));
    done()
}

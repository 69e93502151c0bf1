//! What survives a reset: its cause, the grip-force line and its settings, the number of the session, and the addresses of a panic.
//!
//! RAM that start-up does not clear holds the line twice, each copy with a check word: a reset between the two writes leaves
//! one good copy. The line's settings are there once, written at the start. Units: force in 1/4096 N. Limits: once the power
//! was away for so long that the memory is lost, a start is one with nothing in the gripper.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

use embassy_stm32::pac::RCC;
use gripline_firmware::{GripForce, ResetCause};
use gripline_protocol::line::{LINE_VALUES, LineSettings};
use gripline_protocol::rounds::at_most;

/// What is known of the time before this start.
#[derive(Clone, Copy)]
pub(crate) struct Reset {
    /// The cause of the reset.
    pub cause: ResetCause,
    /// The line's last force; none when both copies are damaged, as after power-on.
    pub line: Option<GripForce>,
    /// The line's settings then in force; none when damaged, as after power-on.
    pub line_settings: Option<LineSettings>,
    /// Differs from start to start.
    pub session: u32,
    /// Where the program panicked, if that was the cause: the place and its caller.
    pub panic: Option<[u32; PANIC_ADDRESSES]>,
}

/// Number of addresses that are kept of a panic.
pub(crate) const PANIC_ADDRESSES: usize = 2;

/// Reads what survived. Clears the chip's flags: call it once per start.
pub(crate) fn read() -> Reset {
    let flags = RCC.csr().read();
    RCC.csr().modify(|clear| clear.set_rmvf(true));
    // Switching on raises both flags, a supply that dips below the brown-out level only the second one.
    let power_came = flags.porrstf();
    let browned_out = flags.borrstf() && !power_came;
    let panic = take_panic().filter(|_| !power_came && !browned_out);
    // A supply that was gone so briefly that the memory still holds is a brown-out too.
    let line = kept_line();
    let is_gripping = line.is_some_and(|line| line > GripForce::ZERO);
    // Every reset also pulls the reset pin, so the flag of the pin says nothing beside another one.
    let cause = if browned_out || power_came && is_gripping {
        ResetCause::BrownOut
    } else if power_came {
        ResetCause::PowerOn
    } else if flags.wdgrstf() || flags.wwdgrstf() {
        ResetCause::Watchdog
    } else if panic.is_some() {
        ResetCause::Software
    } else {
        // The reset pin or a debug probe: a person is there.
        ResetCause::PowerOn
    };
    // A reset by the button must not drop the object either.
    Reset {
        cause,
        line,
        line_settings: kept_line_settings(),
        session: next_session(),
        panic,
    }
}

struct Panic(UnsafeCell<MaybeUninit<[u32; PANIC_ADDRESSES + 1]>>);

// SAFETY: written when nothing else runs any more, read at start-up before anything else does.
unsafe impl Sync for Panic {}

#[unsafe(link_section = ".uninit.gripline_panic")]
static PANIC: Panic = Panic(UnsafeCell::new(MaybeUninit::uninit()));

/// Keeps where the program panicked.
pub(crate) fn keep_panic(addresses: [u32; PANIC_ADDRESSES]) {
    let [address, caller] = addresses;
    // SAFETY: nothing else runs any more, and nobody holds a reference into `PANIC`.
    unsafe {
        PANIC
            .0
            .get()
            .cast::<[u32; PANIC_ADDRESSES + 1]>()
            .write_volatile([check_all(addresses), address, caller]);
    }
}

/// Where the program panicked before this start. Clears it.
fn take_panic() -> Option<[u32; PANIC_ADDRESSES]> {
    let words = PANIC.0.get().cast::<[u32; PANIC_ADDRESSES + 1]>();
    // SAFETY: any bit pattern is a valid `u32`, and volatile accesses take RAM as it is; nobody else holds a reference.
    let [found, addresses @ ..] = unsafe { words.read_volatile() };
    // SAFETY: as above.
    unsafe { words.write_volatile([0; PANIC_ADDRESSES + 1]) };
    (found == check_all(addresses)).then_some(addresses)
}

/// The check word of these words; not 0 for zeros.
fn check_all<const WORDS: usize>(words: [u32; WORDS]) -> u32 {
    words
        .into_iter()
        .fold(MARK, |all, word| all.rotate_left(5) ^ word)
}

/// A force and its check word.
type Checked = [u32; 2];

/// Unlikely in RAM at power-on. Change it when the meaning of the force changes.
const MARK: u32 = 0x6721_9e5d;

struct Kept(UnsafeCell<MaybeUninit<[Checked; 2]>>);

// SAFETY: written by the one owner of the line (start-up, then `control`), read at start-up before it exists.
unsafe impl Sync for Kept {}

#[unsafe(link_section = ".uninit.gripline_line")]
static KEPT: Kept = Kept(UnsafeCell::new(MaybeUninit::uninit()));

/// Keeps the force that the line shows. Only the owner of the line may call it.
#[inline]
pub(crate) fn keep_line(force: GripForce) {
    let force = force.lsb().cast_unsigned();
    let copy = [force, check(force)];
    let copies = KEPT.0.get().cast::<Checked>();
    for place in at_most::<2, _>(0..2) {
        // SAFETY: in bounds of two copies; nobody else holds a reference into `KEPT`.
        unsafe { copies.add(place).write_volatile(copy) };
    }
}

/// The first copy whose check word is right.
fn kept_line() -> Option<GripForce> {
    let copies = KEPT.0.get().cast::<Checked>();
    (0..2).find_map(|place| {
        // SAFETY: in bounds of two copies; any bit pattern is a valid `u32`, and volatile reads take RAM as it is.
        let [force, found] = unsafe { copies.add(place).read_volatile() };
        (found == check(force)).then_some(GripForce::from_lsb(force.cast_signed()))
    })
}

/// The check word of a force.
fn check(force: u32) -> u32 {
    !force.rotate_left(7) ^ MARK
}

struct KeptSettings(UnsafeCell<MaybeUninit<[u32; LINE_VALUES + 1]>>);

// SAFETY: used at start-up only, before any interrupt or task.
unsafe impl Sync for KeptSettings {}

#[unsafe(link_section = ".uninit.gripline_line_settings")]
static KEPT_SETTINGS: KeptSettings = KeptSettings(UnsafeCell::new(MaybeUninit::uninit()));

/// Keeps the line's settings that are in force. Call it at start-up, once the line is driven.
pub(crate) fn keep_line_settings(settings: &LineSettings) {
    let values = settings.values().map(i32::cast_unsigned);
    let words = KEPT_SETTINGS.0.get().cast::<u32>();
    for (place, word) in values.into_iter().chain([check_all(values)]).enumerate() {
        // SAFETY: in bounds; nobody else holds a reference into `KEPT_SETTINGS`.
        unsafe { words.add(place).write_volatile(word) };
    }
}

/// The line's settings, if their check word is right.
fn kept_line_settings() -> Option<LineSettings> {
    let words = KEPT_SETTINGS.0.get().cast::<[u32; LINE_VALUES + 1]>();
    // SAFETY: any bit pattern is a valid `u32`, and volatile reads take RAM as it is; nobody else holds a reference.
    let [values @ .., found] = unsafe { words.read_volatile() };
    (found == check_all(values)).then(|| LineSettings::from_values(&values.map(u32::cast_signed)))
}

/// Words of RAM that are partly random at power-on; the first one then counts the starts.
const NOISE_WORDS: usize = 16;

struct Noise(UnsafeCell<MaybeUninit<[u32; NOISE_WORDS]>>);

// SAFETY: used by `next_session` only, once per start, before any interrupt or task.
unsafe impl Sync for Noise {}

#[unsafe(link_section = ".uninit.gripline_session")]
static NOISE: Noise = Noise(UnsafeCell::new(MaybeUninit::uninit()));

/// Hashes the noise of power-on and the number of starts since (FNV-1a over words).
fn next_session() -> u32 {
    let words = NOISE.0.get().cast::<u32>();
    // SAFETY: in bounds; any bit pattern is a valid `u32`, and volatile accesses take RAM as it is.
    unsafe { words.write_volatile(words.read_volatile().wrapping_add(1)) };
    (0..NOISE_WORDS).fold(0x811c_9dc5, |hash: u32, word| {
        // SAFETY: as above.
        (hash ^ unsafe { words.add(word).read_volatile() }).wrapping_mul(0x0100_0193)
    })
}

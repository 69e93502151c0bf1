//! What survives a reset: its cause, the grip-force line, a number per start, and where a crash happened.
//!
//! The line lies twice in RAM that start-up does not clear, each time with a check word, so that a reset between two
//! writes leaves one good copy. Units: force in 1/4096 N. Limits: power loss forgets it, and should.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

use embassy_stm32::pac::RCC;
use gripline_firmware::{GripForce, ResetCause};

/// What is known of the time before this start.
#[derive(Clone, Copy)]
pub(crate) struct Reset {
    /// Why the chip started.
    pub cause: ResetCause,
    /// What the line showed; nothing after power came on, or when both copies are damaged.
    pub line: Option<GripForce>,
    /// A number that differs from start to start.
    pub session: u32,
    /// Where the program crashed, if that was the cause.
    pub crash: Option<[u32; CRASH_PLACES]>,
}

/// Addresses that are kept of a crash.
pub(crate) const CRASH_PLACES: usize = 2;

/// Reads what survived. Clears the chip's flags, so it answers truly once per start.
pub(crate) fn read() -> Reset {
    let flags = RCC.csr().read();
    RCC.csr().modify(|clear| clear.set_rmvf(true));
    let power_came = flags.porrstf() || flags.borrstf();
    let crash = take_crash().filter(|_| !power_came);
    // Every reset also pulls the reset pin, so that flag tells nothing beside another.
    let cause = if power_came {
        ResetCause::PowerOn
    } else if flags.wdgrstf() || flags.wwdgrstf() {
        ResetCause::Watchdog
    } else if crash.is_some() {
        ResetCause::Software
    } else {
        // The reset pin, or a debug probe that put a program on the chip: somebody stands beside it.
        ResetCause::PowerOn
    };
    // Whoever presses the reset button with an object in the grip does not mean to drop it.
    Reset {
        cause,
        line: if power_came { None } else { kept_line() },
        session: next_session(),
        crash,
    }
}

struct Crash(UnsafeCell<MaybeUninit<[u32; CRASH_PLACES + 1]>>);

// SAFETY: written when nothing else runs any more, read at start-up before anything else does.
unsafe impl Sync for Crash {}

#[unsafe(link_section = ".uninit.gripline_crash")]
static CRASH: Crash = Crash(UnsafeCell::new(MaybeUninit::uninit()));

/// Remembers where the program crashed.
pub(crate) fn keep_crash(places: [u32; CRASH_PLACES]) {
    let [place, caller] = places;
    // SAFETY: nothing else runs any more, and nobody holds a reference into `CRASH`.
    unsafe {
        CRASH
            .0
            .get()
            .cast::<[u32; CRASH_PLACES + 1]>()
            .write_volatile([check_all(places), place, caller]);
    }
}

/// Where the program crashed before this start; tells it once.
fn take_crash() -> Option<[u32; CRASH_PLACES]> {
    let words = CRASH.0.get().cast::<[u32; CRASH_PLACES + 1]>();
    // SAFETY: any bit pattern is a valid `u32`, and volatile accesses take RAM as it is; nobody else holds a reference.
    let [found, places @ ..] = unsafe { words.read_volatile() };
    // SAFETY: as above.
    unsafe { words.write_volatile([0; CRASH_PLACES + 1]) };
    (found == check_all(places)).then_some(places)
}

/// The word that belongs to these places; never 0 for none of them.
fn check_all(places: [u32; CRASH_PLACES]) -> u32 {
    places
        .into_iter()
        .fold(MARK, |all, place| all.rotate_left(5) ^ place)
}

/// A force and the word that proves it was written by this program.
type Checked = [u32; 2];

/// Differs from what RAM tends to hold at power-on; change it when the meaning of the force changes.
const MARK: u32 = 0x6721_9e5d;

struct Kept(UnsafeCell<MaybeUninit<[Checked; 2]>>);

// SAFETY: written by the one owner of the line (start-up, then `control`), read at start-up before it exists.
unsafe impl Sync for Kept {}

#[unsafe(link_section = ".uninit.gripline_line")]
static KEPT: Kept = Kept(UnsafeCell::new(MaybeUninit::uninit()));

/// Remembers what the line shows. Only the owner of the line may call it.
#[inline]
pub(crate) fn keep_line(force: GripForce) {
    let force = force.lsb().cast_unsigned();
    let copy = [force, check(force)];
    let copies = KEPT.0.get().cast::<Checked>();
    for place in 0..2 {
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

/// The word that belongs to a force.
fn check(force: u32) -> u32 {
    !force.rotate_left(7) ^ MARK
}

/// Words of RAM whose content at power-on is partly chance, and that count starts after it.
const CHANCE_WORDS: usize = 16;

struct Chance(UnsafeCell<MaybeUninit<[u32; CHANCE_WORDS]>>);

// SAFETY: used by `next_session` only, once per start, before any interrupt or task.
unsafe impl Sync for Chance {}

#[unsafe(link_section = ".uninit.gripline_session")]
static CHANCE: Chance = Chance(UnsafeCell::new(MaybeUninit::uninit()));

/// Mixes what chance left in RAM at power-on (FNV-1a over words) with the number of starts since.
fn next_session() -> u32 {
    let words = CHANCE.0.get().cast::<u32>();
    // SAFETY: in bounds; any bit pattern is a valid `u32`, and volatile accesses take RAM as it is.
    unsafe { words.write_volatile(words.read_volatile().wrapping_add(1)) };
    (0..CHANCE_WORDS).fold(0x811c_9dc5, |hash: u32, word| {
        // SAFETY: as above.
        (hash ^ unsafe { words.add(word).read_volatile() }).wrapping_mul(0x0100_0193)
    })
}

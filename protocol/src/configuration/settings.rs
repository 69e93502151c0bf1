//! The settings themselves, and their default values.

use postcard_schema::Schema;

use crate::constants::{LSB_PER_NEWTON, SENSORS};
use crate::line::LineSettings;

/// Version of [`Configuration`]'s layout in flash. Raise it with every change of the layout.
pub const CONFIGURATION_VERSION: u16 = 2;

/// How a fingertip sits in the gripper. It converts a map's sums to newton-millimetres and millimetres in the gripper's
/// frame. Stick ratio, shear and grip do not depend on it.
///
/// The gripper's z points into the first fingertip's surface. The second fingertip faces the first: its frame has x and z
/// reversed, before any quarter turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FingertipGeometry {
    /// Distance between taxel centres, µm.
    pub pitch_um: u16,
    /// Centre of the map, x and y in the gripper's frame, µm from its axis.
    pub centre_um: [i16; 2],
    /// Quarter turns from the gripper's x (for the second fingertip, from −x) to the map's x, anticlockwise as seen from
    /// outside the fingertip.
    pub quarter_turns: u8,
}

impl FingertipGeometry {
    /// 1.6 mm between taxels, on the axis, not turned.
    pub const DEFAULT: Self = Self {
        pitch_um: 1_600,
        centre_um: [0, 0],
        quarter_turns: 0,
    };
}

impl Default for FingertipGeometry {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Everything that can be set on the microcontroller. On the wire and in flash it is the list of its
/// [`values`](Self::values): a loop on the chip, where derived code takes kilobytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Configuration {
    /// Fingertips that must send maps: 1 or 2.
    pub sensors: u8,
    /// Friction coefficient of the detector, 1/10000. It must be below the true one of the sensor surface.
    pub friction: u16,
    /// Upper limit of the friction that the estimator may learn from a contact, 1/10000. The grip follows the learnt
    /// friction instead of the detector's. At or below `friction` nothing is learnt.
    pub friction_max: u16,
    /// A taxel is in contact when its normal force exceeds this, 1/4096 N.
    pub contact_min: i16,
    /// Stick ratio below which the state is SLIP, 1/10000.
    pub slip_threshold: u16,
    /// Stick ratio at and above which SLIP may end, 1/10000.
    pub slip_leave: u16,
    /// Stick ratio below which the state is INCIPIENT, 1/10000.
    pub incipient_threshold: u16,
    /// Time-to-slip estimate below which the state is INCIPIENT, ms.
    pub incipient_horizon_ms: u16,
    /// Minimum time in SLIP and INCIPIENT unless the load falls, ms.
    pub dwell_ms: u16,
    /// Grip above what friction needs, 1/10000 of it; people keep 10–40 %.
    pub margin: u16,
    /// Minimum grip force while holding, 1/4096 N.
    pub floor: i32,
    /// Maximum grip force, 1/4096 N.
    pub ceiling: i32,
    /// Fail-safe force: grip force after a lost host, unless it is higher already, 1/4096 N.
    pub fail_safe: i32,
    /// The reflex keeps the stick ratio above this, 1/10000.
    pub reflex_target: u16,
    /// How fast the reflex adds grip when nothing sticks, 1/4096 N per ms; 0: no reflex.
    pub reflex_rate: u16,
    /// Fastest rise of the line, 1/4096 N per ms.
    pub rise_rate: u16,
    /// Fall of the line while relaxing by plan, 1/4096 N per second; 0 never relaxes.
    pub relax_rate: u16,
    /// How long the contact must stick before the line relaxes, ms.
    pub relax_after_ms: u16,
    /// Fall of the line after `Release`, 1/4096 N per ms.
    pub release_rate: u16,
    /// Age of the newest map that raises STALE MAPS, ms.
    pub stale_ms: u16,
    /// Silence on the link that raises LINK LOST, ms.
    pub link_lost_ms: u16,
    /// The grip-force line. It takes effect at the next start, from flash: with an object in the gripper, the same force
    /// must not become another voltage.
    pub line: LineSettings,
    /// How each fingertip sits in the gripper.
    pub fingertips: [FingertipGeometry; SENSORS],
}

pub(super) const fn newtons(value: i32) -> i32 {
    value * LSB_PER_NEWTON
}

/// The strongest gripper that is supported, 1/4096 N.
pub const FORCE_MAX: i32 = newtons(125);

impl Configuration {
    /// The paper's detector (μ 0.45, threshold 0.5), and a grip that learns the object's friction from what it carries.
    pub const DEFAULT: Self = Self {
        friction_max: 10_000,
        margin: 3_000,
        reflex_rate: 0,
        relax_rate: 12 * 4_096, // 12 N/s
        relax_after_ms: 50,
        ..Self::CAREFUL
    };

    /// A grip that learns nothing: by the detector's friction alone, with a reflex, and slow to let go.
    pub const CAREFUL: Self = Self {
        sensors: 1,
        friction: 4_500,
        friction_max: 0,
        contact_min: 0,
        slip_threshold: 5_000,
        slip_leave: 6_000,
        incipient_threshold: 6_500,
        incipient_horizon_ms: 100,
        dwell_ms: 50,
        margin: 4_000,
        floor: newtons(1),
        ceiling: newtons(30),
        fail_safe: newtons(10),
        reflex_target: 5_500,
        reflex_rate: 164,  // 40 N/s
        rise_rate: 410,    // 100 N/s
        relax_rate: 4_096, // 1 N/s
        relax_after_ms: 500,
        release_rate: 82, // 20 N/s
        stale_ms: 100,
        link_lost_ms: 500,
        line: LineSettings::DEFAULT,
        fingertips: [FingertipGeometry::DEFAULT; SENSORS],
    };

    /// Takes over other settings, number by number: the microcontroller does it with the map-to-line path blocked, where one copy
    /// of the whole costs four times as much in the worst-case bound (`cargo xtask latency`).
    pub const fn take_over(&mut self, other: &Self) {
        let Self {
            sensors,
            friction,
            friction_max,
            contact_min,
            slip_threshold,
            slip_leave,
            incipient_threshold,
            incipient_horizon_ms,
            dwell_ms,
            margin,
            floor,
            ceiling,
            fail_safe,
            reflex_target,
            reflex_rate,
            rise_rate,
            relax_rate,
            relax_after_ms,
            release_rate,
            stale_ms,
            link_lost_ms,
            line,
            fingertips,
        } = other;
        self.sensors = *sensors;
        self.friction = *friction;
        self.friction_max = *friction_max;
        self.contact_min = *contact_min;
        self.slip_threshold = *slip_threshold;
        self.slip_leave = *slip_leave;
        self.incipient_threshold = *incipient_threshold;
        self.incipient_horizon_ms = *incipient_horizon_ms;
        self.dwell_ms = *dwell_ms;
        self.margin = *margin;
        self.floor = *floor;
        self.ceiling = *ceiling;
        self.fail_safe = *fail_safe;
        self.reflex_target = *reflex_target;
        self.reflex_rate = *reflex_rate;
        self.rise_rate = *rise_rate;
        self.relax_rate = *relax_rate;
        self.relax_after_ms = *relax_after_ms;
        self.release_rate = *release_rate;
        self.stale_ms = *stale_ms;
        self.link_lost_ms = *link_lost_ms;
        self.line = *line;
        self.fingertips = *fingertips;
    }

    /// Whether the grip follows the friction that a contact has proven.
    #[must_use]
    pub const fn learns(&self) -> bool {
        self.friction_max > self.friction
    }
}

impl Default for Configuration {
    fn default() -> Self {
        Self::DEFAULT
    }
}

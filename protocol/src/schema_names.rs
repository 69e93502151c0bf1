//! Former field names of wire types. [`SCHEMA_HASH`](crate::message::SCHEMA_HASH) covers names, but a renamed field changes no
//! byte: with these names builds from before and after the renaming still accept each other. Raise
//! [`SCHEMA_VERSION`](crate::message::SCHEMA_VERSION) for the next change of the layout, and delete this file.

use postcard_schema::{Schema, schema::NamedType};

use crate::configuration::{Configuration, FingertipGeometry, OutOfRange};
use crate::constants::SENSORS;
use crate::line::LineSettings;
use crate::message::MapSums;

/// Declares the schema of a type by its former names; does not compile when fields or their types differ.
macro_rules! former_names {
    ($type:ident as $former:ident { $($field:ident as $name:ident: $of:ty,)* }) => {
        #[derive(Schema)]
        #[expect(dead_code, reason = "only its schema is used")]
        struct $former {
            $($name: $of,)*
        }

        const _: fn($type) -> $former = |$type { $($field,)* }| $former { $($name: $field,)* };

        impl Schema for $type {
            const SCHEMA: &'static NamedType = $former::SCHEMA;
        }
    };
}

former_names! { MapSums as FormerMapSums {
    contact as contact: u16,
    stick as stick: u16,
    force as force: [i32; 3],
    moment as moment: i32,
    first_moment as pressure: [i32; 2],
    second_moment as spread: i32,
} }

former_names! { OutOfRange as FormerOutOfRange {
    field as field: u8,
    found as found: i32,
    min as least: i32,
    max as most: i32,
} }

former_names! { Configuration as FormerConfiguration {
    sensors as sensors: u8,
    friction as friction: u16,
    friction_max as friction_most: u16,
    contact_min as contact_min: i16,
    slip_threshold as slip_threshold: u16,
    slip_leave as slip_leave: u16,
    incipient_threshold as incipient_threshold: u16,
    incipient_horizon_ms as incipient_horizon_ms: u16,
    dwell_ms as dwell_ms: u16,
    margin as margin: u16,
    floor as floor: i32,
    ceiling as ceiling: i32,
    fail_safe as tighten: i32,
    reflex_target as reflex_target: u16,
    reflex_rate as reflex_rate: u16,
    rise_rate as rise_rate: u16,
    relax_rate as relax_rate: u16,
    relax_after_ms as relax_after_ms: u16,
    release_rate as release_rate: u16,
    stale_ms as stale_ms: u16,
    link_lost_ms as link_lost_ms: u16,
    line as line: LineSettings,
    fingertips as fingertips: [FingertipGeometry; SENSORS],
} }

//! Force maps as foxglove.Grid messages and back. Pure.
//! Forces travel as newtons in f32, which holds the wire's 1/4096 N exactly, so that maps read back bit by bit.

use foxglove::Decode;
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{Grid, PackedElementField, Pose, Quaternion, Vector2, Vector3};
use gripline_protocol::{ForceMap, LSB_PER_NEWTON, SIDE, TAXELS, TaxelForce};

use crate::topics::{FRAME_ID, encoded, timestamp};

/// Three f32 a taxel.
const CELL_BYTES: usize = 12;

/// The body of a map's message; its taxels lie `pitch_um` apart.
pub(crate) fn map_bytes(map: &ForceMap, pitch_um: u16, ns: u64) -> Vec<u8> {
    let field = |(name, offset): (&str, u32)| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: NumericType::Float32 as i32,
    };
    let pitch_m = f64::from(pitch_um) / 1e6;
    let corner_m = -pitch_m * SIDE as f64 / 2.0;
    let newtons = map.dequantise();
    encoded(&Grid {
        timestamp: Some(timestamp(ns)),
        frame_id: FRAME_ID.to_owned(),
        pose: Some(Pose {
            position: Some(Vector3 {
                x: corner_m,
                y: corner_m,
                z: 0.0,
            }),
            orientation: Some(Quaternion {
                x: 0.0,
                y: 0.0,
                z: 0.0,
                w: 1.0,
            }),
        }),
        column_count: SIDE as u32,
        cell_size: Some(Vector2 {
            x: pitch_m,
            y: pitch_m,
        }),
        row_stride: (SIDE * CELL_BYTES) as u32,
        cell_stride: CELL_BYTES as u32,
        fields: [("fx", 0), ("fy", 4), ("fz", 8)].map(field).to_vec(),
        data: newtons
            .iter()
            .flatten()
            .flat_map(|force| force.to_le_bytes())
            .collect(),
    })
}

/// The map of a message, when it is one of ours.
pub(crate) fn map_of(bytes: &[u8]) -> Option<Box<ForceMap>> {
    let grid = Grid::decode(bytes).ok()?;
    if grid.data.len() != TAXELS * CELL_BYTES {
        return None;
    }
    let mut map = Box::new(ForceMap::EMPTY);
    for (taxel, cell) in map.taxels.iter_mut().zip(grid.data.chunks_exact(CELL_BYTES)) {
        let component = |place: usize| {
            let bytes = cell.get(4 * place..4 * place + 4)?.try_into().ok()?;
            Some((f32::from_le_bytes(bytes) * LSB_PER_NEWTON as f32).round() as i16)
        };
        *taxel = TaxelForce {
            x: component(0)?,
            y: component(1)?,
            z: component(2)?,
        };
    }
    Some(map)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_map_is_as_large_as_its_sensor() {
        let grid = Grid::decode(map_bytes(&ForceMap::EMPTY, 930, 5).as_slice()).unwrap();
        let (cell, corner) = (grid.cell_size.unwrap(), grid.pose.unwrap().position.unwrap());
        for (found, expected) in [
            (cell.x, 0.930e-3),
            (cell.y, 0.930e-3),
            (corner.x, -9.3e-3),
            (corner.y, -9.3e-3),
        ] {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }

    proptest! {
        #[test]
        fn a_map_reads_back_bit_by_bit(values in proptest::collection::vec(any::<i16>(), 3 * TAXELS)) {
            let mut map = ForceMap::EMPTY;
            for (taxel, value) in map.taxels.iter_mut().zip(values.chunks(3)) {
                *taxel = TaxelForce { x: value[0], y: value[1], z: value[2] };
            }
            prop_assert_eq!(*map_of(&map_bytes(&map, 1_600, 5)).unwrap(), map);
        }
    }
}

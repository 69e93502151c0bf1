//! From the wire's units to people's: newtons, newton-millimetres, ratios, and from a fingertip's map to the gripper's
//! frame. Exact where f64 is.

use gripline_protocol::message::{FingertipGeometry, MapSums};
use serde::Serialize;

use gripline_protocol::{LSB_PER_NEWTON, PER_UNIT, SensorId};

/// 1/4096 N to newtons, exact.
#[must_use]
pub fn newtons(lsb: i32) -> f64 {
    f64::from(lsb) / f64::from(LSB_PER_NEWTON)
}

/// 1/10000 to a ratio.
#[must_use]
pub fn ratio(per_unit: u16) -> f64 {
    f64::from(per_unit) / f64::from(PER_UNIT)
}

/// F_x, F_y and F_N over the whole map, newtons.
#[must_use]
pub fn force_n(sums: &MapSums) -> [f64; 3] {
    sums.force.map(newtons)
}

/// F_T over the whole map, newtons.
#[must_use]
pub fn shear_n(sums: &MapSums) -> f64 {
    let [x, y, _] = force_n(sums);
    x.hypot(y)
}

/// Moment about z at the centre of the 20×20 map, N·mm, with so much between taxel centres.
#[must_use]
pub fn moment_nmm(sums: &MapSums, pitch_mm: f64) -> f64 {
    newtons(sums.moment) * (pitch_mm / 2.0)
}

/// Centre of pressure Σ(x fz)/Σ fz, Σ(y fz)/Σ fz from the map's centre, mm; `None` when nothing presses.
#[must_use]
pub fn centre_of_pressure_mm(sums: &MapSums, pitch_mm: f64) -> Option<[f64; 2]> {
    let normal = f64::from(sums.force[2]);
    (normal > 0.0).then(|| {
        sums.first_moment
            .map(|moment| f64::from(moment) / normal * (pitch_mm / 2.0))
    })
}

/// µm to mm.
#[must_use]
pub fn millimetres(um: impl Into<f64>) -> f64 {
    um.into() / 1e3
}

/// What a fingertip feels, in the gripper's frame: its geometry is taken out.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Load {
    /// Force of the object on the fingertip: x, y, z, newtons.
    pub force_n: [f64; 3],
    /// Moment about the gripper's axis.
    pub moment_nmm: f64,
    /// Where it presses, from the gripper's axis; `None` when nothing presses.
    pub centre_of_pressure_mm: Option<[f64; 2]>,
}

impl Load {
    /// What the sums of fingertip `sensor`'s map mean with this geometry.
    #[must_use]
    pub fn of(sums: &MapSums, sensor: SensorId, geometry: &FingertipGeometry) -> Self {
        // The second fingertip faces the first: what is right for one is left for the other.
        let side = if sensor == SensorId::FIRST { 1.0 } else { -1.0 };
        let turned = |vector: [f64; 2]| {
            let [x, y] = (0..geometry.quarter_turns % 4).fold(vector, |[x, y], _| [-y, x]);
            [side * x, y]
        };
        let pitch_mm = millimetres(geometry.pitch_um);
        let [cx, cy] = geometry.centre_um.map(millimetres);
        let [x, y, z] = force_n(sums);
        let [x, y] = turned([x, y]);
        Self {
            force_n: [x, y, side * z],
            moment_nmm: side * moment_nmm(sums, pitch_mm) + cx * y - cy * x,
            centre_of_pressure_mm: centre_of_pressure_mm(sums, pitch_mm).map(|place| {
                let [x, y] = turned(place);
                [cx + x, cy + y]
            }),
        }
    }
}

/// stick / contact; `None` when nothing is in contact.
#[must_use]
pub fn stick_ratio(sums: &MapSums) -> Option<f64> {
    (sums.contact > 0).then(|| f64::from(sums.stick) / f64::from(sums.contact))
}

#[cfg(test)]
mod tests {
    use gripline_firmware::Friction;
    use gripline_firmware::sums::{TaxelRule, sums_of};
    use gripline_protocol::constants::TAXEL_PITCH_MM;
    use gripline_protocol::{ForceMap, SIDE, TaxelForce};
    use proptest::prelude::*;

    use super::*;

    fn sums(map: &ForceMap) -> MapSums {
        sums_of(
            map,
            TaxelRule {
                friction: Friction::clamped(4_500),
                contact_min: 0,
            },
        )
    }

    fn press(taxels: &[(usize, i16)]) -> Option<[f64; 2]> {
        let mut map = ForceMap::EMPTY;
        for &(taxel, z) in taxels {
            map.taxels[taxel].z = z;
        }
        centre_of_pressure_mm(&sums(&map), TAXEL_PITCH_MM)
    }

    #[test]
    fn the_centre_of_pressure_is_where_the_force_presses() {
        let near = |found: Option<[f64; 2]>, expected: [f64; 2]| {
            let found = found.expect("something presses");
            assert!(
                (found[0] - expected[0]).hypot(found[1] - expected[1]) < 1e-12,
                "{found:?}, expected {expected:?}"
            );
        };
        assert_eq!(press(&[]), None);
        near(press(&[(0, 700)]), [-15.2, -15.2]); // 9.5 pitches of 1.6 mm to the left and down
        near(press(&[(399, i16::MAX)]), [15.2, 15.2]);
        near(press(&[(20 * 9 + 9, 5), (20 * 10 + 10, 5)]), [0.0, 0.0]);
        // 5.5·¾ + 1.5·¼ pitches
        near(press(&[(20 * 10 + 4, 300), (20 * 10 + 8, 100)]), [-7.2, 0.8]);
        assert_eq!(press(&[(0, 10), (1, -10)]), None);
        assert_eq!(press(&[(0, -10)]), None);
    }

    #[test]
    fn a_fingertip_on_the_axis_that_is_not_turned_feels_what_its_map_says() {
        let mut map = ForceMap::EMPTY;
        map.taxels[37] = TaxelForce {
            x: 100,
            y: -700,
            z: 2_000,
        };
        let sums = sums(&map);
        let expected = Load {
            force_n: force_n(&sums),
            moment_nmm: moment_nmm(&sums, TAXEL_PITCH_MM),
            centre_of_pressure_mm: centre_of_pressure_mm(&sums, TAXEL_PITCH_MM),
        };
        assert_eq!(
            Load::of(&sums, SensorId::FIRST, &FingertipGeometry::DEFAULT),
            expected
        );
    }

    #[test]
    fn a_fingertip_turned_by_a_quarter_feels_a_pull_along_its_x_as_one_along_the_grippers_y() {
        let mut map = ForceMap::EMPTY;
        map.taxels[210].x = 4_096;
        let turned = FingertipGeometry {
            quarter_turns: 1,
            ..FingertipGeometry::DEFAULT
        };
        let [x, y, z] = Load::of(&sums(&map), SensorId::FIRST, &turned).force_n;
        assert!(x.abs() < 1e-12 && (y - 1.0).abs() < 1e-12 && z.abs() < 1e-12);
    }

    proptest! {
        /// Two fingertips that feel one and the same force at one and the same place of the gripper, each in its own map,
        /// tell the same of it: force, moment about the axis and place, against the definition r × f.
        #[test]
        fn whatever_its_geometry_a_fingertip_tells_the_load_that_is_there(
            is_second: bool,
            column in 0..SIDE,
            row in 0..SIDE,
            force in prop::array::uniform3(-5_000_i16..5_000),
            pitch_um in 100_u16..10_000,
            centre_um in prop::array::uniform2(any::<i16>()),
            quarter_turns in 0_u8..4,
        ) {
            let geometry = FingertipGeometry { pitch_um, centre_um, quarter_turns };
            let mut map = ForceMap::EMPTY;
            let [x, y, z] = force.map(|part| part.max(1));
            map.taxels[row * SIDE + column] = TaxelForce { x, y, z };
            let sensor = SensorId::ALL[usize::from(is_second)];
            let load = Load::of(&sums(&map), sensor, &geometry);
            // The axes of the map in the gripper's frame, by their angles.
            let angle = f64::from(quarter_turns) * std::f64::consts::FRAC_PI_2;
            let mirror = if is_second { -1.0 } else { 1.0 };
            let axes = [
                [mirror * angle.cos(), angle.sin()],
                [-mirror * angle.sin(), angle.cos()],
            ];
            let along = |a: f64, b: f64| [0, 1].map(|part| a * axes[0][part] + b * axes[1][part]);
            let [fx, fy] = along(newtons(x.into()), newtons(y.into()));
            let place = |taxel: usize| (taxel as f64 - 9.5) * f64::from(pitch_um) / 1e3;
            let [px, py] = along(place(column), place(row));
            let (px, py) = (px + f64::from(centre_um[0]) / 1e3, py + f64::from(centre_um[1]) / 1e3);
            let near = |found: f64, expected: f64| (found - expected).abs() <= 1e-9 * (1.0 + expected.abs());
            prop_assert!(near(load.force_n[0], fx) && near(load.force_n[1], fy), "{load:?}");
            prop_assert!(near(load.force_n[2], mirror * newtons(z.into())));
            prop_assert!(near(load.moment_nmm, px * fy - py * fx), "{load:?} against {}", px * fy - py * fx);
            let centre = load.centre_of_pressure_mm.unwrap();
            prop_assert!(near(centre[0], px) && near(centre[1], py), "{load:?}");
        }
    }
}

//! Forces by a small network that a sensor's simulated world has trained: the markers' motions, interpolated onto a coarse grid
//! over the field and divided by their root mean square, then three dense layers to newtons per taxel. A linear layer answers in
//! proportion, so the network learns one shape for all loads. Pure; no allocation after [`MarkerNetwork::set_rest`].
//!
//! Normal force moves printed markers much as radial shear does; which one it was shows in the field's shape, not in its size. The
//! best linear estimate errs by 15 % there, this network by 4 % (`gripline-training markers evaluate`).

use std::collections::BTreeMap;

use super::motion::MarkerMotion;
use crate::constants::TAXELS;
use crate::error::NetworkError;
use crate::force_map::{Calibration, ForceMap, NO_FORCES};
use crate::weights::{self, Tensor, WeightsFile, check_tensors};

/// Columns and rows of the grid of motions.
pub const MOTION_NODES: [usize; 2] = [12, 9];
/// Values of a grid: motion x and y over the root mean square, and how much is known, for each node; then the logarithm of the root
/// mean square over `USUAL_MM`.
pub const MOTION_INPUTS: usize = 3 * MOTION_NODES[0] * MOTION_NODES[1] + 1;
/// Outputs: x, y and z of every taxel, over the root mean square.
pub const FORCE_OUTPUTS: usize = 3 * TAXELS;
/// What is left of a number below zero between layers.
pub const LEAK: f32 = 0.05;
/// What counts of a taxel that pulls: next to nothing, but its sum with the others is what training compares.
pub const PULL: f32 = 0.1;
/// A taxel is empty below this share of the most loaded one's normal force: less is the network's noise.
const EMPTY: f32 = 0.03;
/// Reach of a marker (sigma), and where it ends, nodes.
const REACH: f32 = 0.7;
const END: f32 = 2.5;
/// Weight of no motion at all.
const PRIOR: f32 = 0.02;
/// Weight at which a node's motion is half known.
const HALF_KNOWN: f32 = 0.2;
/// Root mean square of usual motions, mm.
const USUAL_MM: f32 = 0.05;
/// Smallest one to divide by, mm: the noise.
const NOISE_MM: f32 = 0.0005;

/// Largest median error of presses that tuning was not fitted to, share of the force.
pub const HELD_OUT_MAX: f32 = 0.3;
/// Its key in a weights file.
const HELD_OUT: &str = "held_out_share";

/// The name in a weights file.
pub(super) const ARCHITECTURE: &str = "markers";

/// Names and shapes of the tensors.
fn tensors([first, second]: [usize; 2]) -> Vec<(String, Vec<usize>)> {
    let sizes = [MOTION_INPUTS, first, second, FORCE_OUTPUTS];
    (0..3)
        .flat_map(|layer| {
            [
                (
                    format!("dense{layer}.weight"),
                    vec![sizes[layer + 1], sizes[layer]],
                ),
                (format!("dense{layer}.bias"), vec![sizes[layer + 1]]),
            ]
        })
        .collect()
}

/// Everything that a weights file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkerWeights {
    /// Identity of the sensor that they are for.
    pub sensor: String,
    /// Distance of the grid's nodes, mm.
    pub node_mm: f32,
    /// Numbers after the first and the second layer, multiples of 8.
    pub widths: [usize; 2],
    /// How the detector should read the maps.
    pub calibration: Calibration,
    /// How the weights were trained, one line.
    pub manifest: String,
    /// Of weights that were tuned on a real gel: median error of presses that were left out, share of the force. Above
    /// [`HELD_OUT_MAX`] they do not fit that gel and are refused.
    pub held_out_share: Option<f32>,
    /// `dense0.weight` and so on, as [`Self::check`] wants them.
    pub tensors: BTreeMap<String, Tensor>,
}

impl MarkerWeights {
    /// Distance of the nodes over a field of this width, mm.
    #[must_use]
    pub fn node_mm(field_mm: [f64; 2]) -> f32 {
        // The outermost ones lie a third of their distance from the border.
        let of = |axis: usize| field_mm[axis] / (MOTION_NODES[axis] as f64 - 0.35);
        of(0).max(of(1)) as f32
    }

    /// Checks the bytes of a weights file.
    ///
    /// # Errors
    /// The first thing that is wrong: format, architecture, metadata, checksum, then tensors.
    pub fn parse(bytes: &[u8]) -> Result<Self, NetworkError> {
        let file = WeightsFile::parse_named(bytes, ARCHITECTURE)?;
        let metadata = file.metadata();
        let widths = metadata.widths()?;
        let weights = Self {
            sensor: metadata.text("sensor")?.to_owned(),
            node_mm: metadata.number("node_mm", 0.0, 100.0)?,
            widths,
            calibration: metadata.calibration()?,
            manifest: metadata.text("manifest")?.to_owned(),
            held_out_share: metadata.optional(HELD_OUT, 0.0, HELD_OUT_MAX)?,
            tensors: file.tensors(&tensors(widths))?,
        };
        weights.check()?;
        Ok(weights)
    }

    /// Checks that every tensor is there, with its shape and with usable values.
    ///
    /// # Errors
    /// The first one that is not.
    pub fn check(&self) -> Result<(), NetworkError> {
        check_tensors(&self.tensors, tensors(self.widths))
    }

    /// The bytes of a weights file that [`Self::parse`] reads back.
    ///
    /// # Panics
    /// When a tensor's values do not fill its shape.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut numbers = vec![("node_mm", self.node_mm)];
        numbers.extend(self.held_out_share.map(|share| (HELD_OUT, share)));
        weights::to_bytes(
            ARCHITECTURE,
            Some(&self.sensor),
            &self.widths,
            &numbers,
            self.calibration,
            &self.manifest,
            &self.tensors,
        )
    }
}

/// Interpolates motions onto the grid, for one set of markers.
#[derive(Debug, Clone, Default)]
pub struct MotionGrid {
    node_mm: f32,
    markers: usize,
    /// Index of each node's first entry, and one past the last.
    starts: Vec<usize>,
    /// Marker and its weight at the node.
    entries: Vec<(u32, f32)>,
}

impl MotionGrid {
    /// Of markers at these places, mm from the middle of the taxels.
    #[must_use]
    pub fn new(node_mm: f32, places_mm: &[[f32; 2]]) -> Self {
        let [columns, rows] = MOTION_NODES;
        let mut grid = Self {
            node_mm,
            markers: places_mm.len(),
            starts: vec![0],
            entries: Vec::new(),
        };
        for node in 0..columns * rows {
            let [x, y] = grid.place_mm(node);
            for (marker, place) in places_mm.iter().enumerate() {
                let far = (place[0] - x).hypot(place[1] - y) / node_mm;
                if far < END {
                    let weight = (-0.5 * (far / REACH).powi(2)).exp();
                    grid.entries.push((marker as u32, weight));
                }
            }
            grid.starts.push(grid.entries.len());
        }
        grid
    }

    /// Where a node lies, mm from the middle.
    fn place_mm(&self, node: usize) -> [f32; 2] {
        let [columns, rows] = MOTION_NODES;
        let from_middle = |at: usize, of: usize| (at as f32 - 0.5 * (of - 1) as f32) * self.node_mm;
        [
            from_middle(node % columns, columns),
            from_middle(node / columns, rows),
        ]
    }

    /// Writes the network's input and returns the root mean square that its outputs are multiplied by, mm.
    ///
    /// # Panics
    /// When there are not as many motions as places at rest.
    pub fn fill(&self, motions: &[MarkerMotion], input: &mut [f32; MOTION_INPUTS]) -> f32 {
        assert_eq!(motions.len(), self.markers, "as many motions as markers at rest");
        let mut squares = 0.0;
        let nodes = input.as_chunks_mut::<3>().0;
        let count = nodes.len() as f32;
        for (node, range) in nodes.iter_mut().zip(self.starts.windows(2)) {
            let mut sum = [0.0_f32; 3];
            for (marker, weight) in &self.entries[range[0]..range[1]] {
                let motion = &motions[*marker as usize];
                if motion.is_seen {
                    sum[0] += weight * motion.moved_mm[0];
                    sum[1] += weight * motion.moved_mm[1];
                    sum[2] += weight;
                }
            }
            let [x, y, known] = sum;
            let motion = [x / (known + PRIOR), y / (known + PRIOR)];
            squares += motion[0] * motion[0] + motion[1] * motion[1];
            *node = [motion[0], motion[1], known / (known + HALF_KNOWN)];
        }
        let rms_mm = (0.5 * squares / count).sqrt().max(NOISE_MM);
        for [x, y, _] in nodes.iter_mut() {
            *x /= rms_mm;
            *y /= rms_mm;
        }
        input[MOTION_INPUTS - 1] = (rms_mm / USUAL_MM).ln();
        rms_mm
    }
}

/// A layer: every output is a bias and a sum over all inputs.
#[derive(Debug, Clone)]
struct Dense {
    weights: Vec<f32>,
    bias: Vec<f32>,
}

impl Dense {
    fn forward(&self, input: &[f32], output: &mut [f32], leak: Option<f32>) {
        let rows = self.weights.chunks_exact(input.len());
        for ((out, row), bias) in output.iter_mut().zip(rows).zip(&self.bias) {
            let sum = bias + super::elastic_layer::dot(row, input);
            *out = match leak {
                Some(leak) if sum < 0.0 => leak * sum,
                _ => sum,
            };
        }
    }
}

/// The network with its weights, for one set of markers.
#[derive(Debug, Clone)]
pub struct MarkerNetwork {
    calibration: Calibration,
    manifest: String,
    node_mm: f32,
    layers: [Dense; 3],
    grid: MotionGrid,
    input: Box<[f32; MOTION_INPUTS]>,
    hidden: [Vec<f32>; 2],
    output: Vec<f32>,
}

impl MarkerNetwork {
    /// Without markers yet.
    ///
    /// # Errors
    /// When a tensor is missing, has another shape, or is not finite.
    pub fn new(weights: &MarkerWeights) -> Result<Self, NetworkError> {
        weights.check()?;
        let values = |name: String| weights.tensors[&name].values.clone();
        Ok(Self {
            calibration: weights.calibration,
            manifest: weights.manifest.clone(),
            node_mm: weights.node_mm,
            layers: [0, 1, 2].map(|layer| Dense {
                weights: values(format!("dense{layer}.weight")),
                bias: values(format!("dense{layer}.bias")),
            }),
            grid: MotionGrid::new(weights.node_mm, &[]),
            input: Box::new([0.0; MOTION_INPUTS]),
            hidden: weights.widths.map(|width| vec![0.0; width]),
            output: vec![0.0; FORCE_OUTPUTS],
        })
    }

    /// How the detector should read the maps.
    #[must_use]
    pub const fn calibration(&self) -> Calibration {
        self.calibration
    }

    /// How the weights were trained.
    #[must_use]
    pub fn manifest(&self) -> &str {
        &self.manifest
    }

    /// Sets where the markers are at rest, mm from the middle of the taxels.
    pub fn set_rest(&mut self, places_mm: &[[f32; 2]]) {
        self.grid = MotionGrid::new(self.node_mm, places_mm);
    }

    /// The forces that moved the markers. A taxel that would pull is empty.
    ///
    /// # Panics
    /// When there are not as many motions as places at rest.
    pub fn infer(&mut self, motions: &[MarkerMotion], newtons: &mut ForceMap) {
        let rms_mm = self.grid.fill(motions, &mut self.input);
        let [first, second, last] = &self.layers;
        let [one, two] = &mut self.hidden;
        first.forward(self.input.as_slice(), one, Some(LEAK));
        second.forward(one, two, Some(LEAK));
        last.forward(two, &mut self.output, None);
        let outputs = self.output.as_chunks::<3>().0;
        let max_n = outputs.iter().map(|force| force[2]).fold(0.0, f32::max);
        let (mut all, mut kept) = ([0.0_f32; 3], [0.0_f32; 3]);
        for (taxel, [x, y, z]) in newtons.iter_mut().zip(outputs) {
            let force = [*x, *y, if *z < 0.0 { PULL * z } else { *z }];
            all = [0, 1, 2].map(|axis| all[axis] + force[axis]);
            *taxel = if *z > EMPTY * max_n { force } else { [0.0; 3] };
            kept = [0, 1, 2].map(|axis| kept[axis] + taxel[axis]);
        }
        if kept[2] <= 0.0 || all[2] <= 0.0 {
            *newtons = NO_FORCES;
            return;
        }
        // What empty taxels had goes to the loaded ones, by their normal force: the sums stay.
        let missing = [0, 1, 2].map(|axis| (all[axis] - kept[axis]) / kept[2]);
        for taxel in newtons.iter_mut() {
            let share = taxel[2];
            *taxel = [0, 1, 2].map(|axis| rms_mm * (taxel[axis] + share * missing[axis]));
        }
    }
}

/// Where the value of a node or taxel comes from when the world is mirrored: along x, along y.
#[must_use]
pub fn mirrored(at: usize, [columns, rows]: [usize; 2], mirror: [bool; 2]) -> usize {
    let (column, row) = (at % columns, at / columns);
    let column = if mirror[0] { columns - 1 - column } else { column };
    let row = if mirror[1] { rows - 1 - row } else { row };
    row * columns + column
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constants::MAP_SIDE;

    fn weights() -> MarkerWeights {
        let widths = [16, 8];
        let mut number = 1.0_f32;
        let tensors = tensors(widths)
            .into_iter()
            .map(|(name, shape)| {
                let values = (0..shape.iter().product())
                    .map(|_| {
                        number = (number * 1.37 + 0.11) % 1.0;
                        0.2 * (number - 0.5)
                    })
                    .collect();
                (name, Tensor { shape, values })
            })
            .collect();
        MarkerWeights {
            sensor: "test.1".to_owned(),
            node_mm: 1.6,
            widths,
            calibration: Calibration {
                contact_min_n: 0.01,
                friction: 0.45,
            },
            manifest: "{}".to_owned(),
            held_out_share: None,
            tensors,
        }
    }

    fn places() -> Vec<[f32; 2]> {
        (0..70)
            .map(|index| {
                [
                    1.9 * ((index % 10) as f32 - 4.5),
                    1.9 * ((index / 10) as f32 - 3.0),
                ]
            })
            .collect()
    }

    fn moved(by: f32) -> Vec<MarkerMotion> {
        (0..70)
            .map(|index| MarkerMotion {
                moved_mm: [by * (index as f32).sin(), by * (index as f32 * 0.7).cos()],
                is_seen: index % 9 != 0,
            })
            .collect()
    }

    #[test]
    fn weights_read_back_and_damage_is_found() {
        let weights = weights();
        let bytes = weights.to_bytes();
        assert_eq!(MarkerWeights::parse(&bytes).unwrap(), weights);
        let mut damaged = bytes.clone();
        let last = damaged.len() - 1;
        damaged[last] ^= 1;
        assert!(matches!(
            MarkerWeights::parse(&damaged),
            Err(NetworkError::Checksum { .. })
        ));
    }

    #[test]
    fn tuned_weights_carry_their_error_and_those_that_do_not_fit_their_gel_are_refused() {
        let tuned = |share| MarkerWeights {
            held_out_share: Some(share),
            ..weights()
        };
        assert_eq!(
            MarkerWeights::parse(&tuned(0.06).to_bytes()).unwrap(),
            tuned(0.06)
        );
        let refused = MarkerWeights::parse(&tuned(0.42).to_bytes())
            .unwrap_err()
            .to_string();
        for part in ["held_out_share", "0.42", "at most 0.3"] {
            assert!(refused.contains(part), "{part}: {refused}");
        }
    }

    #[test]
    fn markers_that_rest_give_next_to_nothing_and_no_taxel_pulls() {
        let mut network = MarkerNetwork::new(&weights()).unwrap();
        network.set_rest(&places());
        let mut map = [[1.0; 3]; TAXELS];
        network.infer(&moved(0.0), &mut map);
        assert!(map.as_flattened().iter().all(|force| force.abs() < 0.01));
        network.infer(&moved(0.2), &mut map);
        assert!(
            map.iter()
                .all(|force| force[2] > 0.0 || force.iter().all(|part| part.abs() <= 0.0))
        );
        assert!(map.iter().any(|force| force[2] > 0.0));
    }

    #[test]
    fn a_mirror_is_its_own_undoing() {
        for mirror in [[false, false], [true, false], [false, true], [true, true]] {
            for at in 0..MAP_SIDE * MAP_SIDE {
                let there = mirrored(at, [MAP_SIDE; 2], mirror);
                assert_eq!(mirrored(there, [MAP_SIDE; 2], mirror), at);
            }
        }
    }
}

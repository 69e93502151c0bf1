//! Rough and odd shapes against tamaas, an independent solver, run from `checks/force_maps.py`, which installs it under
//! the build folder. On a half-space of ν = ½, where pressure and shear do not act on each other, since tamaas
//! solves no layers. The script runs beside other sections.

use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use gripline_simulation::Gel;
use gripline_simulation::contact_world::{
    GridShape, HeightMap, Mount, Shape, TRAINING_SHAPES, UNSEEN_SHAPES,
};
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::report::{Bound, Report, Worst};
use crate::world::{FRICTION, World, drive};

const CELLS: usize = 80;
const FORCE_N: f64 = 3.0;
const AT_MM: [f64; 2] = [0.3, -0.1];
/// Shift that brings the contact into partial slip, mm.
const PULL_MM: [f64; 2] = [0.32, 0.12];
/// What goes to tamaas; those of the first list are pulled too.
const PULLED: [&str; 4] = ["two spheres", "wavy", "triangle", "rough"];
const PRESSED: [&str; 2] = ["cross", "ring"];

/// The script at work, and our own maps.
pub(crate) struct Running {
    child: Child,
    own: Vec<(String, Vec<[f64; 3]>, bool)>,
}

/// A ball of 12 mm radius with waves of many lengths in random directions and phases, heights falling as those of
/// a ground surface.
fn rough() -> Result<GridShape, Failure> {
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut draw = || {
        // Numbers that look random suffice (SplitMix64).
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    };
    let waves: Vec<[f64; 4]> = (0..60)
        .map(|_| {
            let length_mm = 2.0 * 6.0_f64.powf(draw());
            let (angle, phase) = (std::f64::consts::TAU * draw(), std::f64::consts::TAU * draw());
            let k = std::f64::consts::TAU / length_mm;
            [
                k * angle.cos(),
                k * angle.sin(),
                phase,
                0.004 * length_mm.powf(1.3),
            ]
        })
        .collect();
    let ball = Shape::Sphere { radius_mm: 12.0 };
    let (side, pitch) = (221, 0.1);
    let heights = (0..side * side)
        .map(|i| {
            let at = [i % side, i / side].map(|k| (k as f64 - 110.0) * pitch);
            let waves = waves
                .iter()
                .map(|[kx, ky, phase, size]| size * (kx * at[0] + ky * at[1] + phase).sin());
            ball.height_mm(at).min(30.0) + waves.sum::<f64>()
        })
        .collect();
    Ok(GridShape::new(side, pitch, heights)?)
}

/// Solves the cases and starts the script on them.
pub(crate) fn start(world: &World) -> Result<Running, Failure> {
    let gel = Gel {
        thickness_mm: 1e9,
        young_mpa: 0.4,
        poisson: 0.5,
    };
    let (mut cases, mut own) = (Vec::new(), Vec::new());
    for name in PULLED.into_iter().chain(PRESSED) {
        let shape: Box<dyn HeightMap> = if name == "rough" {
            Box::new(rough()?)
        } else {
            let known = TRAINING_SHAPES
                .into_iter()
                .chain(UNSEEN_SHAPES)
                .find(|shape| shape.name() == name);
            Box::new(known.ok_or_else(|| format!("no built-in shape is called {name:?}"))?)
        };
        let shape: std::sync::Arc<dyn HeightMap> = std::sync::Arc::from(shape);
        let mut contact = world
            .contact(
                &gel,
                CELLS,
                Shared(std::sync::Arc::clone(&shape)),
                Mount::default(),
            )?
            .vertical_pressure();
        let truth = contact.step(drive(FORCE_N, AT_MM, 0.0))?;
        let heights: Vec<f64> = (0..CELLS * CELLS)
            .map(|cell| {
                let [x, y] = truth.place_mm(cell);
                shape.height_mm([x - AT_MM[0], y - AT_MM[1]])
            })
            .collect();
        let pulled = PULLED.contains(&name);
        let truth = if pulled {
            contact.step(drive(
                FORCE_N,
                [AT_MM[0] + PULL_MM[0], AT_MM[1] + PULL_MM[1]],
                0.0,
            ))?
        } else {
            truth
        };
        let force = truth.force_n();
        own.push((
            name.to_owned(),
            truth.force_map().map(|taxel| taxel.map(f64::from)).to_vec(),
            pulled,
        ));
        let pull = if pulled {
            json!([force[0], force[1]])
        } else {
            Value::Null
        };
        cases.push(json!({"name": name, "height_mm": heights, "force_n": FORCE_N, "pull_n": pull}));
    }
    let problem = json!({
        "cells": CELLS, "pitch_mm": 32.0 / CELLS as f64, "young_mpa": gel.young_mpa, "poisson": gel.poisson,
        "friction": FRICTION, "cases": cases,
    });
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("checks/force_maps.py");
    let mut child = Command::new("python3")
        .arg(&script)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|error| format!("`python3` cannot be started: {error}; install Python 3 with venv"))?;
    if let Some(mut input) = child.stdin.take() {
        // A script that ended early says why on its standard error.
        let _ = input.write_all(problem.to_string().as_bytes());
    }
    Ok(Running { child, own })
}

/// A shape in two hands.
#[derive(Debug)]
struct Shared(std::sync::Arc<dyn HeightMap>);

impl HeightMap for Shared {
    fn height_mm(&self, at_mm: [f64; 2]) -> f64 {
        self.0.height_mm(at_mm)
    }
}

impl Running {
    /// Waits for the script and compares.
    pub(crate) fn finish(self, report: &mut Report) -> Result<(), Failure> {
        let output = self.child.wait_with_output()?;
        let said = String::from_utf8_lossy(&output.stderr);
        if !output.status.success() {
            let last = said
                .lines()
                .rfind(|line| !line.trim().is_empty())
                .unwrap_or("nothing said")
                .to_owned();
            return Err(format!(
                "checks/force_maps.py failed ({}): {last}; it needs Python 3 with venv and the package index",
                output.status
            )
            .into());
        }
        let theirs: Value = serde_json::from_slice(&output.stdout)?;
        let (mut normal, mut shear) = (Worst::default(), Worst::default());
        for (name, map, pulled) in &self.own {
            let component = |key: &str| -> Result<Vec<f64>, Failure> {
                let list = theirs[name][key]
                    .as_array()
                    .ok_or_else(|| format!("force_maps.py gave no {name}.{key}"))?;
                Ok(list.iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect())
            };
            let off = |pairs: &[(usize, Vec<f64>)]| {
                let (mut difference, mut size) = (0.0, 0.0);
                for (k, other) in pairs {
                    for (own, other) in map.iter().zip(other) {
                        difference += (own[*k] - other).powi(2);
                        size += other.powi(2);
                    }
                }
                100.0 * (difference / size).sqrt()
            };
            normal.see(off(&[(2, component("z")?)]), || name.clone());
            if *pulled {
                shear.see(off(&[(0, component("x")?), (1, component("y")?)]), || {
                    name.clone()
                });
            }
        }
        let list = |names: &[&str]| names.join(", ");
        report.row(
            "tamaas_normal",
            &format!("normal force map of {}, {}", list(&PULLED), list(&PRESSED)),
            "tamaas, pressure without period",
            Bound::AtMost(3.0),
            (normal.value, "%"),
            &normal.at,
        );
        report.row(
            "tamaas_shear",
            &format!("shear force map of {} in partial slip", list(&PULLED)),
            "tamaas, Coulomb friction in one step",
            Bound::AtMost(3.0),
            (shear.value, "%"),
            &shear.at,
        );
        Ok(())
    }
}

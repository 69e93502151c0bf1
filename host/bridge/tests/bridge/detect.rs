//! `gripline detect` as other programs see it: the built binary, its CSV, its messages, its exit codes; against plain
//! f64 and integer computations written here, and against three labelled recordings.
#![expect(
    clippy::float_cmp,
    reason = "forces are multiples of 1/4096 N, whose sums are exact"
)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use gripline_protocol::PER_UNIT;
use gripline_protocol::message::Configuration;

const TAXELS: usize = 400;

/// A directory of its own for every test.
fn directory(test: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("detect").join(test);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

fn npy(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let fortran = if fortran { "True" } else { "False" };
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}");
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

fn f32_bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// One frame: (x, y, z) of each taxel.
type Frame = Vec<[f64; 3]>;

/// Frames of `rows`×`columns` as a C-ordered float32 file.
fn write_maps(path: &Path, frames: &[Frame], rows: usize, columns: usize) {
    let mut values = Vec::new();
    for frame in frames {
        assert_eq!(frame.len(), rows * columns);
        for axis in 0..3 {
            values.extend(frame.iter().map(|force| force[axis] as f32));
        }
    }
    let shape = format!("({}, 3, {rows}, {columns})", frames.len());
    fs::write(path, npy("<f4", false, &shape, &f32_bytes(&values))).unwrap();
}

fn detect(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gripline"))
        .arg("detect")
        .args(arguments)
        .output()
        .unwrap()
}

/// The rows of a run that must succeed: column name to text.
fn rows(maps: &Path, arguments: &[&str]) -> Vec<BTreeMap<String, String>> {
    let mut all = vec![maps.to_str().unwrap(), "--csv", "-"];
    all.extend(arguments);
    let output = detect(&all);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let text = String::from_utf8(output.stdout).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    lines
        .map(|line| {
            let values: Vec<&str> = line.split(',').collect();
            assert_eq!(values.len(), names.len(), "{line}");
            names
                .iter()
                .zip(values)
                .map(|(name, value)| ((*name).to_owned(), value.to_owned()))
                .collect()
        })
        .collect()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap()
}

/// SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// −1 to 1.
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// What a plain f64 computation says of a frame on the quantised values.
fn plain(
    frame: &[[f64; 3]],
    columns: usize,
    mu: f64,
    threshold: f64,
    contact_min: f64,
) -> BTreeMap<&'static str, f64> {
    let (mut contact, mut stick, mut total, mut moment) = (0.0, 0.0, [0.0; 3], 0.0);
    for (taxel, force) in frame.iter().enumerate() {
        let [x, y, z] = force.map(|newton| (newton * 4096.0).round().clamp(-32768.0, 32767.0) / 4096.0);
        for (sum, component) in total.iter_mut().zip([x, y, z]) {
            *sum += component;
        }
        let (row, column) = (taxel / columns, taxel % columns);
        moment += (column as f64 - 9.5) * 1.6 * y - (row as f64 - 9.5) * 1.6 * x;
        if z > contact_min {
            contact += 1.0;
            stick += f64::from(u8::from(x * x + y * y <= mu * mu * z * z));
        }
    }
    let shear = total[0].hypot(total[1]);
    let flag = |truth: bool| f64::from(u8::from(truth));
    let mut values = BTreeMap::from([
        ("fn", total[2]),
        ("fx", total[0]),
        ("fy", total[1]),
        ("ft", shear),
        ("mz", moment),
        ("contact", contact),
        ("stick", stick),
        ("coulomb_slip", flag(shear > mu * total[2])),
        ("slip", flag(contact > 0.0 && stick / contact < threshold)),
    ]);
    if contact > 0.0 {
        values.insert("stick_ratio", stick / contact);
    }
    values
}

fn assert_agrees(row: &BTreeMap<String, String>, expected: &BTreeMap<&str, f64>, frame: usize) {
    for column in ["contact", "stick", "coulomb_slip", "slip", "fn", "fx", "fy"] {
        // Sums of multiples of 1/4096 are exact in f64.
        assert_eq!(number(row, column), expected[column], "frame {frame}, {column}");
    }
    for column in ["ft", "mz"] {
        let difference = number(row, column) - expected[column];
        assert!(difference.abs() < 1e-9, "frame {frame}, {column}: {difference}");
    }
    match expected.get("stick_ratio") {
        Some(&ratio) => assert_eq!(number(row, "stick_ratio"), ratio, "frame {frame}"),
        None => assert_eq!(row["stick_ratio"], "", "frame {frame}"),
    }
}

/// Frames of every kind: dense and sparse, light and beyond ±8 N, sticking and slipping, pulled off the skin.
fn random_frames(random: &mut Random, count: usize, taxels: usize) -> Vec<Frame> {
    (0..count)
        .map(|_| {
            let press = 9.0 * random.unit().abs().powi(4);
            let shear = 0.9 * random.unit().abs();
            let part = random.unit();
            (0..taxels)
                .map(|_| {
                    if random.unit() < part {
                        return [0.0; 3];
                    }
                    // Odd steps and less than half a step beside them: with μ = 0.45, 400 (fx² + fy²) = 81 fz² has no
                    // solution with odd fz, so no decision depends on the last bit of an f64.
                    let odd = ((press * (0.8 + random.unit()) * 2048.0).round() * 2.0 + 1.0) / 4096.0;
                    let z = odd + 0.4 * random.unit() / 4096.0;
                    [z * shear * random.unit(), z * shear * random.unit(), z]
                        .map(|newton| f64::from(newton as f32))
                })
                .collect()
        })
        .collect()
}

#[test]
fn ten_thousand_frames_agree_with_plain_f64_in_every_column() {
    let directory = directory("random");
    let maps = directory.join("maps.npy");
    let frames = random_frames(&mut Random(1), 10_000, TAXELS);
    write_maps(&maps, &frames, 20, 20);
    let found = rows(&maps, &[]);
    assert_eq!(found.len(), frames.len());
    let (mut slips, mut empty) = (0, 0);
    for (index, (row, frame)) in found.iter().zip(&frames).enumerate() {
        assert_eq!(row["frame"], index.to_string());
        let expected = plain(frame, 20, 0.45, 0.5, 0.0);
        assert_agrees(row, &expected, index);
        slips += u32::from(row["slip"] == "1");
        empty += u32::from(row["stick_ratio"].is_empty());
    }
    // The data must be able to tell a wrong detector from a right one.
    assert!((1_000..9_000).contains(&slips) && empty > 0, "{slips} {empty}");
    fs::remove_file(maps).unwrap();
}

#[test]
fn other_settings_and_smaller_grids_agree_with_plain_f64() {
    let directory = directory("settings");
    let maps = directory.join("maps.npy");
    let mut random = Random(2);
    for (grid, mu, threshold, contact_min) in [
        ((4, 4), 0.5, 0.5, 0.0),
        ((1, 1), 1.0, 1.0, 0.1),
        ((3, 7), 0.0, 0.25, 0.0003),
        ((20, 2), 2.0, 0.0, 7.9),
        ((1, 20), 1.25, 0.75, 8.0),
    ] {
        let frames = random_frames(&mut random, 200, grid.0 * grid.1);
        write_maps(&maps, &frames, grid.0, grid.1);
        let [mu_text, threshold_text, contact_text] =
            [mu, threshold, contact_min].map(|value: f64| value.to_string());
        let arguments = [
            "--mu",
            &mu_text,
            "--threshold",
            &threshold_text,
            "--contact-min",
            &contact_text,
        ];
        for (index, (row, frame)) in rows(&maps, &arguments).iter().zip(&frames).enumerate() {
            assert_agrees(row, &plain(frame, grid.1, mu, threshold, contact_min), index);
        }
    }
}

#[test]
fn taxels_on_the_very_boundary_are_decided_as_integers_decide_them() {
    let directory = directory("ties");
    let maps = directory.join("maps.npy");
    for mu in [
        1u32, 3_000, 4_499, 4_500, 4_501, 5_000, 9_999, 10_000, 12_345, 19_999, 20_000,
    ] {
        let (mut frames, mut expected) = (Vec::new(), Vec::new());
        for normal in (1..=32_767).step_by(997).chain([1, 2, 20_000, 32_766, 32_767]) {
            let mut frame = vec![[0.0; 3]; TAXELS];
            let mut sticking = 0;
            // The boundary along an axis, along the diagonal, and along a 3-4-5 triangle, one step to either side.
            let bound = (u64::from(mu) * u64::from(normal as u32)) as f64 / 10_000.0;
            let mut taxel = 0;
            for (x, y) in [(1.0, 0.0), (0.5f64.sqrt(), -(0.5f64.sqrt())), (0.6, 0.8)] {
                for step in -1..=1 {
                    let side = |part: f64| ((bound * part).round() as i64 + step).clamp(-32_768, 32_767);
                    let (fx, fy) = (side(x), if y == 0.0 { 0 } else { side(y) });
                    frame[taxel] = [fx as f64, fy as f64, f64::from(normal)].map(|steps| steps / 4096.0);
                    taxel += 1;
                    let left = ((fx * fx + fy * fy) as u128) * 100_000_000;
                    sticking += u32::from(left <= u128::from(mu).pow(2) * (normal as u128).pow(2));
                }
            }
            frames.push(frame);
            expected.push(sticking);
        }
        write_maps(&maps, &frames, 20, 20);
        let mu_text = (f64::from(mu) / 10_000.0).to_string();
        for (index, (row, sticking)) in rows(&maps, &["--mu", &mu_text]).iter().zip(expected).enumerate() {
            assert_eq!(row["contact"], "9", "mu {mu_text}, frame {index}");
            assert_eq!(row["stick"], sticking.to_string(), "mu {mu_text}, frame {index}");
        }
    }
}

#[test]
fn a_stick_ratio_on_the_threshold_does_not_slip() {
    let directory = directory("threshold");
    let maps = directory.join("maps.npy");
    let stick = [0.0, 0.0, 1.0];
    let slide = [1.0, 0.0, 1.0];
    write_maps(&maps, &[vec![stick, stick, slide, slide, slide]], 1, 5);
    assert_eq!(rows(&maps, &["--threshold", "0.4"])[0]["slip"], "0");
    assert_eq!(rows(&maps, &["--threshold", "0.4001"])[0]["slip"], "1");
}

#[test]
fn a_taxel_is_in_contact_only_above_the_least_force_even_between_two_steps() {
    let directory = directory("contact");
    let maps = directory.join("maps.npy");
    let step = 1.0 / 4096.0;
    write_maps(
        &maps,
        &[vec![
            [0.0, 0.0, step],
            [0.0, 0.0, 2.0 * step],
            [0.0, 0.0, 3.0 * step],
        ]],
        1,
        3,
    );
    // One step is 0.000244 N.
    for (min, contact) in [
        ("0", "3"),
        ("0.0003", "2"),
        ("0.00048828125", "1"),
        ("0.0006", "1"),
        ("8", "0"),
    ] {
        assert_eq!(
            rows(&maps, &["--contact-min", min])[0]["contact"],
            contact,
            "{min}"
        );
    }
}

#[test]
fn the_csv_is_what_other_programs_were_promised() {
    let directory = directory("golden");
    let maps = directory.join("maps.npy");
    let frames = vec![
        vec![
            [0.25, 0.0, 1.0],
            [0.5, 0.0, 1.0],
            [0.0, -0.5, 0.5],
            [0.0, 0.0, 0.0],
        ],
        vec![[0.0; 3]; 4],
        vec![[0.0, 0.0, -0.25], [0.0, 0.0, 0.125], [0.75, 1.0, 0.0], [0.0; 3]],
    ];
    write_maps(&maps, &frames, 2, 2);
    let output = detect(&[maps.to_str().unwrap(), "--csv", "-"]);
    assert_eq!(
        String::from_utf8(output.stdout).unwrap(),
        "frame,fn,fx,fy,ft,mz,contact,stick,stick_ratio,coulomb_slip,slip\n\
         0,2.5,0.75,-0.5,0.9013878188659973,19,3,1,0.3333333333333333,0,1\n\
         1,0,0,0,0,0,0,0,,0,0\n\
         2,-0.125,0.75,1,1.25,-5,1,1,1,1,0\n"
    );
    let summary = String::from_utf8(output.stderr).unwrap();
    assert!(summary.contains("3 frames of 2×2 taxels"), "{summary}");

    let csv = directory.join("out.csv");
    let output = detect(&[
        maps.to_str().unwrap(),
        "--csv",
        csv.to_str().unwrap(),
        "--state",
        "--line",
        "--json",
    ]);
    let header =
        "frame,fn,fx,fy,ft,mz,contact,stick,stick_ratio,coulomb_slip,slip,state,slip_evidence,line_n\n";
    assert!(fs::read_to_string(&csv).unwrap().starts_with(header));
    let files: Vec<_> = fs::read_dir(&directory).unwrap().collect();
    assert_eq!(
        files.len(),
        2,
        "something beside the recording and the CSV was left: {files:?}"
    );
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let counts = [
        "frames",
        "contact_frames",
        "slip_frames",
        "coulomb_slip_frames",
        "saturated_components",
    ];
    assert_eq!(
        counts.map(|name| summary[name].as_u64()),
        [3, 2, 1, 1, 0].map(Some)
    );
}

#[test]
fn float64_fortran_order_and_big_endian_read_as_the_same_maps() {
    let directory = directory("orders");
    let maps = directory.join("maps.npy");
    let (rows_of_grid, columns) = (3, 5);
    let frames = random_frames(&mut Random(3), 7, rows_of_grid * columns);
    write_maps(&maps, &frames, rows_of_grid, columns);
    let expected = rows(&maps, &[]);
    let shape = format!("({}, 3, {rows_of_grid}, {columns})", frames.len());
    // The first axis varies fastest.
    let mut fortran = Vec::new();
    for column in 0..columns {
        for row in 0..rows_of_grid {
            for axis in 0..3 {
                fortran.extend(frames.iter().map(|frame| frame[row * columns + column][axis]));
            }
        }
    }
    let little: Vec<u8> = fortran.iter().flat_map(|value| value.to_le_bytes()).collect();
    let big: Vec<u8> = fortran.iter().flat_map(|value| value.to_be_bytes()).collect();
    let single: Vec<u8> = fortran
        .iter()
        .flat_map(|value| (*value as f32).to_be_bytes())
        .collect();
    for (descr, data) in [("<f8", little), (">f8", big), (">f4", single)] {
        fs::write(&maps, npy(descr, true, &shape, &data)).unwrap();
        assert_eq!(rows(&maps, &[]), expected, "{descr}");
    }
}

#[test]
fn the_scale_turns_counts_into_newtons_before_anything_is_decided() {
    let directory = directory("scale");
    let maps = directory.join("maps.npy");
    write_maps(&maps, &[vec![[100.0, 0.0, 400.0], [0.0, 0.0, 50.0]]], 1, 2);
    let scaled = &rows(&maps, &["--scale", "0.0078125", "--contact-min", "0.390625"])[0];
    assert_eq!(number(scaled, "fn"), 3.515_625);
    assert_eq!((&*scaled["contact"], &*scaled["stick"]), ("1", "1"));
    // Without it everything is clipped, and the summary says what to do.
    let output = detect(&[maps.to_str().unwrap()]);
    let summary = String::from_utf8(output.stdout).unwrap();
    assert!(
        output.status.success() && summary.contains("3 components beyond ±8 N"),
        "{summary}"
    );
    assert!(
        summary.contains("give --scale (at most 1.9e-2 here)"),
        "{summary}"
    );
}

#[test]
fn moments_have_the_pitch_of_the_maps_sensor() {
    let directory = directory("pitch");
    let maps = directory.join("maps.npy");
    // Half a newton up at the right edge and half a newton down at the left one, pressed everywhere.
    let mut frame = vec![[0.0, 0.0, 0.02]; 400];
    for row in 0..20 {
        (frame[20 * row][1], frame[20 * row + 19][1]) = (-0.025, 0.025);
    }
    write_maps(&maps, &vec![frame; 60], 20, 20);
    let [own, narrow] = ["1.6", "0.93"].map(|pitch| rows(&maps, &["--line", "--pitch-mm", pitch]));
    assert_eq!(own, rows(&maps, &["--line"]));
    let moment_n_pitches = (2.0 * 20.0 * 9.5) * (0.025_f64 * 4096.0).round() / 4096.0;
    for (found, pitch_mm) in [(&own, 1.6), (&narrow, 0.93)] {
        let moment_nmm = number(&found[59], "mz");
        assert!(
            (moment_nmm - moment_n_pitches * pitch_mm).abs() < 1e-9,
            "{moment_nmm}"
        );
    }
    // Friction's moment and the load's shrink alike, so the same grip holds it.
    assert_eq!(narrow[59]["line_n"], own[59]["line_n"]);
}

#[test]
fn the_state_column_has_the_memory_that_the_slip_column_lacks() {
    let directory = directory("state");
    let maps = directory.join("maps.npy");
    let frame = |sticking: usize| -> Frame {
        (0..20)
            .map(|taxel| {
                if taxel < sticking {
                    [0.0, 0.0, 1.0]
                } else {
                    // To and fro, so that the load on the whole does not fall with their number.
                    [if taxel % 2 == 0 { 1.0 } else { -1.0 }, 0.0, 1.0]
                }
            })
            .collect()
    };
    // 1.0 long enough to rest, 0.45 slips, 0.55 lies between threshold and leave level, then nothing touches.
    let mut frames = vec![frame(20); 12];
    frames.extend([frame(9), frame(11), frame(11), vec![[0.0; 3]; 20]]);
    write_maps(&maps, &frames, 1, 20);
    let found = rows(&maps, &["--state", "--rate", "100"]);
    let states: Vec<&str> = found[11..].iter().map(|row| &*row["state"]).collect();
    assert_eq!(states, ["STICK", "SLIP", "SLIP", "SLIP", "NO_CONTACT"]);
    let slips: Vec<&str> = found[11..].iter().map(|row| &*row["slip"]).collect();
    assert_eq!(slips, ["0", "1", "0", "0", "0"]);
}

#[test]
fn the_line_rises_to_what_friction_needs_and_never_falls_while_maps_are_clipped() {
    let directory = directory("line");
    let maps = directory.join("maps.npy");
    // Half a newton of shear over four taxels that stick. It comes at once, so the grip looks ahead of it and then settles.
    let needed_n = 0.5 / 0.45;
    let kept_n = needed_n * (1.0 + f64::from(Configuration::DEFAULT.margin) / f64::from(PER_UNIT));
    let calm: Frame = vec![[0.125, 0.0, 1.0]; 4];
    write_maps(&maps, &vec![calm.clone(); 60], 2, 2);
    let line: Vec<f64> = rows(&maps, &["--line"])
        .iter()
        .map(|row| number(row, "line_n"))
        .collect();
    assert!(line[1..].iter().all(|line_n| *line_n > needed_n), "{line:?}");
    // The load's share is rounded to 1/10000, force to 1/4096 N.
    assert!((line[59] - kept_n).abs() < 4.0 / 4096.0, "{line:?}");
    // A slower recording gives the same force in fewer frames, once the load that settled below friction has been tested.
    let slow = rows(&maps, &["--line", "--rate", "10"]);
    let line: Vec<f64> = slow.iter().map(|row| number(row, "line_n")).collect();
    assert!((line[20] - kept_n).abs() < 4.0 / 4096.0, "{kept_n}: {line:?}");
    // Clipped maps are doubtful ones: the controller holds what it has although the shear is gone.
    let mut frames = vec![calm; 30];
    frames.extend(vec![vec![[0.0, 0.0, 9.0]; 4]; 90]);
    write_maps(&maps, &frames, 2, 2);
    let line: Vec<f64> = rows(&maps, &["--line"])
        .iter()
        .map(|row| number(row, "line_n"))
        .collect();
    assert!(line[29..].windows(2).all(|pair| pair[0] <= pair[1]), "{line:?}");
}

/// Runs with what must fail and returns the one line that says why.
fn failure(arguments: &[&str], code: i32) -> String {
    let output = detect(arguments);
    let line = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {line}");
    assert_eq!(output.stdout, b"", "{arguments:?}");
    line
}

fn assert_contains(line: &str, parts: &[&str]) {
    for part in parts {
        assert!(line.contains(part), "{part:?} is not in {line:?}");
    }
}

/// What a file contains, and what the error about it must say.
type BadFile<'a> = (Vec<u8>, &'a [&'a str]);

fn assert_refused(test: &str, cases: &[BadFile]) {
    let directory = directory(test);
    let path = directory.join("maps.npy");
    let csv = directory.join("out.csv");
    for (bytes, parts) in cases {
        fs::write(&path, bytes).unwrap();
        let line = failure(&[path.to_str().unwrap(), "--csv", csv.to_str().unwrap()], 1);
        assert_eq!(line.lines().count(), 1, "{line}");
        assert_contains(&line, &["gripline: ", path.to_str().unwrap()]);
        assert_contains(&line, parts);
        // No CSV that looks like a result, and nothing half-written beside it.
        let left: Vec<_> = fs::read_dir(&directory)
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        assert_eq!(left, ["maps.npy"], "{line}");
    }
}

/// A file of float32 zeros except for one number.
fn with_number(shape: &str, numbers: usize, index: usize, value: f32) -> Vec<u8> {
    let mut values = vec![0.0; numbers];
    values[index] = value;
    npy("<f4", false, shape, &f32_bytes(&values))
}

#[test]
fn a_file_that_is_missing_empty_cut_short_or_no_numpy_file_is_refused_in_one_line() {
    let good = npy("<f4", false, "(2, 3, 4, 4)", &[0; 384]);
    assert_refused(
        "bad-files",
        &[
            (Vec::new(), &["empty file (0 bytes)", "expected a NumPy file"]),
            (
                b"frame,fn\n".to_vec(),
                &["starts with 66 72 61 6d 65 2c", "expected the NumPy signature"],
            ),
            (
                b"PK\x03\x04 and so on".to_vec(),
                &["starts with 50 4b", ".npz archive"],
            ),
            (
                good[..9].to_vec(),
                &["ends inside the NumPy header after 9 bytes", "expected at least"],
            ),
            (
                good[..100].to_vec(),
                &[
                    "ends inside the NumPy header after 100 bytes",
                    "expected at least 128",
                ],
            ),
            (
                good[..good.len() - 1].to_vec(),
                &[
                    "truncated: found 383 bytes of data, expected 384",
                    "2 frames of 192",
                ],
            ),
            (
                [&good[..], &[0]].concat(),
                &["found 385 bytes of data, expected 384"],
            ),
        ],
    );
    let directory = directory("missing-file");
    let missing = directory.join("missing.npy");
    let line = failure(&[missing.to_str().unwrap()], 1);
    assert_contains(
        &line,
        &[missing.to_str().unwrap(), "no such file", "check the path"],
    );
    let line = failure(&[directory.to_str().unwrap()], 1);
    assert_contains(&line, &["not a regular file", "expected a NumPy file"]);
}

#[test]
fn a_wrong_dtype_or_shape_is_refused_in_one_line() {
    let file = |descr, shape, bytes| npy(descr, false, shape, &vec![0; bytes]);
    assert_refused(
        "bad-shapes",
        &[
            (
                file("<i4", "(2, 3, 4, 4)", 384),
                &["dtype '<i4'", "expected float32 or float64"],
            ),
            (
                file("<f2", "(2, 3, 4, 4)", 192),
                &["dtype '<f2'", "expected float32 or float64"],
            ),
            (
                file("<c8", "(2, 3, 4, 4)", 768),
                &["dtype '<c8'", "expected float32 or float64"],
            ),
            (
                file("<f4", "(96,)", 384),
                &["shape (96,), expected (T, 3, R, C)", "found 1 dimensions"],
            ),
            (file("<f4", "()", 4), &["shape (), expected (T, 3, R, C)"]),
            (
                file("<f4", "(2, 4, 4, 3)", 384),
                &["found 4 channels on axis 1, expected 3", "moveaxis"],
            ),
            (
                file("<f4", "(2, 3, 21, 4)", 2_016),
                &["found 21 rows, expected 1 to 20"],
            ),
            (
                file("<f4", "(2, 3, 4, 40)", 3_840),
                &["found 40 columns, expected 1 to 20"],
            ),
            (
                file("<f4", "(2, 3, 0, 4)", 0),
                &["found 0 rows, expected 1 to 20"],
            ),
            (
                file("<f4", "(0, 3, 4, 4)", 0),
                &["found 0 frames, expected at least 1"],
            ),
            (
                file("<f4", "(9999999999999, 3, 4, 4)", 0),
                &["found 0 bytes of data, expected 1919999999999808"],
            ),
            (
                file("<f4", "(2, 3, 4, -4)", 384),
                &["NumPy header", "expected that of a plain float array"],
            ),
        ],
    );
}

#[test]
fn a_number_that_is_not_finite_is_refused_and_its_place_named() {
    let last_z = 48 + 32 + 4 * 2 + 3; // frame 1, axis z, row 2, column 3
    assert_refused(
        "bad-numbers",
        &[
            (
                with_number("(2, 3, 4, 4)", 96, 0, f32::NAN),
                &["frame 0, row 0, column 0, axis x: found NaN, expected a finite number"],
            ),
            (
                with_number("(2, 3, 4, 4)", 96, last_z, f32::NEG_INFINITY),
                &["frame 1, row 2, column 3, axis z: found -inf, expected a finite number"],
            ),
        ],
    );
}

#[test]
fn a_csv_that_cannot_be_written_is_said_and_the_recording_is_never_overwritten() {
    let directory = directory("bad-csv");
    let path = directory.join("maps.npy");
    write_maps(&path, &[vec![[0.0, 0.0, 1.0]]], 1, 1);
    let maps = path.to_str().unwrap();
    let before = fs::read(&path).unwrap();
    let nowhere = directory.join("nowhere/out.csv");
    let line = failure(&[maps, "--csv", nowhere.to_str().unwrap()], 1);
    assert_contains(
        &line,
        &[
            nowhere.to_str().unwrap(),
            "cannot be written",
            "create the directory",
        ],
    );
    let line = failure(&[maps, "--csv", directory.to_str().unwrap()], 1);
    assert_contains(&line, &[directory.to_str().unwrap(), "cannot be written"]);
    let line = failure(&[maps, "--csv", maps], 2);
    assert_contains(&line, &["found the recording itself", "choose another name"]);
    assert_eq!(fs::read(&path).unwrap(), before);
}

#[test]
fn settings_out_of_range_are_wrong_usage_and_name_found_and_expected() {
    let directory = directory("bad-settings");
    let path = directory.join("maps.npy");
    write_maps(&path, &[vec![[0.0, 0.0, 1.0]]], 1, 1);
    let maps = path.to_str().unwrap();
    for (option, found, expected) in [
        ("--mu", "2.0001", "from 0 to 2"),
        ("--mu", "-0.1", "from 0 to 2"),
        ("--mu", "NaN", "from 0 to 2"),
        ("--mu", "much", "from 0 to 2"),
        ("--threshold", "1.01", "from 0 to 1"),
        ("--pitch-mm", "0", "from 0.1 to 10"),
        ("--threshold", "-1", "from 0 to 1"),
        ("--threshold", "inf", "from 0 to 1"),
        ("--contact-min", "-0.001", "from 0 to 8"),
        ("--contact-min", "nan", "from 0 to 8"),
        ("--scale", "0", "a positive number"),
        ("--scale", "-1", "a positive number"),
        ("--scale", "inf", "a positive number"),
        ("--rate", "9", "from 10 to 1000"),
    ] {
        let line = failure(&[maps, option, found], 2);
        assert_contains(&line, &[option, &format!("found {found}, expected"), expected]);
    }
    assert_contains(&failure(&[], 2), &["MAPS.npy"]);
    assert_contains(&failure(&[maps, "--state"], 2), &["--csv"]);
    // More places than the detector has are rounded, and said.
    let output = detect(&[maps, "--mu", "0.45678"]);
    let note = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success());
    assert_contains(&note, &["--mu 0.45678 is taken as 0.4568"]);
}

/// One finger of the three trials: per frame whether it slips by the label, and the CSV's row. Frames from the first
/// lost one on are left out.
fn trials(folder: &Path, finger: u8, arguments: &[&str]) -> Vec<(bool, BTreeMap<String, String>)> {
    let mut frames = Vec::new();
    for trial in 1..=3 {
        let path = folder.join(format!("trial{trial}_labels.npy"));
        let labels = fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let header = 10 + usize::from(u16::from_le_bytes([labels[8], labels[9]]));
        let rows = rows(
            &folder.join(format!("trial{trial}_finger{finger}.npy")),
            arguments,
        );
        let labels: Vec<&[u8]> = labels[header..].chunks_exact(2).collect();
        assert_eq!(labels.len(), rows.len());
        frames.extend(
            labels
                .iter()
                .zip(rows)
                .take_while(|(label, _)| label[1] == 0)
                .map(|(label, row)| (label[0] != 0, row)),
        );
    }
    frames
}

/// Area under the ROC curve: how often a slipping frame scores above a sticking one; ties count half.
fn roc_area(
    frames: &[(bool, BTreeMap<String, String>)],
    score: impl Fn(&BTreeMap<String, String>) -> f64,
) -> f64 {
    let scores = |slips: bool| -> Vec<f64> {
        frames
            .iter()
            .filter(|frame| frame.0 == slips)
            .map(|frame| score(&frame.1))
            .collect()
    };
    let (slipping, sticking) = (scores(true), scores(false));
    let mut above = 0.0;
    for high in &slipping {
        for low in &sticking {
            above += if high > low {
                1.0
            } else if high < low {
                0.0
            } else {
                0.5
            };
        }
    }
    above / (slipping.len() * sticking.len()) as f64
}

/// The recordings' README gives, per finger, the area for F_T/F_N and for 1 − SR with the best friction. Its numbers
/// come out with: totals over all taxels, F_N at or below 0 as the worst score, contact above 30 counts, a frame without
/// contact as stick ratio 0, and a coarse list of frictions that has 0.3 and 0.5 but not 0.4.
#[test]
fn three_labelled_recordings_give_the_areas_that_their_readme_states() {
    let Some(recordings) = std::env::var_os("GRIPLINE_RECORDINGS") else {
        println!("skipped: recordings not found, set GRIPLINE_RECORDINGS");
        return;
    };
    let folder = Path::new(&recordings).join("uskin-slip");
    let coulomb = |row: &BTreeMap<String, String>| {
        let normal = number(row, "fn");
        if normal > 0.0 {
            number(row, "ft") / normal
        } else {
            f64::INFINITY
        }
    };
    let missing_stick = |row: &BTreeMap<String, String>| {
        if row["stick_ratio"].is_empty() {
            1.0
        } else {
            1.0 - number(row, "stick_ratio")
        }
    };
    // Counts of up to 1,866 come into the range of ±8 N.
    let area = |finger: u8, mu: &str| {
        let frames = trials(
            &folder,
            finger,
            &["--scale", "0.001", "--contact-min", "0.03", "--mu", mu],
        );
        assert_eq!(frames.len(), 577);
        (roc_area(&frames, coulomb), roc_area(&frames, missing_stick))
    };
    for (finger, mu, expected_coulomb, expected_stick) in [
        (1, "0.3", 0.801, 0.791),
        (2, "0.5", 0.698, 0.822),
        // Not in the README: the best friction of the first finger on a finer list.
        (1, "0.4", 0.801, 0.813),
    ] {
        let (coulomb, stick) = area(finger, mu);
        assert!(
            (coulomb - expected_coulomb).abs() <= 0.005,
            "finger {finger}: F_T/F_N {coulomb}"
        );
        assert!(
            (stick - expected_stick).abs() <= 0.005,
            "finger {finger}, mu {mu}: 1 - SR {stick}"
        );
    }
}

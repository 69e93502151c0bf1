//! What `gripline detect` writes: the CSV, which other programs rely on, and the summary. Pure.
//! Units: newtons and N·mm. Numbers are written so that reading them gives the same f64 again; flags are 0 or 1.

use std::io::{self, Write};

use serde::Serialize;

use crate::detect::judge::{Settings, Verdict};
use crate::detect::replay::Answer;
use gripline_recording::units::{force_n, moment_nmm, newtons, ratio, shear_n, stick_ratio};

/// The columns that are always there.
pub const HEADER: &str = "frame,fn,fx,fy,ft,mz,contact,stick,stick_ratio,coulomb_slip,slip";

/// The columns that must be asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Extra {
    /// `state` and `slip_evidence`: the slip state machine's, and how sure the whole detector is, 0 to 1.
    pub state: bool,
    /// `line_n`: the grip controller's.
    pub line: bool,
}

/// Writes the line with the names of the columns.
///
/// # Errors
/// Those of `out`.
pub fn write_header(out: &mut impl Write, extra: Extra) -> io::Result<()> {
    out.write_all(HEADER.as_bytes())?;
    if extra.state {
        out.write_all(b",state,slip_evidence")?;
    }
    if extra.line {
        out.write_all(b",line_n")?;
    }
    out.write_all(b"\n")
}

/// Writes the line of one frame, whose taxels are `pitch_mm` apart; the extra columns need the controller's `answer`.
///
/// # Errors
/// Those of `out`.
pub fn write_row(
    out: &mut impl Write,
    extra: Extra,
    pitch_mm: f64,
    frame: u64,
    verdict: &Verdict,
    answer: Option<Answer>,
) -> io::Result<()> {
    let [x, y, normal] = force_n(&verdict.sums);
    let (shear, moment) = (shear_n(&verdict.sums), moment_nmm(&verdict.sums, pitch_mm));
    let (contact, stick) = (verdict.sums.contact, verdict.sums.stick);
    write!(
        out,
        "{frame},{normal},{x},{y},{shear},{moment},{contact},{stick},"
    )?;
    if let Some(ratio) = stick_ratio(&verdict.sums) {
        write!(out, "{ratio}")?;
    }
    write!(
        out,
        ",{},{}",
        u8::from(verdict.coulomb_slip),
        u8::from(verdict.slip)
    )?;
    if let Some(answer) = answer {
        if extra.state {
            write!(out, ",{},{}", answer.state.name(), ratio(answer.slip_evidence))?;
        }
        if extra.line {
            write!(out, ",{}", newtons(answer.line))?;
        }
    }
    out.write_all(b"\n")
}

/// All frames in numbers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// The file, as it was given.
    pub file: String,
    /// Rows of the file's grid.
    pub rows: usize,
    /// Columns of the file's grid.
    pub columns: usize,
    /// Friction coefficient of the detector.
    pub mu: f64,
    /// Stick ratio below which a frame slips.
    pub threshold: f64,
    /// A taxel is in contact above this normal force: the largest multiple of 1/4096 N not above what was asked.
    pub contact_min_n: f64,
    /// Newtons per unit of the file.
    pub scale: f64,
    /// Frames.
    pub frames: u64,
    /// Frames with at least one taxel in contact.
    pub contact_frames: u64,
    /// Frames whose stick ratio is below the threshold.
    pub slip_frames: u64,
    /// Frames with F_T > μ F_N.
    pub coulomb_slip_frames: u64,
    /// Components that did not fit ±8 N and were clipped.
    pub saturated_components: u64,
    /// Frames with at least one of those.
    pub saturated_frames: u64,
    /// Greatest magnitude of a component before clipping.
    pub max_component_n: f64,
}

impl Summary {
    /// Of no frame yet.
    #[must_use]
    pub fn new(file: String, (rows, columns): (usize, usize), settings: &Settings) -> Self {
        Self {
            file,
            rows,
            columns,
            mu: ratio(settings.friction.per_unit()),
            threshold: ratio(settings.threshold),
            contact_min_n: newtons(settings.contact_min.into()),
            scale: settings.scale,
            frames: 0,
            contact_frames: 0,
            slip_frames: 0,
            coulomb_slip_frames: 0,
            saturated_components: 0,
            saturated_frames: 0,
            max_component_n: 0.0,
        }
    }

    /// Counts a frame.
    pub fn add(&mut self, verdict: &Verdict, saturated: u16, max_n: f64) {
        self.frames += 1;
        self.contact_frames += u64::from(verdict.sums.contact > 0);
        self.slip_frames += u64::from(verdict.slip);
        self.coulomb_slip_frames += u64::from(verdict.coulomb_slip);
        self.saturated_components += u64::from(saturated);
        self.saturated_frames += u64::from(saturated > 0);
        self.max_component_n = self.max_component_n.max(max_n);
    }

    /// A few lines for people.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_text(&self, out: &mut impl Write) -> io::Result<()> {
        let Self { mu, threshold, .. } = self;
        writeln!(
            out,
            "{}: {} frames of {}×{} taxels",
            self.file, self.frames, self.rows, self.columns
        )?;
        let above = self.contact_min_n;
        writeln!(
            out,
            "  in contact    {:>8}  a taxel above {above} N",
            self.contact_frames
        )?;
        writeln!(
            out,
            "  slip          {:>8}  stick ratio below {threshold} at friction {mu}",
            self.slip_frames
        )?;
        writeln!(
            out,
            "  Coulomb slip  {:>8}  F_T > {mu} F_N",
            self.coulomb_slip_frames
        )?;
        if self.saturated_components > 0 {
            writeln!(
                out,
                "  clipped       {:>8}  {} components beyond ±8 N, the greatest {:.4} N: if the file is not in newtons, \
                 give --scale (at most {:.1e} here)",
                self.saturated_frames,
                self.saturated_components,
                self.max_component_n,
                self.largest_scale(),
            )?;
        }
        Ok(())
    }

    /// A scale at which nothing is clipped, with room for rounding it to two digits.
    fn largest_scale(&self) -> f64 {
        7.6 * self.scale / self.max_component_n
    }
}

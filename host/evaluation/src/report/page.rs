//! The page of `gripline evaluate paper`, in Markdown.

use super::super::detectors::{PAPER_FRICTION, PAPER_THRESHOLD};
use super::super::document::{number, scores_cell, table};
use super::super::plan::{PAPER_OBJECTS, PAPER_ROTATION, PAPER_TRANSLATION};
use super::figures::{Report, Sensitivity, Tables};

impl Report {
    /// The page.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut page = self.head();
        page += "\n### What it must show\n\n";
        page += &self.bounds_table();
        page += "\n### Per frame: accuracy / precision / recall, percent\n\n";
        page += &self.objects_table();
        let [baseline, stick_ratio, gripline] =
            self.perfect_sensor.named().map(|(_, scores)| scores_cell(scores));
        page += "\nOn the true maps of a perfect sensor the same detectors reach ";
        page += &[baseline, stick_ratio, gripline].join(", ");
        page += " (baseline, stick ratio, Gripline).\n";
        page += "\n### The same with gross slip alone as the truth\n\n";
        page += &gross_table(&self.gross_slip_only);
        page += "\nWhoever warns 50 ms and more before gross slip has three and more frames a slip against its precision \
                 here: a bound on this precision and one on lead time exclude each other at these lengths of slips.\n";
        page += "\n### Lead time, kinds of slip, false alarms\n\n";
        page += &self.notice_table();
        page += "\n### What it depends on\n\nAccuracy / precision / recall, percent, over the sequences.\n\n";
        page += &self.sensitivity_tables();
        page
    }

    fn head(&self) -> String {
        let quick = if self.quick {
            " --quick (coarse grid, short runs: no evidence)"
        } else {
            ""
        };
        let objects = if self.objects_played < 5 {
            format!(" --objects {} (not all five: no evidence)", self.objects_played)
        } else {
            String::new()
        };
        let settings: Vec<String> = self
            .settings
            .iter()
            .map(|(name, value)| format!("{name} {value:.4}"))
            .map(|text| text.trim_end_matches('0').trim_end_matches('.').to_owned())
            .collect();
        format!(
            "## The paper's experiment\n\n`gripline evaluate paper --data {} --seed {} --runs {}{quick}{objects}`: {} frames, \
             network {}, {} of them doubtful.\n\n\
             Five objects with the paper's masses in the contact world, gripped by a constant force; a hand (a spring of \
             1 mm/N) pulls until the object slides and lets go, as T-T-R-T-T, translation only (three slips) and rotation \
             only. Every frame is a rendered picture with the sensor's noise, light and lens, through gate, force \
             network, quantised map and the microcontroller's own detector. What the objects were, the paper does not \
             say: shapes, friction, grips and hands are assumed.\n\n\
             Truth: a frame slips when less than half of the contact area sticks in the world, or the contact slides as \
             a whole. That is the paper's own threshold, on the truth, and counts incipient slip, which is what a stick \
             ratio is for. The paper labelled by hand from what could be seen, which lies between this and gross slip \
             alone; both are reported.\n\n\
             The baseline and the stick ratio have the paper's settings (friction {PAPER_FRICTION}, threshold \
             {PAPER_THRESHOLD}). Gripline says slip in its states INCIPIENT and SLIP, with the settings that `gripline \
             run` has by default: {}. None of \
             them was chosen on these runs: friction and contact threshold are the network's calibration, the rest are the \
             firmware's defaults. While the load on the contact falls, everything sticks, whatever the ratios in the map \
             (Mindlin and Deresiewicz 1953); once it has slid, friction is known, and half of the contact slips where the \
             load is further than a part of what slid from the rest of it: about two thirds for a round contact, three \
             quarters for a line, nine tenths for a flat one, told apart by how the reach of the pressure grew while it was \
             pressed. Beyond is INCIPIENT before the ratios show it, within STICK although they do not, unless they are \
             below a quarter of the threshold. That rule was found on `--data tuning`, which has other objects, seeds \
             and sensors (from 7000000 on); sensors here: {} to {}.\n",
            self.data,
            self.seed,
            self.runs,
            self.frames,
            self.network,
            self.doubtful_frames,
            settings.join(", "),
            self.sensors[0],
            self.sensors[1],
        )
    }

    fn objects_table(&self) -> String {
        let is_papers = self.data == "report";
        let mut rows = Vec::new();
        for (number, object) in self.tables.objects.iter().enumerate() {
            let papers = is_papers.then(|| PAPER_OBJECTS[number]);
            let cell = |which: usize| papers.map_or_else(String::new, |both| scores_cell(&both[which]));
            rows.push(vec![
                object.name.clone(),
                format!("{:.2} to {:.2}", object.friction[0], object.friction[1]),
                cell(0),
                cell(1),
                scores_cell(&object.scores.baseline),
                scores_cell(&object.scores.stick_ratio),
                scores_cell(&object.scores.gripline),
            ]);
        }
        let more = [
            ("all five", self.tables.all, None),
            (
                "translation only",
                self.tables.translation,
                Some(PAPER_TRANSLATION),
            ),
            ("rotation only", self.tables.rotation, Some(PAPER_ROTATION)),
        ];
        for (name, scores, papers) in more {
            rows.push(vec![
                name.to_owned(),
                String::new(),
                String::new(),
                papers.map_or_else(String::new, |papers| scores_cell(&papers)),
                scores_cell(&scores.baseline),
                scores_cell(&scores.stick_ratio),
                scores_cell(&scores.gripline),
            ]);
        }
        table(
            &[
                "object",
                "true friction",
                "paper: baseline",
                "paper: stick ratio",
                "baseline",
                "stick ratio",
                "Gripline",
            ],
            &rows,
        )
    }

    fn notice_table(&self) -> String {
        let mut rows = Vec::new();
        for kind in ["translation", "rotation", "all"] {
            for (name, notice) in self.slips[kind].named() {
                rows.push(vec![
                    kind.to_owned(),
                    name.to_owned(),
                    format!("{} of {}", notice.noticed, notice.slips),
                    notice.before.to_string(),
                    number(notice.lead_ms_median, 0),
                    number(notice.lead_ms_p5, 0),
                ]);
            }
        }
        let alarms = self.alarms_per_minute_of;
        table(
            &[
                "slips",
                "detector",
                "noticed",
                "before gross slip",
                "lead, median ms",
                "lead, 5th percentile ms",
            ],
            &rows,
        ) + &format!(
            "\nAlarms a minute in {:.1} minutes of steady holds (shear 10 to 32 % of the normal force, with tremor): \
             baseline {:.2}, stick ratio {:.2}, Gripline {:.2}.\n",
            self.hold_minutes, alarms.baseline, alarms.stick_ratio, alarms.gripline
        )
    }

    fn sensitivity_tables(&self) -> String {
        let Sensitivity {
            friction_assumed_over_true,
            threshold,
            camera_noise_levels,
            contact_taxels_from,
        } = &self.sensitivity;
        let mut text = String::new();
        for (name, digits, figures) in [
            (
                "detector's friction over the true one",
                1,
                friction_assumed_over_true,
            ),
            (
                "threshold on the stick ratio (ours: all its levels move with it)",
                1,
                threshold,
            ),
            (
                "noise of the camera, grey levels (first runs)",
                0,
                camera_noise_levels,
            ),
            ("contact: loaded taxels from", 0, contact_taxels_from),
        ] {
            let rows: Vec<Vec<String>> = figures
                .iter()
                .map(|at| {
                    vec![
                        format!("{:.digits$}", at.value),
                        at.frames.to_string(),
                        scores_cell(&at.stick_ratio),
                        scores_cell(&at.gripline),
                    ]
                })
                .collect();
            text += &table(&[name, "frames", "stick ratio", "Gripline"], &rows);
            text.push('\n');
        }
        text
    }
}

fn gross_table(tables: &Tables) -> String {
    let mut rows: Vec<Vec<String>> = tables
        .objects
        .iter()
        .map(|object| (object.name.clone(), object.scores))
        .chain([
            ("all five".to_owned(), tables.all),
            ("translation only".to_owned(), tables.translation),
            ("rotation only".to_owned(), tables.rotation),
        ])
        .map(|(name, scores)| {
            vec![
                name,
                scores_cell(&scores.baseline),
                scores_cell(&scores.stick_ratio),
                scores_cell(&scores.gripline),
            ]
        })
        .collect();
    rows.shrink_to_fit();
    table(&["object", "baseline", "stick ratio", "Gripline"], &rows)
}

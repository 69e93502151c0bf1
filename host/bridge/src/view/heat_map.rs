//! The skin, 20 x 20 taxels: normal force as brightness, shear as an arrow, slipping taxels warm and sticking ones cold.
//!
//! Row 0 of the map (lowest y) is the lowest line on the screen. Newtons. The microcontroller's rule, applied to the quantised
//! force, decides whether a taxel sticks, so the view cannot disagree with its counts.

use gripline_firmware::Friction;
use gripline_firmware::sums::TaxelRule;
use gripline_protocol::force_map::quantise_component;
use gripline_protocol::{PER_UNIT, SIDE, TaxelForce};
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};
use ratatui::text::{Line, Span};

use super::colour::{ARROW, COLD, DIM, Rgb, TEXT, WARM, mix, ramp, solid};
use gripline_recording::telemetry::Limits;

/// Columns and lines of a taxel at scale 1: nearly square in most fonts.
const TAXEL_COLUMNS: u16 = 2;
/// Taxels along a side.
const SIDE_LINES: u16 = SIDE as u16;
/// Columns of the map at scale 1.
pub(super) const COLUMNS: u16 = SIDE_LINES * TAXEL_COLUMNS;
/// Lines of the map at scale 1.
pub(super) const LINES: u16 = SIDE_LINES;
/// Columns of the legend's colour bar.
const BAR_COLUMNS: u16 = 8;
/// Shear below this share of what friction can hold at full scale is a dot instead of an arrow.
const SHEAR_VISIBLE: f32 = 0.02;

/// State of a taxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Taxel {
    Free,
    Sticks,
    Slips,
}

/// One map on the screen.
pub(super) struct HeatMap<'a> {
    pub(super) map: &'a [[f32; 3]; SIDE * SIDE],
    pub(super) limits: &'a Limits,
    /// Normal force of the brightest colour.
    pub(super) full_scale_n: f64,
}

/// How many times the map at scale 1, with its legend, fits into an area.
pub(super) fn scale(columns: u16, lines: u16) -> u16 {
    (columns / COLUMNS).min(lines.saturating_sub(1) / LINES)
}

impl HeatMap<'_> {
    /// Draws the map in the upper left of `area`, as large as fits, and its legend below; nothing where not even
    /// scale 1 fits.
    pub(super) fn draw(&self, area: Rect, buffer: &mut Buffer) {
        let scale = scale(area.width, area.height);
        if scale == 0 {
            return;
        }
        let rule = rule(self.limits);
        for (index, &force) in self.map.iter().enumerate() {
            let (row, column) = ((index / SIDE) as u16, (index % SIDE) as u16);
            let place = Rect {
                x: area.x + column * TAXEL_COLUMNS * scale,
                y: area.y + (SIDE_LINES - 1 - row) * scale,
                width: TAXEL_COLUMNS * scale,
                height: scale,
            };
            self.draw_taxel(force, taxel(force, rule), place, buffer);
        }
        self.draw_legend(
            Rect {
                y: area.y + LINES * scale,
                height: 1,
                ..area
            },
            buffer,
        );
    }

    fn draw_taxel(&self, [fx, fy, fz]: [f32; 3], taxel: Taxel, place: Rect, buffer: &mut Buffer) {
        let full_scale_n = self.full_scale_n as f32;
        let stops = if taxel == Taxel::Slips { &WARM } else { &COLD };
        let ground = ramp(stops, brightness(fz.max(0.0) / full_scale_n));
        buffer.set_style(place, Style::new().bg(solid(ground)));
        if taxel == Taxel::Free {
            return;
        }
        let share = fx.hypot(fy) / (self.limits.friction as f32 * full_scale_n);
        let glyph = if share > SHEAR_VISIBLE {
            arrow(fx, fy)
        } else {
            '·'
        };
        let text = match taxel {
            Taxel::Slips => format!("{glyph}{glyph}"),
            _ => glyph.to_string(),
        };
        let style = Style::new()
            .fg(solid(arrow_colour(ground, share)))
            .add_modifier(Modifier::BOLD);
        let (x, y) = (place.x + (place.width - 1) / 2, place.y + (place.height - 1) / 2);
        buffer.set_string(x, y, text, style);
    }

    fn draw_legend(&self, area: Rect, buffer: &mut Buffer) {
        let colour = |stops: &[Rgb; 4], column: u16| {
            solid(ramp(
                stops,
                (f32::from(column) / f32::from(BAR_COLUMNS - 1)).sqrt(),
            ))
        };
        let mut spans = vec![Span::styled("0 ", DIM)];
        spans.extend((0..BAR_COLUMNS).map(|column| {
            let style = Style::new().fg(colour(&COLD, column)).bg(colour(&WARM, column));
            Span::styled("▀", style)
        }));
        spans.extend([
            Span::styled(format!(" {:.2} N", self.full_scale_n), DIM),
            Span::styled("   → ", Style::new().fg(TEXT).add_modifier(Modifier::BOLD)),
            Span::styled("sticks", solid(COLD[3])),
            Span::styled("  →→ ", Style::new().fg(TEXT).add_modifier(Modifier::BOLD)),
            Span::styled("slips", solid(WARM[3])),
        ]);
        buffer.set_line(area.x, area.y, &Line::from(spans), area.width);
    }
}

/// Spreads the weak forces at the contact's edge, where slip begins.
fn brightness(share: f32) -> f32 {
    share.powf(0.7)
}

/// Brighter with more shear; never so dark that the arrow cannot be read.
fn arrow_colour(ground: Rgb, share: f32) -> Rgb {
    mix(ground, ARROW, 0.4 + 0.6 * share.clamp(0.0, 1.0).sqrt())
}

/// The microcontroller's rule for the limits of this run.
fn rule(limits: &Limits) -> TaxelRule {
    TaxelRule {
        friction: Friction::clamped((limits.friction * f64::from(PER_UNIT)).round() as u16),
        contact_min: quantise_component(limits.contact_min_n).0.max(0),
    }
}

fn taxel(force: [f32; 3], rule: TaxelRule) -> Taxel {
    let [x, y, z] = force.map(|newton| quantise_component(f64::from(newton)).0);
    match rule.decide(TaxelForce { x, y, z }) {
        (false, _) => Taxel::Free,
        (true, false) => Taxel::Slips,
        (true, true) => Taxel::Sticks,
    }
}

/// The arrow nearest to the direction; y points up.
fn arrow(fx: f32, fy: f32) -> char {
    const ARROWS: [char; 8] = ['→', '↗', '↑', '↖', '←', '↙', '↓', '↘'];
    let eighth = (fy.atan2(fx) / std::f32::consts::FRAC_PI_4).round() as i32;
    ARROWS[eighth.rem_euclid(8) as usize]
}

#[cfg(test)]
mod tests {
    use super::super::tests::LIMITS;
    use super::*;

    fn drawn(map: &[[f32; 3]; 400], width: u16, height: u16) -> Buffer {
        let mut buffer = Buffer::empty(Rect::new(0, 0, width, height));
        let heat_map = HeatMap {
            map,
            limits: &LIMITS,
            full_scale_n: 1.0,
        };
        heat_map.draw(buffer.area, &mut buffer);
        buffer
    }

    #[test]
    fn an_arrow_points_where_the_shear_points_with_y_up() {
        let directions = [
            (1.0, 0.0, '→'),
            (1.0, 1.0, '↗'),
            (0.0, 1.0, '↑'),
            (-1.0, 1.0, '↖'),
            (-1.0, 0.0, '←'),
            (-1.0, -1.0, '↙'),
            (0.0, -1.0, '↓'),
            (1.0, -1.0, '↘'),
            (1.0, 0.4, '→'),
            (1.0, 0.42, '↗'),
        ];
        for (fx, fy, expected) in directions {
            assert_eq!(arrow(fx, fy), expected, "({fx}, {fy})");
        }
    }

    #[test]
    fn the_lowest_row_of_the_map_is_the_lowest_line_and_columns_run_to_the_right() {
        let mut map = [[0.0; 3]; 400];
        map[3] = [0.2, 0.0, 1.0];
        map[19 * 20 + 19] = [0.0, -0.2, 1.0];
        let buffer = drawn(&map, 40, 21);
        assert_eq!(buffer[(6, 19)].symbol(), "→");
        assert_eq!(buffer[(38, 0)].symbol(), "↓");
        let arrows = buffer.content[..40 * 20]
            .iter()
            .filter(|cell| cell.symbol() != " ")
            .count();
        assert_eq!(arrows, 2);
    }

    #[test]
    fn a_slipping_taxel_differs_in_glyph_and_colour_from_a_sticking_one() {
        let mut map = [[0.0; 3]; 400];
        map[0] = [0.44, 0.0, 1.0];
        map[1] = [0.46, 0.0, 1.0];
        let buffer = drawn(&map, 40, 21);
        assert_eq!((buffer[(0, 19)].symbol(), buffer[(1, 19)].symbol()), ("→", " "));
        assert_eq!((buffer[(2, 19)].symbol(), buffer[(3, 19)].symbol()), ("→", "→"));
        assert_eq!(buffer[(0, 19)].bg, solid(COLD[3]));
        assert_eq!(buffer[(2, 19)].bg, solid(WARM[3]));
        assert_eq!(buffer[(4, 19)].bg, solid(COLD[0]));
    }

    #[test]
    fn contact_begins_above_the_least_force_as_quantised() {
        let rule = TaxelRule {
            contact_min: 10,
            ..rule(&LIMITS)
        };
        assert_eq!(taxel([0.0, 0.0, 10.4 / 4096.0], rule), Taxel::Free);
        assert_eq!(taxel([0.0, 0.0, 10.6 / 4096.0], rule), Taxel::Sticks);
        assert_eq!(taxel([1.0, 0.0, 10.6 / 4096.0], rule), Taxel::Slips);
        assert_eq!(taxel([1.0, 0.0, -1.0], rule), Taxel::Free);
        assert_eq!(taxel([f32::NAN; 3], rule), Taxel::Free);
    }

    #[test]
    fn a_larger_screen_gets_larger_taxels() {
        let mut map = [[0.0; 3]; 400];
        map[0] = [0.0, 0.2, 1.0];
        let buffer = drawn(&map, 85, 45);
        let bright = buffer
            .content
            .iter()
            .filter(|cell| cell.bg == solid(COLD[3]))
            .count();
        assert_eq!(bright, 4 * 2);
        assert_eq!(buffer[(1, 38)].symbol(), "↑");
    }
}

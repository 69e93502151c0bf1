//! Every colour of the view, and its replacement on a terminal with 256 colours.
//!
//! The view draws in true colour on its own dark ground, so that it looks the same on any theme.

use ratatui::buffer::Buffer;
use ratatui::style::Color;

pub(super) type Rgb = (u8, u8, u8);

/// Behind everything.
pub(super) const GROUND: Color = Color::Rgb(12, 14, 18);
pub(super) const TEXT: Color = Color::Rgb(205, 210, 218);
pub(super) const DIM: Color = Color::Rgb(110, 116, 128);

pub(super) const NO_CONTACT: Color = Color::Rgb(130, 135, 145);
pub(super) const STICK: Color = Color::Rgb(80, 210, 120);
pub(super) const INCIPIENT: Color = Color::Rgb(250, 205, 70);
pub(super) const SLIP: Color = Color::Rgb(255, 85, 75);

pub(super) const DETECTOR: Color = Color::Rgb(90, 200, 255);
pub(super) const EVIDENCE: Color = Color::Rgb(255, 125, 190);
pub(super) const WORLD: Color = Color::Rgb(105, 108, 120);
pub(super) const THRESHOLD: Color = Color::Rgb(150, 62, 60);
pub(super) const GRIP_LINE: Color = Color::Rgb(255, 190, 90);
pub(super) const OBJECT: Color = Color::Rgb(120, 150, 255);
pub(super) const GRIP_LIMIT: Color = Color::Rgb(75, 79, 90);

/// Normal force of a taxel that sticks (or is free): cold, dark to bright.
pub(super) const COLD: [Rgb; 4] = [(23, 26, 34), (20, 58, 105), (18, 102, 150), (44, 166, 168)];
/// Normal force of a taxel that slips: warm, dark to bright.
pub(super) const WARM: [Rgb; 4] = [(62, 22, 22), (135, 40, 26), (194, 74, 22), (232, 134, 30)];
/// Shear arrow at full force.
pub(super) const ARROW: Rgb = (255, 255, 245);

/// The colour at `level` (0 to 1, clamped) of a ramp with evenly spaced stops.
pub(super) fn ramp(stops: &[Rgb; 4], level: f32) -> Rgb {
    let place = level.clamp(0.0, 1.0) * (stops.len() - 1) as f32;
    let below = (place as usize).min(stops.len() - 2);
    mix(stops[below], stops[below + 1], place - below as f32)
}

/// The colour at `share` (0 to 1) between the two.
pub(super) fn mix(from: Rgb, to: Rgb, share: f32) -> Rgb {
    let channel =
        |from: u8, to: u8| (f32::from(from) + (f32::from(to) - f32::from(from)) * share).round() as u8;
    (
        channel(from.0, to.0),
        channel(from.1, to.1),
        channel(from.2, to.2),
    )
}

pub(super) const fn solid((red, green, blue): Rgb) -> Color {
    Color::Rgb(red, green, blue)
}

/// Replaces true colours by the nearest of the 256 that xterm fixed.
pub(super) fn reduce_to_256(buffer: &mut Buffer) {
    let reduce = |colour: &mut Color| {
        if let Color::Rgb(red, green, blue) = *colour {
            *colour = Color::Indexed(nearest_of_256([red, green, blue]));
        }
    };
    for cell in &mut buffer.content {
        reduce(&mut cell.fg);
        reduce(&mut cell.bg);
    }
}

/// Levels of the 6 x 6 x 6 cube that starts at colour 16.
const CUBE: [u8; 6] = [0, 95, 135, 175, 215, 255];

/// The nearest colour of xterm's cube (16 to 231) and grey ramp (232 to 255: 8, 18, .. 238).
fn nearest_of_256(rgb: [u8; 3]) -> u8 {
    let distance = |other: [u8; 3]| -> u32 {
        (0..3)
            .map(|channel| u32::from(rgb[channel].abs_diff(other[channel])).pow(2))
            .sum()
    };
    let steps = rgb.map(|value| (0..6).min_by_key(|&step| CUBE[step].abs_diff(value)).unwrap_or(0));
    let mean = rgb.iter().map(|&value| u32::from(value)).sum::<u32>() / 3;
    let grey_step = (mean.saturating_sub(3) / 10).min(23) as u8;
    if distance([8 + 10 * grey_step; 3]) < distance(steps.map(|step| CUBE[step])) {
        232 + grey_step
    } else {
        (16 + 36 * steps[0] + 6 * steps[1] + steps[2]) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_the_fixed_palette_are_found_again() {
        for (step, &level) in CUBE.iter().enumerate() {
            assert_eq!(usize::from(nearest_of_256([level, 0, 0])), 16 + 36 * step);
            assert_eq!(usize::from(nearest_of_256([0, level, 255])), 16 + 6 * step + 5);
        }
        for step in 0..24 {
            assert_eq!(nearest_of_256([8 + 10 * step; 3]), 232 + step);
        }
    }

    #[test]
    fn the_reduction_leaves_no_true_colour() {
        let mut buffer = Buffer::empty(ratatui::layout::Rect::new(0, 0, 3, 1));
        buffer[(0, 0)].set_fg(SLIP).set_bg(GROUND);
        buffer[(1, 0)].set_fg(Color::Reset);
        reduce_to_256(&mut buffer);
        assert_eq!(buffer[(0, 0)].fg, Color::Indexed(203));
        assert_eq!(buffer[(0, 0)].bg, Color::Indexed(233));
        assert_eq!(buffer[(1, 0)].fg, Color::Reset);
    }

    #[test]
    fn a_ramp_starts_and_ends_at_its_outer_stops() {
        assert_eq!(ramp(&COLD, -1.0), COLD[0]);
        assert_eq!(ramp(&COLD, 1.0 / 3.0), COLD[1]);
        assert_eq!(ramp(&COLD, 7.0), COLD[3]);
    }
}

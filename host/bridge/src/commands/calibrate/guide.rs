//! Instructions for a person, as text and small drawings, on standard error; standard output is for results.

use std::io::{self, Write as _};

use crate::error::Error;

/// Letters in a line of text, behind its number.
const WIDTH: usize = 74;

/// One thing to do.
pub(super) struct Step {
    pub drawing: &'static str,
    pub text: &'static str,
}

pub(super) const REST: [Step; 2] = [
    Step {
        drawing: r"
        nothing here
     .- - - - - - - - -.
    ╭───────────────────╮
    │ ·  ·   · ·  ·   · │  sensor surface with particles
    │   ·  ·    ·   ·   │
    ╰───────────────────╯
      ☼      (◎)      ☼    lamps on, camera below
",
        text: "Open the gripper, take everything off the sensor surface, and light it as in use. Do not touch the table meanwhile.",
    },
    Step {
        drawing: r"
             ╭─╮
             │ │  ↓ ↑  a fingertip, lightly, and away again
             ╰─╯
    ╭───────────────────╮
    │ ·  ·   · ·  ·   · │
    ╰───────────────────╯
",
        text: "Touch the surface once with a finger and let go. If something lay on it, the pictures after this differ.",
    },
];

pub(super) const FRICTION: [Step; 3] = [
    Step {
        drawing: r"
          ╭─────╮
          │  ↓  │  1 to 8 N
    ╭─────┴─────┴─────╮
    │ ·  ·  ·   ·  ·  │
    ╰─────────────────╯
",
        text: "Record (`gripline run --record slides.mcap`). Press an object of the kind to be held onto the surface.",
    },
    Step {
        drawing: r"
          ╭─────╮
          │     │  → → →  straight, 5 mm, slowly
    ╭─────┴─────┴─────╮
    │ ·  ·  ·   ·  ·  │
    ╰─────────────────╯
",
        text: "Drag it straight until it slides as a whole, and for half a second more. Do not turn it.",
    },
    Step {
        drawing: r"
                 ╭─────╮
              ↑  │     │  ↑
                 ╰─────╯     six times or more, other places and directions
    ╭─────────────────╮
    ╰─────────────────╯
",
        text: "Lift it and repeat. Then: `gripline calibrate friction slides.mcap`.",
    },
];

pub(super) const GEOMETRY: [Step; 3] = [
    Step {
        drawing: r"
            y ↑
              3
              │
        4 ─── 1 ─── 2  → x      5 mm from mark to mark
              │
              5
",
        text: "Make a jig with five holes as drawn, seen from outside the first fingertip, and fix it to the gripper with hole 1 on \
               its axis. For other marks use --marks.",
    },
    Step {
        drawing: r"
            ││
            ││  ↓  1 to 4 N, half a second
            ╰╯
    ╭─────────────────╮
    │ ·  ·  ·   ·  ·  │
    ╰─────────────────╯
",
        text: "Record (`gripline run --record presses.mcap`). Press a pin with a round tip of 5 mm or so through hole 1, straight.",
    },
    Step {
        drawing: r"
            ││      ││
            ││   ↷  ││   1, 2, 3, 4, 5
            ╰╯      ╰╯
    ╭─────────────────╮
    ╰─────────────────╯
",
        text: "Lift it, and press the other holes in order, each once. Then: `gripline calibrate geometry presses.mcap`.",
    },
];

pub(super) const GEL: [Step; 3] = [
    Step {
        drawing: r"
                ╭───╮
                │ o │   a ball of known radius, 4 to 10 mm
                ╰───╯
    ╭─────────────────╮
    ╰─────────────────╯
    ┌─────────────────┐
    │  scale: 0.00 N  │
    └─────────────────┘
",
        text: "Lay the sensor on a kitchen scale (or fix the ball to a force-torque sensor) and zero it.",
    },
    Step {
        drawing: r"
              ↓ ╭───╮
                │ o │   0.5, 1, 2, 3 N ...
                ╰───╯
    ╭─────────────────╮
    ╰─────────────────╯
",
        text: "Record (`gripline run --sensor gelsight-mini --record presses.mcap`). Press, hold still for two seconds, note what the \
               scale reads, and lift it.",
    },
    Step {
        drawing: r"
          ╭───╮ ╭───╮ ╭───╮
          │ o │ │ o │ │ o │   twelve times, everywhere
          ╰───╯ ╰───╯ ╰───╯
    ╭─────────────────────────╮
    ╰─────────────────────────╯
",
        text: "Repeat at other places and loads. Then: `gripline calibrate gel presses.mcap --readings \"0.5 1.0 2.1 ...\"`.",
    },
];

pub(super) const LINE: [Step; 2] = [
    Step {
        drawing: r"
      finger       load cell       finger
     ▐████▌ →    ┌───────────┐    ← ▐████▌
     ▐████▌      │  0.00 N   │      ▐████▌
                 └───────────┘
",
        text: "Put a load cell (or a kitchen scale and a lever) between the open fingers. Keep your hands out of them.",
    },
    Step {
        drawing: r"
      force
        │            ╭─ o
        │       o ─ ─╯
        │  o ─ ╯
        └───────────────── code of the line
",
        text: "The line rises step by step. At each step wait until the gauge is steady, type the newtons, press Enter.",
    },
];

/// Shows a step.
pub(super) fn show(number: usize, step: &Step) {
    eprintln!("\n{number}. {}{}", wrapped(step.text), step.drawing);
}

/// Lines of at most [`WIDTH`] letters, indented under the number except for the first.
pub(in crate::commands) fn wrapped(text: &str) -> String {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let line = lines.last().map_or(0, |line| line.chars().count());
        if line > 0 && line + 1 + word.chars().count() > WIDTH {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines.join("\n   ")
}

/// Shows a step and waits for Enter.
///
/// # Errors
/// [`Error`] when standard input ends instead.
pub(super) fn ask(number: usize, step: &Step) -> Result<(), Error> {
    show(number, step);
    eprint!("   Enter when done, Ctrl-C to stop: ");
    let _ = io::stderr().flush();
    let mut line = String::new();
    match io::stdin().read_line(&mut line) {
        Ok(0) => Err(Error::failed(
            "standard input ended, expected Enter; nothing was written",
        )),
        Ok(_) => Ok(()),
        Err(error) => Err(Error::failed(format!("standard input: {error}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_step_fits_a_terminal_of_eighty_columns() {
        for step in REST
            .iter()
            .chain(&FRICTION)
            .chain(&GEOMETRY)
            .chain(&LINE)
            .chain(&GEL)
        {
            for line in step.drawing.lines().chain(wrapped(step.text).lines()) {
                assert!(line.chars().count() <= 80, "{line}");
            }
            assert!(step.text.ends_with(['.', '`']) && step.drawing.ends_with('\n'));
        }
    }
}

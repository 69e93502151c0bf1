//! The terminal: raw mode, alternate screen, keys. Nothing here knows what is drawn.
//!
//! The terminal is given back on drop and before a panic's message is printed, whichever thread panics. A signal that
//! kills the process outright leaves it as it is (`reset` brings it back).

use std::io::{self, BufWriter, IsTerminal, Stdout, Write};
#[cfg(target_os = "linux")]
use std::os::fd::AsFd as _;
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crossterm::cursor::Show;
use crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use crossterm::terminal::{
    BeginSynchronizedUpdate, EndSynchronizedUpdate, EnterAlternateScreen, LeaveAlternateScreen,
    disable_raw_mode, enable_raw_mode,
};
use crossterm::{execute, queue};
#[cfg(target_os = "linux")]
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;

use super::{View, colour};

/// A whole frame goes to the terminal in one write.
const FRAME_BYTES: usize = 1 << 16;

/// Whether the terminal is ours; the panic hook and the drop may both want to give it back.
static TAKEN: AtomicBool = AtomicBool::new(false);
static PANIC_HOOK: Once = Once::new();

/// What a key asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// `h`: close and hold.
    Hold,
    /// `r`: open.
    Release,
    /// `a`: the latched faults that are shown have been looked at.
    Acknowledge,
    /// `z`: take new rest pictures.
    Rezero,
    /// `+`: more least force.
    RaiseFloor,
    /// `-`: less least force.
    LowerFloor,
    /// `t`: own the gripper from now on.
    TakeOver,
    /// `y`: own it no longer.
    Yield,
    /// `q`, Esc or Ctrl-C: end the run.
    Quit,
}

/// The terminal, as long as the view owns it.
#[derive(Debug)]
pub struct Screen {
    terminal: Terminal<CrosstermBackend<BufWriter<Stdout>>>,
    true_colour: bool,
}

impl Screen {
    /// Takes the terminal behind standard output.
    ///
    /// # Errors
    /// Standard output is no terminal, or it refuses raw mode; the terminal is then as it was.
    pub fn open() -> Result<Self, io::Error> {
        if !io::stdout().is_terminal() {
            return Err(io::Error::other("standard output is no terminal"));
        }
        PANIC_HOOK.call_once(|| {
            let before = std::panic::take_hook();
            std::panic::set_hook(Box::new(move |panic| {
                give_back();
                before(panic);
            }));
        });
        enable_raw_mode()?;
        TAKEN.store(true, Ordering::SeqCst);
        let open = || {
            let mut output = BufWriter::with_capacity(FRAME_BYTES, io::stdout());
            execute!(output, EnterAlternateScreen)?;
            let mut terminal = Terminal::new(CrosstermBackend::new(output))?;
            terminal.clear()?;
            Ok(terminal)
        };
        match open() {
            Ok(terminal) => Ok(Self {
                terminal,
                true_colour: knows_true_colour(std::env::var("COLORTERM").ok().as_deref()),
            }),
            Err(error) => {
                give_back();
                Err(error)
            }
        }
    }

    /// Draws the view; the terminal shows the frame whole or not at all, where it knows synchronised updates.
    ///
    /// # Errors
    /// Writing failed, or a panic elsewhere has given the terminal back.
    pub fn draw(&mut self, view: &View) -> Result<(), io::Error> {
        if !TAKEN.load(Ordering::SeqCst) {
            return Err(io::Error::other("the terminal was given back after a panic"));
        }
        queue!(self.terminal.backend_mut(), BeginSynchronizedUpdate)?;
        self.terminal.draw(|frame| {
            view.draw(frame);
            if !self.true_colour {
                colour::reduce_to_256(frame.buffer_mut());
            }
        })?;
        execute!(self.terminal.backend_mut(), EndSynchronizedUpdate)
    }

    /// What was pressed since the last call: q, Esc or Ctrl-C quit, a acknowledges. A window that was closed quits too. Never waits.
    ///
    /// # Errors
    /// Reading the keys failed.
    pub fn pressed() -> Result<Vec<Key>, io::Error> {
        let mut keys = Vec::new();
        // crossterm 0.29 reads a closed terminal for ever (`try_read` in its event/source/unix/mio.rs goes on at the end of the file).
        while !is_closed()? {
            if !event::poll(Duration::ZERO)? {
                return Ok(keys);
            }
            if let Event::Key(key) = event::read()? {
                keys.extend(meaning(key));
            }
        }
        keys.push(Key::Quit);
        Ok(keys)
    }
}

/// Whether the terminal's other end is gone: a window that was closed, a connection that broke.
#[cfg(target_os = "linux")]
fn is_closed() -> Result<bool, io::Error> {
    let output = io::stdout();
    // A hang-up is reported whether asked for or not.
    let mut terminal = [PollFd::new(output.as_fd(), PollFlags::empty())];
    poll(&mut terminal, PollTimeout::ZERO)?;
    Ok(terminal[0].any().unwrap_or(true))
}

#[cfg(not(target_os = "linux"))]
fn is_closed() -> Result<bool, io::Error> {
    Ok(false)
}

impl Screen {
    /// Gives the keyboard back when the terminal takes nothing that is written to it.
    pub(crate) fn abandon() {
        if TAKEN.swap(false, Ordering::SeqCst) {
            let _ = disable_raw_mode();
        }
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        give_back();
    }
}

/// Once however often it is called. Failures are of no use to anyone here: there is no other screen to tell them on.
fn give_back() {
    if TAKEN.swap(false, Ordering::SeqCst) {
        let mut output = io::stdout();
        let _ = execute!(output, EndSynchronizedUpdate, LeaveAlternateScreen, Show);
        let _ = disable_raw_mode();
        let _ = output.flush();
    }
}

fn meaning(key: KeyEvent) -> Option<Key> {
    if key.kind == KeyEventKind::Release {
        return None;
    }
    match (key.code, key.modifiers.contains(KeyModifiers::CONTROL)) {
        (KeyCode::Esc, _) | (KeyCode::Char('q'), false) | (KeyCode::Char('c'), true) => Some(Key::Quit),
        // A key that is held down repeats: that is nobody who looks.
        _ if key.kind != KeyEventKind::Press => None,
        (KeyCode::Char('h'), false) => Some(Key::Hold),
        (KeyCode::Char('r'), false) => Some(Key::Release),
        (KeyCode::Char('a'), false) => Some(Key::Acknowledge),
        (KeyCode::Char('z'), false) => Some(Key::Rezero),
        (KeyCode::Char('+'), false) => Some(Key::RaiseFloor),
        (KeyCode::Char('-'), false) => Some(Key::LowerFloor),
        (KeyCode::Char('t'), false) => Some(Key::TakeOver),
        (KeyCode::Char('y'), false) => Some(Key::Yield),
        _ => None,
    }
}

/// By the convention that terminals with 24-bit colour follow.
fn knows_true_colour(colorterm: Option<&str>) -> bool {
    matches!(colorterm, Some("truecolor" | "24bit"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_documented_keys_quit_or_ask_and_only_when_they_are_pressed() {
        let key = |code, modifiers| meaning(KeyEvent::new(code, modifiers)) == Some(Key::Quit);
        assert!(key(KeyCode::Char('q'), KeyModifiers::NONE));
        assert!(key(KeyCode::Esc, KeyModifiers::NONE));
        assert!(key(KeyCode::Char('c'), KeyModifiers::CONTROL));
        assert!(!key(KeyCode::Char('c'), KeyModifiers::NONE));
        assert!(!key(KeyCode::Char('q'), KeyModifiers::CONTROL));
        assert!(!key(KeyCode::Enter, KeyModifiers::NONE));
        let release = KeyEvent::new_with_kind(KeyCode::Char('q'), KeyModifiers::NONE, KeyEventKind::Release);
        assert_eq!(meaning(release), None);
        for (letter, expected) in [
            ('h', Key::Hold),
            ('r', Key::Release),
            ('a', Key::Acknowledge),
            ('z', Key::Rezero),
            ('+', Key::RaiseFloor),
            ('-', Key::LowerFloor),
            ('t', Key::TakeOver),
            ('y', Key::Yield),
        ] {
            let it =
                |modifiers, kind| meaning(KeyEvent::new_with_kind(KeyCode::Char(letter), modifiers, kind));
            assert_eq!(it(KeyModifiers::NONE, KeyEventKind::Press), Some(expected));
            assert_eq!(it(KeyModifiers::NONE, KeyEventKind::Repeat), None);
            assert_eq!(it(KeyModifiers::CONTROL, KeyEventKind::Press), None);
        }
    }

    #[test]
    fn true_colour_is_used_only_where_the_terminal_says_so() {
        assert!(knows_true_colour(Some("truecolor")));
        assert!(knows_true_colour(Some("24bit")));
        assert!(!knows_true_colour(Some("")));
        assert!(!knows_true_colour(None));
    }
}

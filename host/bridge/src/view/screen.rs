//! The terminal: raw mode, alternate screen, keys. Nothing here knows what is drawn.
//!
//! The terminal is given back on drop and before a panic's message is printed, whichever thread panics. A signal that
//! kills the process outright leaves it as it is (`reset` brings it back).

use std::io::{self, BufWriter, IsTerminal, Stdout, Write};
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
use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;

use super::{View, colour};

/// A whole frame goes to the terminal in one write.
const FRAME_BYTES: usize = 1 << 16;

/// Whether the terminal is ours; the panic hook and the drop may both want to give it back.
static TAKEN: AtomicBool = AtomicBool::new(false);
static PANIC_HOOK: Once = Once::new();

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

    /// Whether q, Esc or Ctrl-C was pressed since the last call. Never waits.
    ///
    /// # Errors
    /// Reading the keys failed.
    pub fn quit_requested(&mut self) -> Result<bool, io::Error> {
        let mut quit = false;
        while event::poll(Duration::ZERO)? {
            if let Event::Key(key) = event::read()? {
                quit |= quits(key);
            }
        }
        Ok(quit)
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

fn quits(key: KeyEvent) -> bool {
    let control = key.modifiers.contains(KeyModifiers::CONTROL);
    key.kind != KeyEventKind::Release
        && match key.code {
            KeyCode::Esc => true,
            KeyCode::Char('q') => !control,
            KeyCode::Char('c') => control,
            _ => false,
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
    fn only_the_documented_keys_quit() {
        let key = |code, modifiers| quits(KeyEvent::new(code, modifiers));
        assert!(key(KeyCode::Char('q'), KeyModifiers::NONE));
        assert!(key(KeyCode::Esc, KeyModifiers::NONE));
        assert!(key(KeyCode::Char('c'), KeyModifiers::CONTROL));
        assert!(!key(KeyCode::Char('c'), KeyModifiers::NONE));
        assert!(!key(KeyCode::Char('q'), KeyModifiers::CONTROL));
        assert!(!key(KeyCode::Enter, KeyModifiers::NONE));
        let release = KeyEvent::new_with_kind(KeyCode::Char('q'), KeyModifiers::NONE, KeyEventKind::Release);
        assert!(!quits(release));
    }

    #[test]
    fn true_colour_is_used_only_where_the_terminal_says_so() {
        assert!(knows_true_colour(Some("truecolor")));
        assert!(knows_true_colour(Some("24bit")));
        assert!(!knows_true_colour(Some("")));
        assert!(!knows_true_colour(None));
    }
}

//! A question with its choices: its screen, and the meaning of an answer. Pure.

use std::fmt::Write as _;

use crate::commands::calibrate::wrapped;

/// Maximum letters of a value before its explanation goes on a separate line.
const VALUE_WIDTH: usize = 28;

/// One way to answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Choice {
    /// The value for the flag.
    pub value: String,
    /// For people.
    pub what: String,
}

impl Choice {
    pub(super) fn new(value: impl Into<String>, what: impl Into<String>) -> Self {
        Self {
            value: value.into(),
            what: what.into(),
        }
    }
}

/// The question.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Question {
    pub number: usize,
    /// Its name in flags and errors, such as `--camera`.
    pub flag: &'static str,
    pub text: &'static str,
    pub choices: Vec<Choice>,
    /// Other input that is allowed.
    pub other: &'static str,
    /// The default choice; else why there is none: what was found, and what to do.
    pub default: Result<usize, String>,
}

/// What an answer means.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Answer {
    /// A value for the flag, not yet checked.
    Value(String),
    /// Look for hardware again.
    LookAgain,
}

impl Question {
    /// The screen: question, choices, and what can be typed.
    pub(super) fn screen(&self) -> String {
        let mut screen = format!("\n{}. {}\n", self.number, self.text);
        if let Err(why) = &self.default {
            let _ = writeln!(screen, "   {}", wrapped(why));
        }
        for (number, Choice { value, what }) in (1..).zip(&self.choices) {
            let _ = if value.chars().count() > VALUE_WIDTH {
                writeln!(screen, "   {number}  {value}\n      {:VALUE_WIDTH$} {what}", "")
            } else {
                writeln!(screen, "   {number}  {value:VALUE_WIDTH$} {what}")
            };
        }
        let enter = match &self.default {
            Ok(default) => format!("Enter for {}", default + 1),
            Err(_) => "Enter to look again".to_owned(),
        };
        let _ = write!(screen, "   A number{}, {enter}: ", self.other);
        screen
    }

    /// What was typed.
    ///
    /// # Errors
    /// What was found and what was expected.
    pub(super) fn answer(&self, typed: &str) -> Result<Answer, String> {
        let typed = typed.trim();
        if typed.is_empty() {
            return Ok(self.default.as_ref().map_or(Answer::LookAgain, |default| {
                Answer::Value(self.choices[*default].value.clone())
            }));
        }
        let Ok(number) = typed.parse::<usize>() else {
            return Ok(Answer::Value(typed.to_owned()));
        };
        let chosen = number.checked_sub(1).and_then(|place| self.choices.get(place));
        chosen
            .map(|choice| Answer::Value(choice.value.clone()))
            .ok_or_else(|| match self.choices.len() {
                1 => format!("found {number}, expected 1"),
                last => format!("found {number}, expected 1 to {last}"),
            })
    }

    /// The answer without a person to ask.
    ///
    /// # Errors
    /// What was found, expected, and which flag says it.
    pub(super) fn unasked(&self, takes_defaults: bool) -> Result<String, String> {
        let flag = self.flag;
        match &self.default {
            Ok(default) if takes_defaults => Ok(self.choices[*default].value.clone()),
            Ok(default) => Err(format!(
                "{flag}: found no answer and no terminal to ask at, expected {flag}, or --yes for {}",
                self.choices[*default].value
            )),
            Err(why) => Err(format!("{flag}: {why} Or say it with {flag}.")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(default: Result<usize, String>) -> Question {
        Question {
            number: 2,
            flag: "--camera",
            text: "Which camera?",
            choices: vec![
                Choice::new("/dev/v4l/by-id/usb-a-video-index0", "A webcam"),
                Choice::new("sim", "none"),
            ],
            other: ", or another source",
            default,
        }
    }

    #[test]
    fn a_number_a_value_and_enter_are_answers_and_a_number_of_no_choice_is_none() {
        let value = |text: &str| Ok(Answer::Value(text.to_owned()));
        let question = camera(Ok(0));
        assert_eq!(question.answer(" 2\n"), value("sim"));
        assert_eq!(question.answer("dir:rest"), value("dir:rest"));
        assert_eq!(question.answer("\n"), value("/dev/v4l/by-id/usb-a-video-index0"));
        assert_eq!(question.answer("3"), Err("found 3, expected 1 to 2".to_owned()));
        assert_eq!(question.answer("0"), Err("found 0, expected 1 to 2".to_owned()));
        assert_eq!(camera(Err("None.".to_owned())).answer(""), Ok(Answer::LookAgain));
    }

    #[test]
    fn nobody_is_asked_without_a_terminal_and_the_error_names_the_flag() {
        assert_eq!(camera(Ok(1)).unasked(true), Ok("sim".to_owned()));
        let error = camera(Ok(1)).unasked(false).unwrap_err();
        assert!(error.contains("expected --camera, or --yes for sim"), "{error}");
        let error = camera(Err("Found no camera: plug one in.".to_owned())).unasked(true);
        assert_eq!(
            error.unwrap_err(),
            "--camera: Found no camera: plug one in. Or say it with --camera."
        );
    }
}

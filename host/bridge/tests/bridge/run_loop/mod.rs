//! The loop of `gripline run` in virtual time, without the program around it: real code, no waiting.

mod late;
mod random_faults;
mod two_fingertips;

//! Every test that crosses crates, in one binary.

mod board;
mod emulated_board;
mod fuzz_corpus;
mod hardware;
mod quantisation;
mod random_faults;
mod safety;
mod safety_table;
mod tracking;
mod world_and_network;

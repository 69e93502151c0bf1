//! What the tests of the lines share.

pub(crate) mod bus;

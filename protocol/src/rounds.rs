//! Loops that say how often they run at most, where they stand. `cargo xtask latency` reads it from the debug information of the image, multiplies
//! with it, and counts the rounds of every run on the emulated board: more rounds than a loop says fail the check.
//!
//! Costs nothing: the wrapper does not count.

/// An iterator of at most `MOST` items.
#[derive(Debug, Clone)]
pub struct AtMost<const MOST: usize, I>(I);

/// Says that an iterator has at most `MOST` items.
#[expect(clippy::inline_always, reason = "the loop itself must carry the number")]
#[inline(always)]
pub fn at_most<const MOST: usize, I: IntoIterator>(items: I) -> AtMost<MOST, I::IntoIter> {
    AtMost(items.into_iter())
}

impl<const MOST: usize, I: Iterator> Iterator for AtMost<MOST, I> {
    type Item = I::Item;

    #[expect(clippy::inline_always, reason = "the loop itself must carry the number")]
    #[inline(always)]
    fn next(&mut self) -> Option<I::Item> {
        next_of_at_most::<MOST, I>(&mut self.0)
    }
}

/// By the name of this function and its first parameter the check finds the loop.
#[expect(clippy::inline_always, reason = "the loop itself must carry the number")]
#[inline(always)]
fn next_of_at_most<const MOST: usize, I: Iterator>(items: &mut I) -> Option<I::Item> {
    items.next()
}

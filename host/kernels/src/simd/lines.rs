//! Numbers that begin at a cache line: no vector of them, read in order, lies in two lines, which would take twice the time.

/// Bytes of a line; a vector has as many or fewer.
const LINE: usize = 64;
const NUMBERS: usize = LINE / 4;

/// A list of numbers of four bytes that begins at a cache line.
#[derive(Debug, Clone)]
pub struct Lines<T> {
    lines: Vec<Line<T>>,
    count: usize,
}

#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct Line<T>([T; NUMBERS]);

impl<T: Copy + Default> Lines<T> {
    const NO_PADDING: () = assert!(size_of::<T>() * NUMBERS == LINE && align_of::<Line<T>>() == LINE);

    /// A copy of these.
    pub fn new(numbers: &[T]) -> Self {
        let () = Self::NO_PADDING;
        let line = |numbers: &[T]| {
            let mut line = [T::default(); NUMBERS];
            line[..numbers.len()].copy_from_slice(numbers);
            Line(line)
        };
        Self {
            lines: numbers.chunks(NUMBERS).map(line).collect(),
            count: numbers.len(),
        }
    }

    /// The numbers.
    #[must_use]
    pub fn numbers(&self) -> &[T] {
        // SAFETY: lines have no padding, see above, so their numbers follow each other, and there are at least `count`.
        unsafe { std::slice::from_raw_parts(self.lines.as_ptr().cast(), self.count) }
    }
}

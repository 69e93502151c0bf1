//! Numbers that begin at a cache line: no vector of them, read in order, lies in two lines, which would take twice the time.

/// Bytes of a line; a vector has as many or fewer.
const LINE: usize = 64;
const NUMBERS: usize = LINE / 4;

/// A list of numbers of four bytes that begins at a cache line.
#[derive(Debug, Clone)]
pub(crate) struct Lines<T> {
    lines: Vec<Line<T>>,
    count: usize,
}

#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct Line<T>([T; NUMBERS]);

impl<T: Copy + Default> Lines<T> {
    const NO_PADDING: () = assert!(size_of::<T>() * NUMBERS == LINE && align_of::<Line<T>>() == LINE);

    pub(crate) fn new(numbers: &[T]) -> Self {
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

    pub(crate) fn numbers(&self) -> &[T] {
        // SAFETY: lines have no padding, see above, so their numbers follow each other, and there are at least `count`.
        unsafe { std::slice::from_raw_parts(self.lines.as_ptr().cast(), self.count) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_numbers_are_those_that_went_in_and_begin_at_a_line_in_a_copy_too() {
        for count in [0, 1, 15, 16, 17, 100] {
            let numbers: Vec<f32> = (0..count).map(|number| number as f32).collect();
            let lines = Lines::new(&numbers);
            for lines in [&lines, &lines.clone()] {
                assert_eq!(lines.numbers(), numbers);
                assert_eq!(lines.numbers().as_ptr().addr() % LINE, 0);
            }
        }
    }
}

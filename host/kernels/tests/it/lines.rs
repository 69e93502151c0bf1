//! Numbers that begin at a cache line.

use gripline_kernels::simd::Lines;

/// Bytes of a cache line.
const LINE: usize = 64;

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

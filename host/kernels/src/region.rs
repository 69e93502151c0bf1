//! A rectangle of pixels: the part of an image that changed.

use std::ops::Range;

/// Rows and columns; empty when either is.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Region {
    /// The rows.
    pub rows: Range<usize>,
    /// The columns.
    pub columns: Range<usize>,
}

impl Region {
    /// No pixels.
    pub const EMPTY: Self = Self {
        rows: 0..0,
        columns: 0..0,
    };

    /// All pixels of an image.
    #[must_use]
    pub fn whole(height: usize, width: usize) -> Self {
        Self {
            rows: 0..height,
            columns: 0..width,
        }
    }

    /// Whether it has no pixel.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty() || self.columns.is_empty()
    }

    /// The smallest rectangle around both.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        if self.is_empty() {
            return other.clone();
        }
        if other.is_empty() {
            return self.clone();
        }
        let union = |a: &Range<usize>, b: &Range<usize>| a.start.min(b.start)..a.end.max(b.end);
        Self {
            rows: union(&self.rows, &other.rows),
            columns: union(&self.columns, &other.columns),
        }
    }

    /// Maps both sides' first and last pixel through `along`, cut to an image's size.
    #[must_use]
    pub fn mapped(
        &self,
        (height, width): (usize, usize),
        along: impl Fn(usize, usize) -> (usize, usize),
    ) -> Self {
        if self.is_empty() {
            return Self::EMPTY;
        }
        let side = |range: &Range<usize>, size: usize| {
            let (first, last) = along(range.start, range.end - 1);
            first.min(size)..(last + 1).min(size)
        };
        Self {
            rows: side(&self.rows, height),
            columns: side(&self.columns, width),
        }
    }
}

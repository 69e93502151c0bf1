//! A rectangle of pixels: the part of an image that changed.

use std::ops::Range;

/// Rows and columns; empty when either is.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Region {
    pub(crate) rows: Range<usize>,
    pub(crate) columns: Range<usize>,
}

impl Region {
    pub(crate) const EMPTY: Self = Self {
        rows: 0..0,
        columns: 0..0,
    };

    pub(crate) fn whole(height: usize, width: usize) -> Self {
        Self {
            rows: 0..height,
            columns: 0..width,
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rows.is_empty() || self.columns.is_empty()
    }

    /// The smallest rectangle around both.
    pub(crate) fn union(&self, other: &Self) -> Self {
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
    pub(crate) fn mapped(
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

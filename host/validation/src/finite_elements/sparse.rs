//! The stiffness of the free nodes as a sparse matrix of fixed pattern, solved by faer's Cholesky on one thread
//! (same bits every time). What depends on the pattern alone is worked out once: the order, by halving the block
//! again and again (nested dissection), and the fill. Units: N/mm. Limits: symmetric, positive definite.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side, Spec};

use super::element::FREEDOMS;
use super::mesh::Mesh;

/// Upper triangle, column by column.
#[derive(Debug)]
pub(super) struct Sparse {
    /// Row of the matrix that belongs to each of a node's three directions; none where it is held.
    free: Vec<[Option<usize>; 3]>,
    size: usize,
    starts: Vec<usize>,
    rows: Vec<usize>,
    values: Vec<f64>,
    symbolic: Option<SymbolicCholesky<usize>>,
    factor: Vec<f64>,
}

impl Sparse {
    /// The pattern of `mesh`; `held` says which direction of which node cannot move.
    pub(super) fn new(mesh: &Mesh, held: impl Fn(usize, usize) -> bool) -> Self {
        let mut size = 0;
        let mut free = vec![[None; 3]; mesh.nodes.len()];
        for node in mesh.dissection() {
            for (axis, row) in free[node].iter_mut().enumerate() {
                if !held(node, axis) {
                    *row = Some(size);
                    size += 1;
                }
            }
        }
        let mut columns = vec![Vec::new(); size];
        for element in &mesh.elements {
            let freedoms = || element.iter().flat_map(|node| free[*node]).flatten();
            for column in freedoms() {
                columns[column].extend(freedoms().filter(|row| *row <= column));
            }
        }
        let mut starts = vec![0];
        let mut rows = Vec::new();
        for mut column in columns {
            column.sort_unstable();
            column.dedup();
            rows.append(&mut column);
            starts.push(rows.len());
        }
        let values = vec![0.0; rows.len()];
        let pattern = SymbolicSparseColMatRef::new_checked(size, size, &starts, None, &rows);
        let symbolic = factorize_symbolic_cholesky(
            pattern,
            Side::Upper,
            SymmetricOrdering::Identity,
            CholeskySymbolicParams::default(),
        )
        .ok();
        let factor = vec![0.0; symbolic.as_ref().map_or(0, SymbolicCholesky::len_val)];
        Self {
            free,
            size,
            starts,
            rows,
            values,
            symbolic,
            factor,
        }
    }

    /// Rows of the matrix.
    pub(super) fn size(&self) -> usize {
        self.size
    }

    /// The row of a node's direction.
    pub(super) fn row(&self, node: usize, axis: usize) -> Option<usize> {
        self.free[node][axis]
    }

    pub(super) fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Adds an element's stiffness.
    pub(super) fn add_element(&mut self, nodes: &[usize; 8], stiffness: &[[f64; FREEDOMS]; FREEDOMS]) {
        let rows = nodes.map(|node| self.free[node]);
        for (i, values) in stiffness.iter().enumerate() {
            for (k, value) in values.iter().enumerate() {
                if let (Some(row), Some(column)) = (rows[i / 3][i % 3], rows[k / 3][k % 3]) {
                    self.add(row, column, *value);
                }
            }
        }
    }

    /// Adds a spring between a node and the ground.
    pub(super) fn add_node(&mut self, node: usize, stiffness: &[[f64; 3]; 3]) {
        for (i, values) in stiffness.iter().enumerate() {
            for (k, value) in values.iter().enumerate() {
                if let (Some(column), Some(row)) = (self.free[node][k], self.free[node][i]) {
                    self.add(row, column, *value);
                }
            }
        }
    }

    /// Adds to an entry, if it is in the upper triangle.
    fn add(&mut self, row: usize, column: usize, value: f64) {
        let range = self.starts[column]..self.starts[column + 1];
        if row <= column
            && let Ok(place) = self.rows[range.clone()].binary_search(&row)
        {
            self.values[range.start + place] += value;
        }
    }

    /// Replaces `right` by the solution; false if the matrix is not positive definite.
    pub(super) fn solve(&mut self, right: &mut [f64]) -> bool {
        let Some(symbolic) = &self.symbolic else {
            return false;
        };
        let pattern =
            SymbolicSparseColMatRef::new_checked(self.size, self.size, &self.starts, None, &self.rows);
        let scratch = symbolic
            .factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default())
            .or(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq));
        let mut memory = MemBuffer::new(scratch);
        let factored = symbolic.factorize_numeric_llt(
            &mut self.factor,
            SparseColMatRef::new(pattern, self.values.as_slice()),
            Side::Upper,
            LltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Spec::default(),
        );
        if factored.is_err() {
            return false;
        }
        LltRef::<'_, usize, f64>::new(symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(right, self.size, 1),
            Par::Seq,
            MemStack::new(&mut memory),
        );
        true
    }
}

//! Sparse symmetric systems of 3 × 3 blocks: minimum degree, then L D Lᵀ.

use std::collections::BTreeSet;

use crate::matrix::{self, Matrix, Vector, ZERO};

/// Which blocks there are, in which order they are eliminated, and what fills in.
#[derive(Debug, Clone)]
pub struct Structure {
    /// Of each variable, when it is eliminated.
    rank: Vec<u32>,
    /// Of each rank, the variable.
    order: Vec<u32>,
    /// Of each rank: where its row begins in `columns`, and where the last ends.
    starts: Vec<u32>,
    /// Ranks of the blocks right of the diagonal, row by row, ascending.
    columns: Vec<u32>,
}

/// Where a block lies, for filling in without a search.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    index: u32,
    /// Whether the block is stored the other way round.
    transposed: bool,
}

impl Structure {
    /// The structure of `count` variables of which these pairs meet.
    ///
    /// The last variable, if `last_meets_all`, is eliminated last and meets everybody.
    #[must_use]
    pub fn new(count: usize, pairs: impl IntoIterator<Item = (usize, usize)>, last_meets_all: bool) -> Self {
        let free = count - usize::from(last_meets_all);
        let mut near: Vec<Vec<u32>> = vec![Vec::new(); free];
        for (a, b) in pairs {
            if a != b && a < free && b < free {
                near[a].push(b as u32);
                near[b].push(a as u32);
            }
        }
        for list in &mut near {
            list.sort_unstable();
            list.dedup();
        }
        let mut queue: BTreeSet<(u32, u32)> = near.iter().zip(0u32..).map(|(list, i)| (list.len() as u32, i)).collect();
        let mut rank = vec![0u32; count];
        let mut order = Vec::with_capacity(count);
        let mut merged = Vec::new();
        while let Some((_, pivot)) = queue.pop_first() {
            rank[pivot as usize] = order.len() as u32;
            order.push(pivot);
            let row = near[pivot as usize].clone();
            for &other in &row {
                queue.remove(&(near[other as usize].len() as u32, other));
                union_without(&near[other as usize], &row, [pivot, other], &mut merged);
                std::mem::swap(&mut near[other as usize], &mut merged);
                queue.insert((near[other as usize].len() as u32, other));
            }
        }
        if last_meets_all {
            rank[free] = order.len() as u32;
            order.push(free as u32);
        }
        let mut starts = vec![0u32];
        let mut columns = Vec::new();
        for variable in &order {
            let from = columns.len();
            if (*variable as usize) < free {
                columns.extend(near[*variable as usize].iter().map(|other| rank[*other as usize]));
                columns[from..].sort_unstable();
                if last_meets_all {
                    columns.push(rank[free]);
                }
            }
            starts.push(columns.len() as u32);
        }
        Self { rank, order, starts, columns }
    }

    /// Where the block of two different variables lies; None where they don't meet.
    #[must_use]
    pub fn place(&self, row: usize, column: usize) -> Option<Place> {
        let (a, b) = (self.rank[row], self.rank[column]);
        let (upper, lower) = (a.min(b), a.max(b));
        let (start, end) = self.row(upper as usize);
        let within = self.columns[start..end].binary_search(&lower).ok()?;
        Some(Place { index: (start + within) as u32, transposed: a > b })
    }

    fn row(&self, rank: usize) -> (usize, usize) {
        (self.starts[rank] as usize, self.starts[rank + 1] as usize)
    }

    /// A system of this structure, all zero.
    #[must_use]
    pub fn system(&self) -> System<'_> {
        let diagonal = vec![ZERO; self.order.len()];
        System { structure: self, diagonal, blocks: vec![ZERO; self.columns.len()] }
    }
}

/// The sorted union of two sorted lists, without these two.
fn union_without(a: &[u32], b: &[u32], without: [u32; 2], union: &mut Vec<u32>) {
    union.clear();
    let (mut i, mut j) = (0, 0);
    while i < a.len() || j < b.len() {
        let next = match (a.get(i), b.get(j)) {
            (Some(x), Some(y)) => *x.min(y),
            (Some(x), None) | (None, Some(x)) => *x,
            (None, None) => break,
        };
        i += usize::from(a.get(i) == Some(&next));
        j += usize::from(b.get(j) == Some(&next));
        if !without.contains(&next) {
            union.push(next);
        }
    }
}

/// A symmetric matrix, by its upper blocks.
#[derive(Debug, Clone)]
pub struct System<'a> {
    structure: &'a Structure,
    /// By rank.
    diagonal: Vec<Matrix>,
    blocks: Vec<Matrix>,
}

impl<'a> System<'a> {
    /// Adds to the diagonal block of a variable.
    pub fn add_diagonal(&mut self, variable: usize, block: &Matrix) {
        matrix::add(&mut self.diagonal[self.structure.rank[variable] as usize], block);
    }

    /// Adds to the block of two variables.
    pub fn add(&mut self, place: Place, block: &Matrix) {
        let target = &mut self.blocks[place.index as usize];
        if place.transposed { matrix::add(target, &matrix::transpose(block)) } else { matrix::add(target, block) }
    }

    /// Factors the system into L D Lᵀ.
    #[must_use]
    pub fn factor(self) -> Factors<'a> {
        let Self { structure, mut diagonal, mut blocks } = self;
        let count = diagonal.len();
        let mut inverses = Vec::with_capacity(count);
        // Of the row that is filled in: where each of its columns lies.
        let mut places = vec![0u32; count];
        for pivot in 0..count {
            let inverse = matrix::symmetric(&matrix::inverse(&diagonal[pivot]));
            inverses.push(inverse);
            let (start, end) = structure.row(pivot);
            for a in start..end {
                let target = structure.columns[a] as usize;
                let scaled = matrix::transposed_product(&blocks[a], &inverse);
                let (row_start, row_end) = structure.row(target);
                for index in row_start..row_end {
                    places[structure.columns[index] as usize] = index as u32;
                }
                subtract_product(&mut diagonal[target], &scaled, &blocks[a]);
                let (done, rest) = blocks.split_at_mut(end);
                for b in a + 1..end {
                    // A row that is eliminated later lies behind this one.
                    let place = places[structure.columns[b] as usize] as usize;
                    subtract_product(&mut rest[place - end], &scaled, &done[b]);
                }
            }
        }
        Factors { structure, inverses, blocks }
    }
}

/// C ← C − A B.
fn subtract_product(c: &mut Matrix, a: &Matrix, b: &Matrix) {
    for row in 0..3 {
        for column in 0..3 {
            c[row][column] -= a[row][0] * b[0][column] + a[row][1] * b[1][column] + a[row][2] * b[2][column];
        }
    }
}

/// What solves a system for any right-hand side.
#[derive(Debug, Clone)]
pub struct Factors<'a> {
    structure: &'a Structure,
    inverses: Vec<Matrix>,
    blocks: Vec<Matrix>,
}

impl Factors<'_> {
    /// x of A x = b, by variables.
    #[must_use]
    pub fn solve(&self, right: &[Vector]) -> Vec<Vector> {
        let structure = self.structure;
        let mut b: Vec<Vector> = structure.order.iter().map(|variable| right[*variable as usize]).collect();
        for pivot in 0..b.len() {
            let scaled = matrix::apply(&self.inverses[pivot], &b[pivot]);
            let (start, end) = structure.row(pivot);
            for index in start..end {
                let off = matrix::apply_transposed(&self.blocks[index], &scaled);
                let target = &mut b[structure.columns[index] as usize];
                for row in 0..3 {
                    target[row] -= off[row];
                }
            }
        }
        for pivot in (0..b.len()).rev() {
            let mut value = b[pivot];
            let (start, end) = structure.row(pivot);
            for index in start..end {
                let off = matrix::apply(&self.blocks[index], &b[structure.columns[index] as usize]);
                for row in 0..3 {
                    value[row] -= off[row];
                }
            }
            b[pivot] = matrix::apply(&self.inverses[pivot], &value);
        }
        let mut x = vec![[0.0; 3]; b.len()];
        for (variable, value) in structure.order.iter().zip(b) {
            x[*variable as usize] = value;
        }
        x
    }

    /// The three columns of A⁻¹ of a variable.
    #[must_use]
    pub fn columns(&self, variable: usize) -> [Vec<Vector>; 3] {
        [0, 1, 2].map(|column| {
            let mut right = vec![[0.0; 3]; self.structure.order.len()];
            right[variable][column] = 1.0;
            self.solve(&right)
        })
    }

    /// The diagonal block of A⁻¹ of a variable: its covariance, where A is the information.
    #[must_use]
    pub fn covariance(&self, variable: usize) -> Matrix {
        let columns = [0, 1, 2].map(|column| {
            let mut right = vec![[0.0; 3]; self.structure.order.len()];
            right[variable][column] = 1.0;
            self.solve(&right)[variable]
        });
        matrix::symmetric(&columns)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const COUNT: usize = 9;

    proptest! {
        /// Any system that is positive definite, by nalgebra's dense Cholesky.
        #[test]
        fn it_solves_what_a_dense_solver_solves(
            pairs in prop::collection::vec((0..COUNT, 0..COUNT), 0..24),
            values in prop::collection::vec(-1.0..1.0f64, 9 * 33),
            right in prop::collection::vec(-1.0..1.0f64, 3 * COUNT),
            last_meets_all: bool,
        ) {
            let structure = Structure::new(COUNT, pairs.iter().copied(), last_meets_all);
            let mut system = structure.system();
            let mut dense = nalgebra::DMatrix::<f64>::zeros(3 * COUNT, 3 * COUNT);
            let mut put = |row: usize, column: usize, block: &Matrix| {
                for r in 0..3 {
                    for c in 0..3 {
                        dense[(3 * row + r, 3 * column + c)] += block[r][c];
                        if row != column {
                            dense[(3 * column + c, 3 * row + r)] += block[r][c];
                        }
                    }
                }
            };
            for variable in 0..COUNT {
                let block = matrix::diagonal([40.0, 50.0, 60.0]);
                system.add_diagonal(variable, &block);
                put(variable, variable, &block);
            }
            for ((a, b), block) in pairs.iter().zip(values.chunks(9)).filter(|((a, b), _)| a != b) {
                let block = [[block[0], block[1], block[2]], [block[3], block[4], block[5]], [block[6], block[7], block[8]]];
                let Some(place) = structure.place(*a, *b) else { panic!("{a} and {b} do not meet") };
                system.add(place, &block);
                put(*a, *b, &block);
            }
            let b: Vec<Vector> = right.chunks(3).map(|v| [v[0], v[1], v[2]]).collect();
            let factors = system.factor();
            let x = factors.solve(&b);
            let oracle = dense.clone().cholesky().unwrap();
            let expected = oracle.solve(&nalgebra::DVector::from_vec(right));
            for (got, expected) in x.iter().flatten().zip(expected.iter()) {
                prop_assert!((got - expected).abs() < 1e-9);
            }
            let inverse = oracle.inverse();
            let covariance = factors.covariance(4);
            for r in 0..3 {
                for c in 0..3 {
                    prop_assert!((covariance[r][c] - inverse[(12 + r, 12 + c)]).abs() < 1e-9);
                }
            }
        }
    }
}

//! Elimination of 2×2 blocks from both ends of the band at once, in two SIMD lanes, without pivoting between blocks.

use wide::f64x2;

use super::{BandMatrix, BlockRow, LinearSolver, Number, Pair, Real};
use crate::error::Result;

/// LU by 2×2 blocks, without pivoting between them: the fastest for the Jacobian of a rod, but inaccurate for some other matrices,
/// so solutions have to be checked ([`BandMatrix::backward_error`]).
///
/// Row k reads E xₖ₋₂ + C xₖ₋₁ + D xₖ + F xₖ₊₁ + G xₖ₊₂ = b. With the two rows before it in the form
/// xⱼ = b̂ⱼ − F̂ⱼ xⱼ₊₁ − Ĝⱼ xⱼ₊₂ it becomes, in this order,
///
/// - C' = C − E F̂ₖ₋₂, D' = D − E Ĝₖ₋₂ − C' F̂ₖ₋₁, F' = F − C' Ĝₖ₋₁, b' = b − E b̂ₖ₋₂ − C' b̂ₖ₋₁,
/// - F̂ = D'⁻¹ F', Ĝ = D'⁻¹ G, b̂ = D'⁻¹ b',
///
/// where D'⁻¹ is applied by the LU factors of D'; its inverse is never formed, which would not be backward stable. The last rows
/// are eliminated likewise from the other end, up to two or three rows in the middle. The two eliminations are independent until
/// then, so they run in two SIMD lanes (twisted factorisation: van der Vorst, Parallel Computing 5, 1987).
///
/// [`factor_and_solve`](LinearSolver::factor_and_solve) stores only what the solve needs and passes through memory once; it leaves
/// no factors for further solves.
#[derive(Debug)]
pub struct BlockBand<T: Real = f64> {
    /// E, C' and D' of pairs of rows, first and last, second and last but one, …; empty until factors are requested. The first of a
    /// pair counts from the first row forwards, the second from the last row backwards.
    lower: Vec<Lower<T::Pair>>,
    /// F̂ and Ĝ of the same rows.
    upper: Vec<Upper<T::Pair>>,
    middle: Middle<T>,
    factored: bool,
}

/// [a₀₀, a₀₁, a₁₀, a₁₁].
type RowMajorBlock<T> = [T; 4];

/// c − A x. The product that becomes available last, with x₀, is subtracted last.
#[inline(always)]
fn less<T: Number>(c: [T; 2], a: RowMajorBlock<T>, x: [T; 2]) -> [T; 2] {
    [(c[0] - a[1] * x[1]) - a[0] * x[0], (c[1] - a[3] * x[1]) - a[2] * x[0]]
}

/// C − A B.
#[inline(always)]
fn less_product<T: Number>(c: RowMajorBlock<T>, a: RowMajorBlock<T>, b: RowMajorBlock<T>) -> RowMajorBlock<T> {
    let [c00, c10] = less([c[0], c[2]], a, [b[0], b[2]]);
    let [c01, c11] = less([c[1], c[3]], a, [b[1], b[3]]);
    [c00, c01, c10, c11]
}

/// The transpose of a block.
#[inline(always)]
fn transpose<T: Number>([a, b, c, d]: RowMajorBlock<T>) -> RowMajorBlock<T> {
    [a, c, b, d]
}

/// Factors of a diagonal block: D' = [d₀₀ 0; d₁₀ u₁₁] [1 w; 0 1] with w = d₀₁/d₀₀ and u₁₁ = det D'/d₀₀.
#[derive(Debug, Clone, Copy)]
struct Pivot<T> {
    /// 1/d₀₀.
    first: T,
    /// d₁₀.
    below: T,
    /// w.
    beside: T,
    /// 1/u₁₁.
    second: T,
}

impl<T: Number> Pivot<T> {
    /// The two divisions are independent: u₁₁ is not d₁₁ − d₁₀ w, which has the same rounding error.
    #[inline(always)]
    fn new([d00, d01, d10, d11]: RowMajorBlock<T>) -> Self {
        let first = d00.like(1.0) / d00;
        Self { first, below: d10, beside: d01 * first, second: d00 / (d00 * d11 - d01 * d10) }
    }

    /// D'⁻¹ b.
    #[inline(always)]
    fn solve(&self, b: [T; 2]) -> [T; 2] {
        let y = b[0] * self.first;
        let x = (b[1] - self.below * y) * self.second;
        [y - self.beside * x, x]
    }

    /// D'⁻¹ B.
    #[inline(always)]
    fn solve_block(&self, b: RowMajorBlock<T>) -> RowMajorBlock<T> {
        let ([x00, x10], [x01, x11]) = (self.solve([b[0], b[2]]), self.solve([b[1], b[3]]));
        [x00, x01, x10, x11]
    }

    /// D'⁻ᵀ b.
    #[inline(always)]
    fn solve_transposed(&self, b: [T; 2]) -> [T; 2] {
        let x = (b[1] - self.beside * b[0]) * self.second;
        [(b[0] - self.below * x) * self.first, x]
    }
}

/// A row of blocks of the lower triangular factor.
#[derive(Debug, Clone, Copy)]
struct Lower<T> {
    e: RowMajorBlock<T>,
    c: RowMajorBlock<T>,
    pivot: Pivot<T>,
}

impl<T: Number> Lower<T> {
    fn of(zero: T) -> Self {
        let pivot = Pivot { first: zero, below: zero, beside: zero, second: zero };
        Self { e: [zero; 4], c: [zero; 4], pivot }
    }

    /// b̂ = D'⁻¹ (b − E b̂ₖ₋₂ − C' b̂ₖ₋₁).
    #[inline(always)]
    fn forward(&self, b: [T; 2], near: [T; 2], far: [T; 2]) -> [T; 2] {
        self.pivot.solve(less(less(b, self.e, far), self.c, near))
    }
}

/// A row of blocks of the unit upper triangular factor, F̂ and Ĝ.
#[derive(Debug, Clone, Copy)]
struct Upper<T> {
    f: RowMajorBlock<T>,
    g: RowMajorBlock<T>,
}

impl<T: Number> Upper<T> {
    #[inline(always)]
    fn of(zero: T) -> Self {
        Self { f: [zero; 4], g: [zero; 4] }
    }

    /// x = b̂ − F̂ xₖ₊₁ − Ĝ xₖ₊₂.
    #[inline(always)]
    fn backward(&self, b: [T; 2], near: [T; 2], far: [T; 2]) -> [T; 2] {
        less(less(b, self.g, far), self.f, near)
    }
}

/// The rows of one end of the band.
#[inline(always)]
fn end<T: Real>(rows: &Upper<T::Pair>, end: usize) -> Upper<T> {
    Upper { f: part_block(rows.f, end), g: part_block(rows.g, end) }
}

/// A block of one end of the band.
#[inline(always)]
fn part_block<T: Real>([a, b, c, d]: RowMajorBlock<T::Pair>, end: usize) -> RowMajorBlock<T> {
    [a.to_array()[end], b.to_array()[end], c.to_array()[end], d.to_array()[end]]
}

/// Eliminates one row, using the two rows before it.
#[inline(always)]
fn eliminate<T: Number>(
    [e, c, d, f, g]: [RowMajorBlock<T>; 5],
    near: &Upper<T>,
    far: &Upper<T>,
) -> (Lower<T>, Upper<T>) {
    let c = less_product(c, e, far.f);
    let d = less_product(less_product(d, e, far.g), c, near.f);
    let f = less_product(f, c, near.g);
    let pivot = Pivot::new(d);
    (Lower { e, c, pivot }, Upper { f: pivot.solve_block(f), g: pivot.solve_block(g) })
}

/// The two or three rows left between both eliminations (one for a single node).
#[derive(Debug)]
struct Middle<T> {
    lower: [Lower<T>; 3],
    upper: [Upper<T>; 3],
    /// The blocks that couple the last middle row to the last two rows eliminated from below, the nearest and the next, and the
    /// last but one middle row to the nearest.
    below: [RowMajorBlock<T>; 3],
}

impl<T: Real> Middle<T> {
    fn of(zero: T) -> Self {
        Self { lower: [Lower::of(zero); 3], upper: [Upper::of(zero); 3], below: [[zero; 4]; 3] }
    }

    #[inline(always)]
    fn factor(&mut self, rows: &[BlockRow<T>], near: &Upper<T::Pair>, far: &Upper<T::Pair>) {
        let none = [rows[0][0][0].like(0.0); 4];
        let (last, other) = (rows.len() - 1, rows.len().saturating_sub(2));
        let (mut near, below, mut far, below_far): (Upper<T>, Upper<T>, _, Upper<T>) =
            (end(near, 0), end(near, 1), end(far, 0), end(far, 1));
        for (k, (row, (lower, upper))) in rows.iter().zip(self.lower.iter_mut().zip(&mut self.upper)).enumerate() {
            let mut row = *row;
            if k == last {
                let [e, c, d, f, g] = row;
                let f = less_product(f, g, below_far.f);
                let d = less_product(less_product(d, g, below_far.g), f, below.f);
                row = [e, less_product(c, f, below.g), d, none, none];
                (self.below[0], self.below[1]) = (f, g);
            }
            if k == other {
                let [e, c, d, f, g] = row;
                row = [e, c, less_product(d, g, below.g), less_product(f, g, below.f), none];
                self.below[2] = g;
            }
            (*lower, *upper) = eliminate(row, &near, &far);
            (far, near) = (near, *upper);
        }
    }

    /// Solves for the middle; returns its unknowns in the nearest and second nearest rows to each end.
    #[inline(always)]
    fn solve(&self, b: &mut [[T; 2]], near: [T::Pair; 2], far: [T::Pair; 2]) -> [[T::Pair; 2]; 2] {
        let (last, other) = (b.len() - 1, b.len().saturating_sub(2));
        let ([mut near, below], [mut far, below_far]): ([[T; 2]; 2], _) = (part(near), part(far));
        let zero = near[0].like(0.0);
        b[last] = less(less(b[last], self.below[1], below_far), self.below[0], below);
        b[other] = less(b[other], self.below[2], below);
        for (b, lower) in b.iter_mut().zip(&self.lower) {
            *b = lower.forward(*b, near, far);
            (far, near) = (near, *b);
        }
        (near, far) = ([zero; 2], [zero; 2]);
        for (b, upper) in b.iter_mut().zip(&self.upper).rev() {
            *b = upper.backward(*b, near, far);
            (far, near) = (near, *b);
        }
        [pair(b[0], b[last]), pair(b[1.min(last)], b[other])]
    }

    /// The same with the transpose; `near` and `far` are what the outer rows subtract: from the middle rows nearest to them, and
    /// from the second nearest.
    fn solve_transposed(&self, b: &mut [[T; 2]], near: [T::Pair; 2], far: [T::Pair; 2]) -> [[T::Pair; 2]; 2] {
        let (first, last, other) = (0, b.len() - 1, b.len().saturating_sub(2));
        let subtract = |b: &mut [T; 2], x: [T; 2]| *b = [b[0] - x[0], b[1] - x[1]];
        let ([top, bottom], [top_far, bottom_far]): ([[T; 2]; 2], [[T; 2]; 2]) = (part(near), part(far));
        subtract(&mut b[first], top);
        subtract(&mut b[1.min(last)], top_far);
        subtract(&mut b[last], bottom);
        subtract(&mut b[other], bottom_far);
        for k in 0..b.len() {
            let upper = self.upper[k];
            let (f, g) = (transpose(upper.f), transpose(upper.g));
            if k + 1 < b.len() {
                b[k + 1] = less(b[k + 1], f, b[k]);
            }
            if k + 2 < b.len() {
                b[k + 2] = less(b[k + 2], g, b[k]);
            }
        }
        for k in (0..b.len()).rev() {
            let lower = self.lower[k];
            b[k] = lower.pivot.solve_transposed(b[k]);
            if k >= 1 {
                b[k - 1] = less(b[k - 1], transpose(lower.c), b[k]);
            }
            if k >= 2 {
                b[k - 2] = less(b[k - 2], transpose(lower.e), b[k]);
            }
        }
        [pair(b[0], b[last]), pair(b[1.min(last)], b[other])]
    }
}

/// Packs two numbers of a top row and two of a bottom row into lanes.
#[inline(always)]
fn pair<T: Real>(top: [T; 2], bottom: [T; 2]) -> [T::Pair; 2] {
    [T::Pair::new([top[0], bottom[0]]), T::Pair::new([top[1], bottom[1]])]
}

/// The inverse of [`pair`].
#[inline(always)]
fn part<T: Real>([first, second]: [T::Pair; 2]) -> [[T; 2]; 2] {
    let ([t0, b0], [t1, b1]) = (first.to_array(), second.to_array());
    [[t0, t1], [b0, b1]]
}

/// A top row and a bottom row, the latter in reverse order, in lanes.
#[inline(always)]
fn pair_rows<T: Real>(top: &BlockRow<T>, bottom: &BlockRow<T>) -> [RowMajorBlock<T::Pair>; 5] {
    let ([e, c, d, f, g], [below_g, below_f, below_d, below_c, below_e]) = (top, bottom);
    [
        pair_block(e, below_e),
        pair_block(c, below_c),
        pair_block(d, below_d),
        pair_block(f, below_f),
        pair_block(g, below_g),
    ]
}

/// Packs a block of a top row and one of a bottom row into lanes.
#[inline(always)]
fn pair_block<T: Real>(top: &RowMajorBlock<T>, bottom: &RowMajorBlock<T>) -> RowMajorBlock<T::Pair> {
    let ([a, b, c, d], [e, f, g, h]) = (*top, *bottom);
    [T::Pair::new([a, e]), T::Pair::new([b, f]), T::Pair::new([c, g]), T::Pair::new([d, h])]
}

/// Number of pairs of rows that are eliminated from both ends of `nodes` rows.
fn pairs(nodes: usize) -> usize {
    nodes.saturating_sub(2) / 2
}

/// The first `pairs` of `all`, the middle, the last `pairs`.
fn ends<T>(all: &[T], pairs: usize) -> [&[T]; 3] {
    let (top, rest) = all.split_at(pairs);
    let (middle, bottom) = rest.split_at(rest.len() - pairs);
    [top, middle, bottom]
}

/// The same, mutable.
fn ends_mut<T>(values: &mut [T], pairs: usize) -> [&mut [T]; 3] {
    let (top, rest) = values.split_at_mut(pairs);
    let (middle, bottom) = rest.split_at_mut(rest.len() - pairs);
    [top, middle, bottom]
}

/// The rows of both axes of node `k` in `width` vectors stored side by side, and those of the nodes near and far from it, if they exist.
type Rows<'a> = ([&'a mut [f64]; 2], [Option<[&'a [f64]; 2]>; 2]);

/// Rows `k`, and `near` and `far`, of `width` vectors side by side.
fn rows_of_many(x: &mut [f64], k: usize, others: [Option<usize>; 2], width: usize) -> Rows<'_> {
    let size = 2 * width;
    let (before, rest) = x.split_at_mut(k * size);
    let (own, after) = rest.split_at_mut(size);
    let (before, after) = (&*before, &*after);
    let row = |j: usize| {
        let row = if j < k { &before[j * size..][..size] } else { &after[(j - k - 1) * size..][..size] };
        let (first, second) = row.split_at(width);
        [first, second]
    };
    let (first, second) = own.split_at_mut(width);
    ([first, second], others.map(|other| other.map(row)))
}

/// Subtracts a block times `x` from `y`, for many vectors side by side.
#[inline(always)]
fn subtract_many([y0, y1]: [&mut [f64]; 2], [a, b, c, d]: RowMajorBlock<f64>, x: [&[f64]; 2]) {
    let width = y0.len();
    let (y1, x) = (&mut y1[..width], x.map(|x| &x[..width]));
    for i in 0..width {
        y0[i] -= a * x[0][i] + b * x[1][i];
        y1[i] -= c * x[0][i] + d * x[1][i];
    }
}

impl Pivot<f64> {
    #[inline(always)]
    fn solve_many(&self, [y0, y1]: [&mut [f64]; 2]) {
        let width = y0.len();
        let y1 = &mut y1[..width];
        for i in 0..width {
            [y0[i], y1[i]] = self.solve([y0[i], y1[i]]);
        }
    }
}

impl BlockBand {
    /// Replaces `width` right-hand sides by the solutions; entry `i` of vector `c` is at `i·width + c`.
    /// [`factor`](LinearSolver::factor) comes first.
    pub(crate) fn solve_many(&self, rhs: &mut [f64], width: usize) {
        if !self.factored {
            rhs.fill(f64::NAN);
            return;
        }
        let (pairs, nodes) = (self.upper.len(), rhs.len() / (2 * width.max(1)));
        let (middle, last) = (nodes - 2 * pairs, nodes - 1);
        let part = |block: &RowMajorBlock<f64x2>, end: usize| part_block::<f64>(*block, end);
        // Forward from both ends; `row(k)` counts from the end.
        for (k, lower) in self.lower.iter().enumerate() {
            for end in 0..2 {
                let row = |k: usize| if end == 0 { k } else { last - k };
                let others = [k.checked_sub(1), k.checked_sub(2)].map(|k| k.map(row));
                let ([y0, y1], [near, far]) = rows_of_many(rhs, row(k), others, width);
                if let Some(far) = far {
                    subtract_many([&mut *y0, &mut *y1], part(&lower.e, end), far);
                }
                if let Some(near) = near {
                    subtract_many([&mut *y0, &mut *y1], part(&lower.c, end), near);
                }
                let Pivot { first, below, beside, second } = lower.pivot;
                let of = |pair: f64x2| pair.to_array()[end];
                let pivot = Pivot { first: of(first), below: of(below), beside: of(beside), second: of(second) };
                pivot.solve_many([y0, y1]);
            }
        }
        // The middle, from above, with the blocks that couple its last rows to those eliminated from below.
        let below = |k: usize| (k < pairs).then(|| nodes - pairs + k);
        let ties = [
            (middle - 1, &self.middle.below[1], below(1)),
            (middle - 1, &self.middle.below[0], below(0)),
            (middle.saturating_sub(2), &self.middle.below[2], below(0)),
        ];
        for (k, block, from) in ties {
            let (own, [from, _]) = rows_of_many(rhs, pairs + k, [from, None], width);
            if let Some(from) = from {
                subtract_many(own, *block, from);
            }
        }
        for (k, lower) in self.middle.lower[..middle].iter().enumerate() {
            let k = pairs + k;
            let ([y0, y1], [near, far]) = rows_of_many(rhs, k, [k.checked_sub(1), k.checked_sub(2)], width);
            if let Some(far) = far {
                subtract_many([&mut *y0, &mut *y1], lower.e, far);
            }
            if let Some(near) = near {
                subtract_many([&mut *y0, &mut *y1], lower.c, near);
            }
            lower.pivot.solve_many([y0, y1]);
        }
        for (k, upper) in self.middle.upper[..middle].iter().enumerate().rev() {
            let there = |ahead: usize| (k + ahead < middle).then(|| pairs + k + ahead);
            let ([y0, y1], [near, far]) = rows_of_many(rhs, pairs + k, [there(1), there(2)], width);
            if let Some(far) = far {
                subtract_many([&mut *y0, &mut *y1], upper.g, far);
            }
            if let Some(near) = near {
                subtract_many([y0, y1], upper.f, near);
            }
        }
        for (k, upper) in self.upper.iter().enumerate().rev() {
            for end in 0..2 {
                let row = |k: usize| if end == 0 { k } else { last - k };
                let others = [k + 1, k + 2].map(|k| (k < nodes).then(|| row(k)));
                let ([y0, y1], [near, far]) = rows_of_many(rhs, row(k), others, width);
                if let Some(far) = far {
                    subtract_many([&mut *y0, &mut *y1], part(&upper.g, end), far);
                }
                if let Some(near) = near {
                    subtract_many([y0, y1], part(&upper.f, end), near);
                }
            }
        }
    }
}

/// The last two rows or vectors that a sweep has passed, the last one first.
type Passed<T> = [T; 2];

impl<T: Real> BlockBand<T> {
    /// For `nodes` rows; `zero` selects the number type.
    pub fn of(nodes: usize, zero: T) -> Self {
        let upper = vec![Upper::of(T::Pair::new([zero; 2])); pairs(nodes)];
        Self { lower: Vec::new(), upper, middle: Middle::of(zero), factored: false }
    }

    /// Replaces `rhs` by the solution for the matrix of `rows`; the factors are not stored.
    #[inline(always)]
    pub fn eliminate(&mut self, rows: &[BlockRow<T>], rhs: &mut [[T; 2]]) {
        self.factored = false;
        let Some(zero) = rows.first().map(|row| T::Pair::new([row[0][0].like(0.0); 2])) else { return };
        let [top, middle, bottom] = ends(rows, self.upper.len());
        let [x_top, x_middle, x_bottom] = ends_mut(rhs, self.upper.len());
        let (mut near, mut far) = (Upper::of(zero), Upper::of(zero));
        let (mut x_near, mut x_far) = ([zero; 2], [zero; 2]);
        let rows = top.iter().zip(bottom.iter().rev());
        let unknowns = x_top.iter_mut().zip(x_bottom.iter_mut().rev());
        for (((t, b), (x_t, x_b)), upper) in rows.zip(unknowns).zip(&mut self.upper) {
            let lower;
            (lower, *upper) = eliminate(pair_rows(t, b), &near, &far);
            (far, near) = (near, *upper);
            let x = lower.forward(pair(*x_t, *x_b), x_near, x_far);
            (x_far, x_near) = (x_near, x);
            [*x_t, *x_b] = part(x);
        }
        let of_middle = &mut self.middle;
        let inner = T::out_of_line(
            #[inline(always)]
            || {
                of_middle.factor(middle, &near, &far);
                of_middle.solve(x_middle, x_near, x_far)
            },
        );
        self.outwards(x_top, x_bottom, inner);
    }

    /// Back substitution from the middle outwards; `near` and `far` are the two middle rows next to the ends.
    #[inline(always)]
    fn outwards(&self, top: &mut [[T; 2]], bottom: &mut [[T; 2]], [mut near, mut far]: Passed<[T::Pair; 2]>) {
        for ((upper, t), b) in self.upper.iter().zip(top).zip(bottom.iter_mut().rev()).rev() {
            let x = upper.backward(pair(*t, *b), near, far);
            (far, near) = (near, x);
            [*t, *b] = part(x);
        }
    }
}

impl LinearSolver for BlockBand {
    fn analyse(matrix: &BandMatrix) -> Result<Self> {
        Ok(Self::of(matrix.nodes(), 0.0))
    }

    fn factor(&mut self, matrix: &BandMatrix) -> Result<()> {
        self.lower.resize(self.upper.len(), Lower::of(f64x2::ZERO));
        let [top, middle, bottom] = ends(matrix.rows(), self.upper.len());
        let (mut near, mut far) = (Upper::of(f64x2::ZERO), Upper::of(f64x2::ZERO));
        let factors = self.lower.iter_mut().zip(&mut self.upper);
        for ((t, b), (lower, upper)) in top.iter().zip(bottom.iter().rev()).zip(factors) {
            (*lower, *upper) = eliminate(pair_rows(t, b), &near, &far);
            (far, near) = (near, *upper);
        }
        self.middle.factor(middle, &near, &far);
        self.factored = true;
        Ok(())
    }

    fn factor_and_solve(&mut self, matrix: &BandMatrix, rhs: &mut [f64]) -> Result<()> {
        self.eliminate(matrix.rows(), rhs.as_chunks_mut().0);
        Ok(())
    }

    fn solve(&mut self, rhs: &mut [f64]) {
        if !self.factored {
            rhs.fill(f64::NAN);
            return;
        }
        let [top, middle, bottom] = ends_mut(rhs.as_chunks_mut().0, self.upper.len());
        let (mut near, mut far) = ([f64x2::ZERO; 2], [f64x2::ZERO; 2]);
        for ((t, b), lower) in top.iter_mut().zip(bottom.iter_mut().rev()).zip(&self.lower) {
            let x = lower.forward(pair(*t, *b), near, far);
            (far, near) = (near, x);
            [*t, *b] = part(x);
        }
        let inner = self.middle.solve(middle, near, far);
        self.outwards(top, bottom, inner);
    }

    fn solve_transposed(&mut self, rhs: &mut [f64]) {
        if !self.factored {
            rhs.fill(f64::NAN);
            return;
        }
        let zero = [f64x2::default(); 2];
        let [top, middle, bottom] = ends_mut(rhs.as_chunks_mut().0, self.upper.len());
        // What the eliminated rows subtract from the next row and from the one after it.
        let (mut next, mut after) = (zero, zero);
        for ((t, b), upper) in top.iter_mut().zip(bottom.iter_mut().rev()).zip(&self.upper) {
            let x = pair(*t, *b);
            let x = [x[0] - next[0], x[1] - next[1]];
            let taken = less(zero, transpose(upper.f), x);
            next = [after[0] - taken[0], after[1] - taken[1]];
            after = less(zero, transpose(upper.g), x).map(|x| -x);
            [*t, *b] = part(x);
        }
        let (count, below) = (middle.len(), self.middle.below);
        let [mut near, mut far] = self.middle.solve_transposed(middle, next, after);
        // The blocks C' and E that couple the eliminated rows to the next row, starting with the middle.
        let lanes = |top: RowMajorBlock<f64>, bottom: RowMajorBlock<f64>| {
            std::array::from_fn(|i| f64x2::new([top[i], bottom[i]]))
        };
        let rows = &self.middle.lower;
        let mut c: RowMajorBlock<f64x2> = lanes(rows[0].c, below[0]);
        let mut e_near: RowMajorBlock<f64x2> = lanes(rows[0].e, below[1]);
        let mut e_far: RowMajorBlock<f64x2> = lanes(rows[1.min(count - 1)].e, below[2]);
        let outwards = top.iter_mut().zip(bottom.iter_mut().rev()).zip(&self.lower).rev();
        for ((t, b), lower) in outwards {
            let x = less(less(pair(*t, *b), transpose(e_far), far), transpose(c), near);
            let x = lower.pivot.solve_transposed(x);
            (far, near) = (near, x);
            (e_far, e_near, c) = (e_near, lower.e, lower.c);
            [*t, *b] = part(x);
        }
    }
}

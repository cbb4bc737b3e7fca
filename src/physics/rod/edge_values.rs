//! Values along the edges of a rod, of which those towards the tip are usually alike.

use std::ops::Index;

/// A value for every edge: from some edge on all are the same and kept once.
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeValues<T> {
    own: Vec<T>,
    rest: T,
    edges: usize,
}

impl<T: Copy> EdgeValues<T> {
    /// The `values` of all edges, of which there is at least one: the `last` of them.
    pub fn all(values: Vec<T>, last: T) -> Self {
        Self { edges: values.len(), own: values, rest: last }
    }
}

impl<T: PartialEq + Default> From<Vec<T>> for EdgeValues<T> {
    fn from(mut own: Vec<T>) -> Self {
        let edges = own.len();
        let rest = own.pop().unwrap_or_default();
        while own.last() == Some(&rest) {
            own.pop();
        }
        own.shrink_to_fit();
        Self { own, rest, edges }
    }
}

impl<T> Index<usize> for EdgeValues<T> {
    type Output = T;

    /// The value of edge `e`.
    #[inline(always)]
    fn index(&self, e: usize) -> &T {
        self.own.get(e).unwrap_or(&self.rest)
    }
}

impl<T> EdgeValues<T> {
    /// The value of every edge.
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = &T> {
        self.own.iter().chain(std::iter::repeat_n(&self.rest, self.edges - self.own.len()))
    }
}

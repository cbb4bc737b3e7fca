//! Values along the edges of a rod. Towards the tip they are usually identical.

use std::ops::Index;

/// A value for every edge. From some edge on all values are the same and stored once.
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeValues<T> {
    own: Vec<T>,
    rest: T,
    edges: usize,
}

impl<T: Copy> EdgeValues<T> {
    /// Stores the `values` of all edges, of which there is at least one, individually; `last` is the last of them.
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

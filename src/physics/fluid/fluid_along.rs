//! The fluid along a rod: ranges of edges in one uniform fluid, and ranges along which the fluid changes.

use std::ops::Range;
use std::{iter, slice};

use super::medium::{Fluid, Layers, LocalFluid};

/// Consecutive edges in one uniform fluid, or in a fluid that changes along each of them.
#[derive(Debug)]
struct FluidRun {
    edges: Range<usize>,
    changes: bool,
    /// The index of the fluid at its first node. It is the only entry in a uniform range; otherwise there is one entry
    /// per node from there on.
    first: usize,
}

/// The fluid along a rod, with buffers that are reused.
#[derive(Debug, Default)]
pub struct FluidRuns {
    runs: Vec<FluidRun>,
    found: Vec<LocalFluid>,
}

impl FluidRuns {
    /// Empty, with buffers for a rod of `nodes` nodes.
    pub fn with_capacity(nodes: usize) -> Self {
        // At most a run per edge, and an entry per edge and one for the last node of every run that changes.
        Self { runs: Vec::with_capacity(nodes), found: Vec::with_capacity(2 * nodes) }
    }

    /// Removes all runs.
    pub fn clear(&mut self) {
        self.runs.clear();
        self.found.clear();
    }

    /// Finds the fluid at all nodes of a rod with positions `q`, two entries per node, where `fluid` is the one before
    /// the first of `layers`.
    pub fn find(&mut self, layers: &Layers, fluid: Fluid, q: &[f64]) -> FluidAlong<'_> {
        self.clear();
        let height = |x: &[f64; 2]| layers.height((*x).into());
        let places = q.as_chunks().0;
        let mut k = 0;
        while let Some(x) = places.get(k) {
            let span = layers.span(height(x));
            let next = k + layers.within(&span, &places[k..]);
            self.push(k..next - 1, span.changes);
            // The edge that leaves the span, if there is one.
            self.push(next - 1..next.min(places.len() - 1), true);
            k = next;
        }
        for run in &mut self.runs {
            run.first = self.found.len();
            let nodes = run.edges.start..=if run.changes { run.edges.end } else { run.edges.start };
            self.found.extend(places[nodes].iter().map(|x| layers.at(fluid, height(x))));
        }
        (&*self).into()
    }

    /// Adds `edges`, if there are any, to the last run or as a new run.
    fn push(&mut self, edges: Range<usize>, changes: bool) {
        match self.runs.last_mut() {
            _ if edges.is_empty() => {}
            Some(last) if last.changes && changes => last.edges.end = edges.end,
            _ => self.runs.push(FluidRun { edges, changes, first: 0 }),
        }
    }
}

/// The fluid along a rod or a part of it; empty until it has been computed.
#[derive(Debug, Clone, Copy, Default)]
pub struct FluidAlong<'a> {
    runs: &'a [FluidRun],
    found: &'a [LocalFluid],
}

impl<'a> From<&'a FluidRuns> for FluidAlong<'a> {
    fn from(FluidRuns { runs, found }: &'a FluidRuns) -> Self {
        Self { runs, found }
    }
}

impl<'a> FluidAlong<'a> {
    /// True if it has not been computed.
    #[inline(always)]
    pub fn is_unknown(self) -> bool {
        self.runs.is_empty()
    }

    /// True if there is exactly one run.
    #[inline(always)]
    pub fn is_one(self) -> bool {
        self.runs.len() == 1
    }

    /// The fluid, if it is known to be the same at every node.
    #[inline(always)]
    pub fn everywhere(self) -> Option<&'a Fluid> {
        match self.runs {
            [FluidRun { changes: false, first, .. }] => Some(&self.found[*first].fluid),
            _ => None,
        }
    }

    /// The fluid at node `k`, if it has been computed.
    #[inline(always)]
    pub fn at(self, k: usize) -> Option<&'a LocalFluid> {
        let run = self.runs.iter().find(|run| run.edges.start <= k && k <= run.edges.end)?;
        Some(&self.found[run.first + if run.changes { k - run.edges.start } else { 0 }])
    }

    /// The fluid at the nodes of `edges`, which lie in one range along which it changes.
    #[inline(always)]
    pub fn along(self, edges: Range<usize>) -> &'a [LocalFluid] {
        match self.runs {
            [run] if run.changes => {
                &self.found[run.first..][edges.start - run.edges.start..=edges.end - run.edges.start]
            }
            _ => &[],
        }
    }

    /// The ranges of `edges`, each by itself; a single range if the fluid has not been computed.
    #[inline(always)]
    pub fn over(self, edges: Range<usize>) -> impl Iterator<Item = (Range<usize>, Self)> {
        let (mut next, mut ahead) = (edges.start, self.runs.iter());
        iter::from_fn(move || {
            let first = next;
            if first >= edges.end {
                return None;
            }
            let Some(run) = ahead.find(|run| run.edges.end > first) else {
                next = edges.end;
                return Some((first..next, self));
            };
            next = edges.end.min(run.edges.end);
            Some((first..next, Self { runs: slice::from_ref(run), ..self }))
        })
    }
}

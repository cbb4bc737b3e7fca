//! The variables of an instance by the value references of both versions.

use caudal::fmu::Target;
use caudal::scene::NODES;
use caudal::variable::{Size, VARIABLES};

use super::Instance;
use crate::status::{FmiResult, refuse};

impl Instance {
    /// Number of entries of a variable of FMI 3.0.
    #[inline]
    pub fn len3(&self, reference: u32) -> Option<usize> {
        match self.catalogue.target(reference) {
            Some(Target::Variable(place, _)) => Some(self.lengths[place]),
            Some(Target::Parameter(_)) => Some(1),
            None => self.scalar(reference).ok().map(|_| 1),
        }
    }

    /// The target of a scalar of FMI 2.0.
    #[inline]
    pub fn scalar(&self, reference: u32) -> FmiResult<Target> {
        match self.catalogue.scalar_target(reference) {
            Some(target @ Target::Variable(place, node)) if node < self.lengths[place] => {
                let nodes = if node == 0 && self.lengths[place] == 1 { 0..1 } else { self.entries(place) };
                if nodes.contains(&node) { Ok(target) } else { unknown(reference) }
            }
            Some(target @ Target::Parameter(_)) => Ok(target),
            _ => unknown(reference),
        }
    }

    /// The nodes at which a variable has entries.
    pub(super) fn entries(&self, place: usize) -> std::ops::Range<usize> {
        let nodes = self.settings.nodes as usize;
        match VARIABLES[place].size {
            Size::Scalar => 0..1,
            Size::Nodes => 0..nodes,
            Size::Joints => self.scene.first_joint()..nodes - 1,
        }
    }

    /// The target of a variable of FMI 3.0.
    #[inline]
    pub fn target(&self, reference: u32) -> FmiResult<Target> {
        // FMI 3.0 without arrays has separate variables for entries of arrays, like FMI 2.0.
        self.catalogue.target(reference).map_or_else(|| self.scalar(reference), Ok)
    }

    /// The target of a real scalar of FMI 2.0.
    #[inline]
    pub fn real(&self, reference: u32) -> FmiResult<Target> {
        self.no_integer(self.scalar(reference)?)
    }

    /// The target of a Float64 of FMI 3.0.
    #[inline]
    pub fn float(&self, reference: u32) -> FmiResult<Target> {
        self.no_integer(self.target(reference)?)
    }

    fn no_integer(&self, target: Target) -> FmiResult<Target> {
        match target {
            Target::Variable(place, _) if place == self.nodes_place => refuse("`nodes` is an integer"),
            other => Ok(other),
        }
    }

    /// The value of an integer. The only one is the number of nodes.
    pub fn integer(&self, target: Target) -> FmiResult<u64> {
        match target {
            Target::Variable(place, _) if place == self.nodes_place => Ok(self.settings.nodes),
            _ => refuse("this variable is not an integer"),
        }
    }

    /// Returns an error for a number of nodes that is not allowed.
    pub fn check_nodes(&self, nodes: u64) -> FmiResult {
        let [least, most] = NODES.map(|nodes| nodes + self.scene.front() as u64);
        if (least..=most).contains(&nodes) {
            return Ok(());
        }
        refuse(format!("nodes: found {nodes}; allowed: {least} to {most}"))
    }

    /// Sets the structural parameter, which [`check_nodes`](Self::check_nodes) has accepted.
    pub fn set_nodes(&mut self, nodes: u64) {
        if nodes != self.settings.nodes {
            self.settings.nodes = nodes;
            self.inputs.forget_arrays();
            self.stale = true;
            self.size();
        }
    }
}

#[cold]
fn unknown<T>(reference: u32) -> FmiResult<T> {
    refuse(format!("there is no variable with value reference {reference}"))
}

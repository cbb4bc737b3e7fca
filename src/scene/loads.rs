//! `[loads]`: gravity, buoyancy and point loads.

use nalgebra::Vector2;
use serde::Deserialize;

use super::key_error::KeyError;
use super::record::{allowed_nodes, is_node};
use super::value::{self, Finite};
use crate::rod::Rod;

/// `[loads]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LoadsTable {
    /// Acceleration of gravity, m/s². Leave it out for a neutrally buoyant rod.
    #[serde(default, deserialize_with = "value::optional_pair")]
    pub gravity_m_s2: Option<[Finite; 2]>,
    /// Whether the medium exerts buoyancy on the rod.
    #[serde(default)]
    pub buoyancy: bool,
    /// Constant forces on single nodes.
    #[serde(default)]
    pub point: Vec<PointLoad>,
}

/// `[[loads.point]]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct PointLoad {
    /// Node. Negative numbers count from the tip, −1. Node 0 is the centre of a body, if the scene has one.
    pub node: i64,
    /// Force, N.
    #[serde(deserialize_with = "value::pair")]
    pub force_n: [Finite; 2],
}

impl LoadsTable {
    pub(super) fn check(&self, nodes: usize) -> Result<(), KeyError> {
        for (i, load) in self.point.iter().enumerate() {
            if !is_node(load.node, nodes) {
                let problem = value::refused(load.node, allowed_nodes(nodes));
                return Err(KeyError { key: format!("loads.point.{i}.node"), problem });
            }
        }
        Ok(())
    }

    /// Gravity (m/s²), if there is buoyancy.
    pub(super) fn buoyed_by(&self) -> Option<Vector2<f64>> {
        let gravity = self.gravity_m_s2.map_or([0.0; 2], |gravity| gravity.map(Finite::get));
        (self.buoyancy && gravity != [0.0; 2]).then(|| gravity.into())
    }

    /// Buoyancy in a fluid of density 1 kg/m³ (N), two entries per node: −V g with the volume V of every node.
    pub(super) fn buoyancy(&self, rod: &Rod) -> Option<Vec<f64>> {
        let gravity = self.buoyed_by()?;
        let mut force = vec![0.0; 2 * rod.nodes];
        if let Some(body) = rod.body {
            (0..2).for_each(|axis| force[axis] = -body.volume() * gravity[axis]);
        }
        for (e, halves) in rod.halves().enumerate() {
            for (i, half) in halves.iter().enumerate() {
                for (axis, g) in gravity.iter().enumerate() {
                    force[2 * (e + i) + axis] -= half.displaced * half.length * g;
                }
            }
        }
        Some(force)
    }

    /// The forces of gravity and point loads (N), two entries per node, or None without loads.
    pub(super) fn build(&self, rod: &Rod) -> Option<Vec<f64>> {
        let gravity = self.gravity_m_s2.map_or([0.0; 2], |gravity| gravity.map(Finite::get));
        if gravity == [0.0; 2] && self.point.is_empty() {
            return None;
        }
        let mut force: Vec<f64> = rod.mass.iter().flat_map(|mass| gravity.map(|g| g * mass)).collect();
        for load in &self.point {
            let node = load.node.rem_euclid(rod.nodes as i64) as usize;
            for (i, component) in load.force_n.iter().enumerate() {
                force[2 * node + i] += component.get();
            }
        }
        Some(force)
    }
}

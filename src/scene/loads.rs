//! `[loads]`: gravity, buoyancy and point loads.

use nalgebra::Vector2;
use serde::Deserialize;

use super::Scene;
use super::key_error::KeyError;
use super::record::{allowed_nodes, is_node};
use super::value::{self, Finite};
use crate::loads::FollowerLoads;
use crate::rod::Rod;

/// `[loads]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LoadsTable {
    /// Acceleration of gravity, m/s². Omit it for a neutrally buoyant rod.
    #[serde(default, deserialize_with = "value::optional_pair")]
    pub gravity_m_s2: Option<[Finite; 2]>,
    /// Whether the medium exerts buoyancy on the rod, with `gravity_m_s2`.
    #[serde(default)]
    pub buoyancy: bool,
    /// Constant forces on single nodes, in the axes of the plane or of the rod.
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
    /// True for a force that turns with the rod, such as that of a jet: its components are along the edge before its node, away
    /// from the head, and across it, to its left.
    #[serde(default)]
    pub follows: bool,
}

impl PointLoad {
    /// The index of its node on `rod`.
    fn node_of(&self, rod: &Rod) -> usize {
        self.node.rem_euclid(rod.nodes as i64) as usize
    }
}

impl LoadsTable {
    pub(super) fn check(&self, nodes: usize) -> Result<(), KeyError> {
        for (i, load) in self.point.iter().enumerate() {
            if !is_node(load.node, nodes) {
                let problem = value::refused(load.node, allowed_nodes(nodes));
                return Err(KeyError { key: format!("loads.point.{i}.node"), problem });
            }
        }
        if self.buoyancy && self.gravity_m_s2.is_none() {
            let problem = "found without gravity_m_s2, which it requires; add it, as gravity_m_s2 = [0.0, -9.81]";
            return Err(KeyError { key: "loads.buoyancy".into(), problem: problem.into() });
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

    /// The point loads that follow the rod, if there are any.
    pub(super) fn followers(&self, rod: &Rod) -> Option<FollowerLoads> {
        let mut loads = self.point.iter().filter(|load| load.follows).peekable();
        loads.peek()?;
        Some(FollowerLoads::new(loads.map(|load| (load.node_of(rod), load.force_n.map(Finite::get).into()))))
    }

    /// The forces of gravity and of point loads of fixed direction (N), two entries per node, or `None` without any.
    pub(super) fn build(&self, rod: &Rod) -> Option<Vec<f64>> {
        let gravity = self.gravity_m_s2.map_or([0.0; 2], |gravity| gravity.map(Finite::get));
        let mut fixed = self.point.iter().filter(|load| !load.follows).peekable();
        if gravity == [0.0; 2] && fixed.peek().is_none() {
            return None;
        }
        let mut force: Vec<f64> = rod.mass.iter().flat_map(|mass| gravity.map(|g| g * mass)).collect();
        for load in fixed {
            for (i, component) in load.force_n.iter().enumerate() {
                force[2 * load.node_of(rod) + i] += component.get();
            }
        }
        Some(force)
    }
}

impl Scene {
    /// True if gravity or a point load acts on the rod.
    #[cfg(feature = "report")]
    pub(crate) fn has_loads(&self) -> bool {
        self.loads.as_ref().is_some_and(|loads| loads.gravity_m_s2.is_some() || !loads.point.is_empty())
    }

    /// True if a point load follows the rod.
    pub fn has_followers(&self) -> bool {
        self.loads.iter().flat_map(|loads| &loads.point).any(|load| load.follows)
    }
}

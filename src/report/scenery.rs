//! What an animation shows in addition to the moving nodes: the width of the body, how its head is held, and the tendons along it.

use serde::{Deserialize, Serialize};

use super::frame::Frame;
use crate::head::Signal;
use crate::model::Model;
use crate::rod::Rod;
use crate::tendons::Tendon;

/// Properties that do not change while a rod moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scenery {
    /// Half the width of the body in the plane of motion, m, at each point of a frame.
    half_widths: Vec<f64>,
    /// The arc length from the head to each point of a frame at rest, m.
    #[serde(skip)]
    arc_lengths: Vec<f64>,
    /// How the head is held; `None` if it is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    head: Option<HeadSupport>,
    /// The tendons.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    tendons: Vec<TendonPath>,
    /// The change of the flow along the normal of the interfaces, if the flow is not uniform.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    shear: Option<Shear>,
}

/// How a head is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum HeadSupport {
    Clamped,
    Driven,
    Hinged,
}

/// The position of a tendon.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct TendonPath {
    /// Its distance from the axis of the rod, m, positive to the left seen from the head.
    offset: f64,
    /// The first and last point of a frame along it.
    points: [usize; 2],
}

/// A flow that is not uniform.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Shear {
    /// Unit normal of the interfaces.
    normal: [f64; 2],
    /// Shear rate, 1/s.
    rate: f64,
    /// Velocity beyond each interface relative to that before the first, m/s.
    beyond: Vec<[f64; 2]>,
}

impl Scenery {
    /// The scenery of a model.
    pub fn of(model: &Model) -> Self {
        let nodes = Frame::nodes(model.rod.nodes);
        let place = |k: usize| nodes.clone().position(|node| node >= k).unwrap_or_default();
        let path = |tendon: &Tendon| TendonPath {
            offset: tendon.offset,
            points: [place(tendon.edges.start), place(tendon.edges.end)],
        };
        let head = model.head.as_ref().map(|motion| match &model.hinge {
            Some(_) => HeadSupport::Hinged,
            None if motion.iter().all(|signal| matches!(signal, Signal::Constant(_))) => HeadSupport::Clamped,
            None => HeadSupport::Driven,
        });
        let shear = model.layers.as_ref().filter(|layers| !layers.flow_together()).map(|layers| Shear {
            normal: layers.normal.into(),
            rate: layers.shear,
            beyond: layers.iter().map(|layer| layer.fluid.flow.into()).collect(),
        });
        Self { head, tendons: model.tendons.iter().map(path).collect(), shear, ..Self::of_rod(&model.rod) }
    }

    /// The scenery of a rod alone.
    pub fn of_rod(rod: &Rod) -> Self {
        Self::of_nodes(rod, Frame::nodes(rod.nodes))
    }

    /// The scenery of a rod alone, whose frames have these nodes as points.
    pub(super) fn of_nodes(rod: &Rod, nodes: impl Iterator<Item = usize> + Clone) -> Self {
        // A tendon also begins inside a head body, which is drawn over it.
        let half_width = |k: usize| rod.sections.at(rod.xi(k.max(rod.front))).semi_axes()[0];
        Self {
            half_widths: nodes.clone().map(half_width).collect(),
            arc_lengths: nodes.map(|k| rod.arc_length(k)).collect(),
            head: None,
            tendons: Vec::new(),
            shear: None,
        }
    }

    /// Half the width of the body at each point of a frame, m.
    pub(super) fn half_widths(&self) -> &[f64] {
        &self.half_widths
    }

    /// The arc length from the head to each point of a frame at rest, m.
    pub(super) fn arc_lengths(&self) -> &[f64] {
        &self.arc_lengths
    }
}

//! The motion of a rod as pages and films draw it: the rod that moved, with the numbers of its nodes that are drawn, and its frames.
//! Whatever records a motion fills all of it; what is unknown is `None`, and is not drawn.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::frame::{Frame, Medium};
use super::interpolation::interpolate;
use crate::head::Signal;
use crate::model::Model;
use crate::tendons::Tendon;
use crate::variable::View;

/// Most nodes that are drawn.
pub const MAX_POINTS: usize = 120;

/// At most `most` of so many nodes, evenly spaced, with head and tip, and the node after the head, which shows the direction of the head.
pub fn drawn_nodes(count: usize, most: usize) -> Vec<usize> {
    match count <= most || most < 3 {
        true => (0..count).collect(),
        false => std::iter::once(0).chain((0..most - 1).map(|i| 1 + i * (count - 2) / (most - 2))).collect(),
    }
}

/// A motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RodMotion {
    /// The rod.
    pub rod: DrawnRod,
    /// Its frames in order of time, whose points are the nodes of the rod.
    pub frames: Vec<Frame>,
    /// Frequency of the fastest drive that is seen, Hz, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drive: Option<f64>,
    /// True if the frames before the last periods are left out, since fewer per period of the fastest drive would show another motion.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_of_last_periods: bool,
}

/// The rod of a motion, and how its head is held.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DrawnRod {
    /// The nodes that are drawn, from the head to the tip.
    pub(super) nodes: Vec<usize>,
    /// Half the width of the body in the plane of motion at each of them, m; `None` if it is unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) half_widths: Option<Vec<f64>>,
    /// Semi-axes of the body at the head along the rod and across it, m. Its direction is from node 0 to node 1, so it is not drawn
    /// without them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) body: Option<[f64; 2]>,
    /// How the head is held; `None` if it is free, or if nodes 0 and 1 are not drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) head: Option<HeadSupport>,
    /// The tendons.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) tendons: Vec<TendonPath>,
    /// The first and last point with a joint.
    pub(super) joints: [usize; 2],
    /// The arc length from the head to each point at rest, m; empty if it is unknown.
    #[serde(skip)]
    pub(super) arc_lengths: Vec<f64>,
}

/// How a head is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum HeadSupport {
    Clamped,
    Driven,
    Hinged,
}

/// The position of a tendon.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct TendonPath {
    /// Its distance from the axis of the rod, m, positive to the left seen from the head.
    offset: f64,
    /// The first and last point of a frame along it.
    points: [usize; 2],
}

impl DrawnRod {
    /// The rod of a model.
    pub fn of(model: &Model) -> Self {
        Self::at(Some(model), drawn_nodes(model.rod.nodes, MAX_POINTS))
    }

    /// The rod of a model, drawn at these `nodes`, in ascending order. Without a model that has them, only their numbers are known.
    pub fn at(model: Option<&Model>, nodes: Vec<usize>) -> Self {
        let unknown = Self::unknown(nodes);
        let nodes = &unknown.nodes;
        let Some(model) = model.filter(|model| nodes.last().is_some_and(|last| *last < model.rod.nodes)) else {
            return unknown;
        };
        let rod = &model.rod;
        let shows_direction = nodes.starts_with(&[0, 1]);
        let place = |k: usize| nodes.partition_point(|node| *node < k).min(nodes.len() - 1);
        let path = |tendon: &Tendon| TendonPath {
            offset: tendon.offset,
            points: [place(tendon.edges.start), place(tendon.edges.end)],
        };
        let head = model.head.as_ref().map(|motion| match &model.hinge {
            Some(_) => HeadSupport::Hinged,
            None if motion.iter().all(|signal| matches!(signal, Signal::Constant(_))) => HeadSupport::Clamped,
            None => HeadSupport::Driven,
        });
        Self {
            half_widths: Some(nodes.iter().map(|k| rod.sections.at(rod.xi(*k)).semi_axes()[0]).collect()),
            body: rod.body.filter(|_| shows_direction).map(|body| [body.along, body.across]),
            head: head.filter(|_| shows_direction),
            tendons: model.tendons.iter().map(path).collect(),
            joints: [
                place(rod.joints().start),
                nodes.partition_point(|node| *node < rod.joints().end).saturating_sub(1),
            ],
            arc_lengths: nodes.iter().map(|k| rod.arc_length(*k)).collect(),
            ..unknown
        }
    }

    /// A rod of which only the numbers of the drawn `nodes` are known.
    pub(super) fn unknown(nodes: Vec<usize>) -> Self {
        let joints = [1, nodes.len().saturating_sub(2)];
        Self { nodes, half_widths: None, body: None, head: None, tendons: Vec::new(), joints, arc_lengths: Vec::new() }
    }

    /// The nodes that are drawn, which are the points of frames.
    pub fn nodes(&self) -> &[usize] {
        &self.nodes
    }

    /// True if the first point is the head.
    pub(super) fn shows_head(&self) -> bool {
        self.nodes.first() == Some(&0)
    }
}

impl RodMotion {
    /// A motion of the rod of a model, without frames.
    pub fn of(model: &Model) -> Self {
        Self::whole(DrawnRod::of(model), Vec::new())
    }

    /// A motion that these frames show from its beginning.
    pub fn whole(rod: DrawnRod, frames: Vec<Frame>) -> Self {
        Self { rod, frames, drive: None, is_of_last_periods: false }
    }

    /// The motion of the rod of a model of which positions are recorded: `rows` have a time (s) and the position (m) by the place of a
    /// node among the recorded `nodes`, which are in any order. The fluid is that of the model.
    pub fn of_positions<P: Fn(usize) -> [f64; 2]>(
        model: &Model,
        nodes: &[usize],
        rows: impl IntoIterator<Item = (f64, P)>,
    ) -> Self {
        let mut places: Vec<usize> = (0..nodes.len()).collect();
        places.sort_by_key(|place| nodes[*place]);
        let places: Vec<usize> = drawn_nodes(nodes.len(), MAX_POINTS).into_iter().map(|i| places[i]).collect();
        let frame = |(time, position): (f64, P)| {
            let points = places.iter().map(|place| position(*place)).collect();
            // Of all nodes, it is the centre of mass.
            let mass = |node: &usize| model.rod.mass.get(*node).copied().unwrap_or(0.0);
            let moments = nodes.iter().enumerate().map(|(place, node)| Vector2::from(position(place)) * mass(node));
            let com = moments.sum::<Vector2<f64>>() / nodes.iter().map(mass).sum::<f64>();
            Frame { time, points, com: com.into(), medium: Some(Medium::at(model, time)), loads: None }
        };
        let frames = rows.into_iter().map(frame).collect();
        let rod = DrawnRod::at(Some(model), places.iter().map(|place| nodes[*place]).collect());
        Self::whole(rod, frames)
    }

    /// Adds the current frame.
    pub fn push(&mut self, view: &View<'_>) {
        self.frames.push(Frame::of(view, &self.rod.nodes));
    }

    /// The points at a time (s), by interpolation; those of the first or last frame outside.
    pub fn points_at(&self, time: f64) -> Vec<Vector2<f64>> {
        let frames = &self.frames;
        let count = 2 * frames.first().map_or(0, |frame| frame.points.len());
        let value = |i: usize, k: usize| frames[i].points[k / 2][k % 2];
        let flat = interpolate(frames.len(), time, |i| frames[i].time, value, count);
        flat.chunks_exact(2).map(|point| Vector2::new(point[0], point[1])).collect()
    }
}

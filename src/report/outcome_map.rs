//! Outcome maps: panels of coloured cells over two linear or logarithmic axes, with a common legend.

use super::chart::{LABEL, LABEL_HEIGHT, PLOT, WIDTH};
use super::chart_axis::ChartAxis;
use super::svg::{Anchor, Colour, Svg, width as text_width};

/// Size of one of several panels, and height of the legend, px.
const PANEL: (f64, f64) = (360.0, 290.0);
const LEGEND: f64 = 54.0;
/// Colour of theoretical boundaries.
const BOUNDARY: Colour = Colour::INK;

/// A possible outcome of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Category {
    /// Legend label.
    pub label: &'static str,
    /// Colour, red, green and blue.
    pub colour: [u8; 3],
    /// True if it has light strokes over its colour, so that it is seen on dark pages too.
    pub hatched: bool,
}

/// A panel of cells.
#[derive(Debug, Clone)]
pub struct Panel {
    /// Title.
    pub title: String,
    /// Index of the category for each x and y.
    pub cells: Vec<Vec<usize>>,
    /// A theoretical boundary; empty if there is none.
    pub boundary: Vec<(f64, f64)>,
}

/// The map.
#[derive(Debug, Clone)]
pub struct OutcomeMap {
    /// Title.
    pub title: String,
    /// Label of the x axis, and its values, increasing.
    pub x: (String, Vec<f64>),
    /// True if x is linear, otherwise logarithmic.
    pub linear: bool,
    /// Label of the y axis, and its values, increasing; y is logarithmic.
    pub y: (String, Vec<f64>),
    /// Label of the boundary.
    pub boundary: String,
    /// The categories.
    pub categories: Vec<Category>,
    /// The panels, two per row.
    pub panels: Vec<Panel>,
}

impl OutcomeMap {
    /// The map as an SVG document.
    pub fn svg(&self) -> String {
        // A single panel is as wide as a chart, of several two stand side by side.
        let (columns, size) = if self.panels.len() > 1 { (2, PANEL) } else { (1, (WIDTH - 10.0, PLOT + 80.0)) };
        let rows = self.panels.len().div_ceil(columns).max(1) as f64;
        let (width_all, top) = (columns as f64 * size.0 + 10.0, 40.0);
        let mut svg = Svg::new(width_all, top + rows * size.1 + LEGEND, &self.title);
        svg.heading((width_all / 2.0, 24.0), &self.title, 17.0, width_all - 20.0);
        for (i, panel) in self.panels.iter().enumerate() {
            let at = ((i % columns) as f64 * size.0, top + (i / columns) as f64 * size.1);
            self.panel(&mut svg, panel, at, size);
        }
        self.legend(&mut svg, top + rows * size.1 + 8.0, width_all);
        svg.finish()
    }

    fn panel(&self, svg: &mut Svg, panel: &Panel, (left, top): (f64, f64), size: (f64, f64)) {
        let [x, y] = [edges(&self.x.1, self.linear), edges(&self.y.1, false)];
        let axis = |edges: &[f64], linear: bool| {
            let ends = [edges[0], edges[edges.len() - 1]];
            if linear { ChartAxis::from(ends) } else { ChartAxis::from_logs(ends.map(f64::log10)) }
        };
        let up = axis(&y, false).apart(size.1 - 70.0, |_| LABEL_HEIGHT);
        let labels = up.ticks.iter().map(|(_, label)| text_width(label, LABEL)).fold(0.0, f64::max);
        // Room for the name and the labels of y.
        let room = (labels + 30.0).max(66.0);
        let (left, top, width, height) = (left + room, top + 24.0, size.0 - room - 16.0, size.1 - 70.0);
        let across = axis(&x, self.linear).apart(width, |label| text_width(label, LABEL) + 8.0);
        let at = |px: f64, py: f64| Some((left + width * across.place(px)?, top + height * (1.0 - up.place(py)?)));
        svg.heading((left + width / 2.0, top - 7.0), &panel.title, 14.0, width);
        for (column, x) in panel.cells.iter().zip(x.windows(2)) {
            // One field for each run of equal cells.
            let mut low = 0;
            for same in column.chunk_by(|a, b| a == b) {
                let high = low + same.len();
                if let (Some(from), Some(to)) = (at(x[0], y[low]), at(x[1], y[high])) {
                    let Category { colour, hatched, .. } = self.categories[same[0]];
                    let (corner, size) = ([from.0, to.1], [to.0 - from.0, from.1 - to.1]);
                    svg.cell(corner, size.map(|side| side + 0.3), colour);
                    if hatched {
                        svg.hatch(corner, size);
                    }
                }
                low = high;
            }
        }
        let boundary: Vec<_> = panel.boundary.iter().map(|(x, y)| [across.part(*x), up.part(*y)]).collect();
        for piece in boundary.windows(2).filter_map(|ends| clipped([ends[0], ends[1]])) {
            let ends = piece.map(|[x, y]| (left + width * x, top + height * (1.0 - y)));
            svg.line(&ends, BOUNDARY, 2.0, "");
        }
        let [low, high] = [(left, top + height), (left + width, top)];
        svg.line(&[low, (low.0, high.1), high, (high.0, low.1), low], Colour::SOFT, 1.0, "");
        for (place, label) in across.ticks.iter().filter(|(_, label)| !label.is_empty()) {
            svg.text((left + width * place, top + height + 15.0), label, LABEL, Anchor::Middle, Colour::SOFT);
        }
        for (place, label) in up.ticks.iter().filter(|(_, label)| !label.is_empty()) {
            svg.text((left - 6.0, top + height * (1.0 - place) + 4.0), label, LABEL, Anchor::End, Colour::SOFT);
        }
        svg.heading((left + width / 2.0, top + height + 33.0), &self.x.0, 13.0, width);
        svg.upright_heading((left - room + 18.0, top + height / 2.0), &self.y.0, 13.0, height);
    }

    fn legend(&self, svg: &mut Svg, top: f64, right: f64) {
        let bounded = self.panels.iter().any(|panel| !panel.boundary.is_empty());
        let occurs =
            |index: usize| self.panels.iter().any(|panel| panel.cells.iter().flatten().any(|cell| *cell == index));
        let some = self.categories.iter().enumerate().filter(|(index, _)| occurs(*index));
        let colours = some.map(|(_, category)| (category.label, Some(*category)));
        let (mut left, mut top) = (14.0, top);
        for (label, colour) in colours.chain(bounded.then_some((self.boundary.as_str(), None))) {
            let room = 36.0 + text_width(label, 13.0);
            if left > 14.0 && left + room > right {
                (left, top) = (14.0, top + 20.0);
            }
            match colour {
                Some(Category { colour, hatched, .. }) => {
                    svg.cell([left, top], [14.0, 14.0], colour);
                    if hatched {
                        svg.hatch([left, top], [14.0, 14.0]);
                    }
                }
                None => svg.line(&[(left, top + 7.0), (left + 14.0, top + 7.0)], BOUNDARY, 2.0, ""),
            }
            svg.text((left + 20.0, top + 12.0), label, 13.0, Anchor::Start, Colour::SOFT);
            left += room;
        }
    }
}

/// The part of a line that is between 0 and 1 in both coordinates (Liang and Barsky 1984); `None` if there is none.
fn clipped([from, to]: [[f64; 2]; 2]) -> Option<[[f64; 2]; 2]> {
    let way = [to[0] - from[0], to[1] - from[1]];
    let (mut enters, mut leaves) = (0.0_f64, 1.0_f64);
    for axis in [0, 1] {
        if way[axis] == 0.0 {
            if !(0.0..=1.0).contains(&from[axis]) {
                return None;
            }
        } else {
            let [a, b] = [0.0, 1.0].map(|border| (border - from[axis]) / way[axis]);
            (enters, leaves) = (enters.max(a.min(b)), leaves.min(a.max(b)));
        }
    }
    let at = |part: f64| [from[0] + part * way[0], from[1] + part * way[1]];
    (enters < leaves).then(|| [at(enters), at(leaves)])
}

/// The borders of cells around `values`: midway between them, and symmetric at the ends.
pub(super) fn edges(values: &[f64], linear: bool) -> Vec<f64> {
    let v: Vec<f64> = values.iter().map(|x| if linear { *x } else { x.ln() }).collect();
    let step = |i: usize| if v.len() < 2 { 0.5 } else { 0.5 * (v[i + 1] - v[i]) };
    let last = v.len() - 1;
    let inner = (0..last).map(|i| v[i] + step(i));
    let all = [v[0] - step(0)].into_iter().chain(inner).chain([v[last] + step(last.saturating_sub(1))]);
    all.map(|x| if linear { x } else { x.exp() }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_small_steps_leave_the_name_of_their_axis_its_room() {
        let label = "2·10⁻⁶";
        let category = Category { label: "stable", colour: [20, 172, 125], hatched: false };
        let map = OutcomeMap {
            title: "steps".to_string(),
            x: ("modulus".to_string(), vec![1.0, 2.0]),
            linear: false,
            y: ("time step (s)".to_string(), vec![1e-6, 3e-6, 1e-5]),
            boundary: String::new(),
            categories: vec![category],
            panels: vec![Panel { title: String::new(), cells: vec![vec![0; 3]; 2], boundary: Vec::new() }],
        };
        let svg = map.svg();
        let place = |text: &str, before: &str| -> f64 {
            let element = svg.split(&format!(">{text}</text>")).next().unwrap_or_default();
            let element = element.rsplit("<text ").next().unwrap_or_default();
            let rest = element.split(before).nth(1).unwrap_or_default();
            rest.split([' ', '"']).next().and_then(|x| x.parse().ok()).unwrap_or(f64::NAN)
        };
        let (name, end) = (place("time step (s)", "translate("), place(label, "x=\""));
        assert!(end - text_width(label, LABEL) > name + 2.0, "{name} {end}");
    }

    #[test]
    fn a_boundary_ends_at_the_border_of_its_panel() {
        assert_eq!(clipped([[0.5, 0.5], [0.5, 1.5]]), Some([[0.5, 0.5], [0.5, 1.0]]));
        assert_eq!(clipped([[-1.0, 0.5], [3.0, 0.5]]), Some([[0.0, 0.5], [1.0, 0.5]]));
        assert_eq!(clipped([[1.5, 0.0], [1.5, 1.0]]), None);
        assert_eq!(clipped([[-1.0, 0.5], [0.5, 2.0]]), None);
    }
}

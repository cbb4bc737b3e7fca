//! Heat maps: a quantity over two axes as cell colours, with extreme values marked.

use std::collections::BTreeSet;

use super::chart::{
    CellCases, Figure, LABEL, LABEL_HEIGHT, LINE, PLOT, PlotArea, Scale, TITLE, WIDTH, readable_along, readable_up,
};
use super::chart_axis::ChartAxis;
use super::outcome_map::edges;
use super::svg::{Anchor, Colour, Svg, width};
use crate::number_format::significant;

/// Sequential colour map with increasing lightness, which survives print and colour-vision deficiency: matplotlib's viridis at
/// equal steps.
const SEQUENTIAL: [[u8; 3]; 10] = [
    [68, 1, 84],
    [72, 40, 120],
    [62, 73, 137],
    [49, 104, 142],
    [38, 130, 142],
    [31, 158, 137],
    [53, 183, 121],
    [110, 206, 88],
    [181, 222, 43],
    [253, 231, 37],
];
/// Diverging colour map with zero in the middle: ColorBrewer's RdBu, from blue to red.
pub(super) const DIVERGING: [[u8; 3]; 5] =
    [[33, 102, 172], [146, 197, 222], [247, 247, 247], [244, 165, 130], [178, 24, 43]];

/// Number of colours.
const COLOUR_COUNT: usize = 64;
/// Positive values are coloured by their logarithm if the largest exceeds this multiple of the least.
const LOG_SCALE_RANGE: f64 = 100.0;
/// Left end of the legend, px.
const LEGEND_LEFT: f64 = 20.0;
/// The marks of the largest and of the least value: a dot and a diamond.
const LARGEST_MARK: usize = 0;
const LEAST_MARK: usize = 2;
/// Half the size of the stroke on a cell whose motion is not periodic yet, px at most.
const UNSETTLED_MARK: f64 = 6.0;
/// Width of the colour scale without its labels, px.
const SCALE_WIDTH: f64 = 44.0;

/// An axis of a heat map.
#[derive(Debug, Clone)]
pub struct HeatMapAxis {
    /// Its name.
    pub name: String,
    /// Positions of its levels, increasing; for categories 0, 1, 2 …
    pub at: Vec<f64>,
    /// Its scale: linear, logarithmic or categories.
    pub scale: Scale,
}

impl HeatMapAxis {
    /// The borders between the levels.
    fn edges(&self) -> Vec<f64> {
        edges(&self.at, self.scale != Scale::LogX)
    }

    fn axis(&self) -> ChartAxis {
        let edges = self.edges();
        match &self.scale {
            Scale::Categories(labels) => ChartAxis::categories(labels),
            Scale::LogX => ChartAxis::logarithmic(edges.into_iter()),
            _ => ChartAxis::linear(edges.into_iter()),
        }
    }

    fn is_of_categories(&self) -> bool {
        matches!(self.scale, Scale::Categories(_))
    }
}

/// A quantity over two axes.
#[derive(Debug, Clone)]
pub struct HeatMap {
    /// Title.
    pub title: String,
    /// The horizontal axis.
    pub x: HeatMapAxis,
    /// The vertical axis.
    pub y: HeatMapAxis,
    /// Label of the quantity, with its unit.
    pub value: String,
    /// Level of x, level of y, value, and index of the case. If several cases share a cell, the last one is shown.
    pub cells: Vec<(usize, usize, f64, usize)>,
    /// Indices of the cases that failed.
    pub failed: Vec<usize>,
    /// Indices of the cases whose value is of a motion that is not periodic yet. They have a mark, and are neither the largest nor
    /// the least, unless all are like that.
    pub unsettled: BTreeSet<usize>,
}

/// A quantity over two axes with so many levels that they look continuous, without marks.
#[derive(Debug, Clone)]
pub struct Raster {
    /// Title.
    pub title: String,
    /// The horizontal axis.
    pub x: HeatMapAxis,
    /// The vertical axis.
    pub y: HeatMapAxis,
    /// Label of the quantity, with its unit.
    pub value: String,
    /// Level of x, level of y, and value.
    pub cells: Vec<(usize, usize, f64)>,
}

/// Number of colours of a raster: neighbours of one colour are drawn as one.
const RASTER_COLOURS: usize = 21;

impl Raster {
    /// The raster as an SVG document.
    pub fn svg(&self) -> String {
        let scale = ColourScale::of(self.cells.iter().map(|cell| cell.2));
        let canvas = MapCanvas::new(&self.title, [&self.x, &self.y], &scale);
        let coarse = |value: f64| {
            (scale.shade(value) * RASTER_COLOURS / COLOUR_COUNT) * (COLOUR_COUNT - 1) / (RASTER_COLOURS - 1)
        };
        let mut shades = vec![vec![None; self.x.at.len()]; self.y.at.len()];
        for (i, j, value) in self.cells.iter().filter(|cell| cell.2.is_finite()) {
            shades[*j][*i] = Some(coarse(*value));
        }
        let MapCanvas { mut svg, frame, columns, rows, .. } = canvas;
        let mut fields: Vec<Vec<[f64; 4]>> = vec![Vec::new(); COLOUR_COUNT];
        for (j, row) in shades.iter().enumerate() {
            let mut first = 0;
            for same in row.chunk_by(|a, b| a == b) {
                if let Some(shade) = same[0] {
                    let (low, high) =
                        (frame.at(columns[first], rows[j]), frame.at(columns[first + same.len()], rows[j + 1]));
                    fields[shade].push([low.0, high.1, high.0 - low.0, low.1 - high.1]);
                }
                first += same.len();
            }
        }
        for (shade, fields) in fields.iter().enumerate().filter(|(_, fields)| !fields.is_empty()) {
            svg.cells(fields, scale.colour(shade));
        }
        scale.draw(&mut svg, &frame, &self.value);
        svg.finish()
    }
}

/// The axes of a map with the place of its colour scale.
struct MapCanvas {
    svg: Svg,
    frame: PlotArea,
    axes: [ChartAxis; 2],
    /// Places of the borders between the levels, from 0 to 1 along each axis.
    columns: Vec<f64>,
    rows: Vec<f64>,
}

impl MapCanvas {
    fn new(title: &str, [along, up]: [&HeatMapAxis; 2], scale: &ColourScale) -> Self {
        let y = readable_up(up.axis(), PLOT);
        let frame = PlotArea::about(&y, LINE);
        let frame = PlotArea { width: frame.width - SCALE_WIDTH - scale.label_width(), ..frame };
        let x = readable_along(along.axis(), frame.width, along.is_of_categories());
        let height = frame.top + frame.height + frame.height_below(&x, along.is_of_categories());
        let mut svg = Svg::new(WIDTH, height, title);
        svg.heading((WIDTH / 2.0, 24.0), title, TITLE, WIDTH - 20.0);
        frame.draw_y(&mut svg, &y, &up.name);
        frame.draw_x(&mut svg, &x, &along.name, along.is_of_categories());
        let [columns, rows] = [(&x, along.edges()), (&y, up.edges())].map(|(axis, edges)| {
            edges.into_iter().map(|edge| axis.place(edge).unwrap_or(f64::NAN)).collect::<Vec<_>>()
        });
        Self { svg, frame, axes: [x, y], columns, rows }
    }
}

impl HeatMap {
    /// The map as a figure of a page that plays its cases.
    pub fn figure(&self, file: impl Into<String>, caption: impl Into<String>) -> Figure {
        let (svg, cells) = self.drawn();
        Figure { cells: Some(cells), ..Figure::new(file, caption, svg) }
    }

    /// True if some of the cells are marked as not periodic yet, but not all of them.
    pub fn has_unsettled(&self) -> bool {
        let settled = self.known().filter(|cell| !self.unsettled.contains(&cell.3)).count();
        settled > 0 && settled < self.known().count()
    }

    /// The map as an SVG document.
    #[cfg(test)]
    fn svg(&self) -> String {
        self.drawn().0
    }

    fn known(&self) -> impl Iterator<Item = &(usize, usize, f64, usize)> + Clone {
        self.cells.iter().filter(|cell| cell.2.is_finite())
    }

    /// The map as an SVG document, and where its cases are.
    fn drawn(&self) -> (String, CellCases) {
        let known = || self.known();
        // Values of one sign are coloured by their size, as everywhere on the page; values of two signs by their order.
        let [negative, positive] = [known().any(|cell| cell.2 < 0.0), known().any(|cell| cell.2 > 0.0)];
        let size = |cell: &(usize, usize, f64, usize)| if positive { cell.2 } else { cell.2.abs() };
        let by_size = |a: &&(usize, usize, f64, usize), b: &&(usize, usize, f64, usize)| size(a).total_cmp(&size(b));
        let is_settled = |cell: &&(usize, usize, f64, usize)| !self.unsettled.contains(&cell.3);
        let any_settled = known().any(|cell| is_settled(&cell));
        let ranked = || known().filter(|cell| !any_settled || is_settled(cell));
        let (least, largest) = (ranked().min_by(by_size), ranked().max_by(by_size));
        let [most, fewest] = match (negative, positive) {
            (true, true) => ["highest", "lowest"],
            (true, false) => ["largest in size", "least in size"],
            _ => ["largest", "least"],
        };
        let scale = ColourScale::of(known().map(|cell| cell.2));
        let MapCanvas { mut svg, frame, axes: [x, y], columns, rows } =
            MapCanvas::new(&self.title, [&self.x, &self.y], &scale);
        let field = |i: usize, j: usize| {
            let (low, high) = (frame.at(columns[i], rows[j]), frame.at(columns[i + 1], rows[j + 1]));
            [low.0, high.1, high.0 - low.0, low.1 - high.1]
        };
        // Where the levels of a cell are, which is not its middle where they are unevenly spaced.
        let at = |i: usize, j: usize| {
            let place = |axis: &ChartAxis, level: f64| axis.place(level).unwrap_or(f64::NAN);
            frame.at(place(&x, self.x.at[i]), place(&y, self.y.at[j]))
        };
        let mut fields: Vec<Vec<[f64; 4]>> = vec![Vec::new(); COLOUR_COUNT];
        for (i, j, value, _) in known() {
            fields[scale.shade(*value)].push(field(*i, *j));
        }
        for (shade, fields) in fields.iter().enumerate().filter(|(_, fields)| !fields.is_empty()) {
            svg.cells(fields, scale.colour(shade));
        }
        // A case that failed has a cross; one that ended without a value, as a Strouhal number without speed, a short bar.
        for (i, j, _, case) in self.cells.iter().filter(|cell| !cell.2.is_finite()) {
            let ([_, _, width, height], (x, y)) = (field(*i, *j), at(*i, *j));
            let half = 0.25 * width.min(height);
            if self.failed.contains(case) {
                svg.line(&[(x - half, y - half), (x + half, y + half)], Colour::SOFT, 1.0, "");
                svg.line(&[(x - half, y + half), (x + half, y - half)], Colour::SOFT, 1.0, "");
            } else {
                svg.line(&[(x - 0.5 * half, y), (x + 0.5 * half, y)], Colour::SOFT, 1.0, "");
            }
        }
        for (i, j, _, _) in known().filter(|cell| !is_settled(cell)) {
            let ([_, _, width, height], (x, y)) = (field(*i, *j), at(*i, *j));
            let half = (0.25 * width.min(height)).min(UNSETTLED_MARK);
            let stroke = [(x - half, y + half), (x + half, y - half)];
            svg.line(&stroke, Colour::PAPER, 4.0, "");
            svg.line(&stroke, Colour::INK, 1.5, "");
        }
        let mut left = LEGEND_LEFT;
        for (what, cell, mark) in [(most, largest, LARGEST_MARK), (fewest, least, LEAST_MARK)] {
            let Some((i, j, value, case)) = cell else { continue };
            let text = format!("{what}: {} (case {case})", significant(*value, 4));
            let middle = 36.0 + 0.7 * LINE;
            for at in [at(*i, *j), (left + 6.0, middle - 4.5)] {
                svg.mark(mark, at, 6.0, Colour::PAPER);
                svg.mark(mark, at, 4.0, Colour::INK);
            }
            svg.text((left + 17.0, middle), &text, LABEL, Anchor::Start, Colour::INK);
            left += 45.0 + width(&text, LABEL);
        }
        scale.draw(&mut svg, &frame, &self.value);
        let cells = CellCases {
            columns: columns.iter().map(|x| frame.at(*x, 0.0).0).collect(),
            rows: rows.iter().map(|y| frame.at(0.0, *y).1).collect(),
            cases: self.cells.iter().map(|(i, j, _, case)| [*i, *j, *case]).collect(),
        };
        (svg.finish(), cells)
    }
}

/// The colour scale. Values of one sign that differ by orders of magnitude are coloured by the logarithm of their size.
struct ColourScale {
    axis: ChartAxis,
    signed: bool,
    /// True for sizes of negative values.
    of_sizes: bool,
}

impl ColourScale {
    fn of(values: impl Iterator<Item = f64> + Clone) -> Self {
        let least = values.clone().fold(f64::INFINITY, f64::min);
        let largest = values.clone().fold(f64::NEG_INFINITY, f64::max);
        let signed = least < 0.0 && largest > 0.0;
        let of_sizes = largest < 0.0 && -least > LOG_SCALE_RANGE * -largest;
        let axis = if signed {
            let most = largest.max(-least);
            ChartAxis::linear([-most, most].into_iter())
        } else if of_sizes || least > 0.0 && largest > LOG_SCALE_RANGE * least {
            ChartAxis::logarithmic(values.map(f64::abs))
        } else {
            ChartAxis::linear(values)
        };
        let mut axis = axis.apart(PLOT, |_| LABEL_HEIGHT);
        let labelled = axis.ticks.iter_mut().filter(|(_, label)| of_sizes && !label.is_empty());
        labelled.for_each(|(_, label)| label.insert(0, '−'));
        Self { axis, signed, of_sizes }
    }

    /// Width of its widest label, px.
    fn label_width(&self) -> f64 {
        self.axis.ticks.iter().map(|(_, label)| width(label, LABEL)).fold(0.0, f64::max)
    }

    fn shade(&self, value: f64) -> usize {
        let value = if self.of_sizes { value.abs() } else { value };
        let place = self.axis.place(value).unwrap_or(0.0).clamp(0.0, 1.0);
        ((place * COLOUR_COUNT as f64) as usize).min(COLOUR_COUNT - 1)
    }

    /// A colour of the map, by linear interpolation.
    fn colour(&self, shade: usize) -> [u8; 3] {
        let given: &[[u8; 3]] = if self.signed { &DIVERGING } else { &SEQUENTIAL };
        let place = shade as f64 / (COLOUR_COUNT - 1) as f64 * (given.len() - 1) as f64;
        let low = (place as usize).min(given.len() - 2);
        let part = place - low as f64;
        let mixed = |k: usize| (1.0 - part) * f64::from(given[low][k]) + part * f64::from(given[low + 1][k]);
        [0, 1, 2].map(|k| mixed(k).round() as u8)
    }

    /// Draws the scale to the right of the map.
    fn draw(&self, svg: &mut Svg, frame: &PlotArea, name: &str) {
        let (left, wide, step) = (frame.left + frame.width + 16.0, 14.0, frame.height / COLOUR_COUNT as f64);
        for shade in 0..COLOUR_COUNT {
            let top = frame.top + step * (COLOUR_COUNT - 1 - shade) as f64;
            svg.cell([left, top], [wide, step + 0.3], self.colour(shade));
        }
        for (place, label) in self.axis.ticks.iter().filter(|(_, label)| !label.is_empty()) {
            let y = frame.top + (1.0 - place) * frame.height;
            svg.line(&[(left + wide, y), (left + wide + 4.0, y)], Colour::SOFT, 1.0, "");
            svg.text((left + wide + 7.0, y + 4.5), label, LABEL, Anchor::Start, Colour::SOFT);
        }
        let name = super::chart::titled(name, &self.axis);
        let middle = frame.top + 0.5 * frame.height;
        svg.upright_heading((WIDTH - 8.0, middle), &name, LABEL, frame.height + 40.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(cells: Vec<(usize, usize, f64, usize)>) -> HeatMap {
        let categories = Scale::Categories(["water", "oil"].map(str::to_string).to_vec());
        HeatMap {
            title: "thrust".to_string(),
            x: HeatMapAxis { name: "frequency (Hz)".to_string(), at: vec![1.0, 2.0, 8.0], scale: Scale::LogX },
            y: HeatMapAxis { name: "fluid".to_string(), at: vec![0.0, 1.0], scale: categories },
            value: "thrust (N)".to_string(),
            cells,
            failed: vec![3],
            unsettled: BTreeSet::new(),
        }
    }

    #[test]
    fn the_colours_of_a_rising_map_grow_lighter_and_those_of_a_signed_one_are_lightest_at_zero() {
        let light = |[r, g, b]: [u8; 3]| 0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b);
        let of = |values: &[f64]| {
            let scale = ColourScale::of(values.iter().copied());
            (0..COLOUR_COUNT).map(|shade| light(scale.colour(shade))).collect::<Vec<_>>()
        };
        assert!(of(&[1.0, 2.0]).windows(2).all(|pair| pair[0] < pair[1]));
        let signed = of(&[-1.0, 3.0]);
        assert!(signed[..COLOUR_COUNT / 2].windows(2).all(|pair| pair[0] < pair[1]));
        assert!(signed[COLOUR_COUNT / 2..].windows(2).all(|pair| pair[0] > pair[1]));
        let scale = ColourScale::of([-1.0, 3.0].into_iter());
        assert_eq!(scale.shade(0.0), COLOUR_COUNT / 2, "zero is in the middle");
    }

    #[test]
    fn every_cell_is_drawn_inside_and_what_is_largest_and_least_is_named() {
        let cells = vec![(0, 0, 1e-3, 0), (1, 0, 0.5, 1), (2, 0, 0.25, 2), (0, 1, f64::NAN, 3), (2, 1, 7e-4, 5)];
        let svg = map(cells).svg();
        assert!(svg.contains("largest: 0.5000 (case 1)") && svg.contains("least: 7.000e-4 (case 5)"), "{svg}");
        let fields = svg.split("<path d=\"").skip(1).filter_map(|path| path.split('"').next());
        assert_eq!(fields.map(|path| path.matches('M').count()).sum::<usize>(), 4, "the failed one has a cross");
        let bars = |cells| map(cells).svg().matches("stroke-width=\"1\"").count();
        let [failed, without] = [3, 4].map(|case| bars(vec![(0, 0, 1.0, 0), (0, 1, f64::NAN, case)]));
        assert_eq!(failed, without + 1, "what has no value has a bar");
        assert!(!svg.contains("NaN"));
        // No values, and a single one.
        assert!(!map(Vec::new()).svg().contains("NaN"));
        assert!(map(vec![(1, 1, -2.0, 9)]).svg().contains("largest in size: -2.000 (case 9)"));
    }

    #[test]
    fn what_is_not_periodic_yet_has_a_stroke_and_is_neither_the_largest_nor_the_least() {
        let cells = vec![(0, 0, 1.0, 0), (1, 0, 5.0, 1), (2, 0, 3.0, 2), (0, 1, 2.0, 4)];
        let of = |unsettled: &[usize]| HeatMap { unsettled: unsettled.iter().copied().collect(), ..map(cells.clone()) };
        let strokes = |map: &HeatMap| map.svg().matches("stroke-width=\"1.5\"").count();
        let some = of(&[0, 1]);
        let svg = some.svg();
        assert!(svg.contains("largest: 3.000 (case 2)") && svg.contains("least: 2.000 (case 4)"), "{svg}");
        assert!(strokes(&some) == 2 && some.has_unsettled());
        // Where all are like that, the largest of all is named.
        let all = of(&[0, 1, 2, 4]);
        assert!(all.svg().contains("largest: 5.000 (case 1)") && !all.has_unsettled());
        assert!(strokes(&of(&[])) == 0 && !of(&[]).has_unsettled());
    }

    #[test]
    fn negative_values_are_large_by_their_size_and_those_of_two_signs_high_or_low() {
        let svg = map(vec![(0, 0, -0.0026, 0), (1, 0, -1.394, 24)]).svg();
        assert!(svg.contains("largest in size: -1.394 (case 24)") && svg.contains("least in size: -0.002600 (case 0)"));
        let svg = map(vec![(0, 0, -3.0, 0), (1, 0, 1.0, 1)]).svg();
        assert!(svg.contains("highest: 1.000 (case 1)") && svg.contains("lowest: -3.000 (case 0)"), "{svg}");
    }

    /// The middle of the first ring in an SVG document, px.
    fn ring(svg: &str) -> [f64; 2] {
        let of = |name: &str| {
            let circle = svg.split("<circle ").nth(1).unwrap_or_default();
            circle
                .split(&format!("{name}=\""))
                .nth(1)
                .and_then(|rest| rest.split('"').next()?.parse().ok())
                .unwrap_or(f64::NAN)
        };
        ["cx", "cy"].map(of)
    }

    #[test]
    fn the_marked_case_stands_at_its_level_by_the_ticks() {
        let levels = HeatMapAxis { name: "a".to_string(), at: vec![0.0, 2.0, 5.0], scale: Scale::Linear };
        let cells = vec![(0, 0, 0.1, 0), (1, 0, 0.9, 1), (2, 0, 0.5, 2)];
        let svg = HeatMap { x: levels, ..map(cells) }.svg();
        // Located by the label of the tick.
        let tick = |label: &str| -> f64 {
            let before = svg.split(&format!(">{label}</text>")).next().unwrap_or_default();
            let text = before.rsplit("<text x=\"").next().unwrap_or_default();
            text.split('"').next().and_then(|x| x.parse().ok()).unwrap_or(f64::NAN)
        };
        assert!((ring(&svg)[0] - tick("2")).abs() < 0.02, "{} {}", ring(&svg)[0], tick("2"));
    }

    #[test]
    fn negative_values_over_orders_of_magnitude_are_coloured_by_the_logarithm_of_their_size() {
        let scale = ColourScale::of([-1e-6, -1e-3, -1.0].into_iter());
        let shades = [-1e-6, -1e-3, -1.0].map(|value| scale.shade(value));
        assert!(
            shades[0] < 5 && shades[1].abs_diff(COLOUR_COUNT / 2) < 3 && shades[2] > COLOUR_COUNT - 6,
            "{shades:?}"
        );
        assert!(scale.axis.ticks.iter().all(|(_, label)| label.is_empty() || label.starts_with('−')));
    }

    #[test]
    fn no_label_of_the_colours_is_cut() {
        for largest in [5e-12, 3e-5, 0.02, 7e9] {
            let svg = map(vec![(0, 0, 1e-3 * largest, 0), (1, 0, largest, 1)]).svg();
            assert!(!svg.contains('…'), "{svg}");
        }
    }
}

//! Charts as SVG: line and scatter plots with axes, legend and labels, in one style for all figures. Time and memory are
//! proportional to the data, and nothing is drawn outside the chart, whatever the data.

use nalgebra::Vector2;

use super::chart_axis::{ChartAxis, told_apart};
use super::packed_numbers::PackedCurve;
pub use super::svg::SERIES;
use super::svg::{Anchor, Colour, Svg, cut, dashes, width, wrapped};
use crate::number_format::superscript;

/// Width of a chart and height of its plot, px.
pub(super) const WIDTH: f64 = 640.0;
pub(super) const PLOT: f64 = 310.0;

/// Font sizes, px.
pub(super) const TITLE: f64 = 17.0;
const NAME: f64 = 15.0;
pub(super) const LABEL: f64 = 13.0;

/// Height of a line of the legend, px, and most lines of it.
pub(super) const LINE: f64 = 19.0;
const MAX_LEGEND_LINES: usize = 8;

/// Width of the widest label of a legend, px.
const MAX_ENTRY: f64 = 420.0;

/// Room that a label above a line takes, px.
const ROOM_OF_LABEL: f64 = 22.0;

/// Width of the widest label of y, and height that a label takes there, px.
const MAX_LABEL: f64 = 160.0;
pub(super) const LABEL_HEIGHT: f64 = 15.0;

/// Space between two labels of x, px.
const BETWEEN_LABELS: f64 = 8.0;

/// Points of a line that are all within this of the first are drawn as one dot, px.
const STILL: f64 = 0.5;

/// Height of the strokes of [`Mark::Missing`], px.
const MISSING_HEIGHT: f64 = 9.0;

/// Most lines of the label of a category below a chart, and their height, px.
const MAX_LINES_OF_CATEGORY: usize = 3;
const LINE_BELOW: f64 = 15.0;

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A line.
    Line,
    /// A line with a dot at each point.
    Dotted,
    /// Dots only.
    Dots,
    /// A thin grey line in the background, without a legend entry.
    Ghost,
    /// Invisible: it only extends the axes, so that charts can be compared.
    Unseen,
    /// A thin dark closed line with its label next to the last point, without a legend entry: the triangle that shows a slope.
    Slope,
    /// The same with its label above the line, or on it, from the last point: a level.
    Level,
    /// Short strokes on the axis at the x of points without a value, within what the others span; without a legend entry.
    Missing,
}

/// One series of a chart.
#[derive(Debug, Clone)]
pub struct Series {
    /// Legend label.
    pub label: String,
    /// Points.
    pub points: Vec<(f64, f64)>,
    /// Its style.
    pub mark: Mark,
    /// Index of its colour and dashes, if it is the same in all figures; otherwise its index among the series.
    pub colour: Option<usize>,
    /// Dots at or below this are hollow: it is only an upper bound of their values.
    pub hollow_to: f64,
    /// A text for each dot, or none: shown under the cursor, and on a page copied by a click.
    pub notes: Vec<String>,
}

impl Series {
    /// A series with a style.
    pub fn new(label: impl Into<String>, points: Vec<(f64, f64)>, mark: Mark) -> Self {
        Self { label: label.into(), points, mark, colour: None, hollow_to: f64::NEG_INFINITY, notes: Vec::new() }
    }

    /// With the `k`-th colour and dashes.
    pub fn coloured(self, k: usize) -> Self {
        Self { colour: Some(k), ..self }
    }

    /// With a text for each dot.
    pub fn with_notes(self, notes: Vec<String>) -> Self {
        Self { notes, ..self }
    }

    /// With hollow dots at or below `level`.
    pub fn hollow_to(self, level: f64) -> Self {
        Self { hollow_to: level, ..self }
    }
}

/// The scales of a chart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Scale {
    /// Both linear.
    Linear,
    /// Both linear, with equal scales.
    Equal,
    /// x logarithmic; only positive x are shown.
    LogX,
    /// y logarithmic; absolute values, down to this many decades below the largest.
    LogY(i32),
    /// y logarithmic in both directions, with this many decades each; smaller values are zero.
    SignedLogY(i32),
    /// Both logarithmic; only positive numbers are shown.
    LogLog,
    /// x is the index of a category, 0, 1, 2 …, with these names. Lines become bars.
    Categories(Vec<String>),
}

/// A chart.
#[derive(Debug, Clone)]
pub struct Chart {
    /// Title.
    pub title: String,
    /// Label of the x axis, with unit.
    pub x: String,
    /// Label of the y axis, with unit.
    pub y: String,
    /// Scales.
    pub scale: Scale,
    /// Series, drawn in order.
    pub series: Vec<Series>,
}

/// A figure with its file name and caption.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Figure {
    /// Name of its file.
    pub file: String,
    /// Its caption.
    pub caption: String,
    /// Its SVG document.
    pub svg: String,
    /// What a page's script draws instead, if it can.
    #[serde(skip)]
    pub chart: Option<InteractiveChart>,
    /// The cases in the cells of a map, for a page that plays them.
    #[serde(skip)]
    pub cells: Option<CellCases>,
}

/// The positions of the cases on a map.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct CellCases {
    /// Borders of columns, from the left, and of rows, from below, px of the figure.
    pub(super) columns: Vec<f64>,
    pub(super) rows: Vec<f64>,
    /// Column, row and index of each case.
    pub(super) cases: Vec<[usize; 3]>,
}

impl Figure {
    /// A figure.
    pub fn new(file: impl Into<String>, caption: impl Into<String>, svg: String) -> Self {
        Self { file: file.into(), caption: caption.into(), svg, chart: None, cells: None }
    }

    /// The figure of a chart, even if it is empty.
    pub fn of_chart(file: impl Into<String>, caption: impl Into<String>, chart: &Chart) -> Self {
        Self { chart: chart.interactive(), ..Self::new(file, caption, chart.svg()) }
    }
}

/// A chart of lines and dots over increasing x, which shows values under the cursor and parts of its axes.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct InteractiveChart {
    title: String,
    x: String,
    y: String,
    /// Scale of x: `linear`, or `log`.
    x_scale: &'static str,
    /// Scale of y: `linear`, `log`, or `signed` for logarithms in both directions.
    y_scale: &'static str,
    /// Least size that a logarithmic y shows, if it does not follow from the data.
    floor: Option<f64>,
    pub(super) series: Vec<InteractiveSeries>,
}

/// A series of it.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub(super) struct InteractiveSeries {
    label: String,
    colour: usize,
    dash: &'static str,
    dots: bool,
    line: bool,
    /// A page has it once for all series that share it.
    #[serde(skip)]
    pub(super) x: PackedCurve,
    y: PackedCurve,
}

/// The plot area, px.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlotArea {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) width: f64,
    pub(super) height: f64,
}

impl Chart {
    /// A chart with a title, labels, scales and series.
    pub fn new(
        title: impl Into<String>,
        x: impl Into<String>,
        y: impl Into<String>,
        scale: Scale,
        series: Vec<Series>,
    ) -> Self {
        Self { title: title.into(), x: x.into(), y: y.into(), scale, series }
    }

    /// The chart as a figure with this file name and caption, which also names the series that the scale cannot show; `None` if it
    /// can show none at all.
    pub fn figure(&self, file: impl Into<String>, caption: impl Into<String>) -> Option<Figure> {
        let axes = self.axes();
        let given = || self.series.iter().filter(|series| series.mark.is_of_data() && !series.points.is_empty());
        let (shown, hidden): (Vec<_>, Vec<_>) = given().partition(|series| self.shows(series, &axes));
        if shown.is_empty() {
            return None;
        }
        let names: Vec<_> =
            hidden.iter().map(|series| series.label.as_str()).filter(|label| !label.is_empty()).collect();
        let mut caption = caption.into();
        if !names.is_empty() {
            caption += &format!(" Without a value on this scale: {}.", names.join(", "));
        }
        Some(Figure::of_chart(file, caption, self))
    }

    /// The chart as a page's script draws it; `None` for scales and marks that it does not have, and where x goes back.
    fn interactive(&self) -> Option<InteractiveChart> {
        let (x_scale, y_scale, decades) = match self.scale {
            Scale::Linear => ("linear", "linear", None),
            Scale::LogX => ("log", "linear", None),
            Scale::LogY(decades) => ("linear", "log", Some(decades)),
            Scale::SignedLogY(decades) => ("linear", "signed", Some(decades)),
            Scale::LogLog => ("log", "log", None),
            Scale::Equal | Scale::Categories(_) => return None,
        };
        let rises = |series: &Series| series.points.is_sorted_by(|a, b| a.0 <= b.0);
        let is_empty = self.series.iter().all(|series| series.points.is_empty());
        if is_empty
            || !self.series.iter().all(|series| series.mark.is_of_data() && rises(series) && series.notes.is_empty())
        {
            return None;
        }
        let sizes = self.series.iter().flat_map(|series| &series.points).map(|point| point.1.abs());
        let largest = sizes.filter(|size| size.is_finite()).fold(0.0, f64::max);
        let of = |(k, series): (usize, &Series)| {
            let colour = series.colour.unwrap_or(k);
            let sized = |y: f64| if y_scale == "log" { y.abs() } else { y };
            InteractiveSeries {
                label: series.label.clone(),
                colour: colour % SERIES,
                dash: dashes(colour),
                dots: series.mark != Mark::Line || series.points.len() == 1,
                line: series.mark != Mark::Dots,
                x: PackedCurve::of(series.points.iter().map(|point| point.0), x_scale == "linear"),
                y: PackedCurve::of(series.points.iter().map(|point| sized(point.1)), y_scale == "linear"),
            }
        };
        Some(InteractiveChart {
            title: self.title.clone(),
            x: self.x.clone(),
            y: self.y.clone(),
            x_scale,
            y_scale,
            floor: decades.filter(|_| largest > 0.0).map(|decades| largest * 10.0_f64.powi(-decades)),
            series: self.series.iter().enumerate().map(of).collect(),
        })
    }

    /// True if the axes can show a point of a series.
    fn shows(&self, series: &Series, axes: &[ChartAxis; 2]) -> bool {
        series.points.iter().any(|point| self.place(*point, axes).is_some())
    }

    /// The place of a point, from 0 to 1 along each axis; `None` if the scale cannot show it.
    fn place(&self, (px, py): (f64, f64), [x, y]: &[ChartAxis; 2]) -> Option<(f64, f64)> {
        let floor = match self.scale {
            Scale::LogY(_) => y.low(),
            _ => 0.0,
        };
        if !(px.is_finite() && py.is_finite()) {
            return None;
        }
        let py = if floor > 0.0 { py.abs().max(floor) } else { py };
        Some((x.place(px)?, y.place(py)?))
    }

    /// The chart as an SVG document.
    pub fn svg(&self) -> String {
        let [x, y] = self.axes();
        let y = readable_up(y, PLOT);
        let axes = [x, y];
        let named = self.series.iter().filter(|series| series.mark.is_of_data()).enumerate();
        let entry = |(k, series): (usize, &Series)| LegendEntry {
            k: series.colour.unwrap_or(k),
            mark: series.mark,
            label: series.label.clone(),
            at: (0.0, 0.0),
        };
        let shown = named.filter(|(_, series)| !series.label.is_empty() && self.shows(series, &axes));
        let legend = Legend::of(shown.map(entry).collect());
        let [x, y] = axes;
        let frame = PlotArea::about(&y, legend.height());
        let [x, y] = match self.scale {
            Scale::Equal => {
                // Values without extent do not define a scale.
                let pixel = |axis: &ChartAxis, room: f64, other: &ChartAxis| match axis.is_point && !other.is_point {
                    true => 0.0,
                    false => axis.size() / room,
                };
                let pixel = pixel(&x, frame.width, &y).max(pixel(&y, frame.height, &x));
                let y = y.widened(pixel * frame.height / y.size());
                [x.widened(pixel * frame.width / x.size()), readable_up(y, frame.height)]
            }
            _ => [x, y],
        };
        let categories = matches!(self.scale, Scale::Categories(_));
        let x = readable_along(x, frame.width, categories);
        let height = frame.top + frame.height + frame.height_below(&x, categories);
        let mut svg = Svg::new(WIDTH, height, &self.title);
        svg.heading((WIDTH / 2.0, 24.0), &self.title, TITLE, WIDTH - 20.0);
        legend.draw(&mut svg);
        frame.draw_y(&mut svg, &y, &self.y);
        frame.draw_x(&mut svg, &x, &self.x, categories);
        let axes = [x, y];
        let place = |point: (f64, f64)| self.place(point, &axes).map(|(x, y)| frame.at(x, y));
        let mut named = 0;
        let mut slopes = Vec::new();
        for series in &self.series {
            if series.mark == Mark::Missing {
                let at = series.points.iter().filter_map(|point| axes[0].place(point.0)).map(|x| frame.at(x, 0.0));
                at.for_each(|(x, y)| svg.line(&[(x, y), (x, y - MISSING_HEIGHT)], Colour::INK, 1.5, ""));
                continue;
            }
            let points: Vec<_> = series.points.iter().map(|p| place(*p)).collect();
            let slot = frame.width / axes[0].size();
            self.draw(&mut svg, series, &points, series.colour.unwrap_or(named), (&frame, slot));
            slopes
                .extend(points.iter().flatten().last().filter(|_| series.mark == Mark::Slope).map(|at| (series, *at)));
            named += usize::from(series.mark.is_of_data());
        }
        label_slopes(&mut svg, &slopes);
        // Above their lines, or, where another level is close above, on them and over all others, so that none goes through them.
        let levels = self.series.iter().filter(|series| series.mark == Mark::Level);
        let levels: Vec<_> = levels.filter_map(|level| Some((level, place(*level.points.last()?)?))).collect();
        for (level, (x, y)) in &levels {
            let crowded = levels.iter().any(|(_, (_, other))| other < y && y - other < ROOM_OF_LABEL);
            let (x, anchor) = beside(*x, &level.label);
            svg.text_over_lines((x, if crowded { y + 4.5 } else { y - 7.0 }), &level.label, LABEL, anchor);
        }
        svg.finish()
    }

    fn axes(&self) -> [ChartAxis; 2] {
        // Invisible series do not extend the axes.
        let drawn = |p: &&(f64, f64)| p.0.is_finite() && p.1.is_finite();
        let series = || self.series.iter().filter(|series| series.mark != Mark::Missing);
        let x = || series().flat_map(|series| &series.points).filter(drawn).map(|p| p.0);
        let y = || series().flat_map(|series| &series.points).filter(drawn).map(|p| p.1);
        match &self.scale {
            Scale::Linear | Scale::Equal => [ChartAxis::linear(x()), ChartAxis::linear(y())],
            Scale::LogX => [ChartAxis::logarithmic(x()), ChartAxis::linear(y())],
            Scale::LogY(decades) => [ChartAxis::linear(x()), ChartAxis::decades(y(), *decades)],
            Scale::SignedLogY(decades) => [ChartAxis::linear(x()), ChartAxis::signed(y(), *decades)],
            Scale::LogLog => [ChartAxis::logarithmic(x()), ChartAxis::logarithmic(y())],
            Scale::Categories(labels) => [ChartAxis::categories(labels), ChartAxis::linear(y())],
        }
    }

    /// Draws the visible points of a series, with the `named`-th colour; `slot` is the width of a category, px.
    fn draw(
        &self,
        svg: &mut Svg,
        series: &Series,
        points: &[Option<(f64, f64)>],
        named: usize,
        (frame, slot): (&PlotArea, f64),
    ) {
        let there = || points.iter().flatten().copied();
        let categories = matches!(self.scale, Scale::Categories(_));
        let colour = Colour::series(named);
        let dashes = dashes(named);
        let dots = |svg: &mut Svg| {
            for (i, (at, (_, value))) in points.iter().zip(&series.points).enumerate() {
                let Some(at) = *at else { continue };
                let note = series.notes.get(i);
                if let Some(note) = note {
                    svg.begin_note(note);
                }
                svg.mark(named, at, 3.2, colour);
                if *value <= series.hollow_to {
                    svg.mark(named, at, 1.9, Colour::PAPER);
                }
                if note.is_some() {
                    svg.end_note();
                }
            }
        };
        match series.mark {
            Mark::Unseen | Mark::Missing => {}
            Mark::Slope | Mark::Level => {
                let closed: Vec<_> = there().chain(there().next()).collect();
                svg.line(&closed, Colour::SOFT, 1.0, "");
            }
            Mark::Ghost if categories => {}
            Mark::Ghost => pieces(points).for_each(|piece| svg.line(&piece, Colour::GHOST, 1.0, "")),
            Mark::Dots => dots(svg),
            Mark::Line | Mark::Dotted if categories => {
                let inside = |x: f64| x.clamp(frame.left, frame.left + frame.width);
                let bar = |(x, y): (f64, f64)| [(inside(x - 0.3 * slot), y), (inside(x + 0.3 * slot), y)];
                there().for_each(|point| svg.line(&bar(point), colour, 3.0, dashes));
            }
            Mark::Line | Mark::Dotted => {
                pieces(points).for_each(|piece| svg.line(&piece, colour, 2.0, dashes));
                if series.mark == Mark::Dotted {
                    dots(svg);
                } else if let Some(first) = there().next()
                    && there().all(|(x, y)| (x - first.0).abs() < STILL && (y - first.1).abs() < STILL)
                {
                    svg.mark(named, first, 3.2, colour); // a line without a length is none
                }
            }
        }
    }
}

impl Mark {
    /// True for a series with a colour, which may have a legend entry.
    fn is_of_data(self) -> bool {
        matches!(self, Self::Line | Self::Dotted | Self::Dots)
    }
}

/// The labels of slopes beside their last points, one after the other where these are close.
fn label_slopes(svg: &mut Svg, slopes: &[(&Series, (f64, f64))]) {
    let mut ends: Vec<(f64, f64)> = Vec::new();
    for (series, (x, y)) in slopes {
        let (mut at, anchor) = beside(*x, &series.label);
        if anchor == Anchor::Start {
            let close = ends.iter().filter(|(end, other)| (y - other).abs() < LABEL && *end > at);
            at = close.map(|(end, _)| end + 3.0).fold(at, f64::max);
            ends.push((at + width(&series.label, LABEL), *y));
        }
        svg.text((at, *y), &series.label, LABEL, anchor, Colour::SOFT);
    }
}

/// A vertical axis of this height (px) with labels that can be told apart and have room.
pub(super) fn readable_up(y: ChartAxis, height: f64) -> ChartAxis {
    y.told_apart(|label| cut(label, LABEL, MAX_LABEL)).apart(height, |_| LABEL_HEIGHT)
}

/// The same for a horizontal axis of this width (px).
pub(super) fn readable_along(x: ChartAxis, wide: f64, categories: bool) -> ChartAxis {
    if categories {
        let (_, room) = PlotArea::room_of_categories(x.ticks.len(), wide);
        x.told_apart(|label| wrapped(label, LABEL, room, MAX_LINES_OF_CATEGORY).join(" "))
    } else {
        x.apart(wide, |label| if label.is_empty() { 0.0 } else { width(label, LABEL) + BETWEEN_LABELS })
    }
}

/// Where a label beside a point begins or ends, so that it is inside.
fn beside(x: f64, label: &str) -> (f64, Anchor) {
    let over = x + 5.0 + width(label, LABEL) > WIDTH - 4.0;
    if over { (x - 5.0, Anchor::End) } else { (x + 5.0, Anchor::Start) }
}

/// The contiguous pieces of a line, without points that do not change the picture.
fn pieces(points: &[Option<(f64, f64)>]) -> impl Iterator<Item = Vec<(f64, f64)>> {
    points.split(Option::is_none).map(|piece| thinned(piece.iter().flatten().map(|(x, y)| Vector2::new(*x, *y))))
}

/// Smallest visible deviation of a line, px.
const VISIBLE: f64 = 0.1;

/// Simplifies the line through `points`, with deviations below [`VISIBLE`]. The directions from the last kept point that pass all
/// later points within that form a cone; a point outside it, or closer than the previous one, starts a new segment.
fn thinned(mut points: impl Iterator<Item = Vector2<f64>>) -> Vec<(f64, f64)> {
    let Some(mut from) = points.next() else { return Vec::new() };
    let (mut kept, mut last) = (vec![(from.x, from.y)], None::<Vector2<f64>>);
    let mut cone: Option<[Vector2<f64>; 2]> = None;
    let mut reached = 0.0;
    for point in points {
        let mut way = point - from;
        let inside =
            |way: &Vector2<f64>| cone.is_none_or(|[right, left]| right.perp(way) >= 0.0 && way.perp(&left) >= 0.0);
        if let Some(passed) =
            last.filter(|_| (way.norm_squared() < reached && reached > VISIBLE * VISIBLE) || !inside(&way))
        {
            kept.push((passed.x, passed.y));
            (from, cone) = (passed, None);
            way = point - from;
        }
        (last, reached) = (Some(point), way.norm_squared());
        if reached > VISIBLE * VISIBLE {
            let side = Vector2::new(-way.y, way.x) * VISIBLE;
            let ahead = way * (reached - VISIBLE * VISIBLE).sqrt();
            let [right, left] = [ahead - side, ahead + side];
            cone = Some(cone.map_or([right, left], |[old_right, old_left]| {
                [
                    if old_right.perp(&right) > 0.0 { right } else { old_right },
                    if left.perp(&old_left) > 0.0 { left } else { old_left },
                ]
            }));
        }
    }
    kept.extend(last.map(|last| (last.x, last.y)));
    kept
}

/// An entry of a legend: the index and mark of its series, its label, and its place, px.
#[derive(Debug)]
struct LegendEntry {
    k: usize,
    mark: Mark,
    label: String,
    at: (f64, f64),
}

/// The legend entries in lines, between title and plot.
struct Legend {
    entries: Vec<LegendEntry>,
    lines: usize,
}

impl Legend {
    /// The legend of named series; empty for a single one.
    fn of(all: Vec<LegendEntry>) -> Self {
        let mut entries: Vec<LegendEntry> = Vec::new();
        let ((mut left, mut line), count) = ((20.0, 0), all.len());
        let labels: Vec<String> = all.iter().map(|entry| entry.label.clone()).collect();
        let (labels, _) = told_apart(&labels, |label| cut(label, LABEL, MAX_ENTRY));
        if count > 1 {
            for (k, (entry, label)) in all.into_iter().zip(labels).enumerate() {
                let label = cut(&label, LABEL, MAX_ENTRY);
                let room = 52.0 + width(&label, LABEL);
                if left > 20.0 && left + room > WIDTH - 8.0 {
                    (left, line) = (20.0, line + 1);
                }
                if line == MAX_LEGEND_LINES {
                    if let Some(last) = entries.last_mut() {
                        last.label = format!("{} … and {} more", last.label, count - k);
                    }
                    break;
                }
                entries.push(LegendEntry { label, at: (left, 36.0 + LINE * (line as f64 + 0.7)), ..entry });
                left += room;
            }
        }
        let lines = entries.last().map_or(0, |_| line.min(MAX_LEGEND_LINES - 1) + 1);
        Self { entries, lines }
    }

    fn height(&self) -> f64 {
        self.lines as f64 * LINE
    }

    fn draw(&self, svg: &mut Svg) {
        for LegendEntry { k, mark, label, at: (x, y) } in &self.entries {
            if *mark != Mark::Dots {
                svg.line(&[(*x, y - 4.5), (x + 28.0, y - 4.5)], Colour::series(*k), 2.5, dashes(*k));
            }
            if *mark != Mark::Line {
                svg.mark(*k, (x + 14.0, y - 4.5), 3.6, Colour::series(*k));
            }
            svg.text((x + 34.0, *y), label, LABEL, Anchor::Start, Colour::INK);
        }
    }
}

/// The label of an axis with the common power of ten of its tick labels, before its unit, or with what numbers of levels mean.
pub(super) fn titled(name: &str, axis: &ChartAxis) -> String {
    if axis.numbered {
        return numbered(name);
    }
    let power = format!("10{}", superscript(axis.power));
    match name.strip_suffix(')').and_then(|name| name.rsplit_once('(')) {
        _ if axis.power == 0 => name.to_string(),
        Some((name, unit)) if unit != "1" => format!("{name}({power} {unit})"),
        _ => format!("{name} (× {power})"),
    }
}

/// The label of an axis whose levels have numbers.
fn numbered(name: &str) -> String {
    format!("{name}, levels numbered from 1")
}

impl PlotArea {
    /// Of so many categories every which has a label, and the width of the room for it, px.
    fn room_of_categories(count: usize, width: f64) -> (usize, f64) {
        let every = count.max(1).div_ceil(12);
        (every, width / count.max(1) as f64 * every as f64 - 6.0)
    }

    /// The plot area below a title and a legend of this height, with room for the labels of y.
    pub(super) fn about(y: &ChartAxis, legend: f64) -> Self {
        let widest = y.ticks.iter().map(|(_, label)| width(label, LABEL)).fold(0.0, f64::max);
        let left = 42.0 + widest.min(MAX_LABEL);
        Self { left, top: 42.0 + legend, width: WIDTH - left - 18.0, height: PLOT }
    }

    /// Pixel position of a point that is given from 0 to 1.
    pub(super) fn at(&self, x: f64, y: f64) -> (f64, f64) {
        (self.left + x * self.width, self.top + (1.0 - y) * self.height)
    }

    pub(super) fn draw_y(&self, svg: &mut Svg, y: &ChartAxis, name: &str) {
        for (place, label) in y.ticks.iter().filter(|(_, label)| !label.is_empty()) {
            let at = self.at(0.0, *place);
            svg.line(&[at, self.at(1.0, *place)], Colour::GRID, 1.0, "");
            svg.text((at.0 - 7.0, at.1 + 4.5), &cut(label, LABEL, MAX_LABEL), LABEL, Anchor::End, Colour::SOFT);
        }
        for (place, _) in y.ticks.iter().filter(|(_, label)| label.is_empty()) {
            let at = self.at(0.0, *place);
            svg.line(&[(at.0 - 4.0, at.1), at], Colour::SOFT, 1.0, "");
        }
        svg.line(&[self.at(0.0, 0.0), self.at(0.0, 1.0)], Colour::SOFT, 1.0, "");
        let room = self.height + 40.0;
        svg.upright_name((17.0, self.top + 0.5 * self.height), &titled(name, y), NAME, room);
    }

    /// The labels of x with their places, those of categories in lines.
    fn labels_below(x: &ChartAxis, width: f64, categories: bool) -> Vec<(f64, Vec<String>)> {
        let labelled = x.ticks.iter().filter(|(_, label)| !label.is_empty());
        let (every, room) = Self::room_of_categories(labelled.clone().count(), width);
        let every = if categories { every } else { 1 };
        let lines = |label: &String| match categories {
            true => wrapped(label, LABEL, room, MAX_LINES_OF_CATEGORY),
            false => vec![label.clone()],
        };
        labelled.step_by(every).map(|(place, label)| (*place, lines(label))).collect()
    }

    /// Height of the labels and the name of x, px.
    pub(super) fn height_below(&self, x: &ChartAxis, categories: bool) -> f64 {
        let labels = Self::labels_below(x, self.width, categories);
        50.0 + LINE_BELOW * labels.iter().map(|(_, lines)| lines.len() - 1).max().unwrap_or(0) as f64
    }

    pub(super) fn draw_x(&self, svg: &mut Svg, x: &ChartAxis, name: &str, categories: bool) {
        let bottom = self.top + self.height;
        for (place, lines) in Self::labels_below(x, self.width, categories) {
            let at = self.at(place, 0.0).0;
            if !categories {
                svg.line(&[(at, self.top), (at, bottom)], Colour::GRID, 1.0, "");
            }
            for (i, line) in lines.iter().enumerate() {
                let down = 17.0 + LINE_BELOW * i as f64;
                svg.text((at, bottom + down), line, LABEL, Anchor::Middle, Colour::SOFT);
            }
        }
        let below = self.height_below(x, categories);
        for (place, _) in x.ticks.iter().filter(|(_, label)| label.is_empty()) {
            let at = self.at(*place, 0.0).0;
            svg.line(&[(at, bottom), (at, bottom + 4.0)], Colour::SOFT, 1.0, "");
        }
        svg.line(&[(self.left, bottom), (self.left + self.width, bottom)], Colour::SOFT, 1.0, "");
        svg.heading((self.left + 0.5 * self.width, bottom + below - 11.0), &titled(name, x), NAME, self.width);
    }
}

/// Main effects: the effect of each axis on the mean of a quantity; one panel per axis, with a common scale.
#[derive(Debug, Clone)]
pub struct Effects {
    /// Title.
    pub title: String,
    /// Label of the y axis.
    pub y: String,
    /// The axes, with the labels of their levels.
    pub axes: Vec<EffectAxis>,
    /// Label, and the mean at each level of each axis.
    pub series: Vec<(String, Vec<Vec<f64>>)>,
}

/// An axis of main effects.
#[derive(Debug, Clone)]
pub struct EffectAxis {
    /// Its name.
    pub name: String,
    /// Labels of its levels.
    pub labels: Vec<String>,
    /// True if a line may join the levels.
    pub joined: bool,
}

/// Least width of a panel of main effects, px.
const MIN_PANEL_WIDTH: f64 = 110.0;

impl Effects {
    /// The figure as an SVG document, with as many rows of panels as needed.
    pub fn svg(&self) -> String {
        let entry = |(k, (label, _)): (usize, &(String, _))| LegendEntry {
            k,
            mark: Mark::Dotted,
            label: label.clone(),
            at: (0.0, 0.0),
        };
        let legend = Legend::of(self.series.iter().enumerate().map(entry).collect());
        let y = ChartAxis::linear(self.series.iter().flat_map(|(_, axes)| axes.iter().flatten().copied()));
        let y = readable_up(y, PLOT);
        let first = PlotArea::about(&y, legend.height());
        let columns = self.axes.len().clamp(1, (first.width / MIN_PANEL_WIDTH) as usize);
        let rows = self.axes.len().div_ceil(columns).max(1);
        let pitch = PLOT + 62.0;
        let mut svg = Svg::new(WIDTH, first.top + pitch * rows as f64 - 6.0, &self.title);
        svg.heading((WIDTH / 2.0, 24.0), &self.title, TITLE, WIDTH - 20.0);
        legend.draw(&mut svg);
        for (row, axes) in self.axes.chunks(columns).enumerate() {
            let frame = PlotArea { top: first.top + pitch * row as f64, ..first };
            frame.draw_y(&mut svg, &y, &self.y);
            for (column, axis) in axes.iter().enumerate() {
                let panel = frame.width / columns as f64;
                let inside = PlotArea { left: frame.left + panel * column as f64, width: panel, ..frame };
                self.panel(&mut svg, &inside, &y, axis, row * columns + column);
            }
        }
        svg.finish()
    }

    fn panel(&self, svg: &mut Svg, frame: &PlotArea, y: &ChartAxis, axis: &EffectAxis, index: usize) {
        let count = axis.labels.len();
        let place = |level: usize| match axis.joined && count > 1 {
            true => 0.14 + 0.72 * level as f64 / (count - 1) as f64,
            false => (level as f64 + 0.5) / count.max(1) as f64, // a category with as much room as another
        };
        let bottom = frame.top + frame.height;
        svg.line(&[frame.at(0.0, 0.0), frame.at(1.0, 0.0)], Colour::SOFT, 1.0, "");
        svg.line(&[frame.at(1.0, 0.0), frame.at(1.0, 1.0)], Colour::GRID, 1.0, "");
        // As many labels as there is room for, the first and the last at least.
        let room = frame.width / count.clamp(1, 3) as f64 - 4.0;
        let (labels, are_numbers) = told_apart(&axis.labels, |label| cut(label, LABEL, room));
        let longest = labels.iter().map(|label| width(label, LABEL) + 8.0).fold(1.0, f64::max);
        let most = ((frame.width / longest) as usize).clamp(2, 6);
        let most = if count == 3 { most.max(3) } else { most };
        let every = count.saturating_sub(1).div_ceil(most - 1).max(1);
        let room = frame.width / (count.saturating_sub(1) / every + 1) as f64 - 4.0;
        for (level, label) in labels.iter().enumerate().step_by(every) {
            let at = (frame.at(place(level), 0.0).0, bottom + 17.0);
            svg.text(at, &cut(label, LABEL, room), LABEL, Anchor::Middle, Colour::SOFT);
        }
        // The last part of a dotted key is enough where space is short.
        let name = if are_numbers { numbered(&axis.name) } else { axis.name.clone() };
        let fits = width(&name, LABEL) <= frame.width - 8.0;
        let name = name.split_once('.').filter(|_| !fits).map_or(name.as_str(), |(_, key)| key);
        let at = (frame.at(0.5, 0.0).0, bottom + 38.0);
        svg.heading(at, name, LABEL, frame.width - 8.0);
        for (k, (_, axes)) in self.series.iter().enumerate() {
            let means = axes.get(index).map_or(&[][..], Vec::as_slice);
            let at = |(level, mean): (usize, &f64)| Some(frame.at(place(level), y.place(*mean)?));
            let points: Vec<_> = means.iter().enumerate().map(at).collect();
            if axis.joined {
                pieces(&points).for_each(|piece| svg.line(&piece, Colour::series(k), 2.0, dashes(k)));
            }
            points.iter().flatten().for_each(|point| svg.mark(k, *point, 3.6, Colour::series(k)));
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]
    use proptest::prelude::*;

    use super::*;

    /// Any number that a simulation or a user may come up with, those that charts used to stumble over more often.
    fn any_number() -> impl Strategy<Value = f64> {
        let extreme = [0.0, -0.0, 1e-320, 1e-308, 1e-300, 1e-160, -1e-160, 1e160, 1e300, -1e300, f64::MAX, f64::MIN]
            .into_iter()
            .chain([f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1.0, 1.0 + f64::EPSILON]);
        prop_oneof![any::<f64>(), -1.0..1.0, prop::sample::select(extreme.collect::<Vec<_>>())]
    }

    fn scales() -> Vec<Scale> {
        let categories = ["water", "<oil> & \"水\"", ""].map(str::to_string).to_vec();
        vec![
            Scale::Linear,
            Scale::Equal,
            Scale::LogX,
            Scale::LogY(12),
            Scale::SignedLogY(6),
            Scale::LogLog,
            Scale::Categories(categories),
            Scale::Categories(Vec::new()),
        ]
    }

    const MARKS: [Mark; 8] =
        [Mark::Line, Mark::Dotted, Mark::Dots, Mark::Ghost, Mark::Unseen, Mark::Slope, Mark::Level, Mark::Missing];

    /// All coordinates in an SVG document, to see that none is off it.
    fn inside(svg: &str) -> bool {
        let of = |name: &str| -> Vec<f64> {
            let sign = format!(" {name}=\"");
            let values = svg.split(&sign).skip(1).filter_map(|rest| rest.split('"').next());
            values
                .flat_map(|value| value.split([',', ' ']).filter_map(|x| x.parse().ok()).collect::<Vec<_>>())
                .collect()
        };
        let height = of("height")[0];
        let within = |x: &f64, limit: f64| (-1.0..=limit + 1.0).contains(x);
        let pairs = of("points");
        of("cx").iter().all(|x| within(x, WIDTH))
            && of("cy").iter().all(|y| within(y, height))
            && pairs.chunks_exact(2).all(|p| within(&p[0], WIDTH) && within(&p[1], height))
    }

    proptest! {
        #[test]
        fn every_chart_is_drawn_in_bounded_space_and_inside_it_whatever_its_data(
            points in prop::collection::vec((any_number(), any_number()), 0..40),
            label in ".{0,400}",
        ) {
            for scale in scales() {
                let series = MARKS.map(|mark| Series::new(label.clone(), points.clone(), mark)).to_vec();
                let svg = Chart::new(label.clone(), label.clone(), "y", scale.clone(), series).svg();
                // Measured: 32 kB with 280 points in all.
                prop_assert!(svg.len() < 100_000, "{scale:?}: {} bytes", svg.len());
                prop_assert!(inside(&svg), "{scale:?}: {svg}");
                prop_assert!(!svg.contains("NaN") && !svg.contains("inf\""), "{scale:?}: {svg}");
                let mut reader = quick_xml::Reader::from_str(&svg);
                while reader.read_event().unwrap() != quick_xml::events::Event::Eof {}
            }
        }

        #[test]
        fn effects_are_drawn_in_bounded_space_whatever_the_means(
            means in prop::collection::vec(any_number(), 1..12),
            label in ".{0,400}",
        ) {
            let axis = |joined| EffectAxis { name: label.clone(), labels: vec![label.clone(); means.len()], joined };
            let axes: Vec<_> = (0..9).map(|i| axis(i % 2 == 0)).collect();
            let series = vec![(label.clone(), vec![means.clone(); 9]), (label.clone(), vec![means.clone(); 9])];
            let svg = Effects { title: label.clone(), y: label, axes, series }.svg();
            prop_assert!(svg.len() < 200_000 && inside(&svg), "{} bytes", svg.len());
        }
    }

    #[test]
    fn axes_label_round_numbers_with_as_many_digits_as_tell_them_apart() {
        let labels = |axis: ChartAxis| {
            let labels = axis.ticks.into_iter().map(|(_, label)| label).filter(|label| !label.is_empty());
            labels.collect::<Vec<_>>().join(" ")
        };
        assert_eq!(labels(ChartAxis::linear([0.0, 1.0].into_iter())), "0.0 0.2 0.4 0.6 0.8 1.0".replace("0.0", "0"));
        let small = ChartAxis::linear([0.0, 4e-6].into_iter());
        assert_eq!((small.power, labels(small)), (-6, "0 1 2 3 4".to_string()));
        assert_eq!(
            labels(ChartAxis::linear([1.00000, 1.00004].into_iter())),
            "1.00000 1.00001 1.00002 1.00003 1.00004"
        );
        assert_eq!(
            labels(ChartAxis::logarithmic([1e-6, 1e6].into_iter())),
            "10⁻⁶ 10⁻⁴ 0.01 1 100 10⁴ 10⁶".replace("10⁴", "10000")
        );
        assert_eq!(labels(ChartAxis::logarithmic([1.0, 30.0].into_iter())), "1 10 2 5 20");
        assert_eq!(labels(ChartAxis::logarithmic([0.7, 1.0].into_iter())), "0.7 0.8 0.9 1");
        assert_eq!(labels(ChartAxis::decades([1e-160, 1e-180, 0.0].into_iter(), 12)).split(' ').count(), 7);
        // No further than the data.
        assert_eq!(labels(ChartAxis::decades([0.9, 0.02, 0.0].into_iter(), 12)), "0.01 0.1 1 0.02 0.05 0.2 0.5");
    }

    /// The points of the line of the first series, which is thinner than that of the legend.
    fn series_line(svg: &str) -> Vec<(f64, f64)> {
        let of_series = |line: &&str| line.contains("class=\"s0\"") && line.contains("stroke-width=\"2\"");
        let line = svg.split("<polyline ").find(of_series).unwrap();
        let points = line.split("points=\"").nth(1).unwrap().split('"').next().unwrap();
        let point = |pair: &str| pair.split_once(',').map(|(x, y)| (x.parse().unwrap(), y.parse().unwrap()));
        points.split_whitespace().filter_map(point).collect()
    }

    #[test]
    fn a_straight_rod_fills_its_shape_whatever_its_length() {
        for length in [1e-6, 0.3, 20.0] {
            let rod = Series::new("rod", vec![(0.0, 0.0), (length, 0.0)], Mark::Line);
            let centre = Series::new("centre of mass", vec![(0.5 * length, 0.0)], Mark::Dots);
            let svg = Chart::new("rest", "x (m)", "y (m)", Scale::Equal, vec![rod, centre]).svg();
            let ends = series_line(&svg);
            assert!(ends[1].0 - ends[0].0 > 400.0, "{length}: {ends:?}");
        }
    }

    #[test]
    fn a_line_without_a_length_is_a_dot_and_the_labels_of_its_axes_have_room() {
        let still = Series::new("", vec![(0.150_000_000_1, 0.0); 9], Mark::Line);
        let svg = Chart::new("path", "x (m)", "y (m)", Scale::Linear, vec![still]).svg();
        assert!(svg.contains("<circle"), "{svg}");
        let axis = ChartAxis::linear([1.000_000_001, 1.000_000_002].into_iter());
        let axis = readable_along(axis, 560.0, false);
        let taken: f64 = axis.ticks.iter().map(|(_, label)| width(label, LABEL)).sum();
        assert!(taken < 560.0 && !axis.ticks.is_empty(), "{axis:?}");
    }

    #[test]
    fn a_chart_without_a_point_on_its_scale_is_no_figure_and_one_names_series_without_one() {
        let zero = Series::new("chain", vec![(5.0, 0.0), (9.0, 0.0)], Mark::Dotted);
        let chart = |series| Chart::new("errors", "nodes", "error", Scale::LogLog, series);
        assert!(chart(vec![zero.clone()]).figure("error.svg", "Errors.").is_none());
        let known = Series::new("positions", vec![(5.0, 0.1), (9.0, 0.02)], Mark::Dotted);
        let figure = chart(vec![zero, known]).figure("error.svg", "Errors.").unwrap();
        assert_eq!(figure.caption, "Errors. Without a value on this scale: chain.");
        assert!(!figure.svg.contains(">chain<"), "{}", figure.svg);
    }

    #[test]
    fn long_labels_are_told_apart_by_what_differs_or_by_their_numbers() {
        let shown = |label: &str| cut(label, LABEL, MAX_LABEL);
        let profile = |radius: &str| format!("[[0.0, 0.008], [0.5, 0.006], [1.0, {radius}]]");
        let labels = ["0.002", "0.003"].map(profile);
        assert_eq!(told_apart(&labels, shown), (vec!["…0.002…".to_string(), "…0.003…".to_string()], false));
        let labels = [profile("0.002"), profile("0.002").replace("0.008", "0.009"), profile("0.003")];
        assert_eq!(told_apart(&labels, shown), (["1", "2", "3"].map(str::to_string).to_vec(), true));
        let words = ["water", "oil"].map(str::to_string);
        assert_eq!(told_apart(&words, shown), (words.to_vec(), false));
        let many: Vec<String> = (0..30).map(|i| format!("body {i}")).collect();
        let axis = readable_up(ChartAxis::categories(&many), PLOT);
        let labelled = axis.ticks.iter().filter(|(_, label)| !label.is_empty()).count();
        assert!(labelled > 5 && labelled as f64 * LABEL_HEIGHT <= PLOT, "{labelled}");
    }

    #[test]
    fn labels_of_slopes_stand_side_by_side_where_they_would_overlap() {
        let slope = |order: i32| {
            Series::new(order.to_string(), vec![(1.0, 1e-6), (2.0, 1e-6 * 0.5_f64.powi(order))], Mark::Slope)
        };
        let errors = Series::new("", vec![(1.0, 1.0), (100.0, 1e-12)], Mark::Dotted);
        let svg = Chart::new("", "x", "y", Scale::LogLog, vec![errors, slope(1), slope(2), slope(3)]).svg();
        let at = |label: &str| -> [f64; 2] {
            let text =
                svg.split("<text ").find(|text| text.contains(&format!(">{label}</text>")) && text.contains("start"));
            ["x=\"", "y=\""]
                .map(|key| text.unwrap().split(key).nth(1).unwrap().split('"').next().unwrap().parse().unwrap())
        };
        let [one, two, three] = ["1", "2", "3"].map(at);
        let apart = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() >= 7.0 || (a[1] - b[1]).abs() >= LABEL;
        assert!(apart(one, two) && apart(two, three) && apart(one, three), "{one:?} {two:?} {three:?}");
    }

    #[test]
    fn the_name_of_y_that_has_no_room_is_in_two_lines() {
        let name = "mean moment on the head over whole cycles of the run, relative to the mean";
        let points = vec![(0.0, 1.0), (1.0, 2.0)];
        let svg = Chart::new("", "x", name, Scale::Linear, vec![Series::new("", points, Mark::Line)]).svg();
        assert!(!svg.contains('…') && svg.matches("rotate(-90)").count() == 2, "{svg}");
    }
}

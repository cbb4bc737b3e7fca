//! Charts as SVG text, drawn by a plotting library: one look for every figure of the program.

use plotters::coord::Shift;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::error::{Error, Result};

/// Size of a chart in pixels.
pub(super) const SIZE: (u32, u32) = (760, 440);

/// Colours that people with any kind of colour vision tell apart (Okabe and Ito 2008), grey among them.
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    GREY,
    RGBColor(0, 0, 0),
];
const GREY: RGBColor = RGBColor(170, 170, 170);
pub(super) const DARK: RGBColor = RGBColor(80, 80, 80);

/// An axis of numbers.
pub(super) trait Axis: Ranged<ValueType = f64> + ValueFormatter<f64> {}
impl<T: Ranged<ValueType = f64> + ValueFormatter<f64>> Axis for T {}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A line.
    Line,
    /// A line with a dot at every point.
    Dotted,
    /// Dots only.
    Dots,
    /// A thin grey line in the background, without an entry in the legend of its own.
    Ghost,
    /// Not drawn: it only widens the axes, so that charts can be compared.
    Unseen,
    /// A thin dark closed line with its label beside the last point, and without an entry in the legend: the triangle that
    /// shows a slope.
    Slope,
    /// The same with its label above the last point: a level.
    Level,
}

/// One series of a chart.
#[derive(Debug, Clone)]
pub struct Series {
    /// Text in the legend.
    pub label: String,
    /// Points.
    pub points: Vec<(f64, f64)>,
    /// Look.
    pub mark: Mark,
}

impl Series {
    /// A series with a look.
    pub fn new(label: impl Into<String>, points: Vec<(f64, f64)>, mark: Mark) -> Self {
        Self { label: label.into(), points, mark }
    }
}

/// The scales of a chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Both linear.
    Linear,
    /// Both linear, and a metre is as long on one axis as on the other.
    Equal,
    /// y logarithmic; values are shown by their size, down to this many decades below the largest.
    LogY(i32),
    /// Both logarithmic; only positive numbers are shown.
    LogLog,
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

    /// The chart as an SVG document.
    ///
    /// # Errors
    /// [`Error::Chart`] where the plotting library fails.
    pub fn svg(&self) -> Result<String> {
        let mut text = String::new();
        {
            let area = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
            self.draw(&area).map_err(|reason| Error::Chart { title: self.title.clone(), reason })?;
        }
        Ok(text)
    }

    fn draw(&self, area: &DrawingArea<SVGBackend<'_>, Shift>) -> std::result::Result<(), String> {
        area.fill(&WHITE).map_err(|e| e.to_string())?;
        let points = || self.series.iter().flat_map(|series| series.points.iter().copied());
        let mut x = range(points().map(|p| p.0));
        match self.scale {
            Scale::Linear => {
                let y = range(points().map(|p| p.1));
                let mut chart = self.builder(area).build_cartesian_2d(x.0..x.1, y.0..y.1).map_err(|e| e.to_string())?;
                self.mesh(&mut chart, [x, y])?;
                self.curves(&mut chart, Some)
            }
            Scale::LogLog => {
                let [x, y] = [|p: (f64, f64)| p.0, |p: (f64, f64)| p.1].map(|of| log_range(points().map(of)));
                let (x, y) = ((x.0..x.1).log_scale(), (y.0..y.1).log_scale());
                let mut chart = self.builder(area).build_cartesian_2d(x, y).map_err(|e| e.to_string())?;
                self.mesh(&mut chart, [(0.0, 0.0); 2])?;
                self.curves(&mut chart, |p| (p.0 > 0.0 && p.1 > 0.0).then_some(p))
            }
            Scale::Equal => {
                let mut y = range(points().map(|p| p.1));
                let margins = (95.0, 100.0); // of the labels around the plot, px
                let (width, height) = (f64::from(SIZE.0) - margins.0, f64::from(SIZE.1) - margins.1);
                let pixel = ((x.1 - x.0) / width).max((y.1 - y.0) / height);
                x = widened(x, pixel * width);
                y = widened(y, pixel * height);
                let mut chart = self.builder(area).build_cartesian_2d(x.0..x.1, y.0..y.1).map_err(|e| e.to_string())?;
                self.mesh(&mut chart, [x, y])?;
                self.curves(&mut chart, Some)
            }
            Scale::LogY(decades) => {
                let top = points().map(|p| p.1.abs()).fold(0.0, f64::max);
                let top = if top > 0.0 { top } else { 1.0 };
                let bottom = 10.0_f64.powf(top.log10().ceil() - f64::from(decades));
                let y = (bottom..2.0 * top).log_scale();
                let mut chart = self.builder(area).build_cartesian_2d(x.0..x.1, y).map_err(|e| e.to_string())?;
                self.mesh(&mut chart, [x, (0.0, 0.0)])?;
                self.curves(&mut chart, |p| Some((p.0, p.1.abs().max(bottom))))
            }
        }
    }

    fn builder<'a, 'b>(&self, area: &'a DrawingArea<SVGBackend<'b>, Shift>) -> ChartBuilder<'a, 'b, SVGBackend<'b>> {
        let mut builder = ChartBuilder::on(area);
        builder
            .caption(&self.title, ("sans-serif", 20))
            .margin(12)
            .margin_right(20)
            .x_label_area_size(46)
            .y_label_area_size(78);
        builder
    }

    fn mesh<X: Axis, Y: Axis>(
        &self,
        chart: &mut ChartContext<'_, SVGBackend<'_>, Cartesian2d<X, Y>>,
        [x, y]: [(f64, f64); 2],
    ) -> std::result::Result<(), String> {
        // A tick at zero comes out as rounding noise; on a logarithmic axis, which has no range here, there is no room for all.
        let label = |value: f64, range: (f64, f64)| {
            if range == (0.0, 0.0) {
                let mantissa = value / 10.0_f64.powf(value.log10().floor());
                let shown = [1.0, 2.0, 5.0, 10.0].iter().any(|round| (mantissa - round).abs() < 1e-6);
                return if shown { number(value) } else { String::new() };
            }
            number(if value.abs() < 1e-9 * (range.1 - range.0) { 0.0 } else { value })
        };
        chart
            .configure_mesh()
            .x_desc(&self.x)
            .y_desc(&self.y)
            .x_label_formatter(&|value| label(*value, x))
            .y_label_formatter(&|value| label(*value, y))
            .axis_desc_style(("sans-serif", 16))
            .label_style(("sans-serif", 13))
            .light_line_style(RGBColor(244, 244, 244))
            .bold_line_style(RGBColor(224, 224, 224))
            .draw()
            .map_err(|e| e.to_string())
    }

    fn curves<'b, X: Axis, Y: Axis>(
        &self,
        chart: &mut ChartContext<'b, SVGBackend<'b>, Cartesian2d<X, Y>>,
        place: impl Fn((f64, f64)) -> Option<(f64, f64)>,
    ) -> std::result::Result<(), String> {
        let mut named = 0;
        let drawn_at =
            self.series.iter().filter(|series| series.mark != Mark::Unseen).flat_map(|series| &series.points);
        let finite = drawn_at.filter(|p| p.0.is_finite() && p.1.is_finite()).filter_map(|p| place(*p));
        let occupied: Vec<(i32, i32)> = finite.map(|p| chart.backend_coord(&p)).collect();
        for series in &self.series {
            let finite = series.points.iter().copied().filter(|p| p.0.is_finite() && p.1.is_finite());
            let points = || finite.clone().filter_map(&place);
            if series.mark == Mark::Unseen {
                continue;
            }
            if matches!(series.mark, Mark::Slope | Mark::Level) {
                let line = PathElement::new(points().chain(points().next()).collect::<Vec<_>>(), DARK.stroke_width(1));
                chart.draw_series([line]).map_err(|e| e.to_string())?;
                let up = if series.mark == Mark::Level { -14 } else { -6 };
                let text = points().last().map(|p| {
                    EmptyElement::at(p)
                        + Text::new(series.label.clone(), (5, up), ("sans-serif", 13).into_font().color(&DARK))
                });
                chart.draw_series(text).map_err(|e| e.to_string())?;
                continue;
            }
            let ghost = series.mark == Mark::Ghost;
            let colour = if ghost { GREY } else { COLOURS[named % COLOURS.len()] };
            let style = colour.stroke_width(if ghost { 1 } else { 2 });
            let mut drawn = None;
            if series.mark != Mark::Dots {
                drawn = Some(chart.draw_series(LineSeries::new(points(), style)).map_err(|e| e.to_string())?);
            }
            if matches!(series.mark, Mark::Dots | Mark::Dotted) {
                let dots = points().map(|p| Circle::new(p, 4, colour.filled()));
                drawn = Some(chart.draw_series(dots).map_err(|e| e.to_string())?);
            }
            if !ghost {
                named += 1;
                if let Some(drawn) = drawn {
                    drawn.label(&series.label).legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
                }
            }
        }
        if named > 1 {
            let corner = emptiest_corner(&occupied, chart.plotting_area().get_pixel_range());
            chart
                .configure_series_labels()
                .background_style(WHITE.mix(0.85))
                .border_style(GREY)
                .label_font(("sans-serif", 14))
                .position(corner)
                .draw()
                .map_err(|e| e.to_string())?;
        }
        Ok(())
    }
}

/// Main effects: what several axes do, each by itself, to the mean of a quantity; one panel an axis, one scale for all.
#[derive(Debug, Clone)]
pub struct Effects {
    /// Title.
    pub title: String,
    /// Label of the y axis.
    pub y: String,
    /// The axes, with their levels in words.
    pub axes: Vec<(String, Vec<String>)>,
    /// Label, and the mean at each level of each axis.
    pub series: Vec<(String, Vec<Vec<f64>>)>,
}

impl Effects {
    /// The figure as an SVG document.
    ///
    /// # Errors
    /// [`Error::Chart`] where the plotting library fails.
    pub fn svg(&self) -> Result<String> {
        let mut text = String::new();
        let size = (SIZE.0.max(150 * self.axes.len() as u32 + 110), SIZE.1);
        {
            let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
            self.draw(&area).map_err(|reason| Error::Chart { title: self.title.clone(), reason })?;
        }
        Ok(text)
    }

    fn draw(&self, area: &DrawingArea<SVGBackend<'_>, Shift>) -> std::result::Result<(), String> {
        let failed = |e: DrawingAreaErrorKind<std::io::Error>| e.to_string();
        area.fill(&WHITE).map_err(failed)?;
        let mut y = range(self.series.iter().flat_map(|(_, axes)| axes.iter().flatten().copied()));
        if self.series.len() > 1 {
            y.1 += 0.06 * (self.series.len() + 1) as f64 * (y.1 - y.0); // for the legend
        }
        let mut chart = ChartBuilder::on(area)
            .caption(&self.title, ("sans-serif", 20))
            .margin(12)
            .margin_right(20)
            .x_label_area_size(56)
            .y_label_area_size(78)
            .build_cartesian_2d(0.0..self.axes.len() as f64, y.0..y.1)
            .map_err(|e| e.to_string())?;
        chart
            .configure_mesh()
            .disable_x_mesh()
            .x_labels(0)
            .y_desc(&self.y)
            .y_label_formatter(&|value| number(if value.abs() < 1e-9 * (y.1 - y.0) { 0.0 } else { *value }))
            .axis_desc_style(("sans-serif", 16))
            .label_style(("sans-serif", 13))
            .light_line_style(RGBColor(244, 244, 244))
            .bold_line_style(RGBColor(224, 224, 224))
            .draw()
            .map_err(|e| e.to_string())?;
        // Each axis has the space from its number to the next, its levels the middle part of it.
        let place = |axis: usize, level: usize, count: usize| {
            axis as f64 + if count < 2 { 0.5 } else { 0.15 + 0.7 * level as f64 / (count - 1) as f64 }
        };
        let bottom = chart.backend_coord(&(0.0, y.0)).1;
        let middle =
            |size: i32| TextStyle::from(("sans-serif", size).into_font()).pos(Pos::new(HPos::Center, VPos::Top));
        for (axis, (name, labels)) in self.axes.iter().enumerate() {
            // As many labels as there is room for, the first and the last at least.
            let longest = labels.iter().map(String::len).max().unwrap_or(0).max(1);
            let room = (20 / longest).clamp(2, 4);
            let every = (labels.len().saturating_sub(1)).div_ceil(room - 1).max(1);
            for (level, label) in labels.iter().enumerate().step_by(every) {
                let x = chart.backend_coord(&(place(axis, level, labels.len()), y.0)).0;
                area.draw(&Text::new(label.clone(), (x, bottom + 6), middle(13))).map_err(failed)?;
            }
            let x = chart.backend_coord(&(axis as f64 + 0.5, y.0)).0;
            // The last part of a dotted key is enough where space is short.
            let name = if name.len() > 20 { name.split_once('.').map_or(name.as_str(), |(_, key)| key) } else { name };
            area.draw(&Text::new(name.to_string(), (x, bottom + 26), middle(13))).map_err(failed)?;
            if axis > 0 {
                let line = vec![(axis as f64, y.0), (axis as f64, y.1)];
                chart.draw_series(LineSeries::new(line, RGBColor(224, 224, 224))).map_err(|e| e.to_string())?;
            }
        }
        for (k, (label, axes)) in self.series.iter().enumerate() {
            let style = COLOURS[k % COLOURS.len()].stroke_width(2);
            for (axis, means) in axes.iter().enumerate() {
                let points = || {
                    let point = |(level, mean): (usize, &f64)| (place(axis, level, means.len()), *mean);
                    means.iter().enumerate().map(point).filter(|point| point.1.is_finite())
                };
                chart.draw_series(LineSeries::new(points(), style)).map_err(|e| e.to_string())?;
                let dots = points().map(|p| Circle::new(p, 4, style.filled()));
                let drawn = chart.draw_series(dots).map_err(|e| e.to_string())?;
                if axis == 0 {
                    drawn.label(label).legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
                }
            }
        }
        if self.series.len() > 1 {
            chart
                .configure_series_labels()
                .background_style(WHITE.mix(0.85))
                .border_style(GREY)
                .label_font(("sans-serif", 14))
                .position(SeriesLabelPosition::UpperMiddle)
                .draw()
                .map_err(|e| e.to_string())?;
        }
        Ok(())
    }
}

/// The corner of the plot, a legend's size, that the fewest points (px) lie in.
fn emptiest_corner(points: &[(i32, i32)], (x, y): (std::ops::Range<i32>, std::ops::Range<i32>)) -> SeriesLabelPosition {
    use SeriesLabelPosition::{LowerLeft, LowerRight, UpperLeft, UpperRight};
    let (width, height) = (2 * (x.end - x.start) / 5, 2 * (y.end - y.start) / 5);
    let (left, right) = (x.start..x.start + width, x.end - width..x.end);
    let (upper, lower) = (y.start..y.start + height, y.end - height..y.end);
    let corners = [
        (UpperRight, &right, &upper),
        (LowerRight, &right, &lower),
        (UpperLeft, &left, &upper),
        (LowerLeft, &left, &lower),
    ];
    let inside = |(_, x, y): &(_, &std::ops::Range<i32>, &std::ops::Range<i32>)| {
        points.iter().filter(|p| x.contains(&p.0) && y.contains(&p.1)).count()
    };
    let emptiest = corners.into_iter().min_by_key(inside);
    emptiest.map_or(UpperRight, |(corner, ..)| corner)
}

/// The values' range with a margin; never empty.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values
        .filter(|value| value.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return (0.0, 1.0);
    }
    let size = high.abs().max(low.abs()).max(1e-12);
    let margin = (0.04 * (high - low)).max(1e-6 * size);
    (low - margin, high + margin)
}

/// The positive values' range with a margin, on a logarithmic scale.
pub(super) fn log_range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let positive = values.filter(|value| value.is_finite() && *value > 0.0);
    let (low, high) = positive.fold((f64::INFINITY, 0.0), |(low, high), value| (value.min(low), value.max(high)));
    if low > high {
        return (0.1, 1.0);
    }
    let margin = (high / low).powf(0.04).max(1.1);
    (low / margin, high * margin)
}

/// A range of size `size` around the middle of `range`.
fn widened((low, high): (f64, f64), size: f64) -> (f64, f64) {
    let middle = 0.5 * (low + high);
    (middle - 0.5 * size, middle + 0.5 * size)
}

/// A number as an axis shows it: short, with an exponent where it is very large or small.
pub fn number(x: f64) -> String {
    let size = x.abs();
    if size != 0.0 && !(1e-3..1e5).contains(&size) {
        return format!("{x:.2e}").replace(".00e", "e").replace("0e", "e");
    }
    let text = format!("{x:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_string() } else { text.to_string() }
}

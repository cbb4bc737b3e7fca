//! Charts as SVG text, drawn by a plotting library: one look for every figure of the program.

use plotters::coord::Shift;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::error::{Error, Result};

/// Size of a chart in pixels.
const SIZE: (u32, u32) = (760, 440);

/// Colours that people with any kind of colour vision tell apart (Okabe and Ito 2008), then grey.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    GREY,
];
const GREY: RGBColor = RGBColor(170, 170, 170);

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
                self.curves(&mut chart, |p| p)
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
                self.curves(&mut chart, |p| p)
            }
            Scale::LogY(decades) => {
                let top = points().map(|p| p.1.abs()).fold(0.0, f64::max);
                let top = if top > 0.0 { top } else { 1.0 };
                let bottom = 10.0_f64.powf(top.log10().ceil() - f64::from(decades));
                let y = (bottom..2.0 * top).log_scale();
                let mut chart = self.builder(area).build_cartesian_2d(x.0..x.1, y).map_err(|e| e.to_string())?;
                self.mesh(&mut chart, [x, (0.0, 0.0)])?;
                self.curves(&mut chart, |p| (p.0, p.1.abs().max(bottom)))
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

    fn mesh<Y: Ranged<ValueType = f64> + ValueFormatter<f64>>(
        &self,
        chart: &mut ChartContext<'_, SVGBackend<'_>, Cartesian2d<RangedCoordf64, Y>>,
        [x, y]: [(f64, f64); 2],
    ) -> std::result::Result<(), String> {
        // A tick at zero comes out as rounding noise.
        let label =
            |value: f64, range: (f64, f64)| number(if value.abs() < 1e-9 * (range.1 - range.0) { 0.0 } else { value });
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

    fn curves<'b, Y: Ranged<ValueType = f64>>(
        &self,
        chart: &mut ChartContext<'b, SVGBackend<'b>, Cartesian2d<RangedCoordf64, Y>>,
        place: impl Fn((f64, f64)) -> (f64, f64),
    ) -> std::result::Result<(), String> {
        let mut named = 0;
        for series in &self.series {
            let ghost = series.mark == Mark::Ghost;
            let colour = if ghost { GREY } else { COLOURS[named % COLOURS.len()] };
            let style = colour.stroke_width(if ghost { 1 } else { 2 });
            let points = || series.points.iter().copied().filter(|p| p.0.is_finite() && p.1.is_finite()).map(&place);
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
            chart
                .configure_series_labels()
                .background_style(WHITE.mix(0.85))
                .border_style(GREY)
                .label_font(("sans-serif", 14))
                .position(match self.scale {
                    Scale::LogY(_) => SeriesLabelPosition::LowerRight,
                    _ => SeriesLabelPosition::UpperRight,
                })
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

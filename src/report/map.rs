//! Maps of outcomes: for every panel a field of coloured cells over two logarithmic or linear axes, one legend for all.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::chart::{Axis, DARK, number};
use crate::error::{Error, Result};

/// Size of a panel and of the strip for the legend, px.
const PANEL: (u32, u32) = (390, 300);
const LEGEND: u32 = 50;
/// About the width of a letter in the legend, px.
const PER_LETTER: f64 = 6.4;

/// What a cell may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Category {
    /// Text in the legend.
    pub label: &'static str,
    /// Colour, red, green and blue.
    pub colour: [u8; 3],
}

/// One field of cells.
#[derive(Debug, Clone)]
pub struct Panel {
    /// Title.
    pub title: String,
    /// For every x, one category for every y, by its place among those of the map.
    pub cells: Vec<Vec<usize>>,
    /// A boundary that theory gives; empty where there is none.
    pub boundary: Vec<(f64, f64)>,
}

/// The whole map.
#[derive(Debug, Clone)]
pub struct Map {
    /// Title.
    pub title: String,
    /// Label of the x axis, and its values, rising.
    pub x: (String, Vec<f64>),
    /// True where x is linear, not logarithmic.
    pub linear: bool,
    /// Label of the y axis, and its values, rising; y is logarithmic.
    pub y: (String, Vec<f64>),
    /// What the boundary is.
    pub boundary: String,
    /// The categories.
    pub categories: Vec<Category>,
    /// The panels, two in a row.
    pub panels: Vec<Panel>,
}

type Drawn = std::result::Result<(), String>;

impl Map {
    /// The map as an SVG document.
    ///
    /// # Errors
    /// [`Error::Chart`] where the plotting library fails.
    pub fn svg(&self) -> Result<String> {
        let rows = self.panels.len().div_ceil(2).max(1);
        let size = (2 * PANEL.0, rows as u32 * PANEL.1 + LEGEND + 40);
        let mut text = String::new();
        {
            let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
            self.draw(&area, rows).map_err(|reason| Error::Chart { title: self.title.clone(), reason })?;
        }
        Ok(text)
    }

    fn draw(&self, area: &DrawingArea<SVGBackend<'_>, Shift>, rows: usize) -> Drawn {
        area.fill(&WHITE).map_err(|e| e.to_string())?;
        let area = area.titled(&self.title, ("sans-serif", 20)).map_err(|e| e.to_string())?;
        let height = area.dim_in_pixel().1;
        let (fields, legend) = area.split_vertically(height - LEGEND);
        for (panel, area) in self.panels.iter().zip(fields.split_evenly((rows, 2))) {
            let x = edges(&self.x.1, self.linear);
            let y = edges(&self.y.1, false);
            let ([x0, x1], [y0, y1]) = [&x, &y].map(|e| [e[0], e[e.len() - 1]]).into();
            let mut builder = ChartBuilder::on(&area);
            builder.caption(&panel.title, ("sans-serif", 15)).margin(8).x_label_area_size(40).y_label_area_size(62);
            let y_axis = (y0..y1).log_scale();
            if self.linear {
                let mut chart = builder.build_cartesian_2d(x0..x1, y_axis).map_err(|e| e.to_string())?;
                self.panel(&mut chart, panel, &x, &y)?;
            } else {
                let mut chart = builder.build_cartesian_2d((x0..x1).log_scale(), y_axis).map_err(|e| e.to_string())?;
                self.panel(&mut chart, panel, &x, &y)?;
            }
        }
        self.legend(&legend)
    }

    fn panel<X: Axis, Y: Axis>(
        &self,
        chart: &mut ChartContext<'_, SVGBackend<'_>, Cartesian2d<X, Y>>,
        panel: &Panel,
        x: &[f64],
        y: &[f64],
    ) -> Drawn {
        let cells = panel.cells.iter().zip(x.windows(2)).flat_map(|(column, x)| {
            column.iter().zip(y.windows(2)).map(move |(category, y)| {
                let [r, g, b] = self.categories[*category].colour;
                Rectangle::new([(x[0], y[0]), (x[1], y[1])], RGBColor(r, g, b).filled())
            })
        });
        chart.draw_series(cells).map_err(|e| e.to_string())?;
        let inside = panel.boundary.iter().copied().filter(|p| (y[0]..=y[y.len() - 1]).contains(&p.1));
        chart.draw_series(LineSeries::new(inside, BLACK.stroke_width(2))).map_err(|e| e.to_string())?;
        chart
            .configure_mesh()
            .disable_mesh()
            .x_desc(&self.x.0)
            .y_desc(&self.y.0)
            .x_label_formatter(&|value| number(*value))
            .y_label_formatter(&|value| number(*value))
            .axis_desc_style(("sans-serif", 13))
            .label_style(("sans-serif", 11))
            .draw()
            .map_err(|e| e.to_string())
    }

    fn legend(&self, area: &DrawingArea<SVGBackend<'_>, Shift>) -> Drawn {
        let bounded = self.panels.iter().any(|panel| !panel.boundary.is_empty());
        let colours =
            self.categories.iter().map(|Category { label, colour: [r, g, b] }| (*label, RGBColor(*r, *g, *b)));
        let entries = colours.chain(bounded.then_some((self.boundary.as_str(), BLACK)));
        let (mut left, mut top) = (14, 4);
        for (label, colour) in entries {
            let width = 34 + (PER_LETTER * label.chars().count() as f64) as i32;
            if left + width > area.dim_in_pixel().0 as i32 {
                (left, top) = (14, top + 20);
            }
            let height = if colour == BLACK { [6, 8] } else { [0, 14] }; // of a line, of a field
            let corners = [(left, top + height[0]), (left + 14, top + height[1])];
            area.draw(&Rectangle::new(corners, colour.filled())).map_err(|e| e.to_string())?;
            let style = ("sans-serif", 13).into_font().color(&DARK);
            area.draw(&Text::new(label.to_string(), (left + 20, top), style)).map_err(|e| e.to_string())?;
            left += width;
        }
        Ok(())
    }
}

/// The borders of cells around `values`: midway between them, and as far out at the ends.
fn edges(values: &[f64], linear: bool) -> Vec<f64> {
    let v: Vec<f64> = values.iter().map(|x| if linear { *x } else { x.ln() }).collect();
    let step = |i: usize| if v.len() < 2 { 0.5 } else { 0.5 * (v[i + 1] - v[i]) };
    let last = v.len() - 1;
    let inner = (0..last).map(|i| v[i] + step(i));
    let all = [v[0] - step(0)].into_iter().chain(inner).chain([v[last] + step(last.saturating_sub(1))]);
    all.map(|x| if linear { x } else { x.exp() }).collect()
}

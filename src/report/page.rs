//! report.html: a self-contained page with an animation of the run, its figures and numbers.

use minijinja::value::Serde;
use minijinja::{AutoEscape, Environment};
use serde::ser::Error as _;
use serde::{Serialize, Serializer};

use super::Summary;
use super::chart::{CellCases, Figure, InteractiveChart};
use super::frame::Frame;
use super::heat_map::DIVERGING;
use super::number_groups::{NumberGroup, groups};
use super::packed_numbers::{PackedCurve, PackedNumbers, QuantizedNumbers};
use super::scenery::Scenery;
use super::svg::{NOTE, SERIES, series_colours};
use crate::error::{Error, Result};
use crate::number_format::{in_sentence, number, significant, typeset};

/// Number of colours of other rods in an animation: `--companion-0` and so on in the style sheet.
const COMPANION_COLOURS: usize = 6;

/// The content of the page.
pub struct Page<'a> {
    /// Summary of the run.
    pub summary: &'a Summary,
    /// The scene's text, and its overrides.
    pub scene: (&'a str, &'a [String]),
    /// The assessment of the scene, line by line.
    pub notes: &'a [String],
    /// Frames of the animation.
    pub frames: &'a [Frame],
    /// What is to be said of them.
    pub motion_note: Option<String>,
    /// Data that frames do not contain.
    pub scenery: &'a Scenery,
    /// Figures.
    pub figures: &'a [Figure],
}

/// The data for the template.
#[derive(Serialize)]
struct RunPageContent<'a> {
    summary: &'a Summary,
    /// `None` for a held head, which goes where it is held.
    displacement: Option<String>,
    step: String,
    end: String,
    cycles: String,
    groups: Vec<NumberGroup>,
    figures: Figures<'a>,
    notes: &'a [String],
    scene: &'a str,
    overrides: &'a [String],
    motion: RawJson<Animation>,
}

/// The figures of a page. Those that its script draws have no SVG there.
#[derive(Serialize)]
pub struct Figures<'a> {
    all: Vec<PageFigure<'a>>,
    /// True if there are maps of cases.
    maps: bool,
    /// True if dots have texts.
    notes: bool,
    /// What the script draws, if anything.
    drawn: Option<RawJson<DrawnCharts<'a>>>,
}

/// A figure of a page.
#[derive(Serialize)]
struct PageFigure<'a> {
    file: &'a str,
    caption: &'a str,
    svg: Option<&'a str>,
    /// The cases of a map.
    cells: Option<RawJson<&'a CellCases>>,
}

/// The charts that the script of a page draws, in order.
#[derive(Serialize)]
struct DrawnCharts<'a> {
    charts: Vec<DrawnChart<'a>>,
    /// The coordinates x of all series, each once.
    x: Vec<&'a PackedCurve>,
}

#[derive(Serialize)]
struct DrawnChart<'a> {
    #[serde(flatten)]
    chart: &'a InteractiveChart,
    /// Index of the coordinates x of each series.
    x_of: Vec<usize>,
}

impl<'a> Figures<'a> {
    /// Those of a page.
    pub fn of(figures: &'a [Figure]) -> Self {
        let on_page = |figure: &'a Figure| PageFigure {
            file: &figure.file,
            caption: &figure.caption,
            svg: figure.chart.is_none().then_some(figure.svg.as_str()),
            cells: figure.cells.as_ref().map(RawJson),
        };
        let mut x: Vec<&PackedCurve> = Vec::new();
        let mut index = |numbers: &'a PackedCurve| {
            x.iter().position(|known| *known == numbers).unwrap_or_else(|| {
                x.push(numbers);
                x.len() - 1
            })
        };
        let mut drawn = |chart: &'a InteractiveChart| DrawnChart {
            chart,
            x_of: chart.series.iter().map(|series| index(&series.x)).collect(),
        };
        let charts: Vec<_> = figures.iter().filter_map(|figure| figure.chart.as_ref()).map(&mut drawn).collect();
        Self {
            all: figures.iter().map(on_page).collect(),
            notes: figures.iter().any(|figure| figure.svg.contains(NOTE)),
            maps: figures.iter().any(|figure| figure.cells.is_some()),
            drawn: (!charts.is_empty()).then_some(RawJson(DrawnCharts { charts, x })),
        }
    }
}

/// Data of an animation. Positions are relative to the centre of mass, so that single precision is enough wherever the rod is.
#[derive(Debug, Clone, Serialize)]
pub struct Animation {
    times: Vec<f64>,
    /// Coordinates of the points of all frames.
    points: PackedNumbers,
    com: Vec<[f64; 2]>,
    /// Semi-axes and angle of the body at the head.
    #[serde(skip_serializing_if = "Option::is_none")]
    body: Option<Vec<[f64; 3]>>,
    /// Other rods at the same times, with their names.
    beside: Vec<Companion>,
    /// The media in the background, if there are several.
    media: Option<Media>,
    /// Objects that do not move by themselves, if known.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    scenery: Option<Scenery>,
    /// Loads on the rod, if known.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    loads: Option<Loads>,
    /// What is to be said of it, as that it is only a part of a run.
    #[serde(skip_serializing_if = "Option::is_none")]
    note: Option<String>,
}

/// Loads on the rod at all times.
#[derive(Debug, Clone, Serialize)]
struct Loads {
    /// Bending moments at the points of all frames, N m, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    moment: Option<QuantizedNumbers>,
    /// Powers per length there, W/m, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    power: Option<QuantizedNumbers>,
    /// Forces on a held head, N.
    #[serde(skip_serializing_if = "Option::is_none")]
    head_force: Option<PackedNumbers>,
    /// Velocities of the flow, m/s, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    flow: Option<PackedNumbers>,
}

impl Loads {
    fn of(frames: &[Frame]) -> Option<Self> {
        let all: Vec<_> = frames.iter().map(|frame| frame.loads.as_ref()).collect::<Option<_>>()?;
        let some = |vectors: Vec<[f64; 2]>| {
            let is_there = vectors.iter().any(|vector| *vector != [0.0; 2]);
            is_there.then(|| vectors.into_iter().flatten().collect())
        };
        Some(Self {
            moment: QuantizedNumbers::of(all.iter().flat_map(|loads| &loads.moment).copied()),
            power: QuantizedNumbers::of(all.iter().flat_map(|loads| &loads.power).copied()),
            head_force: some(all.iter().filter_map(|loads| loads.head_force).collect()),
            flow: some(all.iter().map(|loads| loads.flow).collect()),
        })
    }
}

/// Another rod in the same animation.
#[derive(Debug, Clone, Serialize)]
struct Companion {
    name: String,
    /// Coordinates of the points of all frames, relative to the centres of mass of the first rod.
    points: PackedNumbers,
    /// Half the width of the body at each point, m, if it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    half_widths: Option<Vec<f64>>,
    /// Semi-axes and angle of the body at the head.
    #[serde(skip_serializing_if = "Option::is_none")]
    body: Option<Vec<[f64; 3]>>,
}

/// Layered media in the background.
#[derive(Debug, Clone, Serialize)]
struct Media {
    /// Direction across the interfaces.
    normal: [f64; 2],
    /// Initial extent of each interface along the normal, m.
    edges: Vec<[f64; 2]>,
    /// The same at each time, if interfaces move.
    moved: Option<Vec<Vec<[f64; 2]>>>,
    /// Description of each fluid.
    names: Vec<String>,
    /// Its tint, from 0 for the lightest to 4 for the densest.
    tints: Vec<usize>,
}

impl Media {
    fn of(frames: &[Frame]) -> Option<Self> {
        let (first, layers) = frames.first()?.medium.as_ref()?;
        let edges = |frame: &Frame| -> Vec<[f64; 2]> {
            let layers = frame.medium.iter().flat_map(|(_, layers)| layers.iter());
            layers.map(|layer| [-0.5, 0.5].map(|part| layer.offset + part * layer.thickness)).collect()
        };
        let all: Vec<_> = frames.iter().map(edges).collect();
        let fluids: Vec<_> = std::iter::once(first)
            .chain(layers.iter().map(|layer| &layer.fluid))
            .map(|f| [f.density, f.viscosity])
            .collect();
        let lighter = |a: &[f64; 2], b: &[f64; 2]| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])).is_lt();
        let rank = |own: &[f64; 2]| fluids.iter().filter(|other| lighter(other, own)).count();
        let deepest = fluids.iter().map(rank).max().unwrap_or(0).max(1);
        let name = |[density, viscosity]: &[f64; 2]| format!("{} kg/m³, {} Pa s", number(*density), number(*viscosity));
        Some(Self {
            normal: layers.normal.into(),
            moved: all.iter().any(|edges| *edges != all[0]).then(|| all.clone()),
            names: fluids.iter().map(name).collect(),
            tints: fluids.iter().map(|own| rank(own) * 4 / deepest).collect(),
            edges: all.into_iter().next()?,
        })
    }
}

/// Renders a page's template, which may include the style sheet and the animation player.
///
/// # Errors
/// [`Error::Page`] if the template fails.
pub fn render(template: &str, content: &impl Serialize) -> Result<String> {
    let failed = |e: minijinja::Error| Error::Page { reason: format!("{e:#}") };
    let mut environment = Environment::new();
    environment.set_auto_escape_callback(|_| AutoEscape::Html);
    environment.add_filter("typeset", |text: String| typeset(&text));
    environment.add_global("series_colours", Serde(series_colours()));
    environment.add_global("diverging", Serde(DIVERGING));
    for (name, text) in [
        ("style.css", include_str!("style.css")),
        ("figures.html", include_str!("figures.html")),
        ("player.html", include_str!("player.html")),
        ("motion.html", include_str!("motion.html")),
        ("rows.html", include_str!("rows.html")),
        ("player.js", include_str!("player.js")),
        ("notes.js", include_str!("notes.js")),
        ("charts.js", include_str!("charts.js")),
        ("uPlot.js", include_str!("uplot/uPlot.iife.min.js")),
        ("uPlot.css", include_str!("uplot/uPlot.min.css")),
    ] {
        environment.add_template(name, text).map_err(failed)?;
    }
    environment.render_str(template, Serde(content)).map_err(failed)
}

/// Data for a script in a page, as JSON text, so that the template engine does not convert each number.
pub struct RawJson<T>(pub T);

impl<T: Serialize> Serialize for RawJson<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let mut text = serde_json::to_string(&self.0).map_err(S::Error::custom)?;
        for (sign, escape) in [('<', "\\u003c"), ('>', "\\u003e"), ('&', "\\u0026"), ('\'', "\\u0027")] {
            if text.contains(sign) {
                text = text.replace(sign, escape); // which stands inside a text
            }
        }
        serializer.serialize_str(&text)
    }
}

impl Page<'_> {
    /// The page's HTML.
    ///
    /// # Errors
    /// [`Error::Page`] if the template fails.
    pub fn html(&self) -> Result<String> {
        // Without the positions of the nodes, which would be most of the page.
        let summary = Summary { final_positions_m: Vec::new(), ..self.summary.clone() };
        let numbers = serde_json::to_value(&summary).map_err(|e| Error::Page { reason: e.to_string() })?;
        let held = numbers.get("mean_thrust_n").is_some_and(serde_json::Value::is_number);
        let content = RunPageContent {
            summary: &summary,
            displacement: (!held).then(|| significant(self.summary.net_displacement_m, 4)),
            step: number(self.summary.time_step_s),
            end: in_sentence(self.summary.end_time_s, 7),
            cycles: self.summary.cycles.to_string(),
            groups: numbers.as_object().map(groups).unwrap_or_default(),
            figures: Figures::of(self.figures),
            notes: self.notes,
            scene: self.scene.0,
            overrides: self.scene.1,
            motion: RawJson(Animation::of(self.frames).with_scenery(Some(self.scenery)).with_note(self.motion_note.clone())),
        };
        render(include_str!("page.html"), &content)
    }
}

impl Animation {
    /// The animation of `frames`.
    pub fn of(frames: &[Frame]) -> Self {
        // Six digits of the rod's own extent, wherever it is.
        let side = |frame: &Frame, axis: usize| {
            let along = frame.points.iter().map(|point| point[axis]);
            along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
        };
        let extent = frames.iter().map(|frame| side(frame, 0).hypot(side(frame, 1))).fold(1e-12, f64::max);
        let unit = 10.0_f64.powi(5 - extent.log10().floor() as i32);
        let com: Vec<_> = frames.iter().map(|frame| frame.com.map(|x| (x * unit).round() / unit)).collect();
        Self {
            times: frames.iter().map(|frame| in_digits(frame.time, 9)).collect(),
            points: relative(frames, &com),
            body: head_bodies(frames),
            com,
            beside: Vec::new(),
            media: Media::of(frames),
            scenery: None,
            loads: Loads::of(frames),
            note: None,
        }
    }

    /// Adds a sentence that the player shows below it.
    pub fn with_note(self, note: Option<String>) -> Self {
        Self { note, ..self }
    }

    /// Adds the data that frames do not contain.
    pub fn with_scenery(self, scenery: Option<&Scenery>) -> Self {
        Self { scenery: scenery.cloned(), ..self }
    }

    /// The series of charts that has the colour of the `i`-th rod with a name beside the first: neither that of the first rod, which is the
    /// first series, nor that of centres of mass.
    pub fn series_of_companion(i: usize) -> usize {
        2 + i % COMPANION_COLOURS + SERIES * (i / COMPANION_COLOURS)
    }

    /// Adds another rod with `frames` at the same times: in the background, or with its own colour if it has a name. Without its
    /// scenery it is a line.
    pub fn with_companion(mut self, name: &str, frames: &[Frame], scenery: Option<&Scenery>) -> Self {
        self.beside.push(Companion {
            name: name.to_string(),
            points: relative(frames, &self.com),
            half_widths: scenery.map(|scenery| scenery.half_widths().to_vec()),
            body: head_bodies(frames),
        });
        self
    }
}

/// Semi-axes (m) and angle (rad) of the body at the head in all frames, if they have one.
fn head_bodies(frames: &[Frame]) -> Option<Vec<[f64; 3]>> {
    frames.iter().map(|frame| frame.body.map(|[a, b, turn]| [a, b, (turn * 1e4).round() / 1e4])).collect()
}

/// The points of all frames relative to these centres.
fn relative(frames: &[Frame], centres: &[[f64; 2]]) -> PackedNumbers {
    let seen = |(frame, centre): (&Frame, &[f64; 2])| -> Vec<f64> {
        let [x, y] = *centre;
        frame.points.iter().flat_map(|point| [point[0] - x, point[1] - y]).collect()
    };
    frames.iter().zip(centres).flat_map(seen).collect()
}

/// A number rounded to these significant digits.
fn in_digits(x: f64, digits: usize) -> f64 {
    format!("{x:.*e}", digits - 1).parse().unwrap_or(x)
}

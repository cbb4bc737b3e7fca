//! report.html: a self-contained page with an animation of the run, its figures and numbers.

use minijinja::value::Serde;
use minijinja::{AutoEscape, Environment};
use serde::ser::Error as _;
use serde::{Serialize, Serializer};

use super::Summary;
use super::chart::{CellCases, Figure, InteractiveChart};
use super::frame::{Frame, Medium};
use super::heat_map::DIVERGING;
use super::number_groups::{NumberGroup, groups};
use super::packed_numbers::{PackedCurve, PackedNumbers, QuantizedNumbers};
use super::rod_motion::{HeadSupport, RodMotion, TendonPath};
use super::sampling::pictures_in_words;
use super::svg::{NOTE, SERIES, series_colours};
use crate::error::{Error, Result};
use crate::fluid::Layers;
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
    /// The motion.
    pub motion: &'a RodMotion,
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
    /// True if there are maps whose cases can be played.
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

    /// The same on a page that plays cases, or has none to play.
    pub fn playing(self, plays: bool) -> Self {
        Self { maps: self.maps && plays, ..self }
    }
}

/// Data of an animation. Positions are relative to the centre of mass, so that single precision is enough wherever the rod is.
#[derive(Debug, Clone, Serialize)]
pub struct Animation {
    times: Vec<f64>,
    com: Vec<[f64; 2]>,
    /// Period of the fastest drive, s, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    period: Option<f64>,
    #[serde(flatten)]
    rod: AnimatedRod,
    /// Other rods at the same times.
    beside: Vec<AnimatedRod>,
    /// The media in the background, if there are several.
    media: Option<Media>,
    /// The flow, if it is known and not at rest.
    #[serde(skip_serializing_if = "Option::is_none")]
    flow: Option<Flow>,
    /// Loads on the rod, if known.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    loads: Option<Loads>,
    /// What is to be said of it, as that it is only a part of a run.
    #[serde(skip_serializing_if = "Option::is_none")]
    note: Option<String>,
}

/// A rod of an animation.
#[derive(Debug, Clone, Serialize)]
struct AnimatedRod {
    /// Its name, if it is told apart from others.
    #[serde(skip_serializing_if = "String::is_empty")]
    name: String,
    /// The series of charts that has its colour.
    series: usize,
    /// Coordinates of the points of all frames, relative to the centres of mass of the first rod.
    points: PackedNumbers,
    /// Half the width of the body at each point, m, if it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    half_widths: Option<Vec<f64>>,
    /// Semi-axes of the body at the head, if there is one and its direction is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    body: Option<[f64; 2]>,
    /// How the head is held, if it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    head: Option<HeadSupport>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    tendons: Vec<TendonPath>,
    /// The first and last point with a joint.
    joints: [usize; 2],
    /// True if the first point is not the head.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    headless: bool,
}

impl AnimatedRod {
    fn of(name: &str, series: usize, motion: &RodMotion, centres: &[[f64; 2]]) -> Self {
        let rod = &motion.rod;
        Self {
            name: name.to_string(),
            series,
            points: relative(&motion.frames, centres),
            half_widths: rod.half_widths.clone(),
            body: rod.body,
            head: rod.head,
            tendons: rod.tendons.clone(),
            joints: rod.joints,
            headless: !rod.shows_head(),
        }
    }
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
}

impl Loads {
    fn of(frames: &[Frame]) -> Option<Self> {
        let all: Vec<_> = frames.iter().map(|frame| frame.loads.as_ref()).collect::<Option<_>>()?;
        let forces: Vec<[f64; 2]> = all.iter().filter_map(|loads| loads.head_force).collect();
        Some(Self {
            moment: QuantizedNumbers::of(all.iter().flat_map(|loads| &loads.moment).copied()),
            power: QuantizedNumbers::of(all.iter().flat_map(|loads| &loads.power).copied()),
            head_force: forces.iter().any(|force| *force != [0.0; 2]).then(|| forces.into_iter().flatten().collect()),
        })
    }
}

/// The velocity of the flow relative to the ground.
#[derive(Debug, Clone, Serialize)]
struct Flow {
    /// The velocities before the first interface and beyond each, or of all media together, m/s: at all times, or one if it is constant.
    /// Those of a shear are where the height along the normal is zero.
    layers: Vec<PackedNumbers>,
    /// Shear rate, 1/s, and the normal along which the flow changes.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    change: Option<FlowChange>,
}

#[derive(Debug, Clone, Serialize)]
struct FlowChange {
    rate: f64,
    normal: [f64; 2],
}

impl Flow {
    /// The flow of all frames; `None` if one of them does not know it, or if the fluid is at rest.
    fn of(frames: &[Frame]) -> Option<Self> {
        let media: Vec<&Medium> = frames.iter().map(|frame| frame.medium.as_ref()).collect::<Option<_>>()?;
        let layers = media.first()?.layers.as_ref().filter(|_| media.iter().any(|medium| !medium.is_uniform()));
        let velocities = |j: usize| -> Vec<[f64; 2]> {
            let beyond = |medium: &Medium| Some(medium.layers.as_ref()?.get(j.checked_sub(1)?)?.fluid.flow);
            media.iter().map(|medium| (medium.fluid.flow + beyond(medium).unwrap_or_default()).into()).collect()
        };
        let all: Vec<_> = (0..=layers.map_or(0, |layers| layers.iter().len())).map(velocities).collect();
        let rate = layers.map_or(0.0, |layers| layers.shear);
        let packed = |velocities: Vec<[f64; 2]>| {
            let constant = velocities.iter().all(|velocity| *velocity == velocities[0]);
            let count = if constant { 1 } else { velocities.len() };
            velocities.into_iter().take(count).flatten().collect()
        };
        (rate != 0.0 || all.iter().flatten().any(|velocity| *velocity != [0.0; 2])).then(|| Self {
            layers: all.into_iter().map(packed).collect(),
            change: layers.map(|layers| FlowChange { rate, normal: layers.normal.into() }),
        })
    }
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
        let medium = frames.first()?.medium.as_ref()?;
        let (first, layers) = (&medium.fluid, medium.interfaces()?);
        let edges = |frame: &Frame| -> Vec<[f64; 2]> {
            let layers = frame.medium.iter().flat_map(Medium::interfaces).flat_map(Layers::iter);
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
            motion: RawJson(Animation::of(self.motion)),
        };
        render(include_str!("page.html"), &content)
    }
}

impl Animation {
    /// The animation of a motion.
    pub fn of(motion: &RodMotion) -> Self {
        Self::of_named("", 0, motion)
    }

    /// The animation of a motion whose rod has a name, and the colour of this series of charts.
    pub fn of_named(name: &str, series: usize, motion: &RodMotion) -> Self {
        let frames = &motion.frames[..];
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
            rod: AnimatedRod::of(name, series, motion, &com),
            com,
            period: motion.drive.map(f64::recip),
            beside: Vec::new(),
            media: Media::of(frames),
            flow: Flow::of(frames),
            loads: Loads::of(frames),
            note: pictures_in_words(motion),
        }
    }

    /// Adds a sentence that the player shows below it.
    pub fn with_note(self, note: Option<String>) -> Self {
        Self { note, ..self }
    }

    /// The series of charts that has the colour of the `i`-th rod with a name beside the first: neither that of the first rod, which is the
    /// first series, nor that of centres of mass.
    pub fn series_of_companion(i: usize) -> usize {
        2 + i % COMPANION_COLOURS + SERIES * (i / COMPANION_COLOURS)
    }

    /// Adds another rod, which moves at the same times, in the colour of this series of charts.
    pub fn with_companion(mut self, name: &str, series: usize, motion: &RodMotion) -> Self {
        self.beside.push(AnimatedRod::of(name, series, motion, &self.com));
        self
    }
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

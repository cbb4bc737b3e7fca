//! report.html: one self-contained file that plays the run and shows its figures and numbers.

use minijinja::value::Serde;
use minijinja::{AutoEscape, Environment};
use serde::ser::Error as _;
use serde::{Serialize, Serializer};

use super::chart::Figure;
use super::record::Frame;
use crate::error::{Error, Result};
use crate::number_format::number;
use crate::run::Summary;

/// Everything the page shows.
pub struct Page<'a> {
    /// Summary of the run.
    pub summary: &'a Summary,
    /// The scene's text, and the overrides of its keys.
    pub scene: (&'a str, &'a [String]),
    /// What `caudal check` says of the scene, line by line.
    pub notes: &'a [String],
    /// Frames of the animation.
    pub frames: &'a [Frame],
    /// Figures.
    pub figures: &'a [Figure],
}

/// What the template sees.
#[derive(Serialize)]
struct Content<'a> {
    summary: &'a Summary,
    displacement: String,
    step: String,
    cycles: String,
    rows: Vec<(String, String)>,
    figures: &'a [Figure],
    notes: &'a [String],
    scene: &'a str,
    overrides: &'a [String],
    motion: Script<Motion>,
}

/// The animation's data: every number rounded to a length of a few micrometres in a rod of a metre.
#[derive(Debug, Clone, Serialize)]
pub struct Motion {
    times: Vec<f64>,
    points: Vec<Vec<f64>>,
    com: Vec<[f64; 2]>,
    /// Semi-axes and angle of the body around the first node.
    #[serde(skip_serializing_if = "Option::is_none")]
    body: Option<Vec<[f64; 3]>>,
    /// Other rods at the same times, by their names.
    beside: Vec<Beside>,
    /// The media behind the rod, where there are several.
    media: Option<Media>,
}

/// A rod beside the one that is played.
#[derive(Debug, Clone, Serialize)]
struct Beside {
    name: String,
    points: Vec<Vec<f64>>,
}

/// Media behind parallel interfaces, for the picture behind the rod.
#[derive(Debug, Clone, Serialize)]
struct Media {
    /// Direction across the interfaces.
    normal: [f64; 2],
    /// From where to where along the normal every interface blends, m, at the start.
    edges: Vec<[f64; 2]>,
    /// The same at every time, where interfaces move.
    moved: Option<Vec<Vec<[f64; 2]>>>,
    /// Every fluid in words.
    names: Vec<String>,
    /// Its tint, from 0 of the lightest to 4 of the densest.
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

/// Fills a page's template, which may include the style, a player with its `motion`, or the player and its script apart.
///
/// # Errors
/// [`Error::Page`] where the template fails.
pub fn render(template: &str, content: &impl Serialize) -> Result<String> {
    let failed = |e: minijinja::Error| Error::Page { reason: format!("{e:#}") };
    let mut environment = Environment::new();
    environment.set_auto_escape_callback(|_| AutoEscape::Html);
    for (name, text) in [
        ("style.css", include_str!("style.css")),
        ("figures.html", include_str!("figures.html")),
        ("player.html", include_str!("player.html")),
        ("motion.html", include_str!("motion.html")),
        ("player.js", include_str!("player.js")),
    ] {
        environment.add_template(name, text).map_err(failed)?;
    }
    environment.render_str(template, Serde(content)).map_err(failed)
}

/// Data that a page takes into a script: to the template it is a text, JSON that may stand there. A template that saw the data itself
/// would make a value of its own of every number first.
pub struct Script<T>(pub T);

impl<T: Serialize> Serialize for Script<T> {
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
    /// [`Error::Page`] where the template fails.
    pub fn html(&self) -> Result<String> {
        let numbers = serde_json::to_value(self.summary).map_err(|e| Error::Page { reason: e.to_string() })?;
        let rows: Vec<(String, String)> = numbers
            .as_object()
            .into_iter()
            .flatten()
            .filter(|(key, _)| !["final_positions_m", "notes"].contains(&key.as_str()))
            .map(|(key, value)| (key.clone(), value.as_str().map_or_else(|| value.to_string(), str::to_string)))
            .collect();
        let content = Content {
            summary: self.summary,
            displacement: format!("{:.6e}", self.summary.net_displacement_m),
            step: number(self.summary.time_step_s),
            cycles: self.summary.cycles.to_string(),
            rows,
            figures: self.figures,
            notes: self.notes,
            scene: self.scene.0,
            overrides: self.scene.1,
            motion: Script(Motion::of(self.frames)),
        };
        render(include_str!("page.html"), &content)
    }
}

impl Motion {
    /// The motion of `frames`.
    pub fn of(frames: &[Frame]) -> Self {
        // Six digits of the rod's own extent, wherever it is.
        let side = |frame: &Frame, axis: usize| {
            let along = frame.points.iter().map(|point| point[axis]);
            along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
        };
        let extent = frames.iter().map(|frame| side(frame, 0).hypot(side(frame, 1))).fold(1e-12, f64::max);
        let unit = 10.0_f64.powi(5 - extent.log10().floor() as i32);
        let round = |x: f64| (x * unit).round() / unit;
        Self {
            times: frames.iter().map(|frame| frame.time).collect(),
            points: frames.iter().map(|frame| frame.points.iter().flatten().map(|x| round(*x)).collect()).collect(),
            com: frames.iter().map(|frame| frame.com.map(round)).collect(),
            body: frames
                .iter()
                .map(|frame| frame.body.map(|[a, b, turn]| [a, b, (turn * 1e4).round() / 1e4]))
                .collect(),
            beside: Vec::new(),
            media: Media::of(frames),
        }
    }

    /// The same with another rod, whose frames are at the same times: in the background, or with a colour of its own where it
    /// has a name.
    pub fn beside(mut self, name: &str, frames: &[Frame]) -> Self {
        self.beside.push(Beside { name: name.to_string(), points: Self::of(frames).points });
        self
    }
}

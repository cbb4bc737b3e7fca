//! The pictures of a film: the body of a rod with its real widths in its fluid, seen across the plane of motion, with a scale bar. A swimmer
//! that comes far is followed at its mean velocity; the specks in the fluid go by at the true speed.

use std::fmt::Write;

use nalgebra::Vector2;

use super::frame::Medium;
use super::rod_motion::RodMotion;
use crate::fluid::{Fluid, Layers};
use crate::number_format::in_sentence;

/// A comment in each film, by which caudal knows it again.
pub(super) const MARK: &str = "a film by caudal";

/// Width of a picture, and the least and the largest height, px.
const WIDTH: f64 = 640.0;
const HEIGHTS: [f64; 2] = [150.0, 400.0];

/// Room around the motion, and below it for the scale bar, px.
const MARGIN: f64 = 26.0;
const FOOT: f64 = 34.0;

/// Half width (px) that a body has at least at its head.
const LEAST_HALF_WIDTH: f64 = 1.6;

/// The camera follows a rod that travels further than this fraction of its extent.
const FOLLOWED: f64 = 1.0;

/// A fluid that moves by less than this fraction of the picture in a film is drawn at rest.
const AT_REST: f64 = 0.01;

/// Sides of a cell of specks, px, and their places in cells of two rows, in parts of these.
const CELL: [f64; 2] = [150.0, 56.0];
const SPECKS: [[[f64; 2]; 3]; 2] =
    [[[0.08, 0.2], [0.41, 0.75], [0.74, 0.38]], [[0.22, 0.6], [0.55, 0.15], [0.9, 0.82]]];

/// Shortest cell of specks of a film that loops, px.
const LEAST_CELL: f64 = 24.0;

/// Font size, px.
const FONT: f64 = 13.0;

/// Colours by class, on light and on dark pages.
const COLOURS: [(&str, &str, [&str; 2]); 8] = [
    ("water", "fill", ["#e9f3fa", "#14222e"]),
    ("empty", "fill", ["#f6f7f8", "#191d22"]),
    ("specks", "stroke", ["#a9c8dd", "#37566d"]),
    ("body", "fill", ["#0b6aa2", "#58aee6"]),
    ("rim", "stroke", ["#0b6aa2", "#58aee6"]),
    ("eye", "fill", ["#ffffff", "#0e161d"]),
    ("ink", "fill", ["#3b4a58", "#b9c5d0"]),
    ("bar", "stroke", ["#3b4a58", "#b9c5d0"]),
];

/// Tints of layered media from the lightest to the densest, on light and on dark pages.
const TINTS: [[&str; 2]; 5] = [
    ["#f7fafc", "#1a2027"],
    ["#e3f0f8", "#182a38"],
    ["#cfe5f3", "#163448"],
    ["#b9d8ec", "#153e58"],
    ["#a3cbe4", "#144868"],
];

/// A motion to be filmed.
#[derive(Debug, Clone, Copy)]
pub struct FilmedMotion<'a> {
    /// Name of the scene.
    pub name: &'a str,
    /// The motion.
    pub motion: &'a RodMotion,
    /// Start and end of its last whole cycle, s, if it has cycles.
    pub cycle: Option<[f64; 2]>,
    /// Frequency of its fastest drive, Hz, if it has one that is known.
    pub drive: Option<f64>,
}

impl<'a> FilmedMotion<'a> {
    /// The rod at a time, by linear interpolation.
    pub fn at(&self, time: f64) -> Vec<Vector2<f64>> {
        self.motion.points_at(time)
    }

    /// Its times, s.
    pub fn times(&self) -> impl DoubleEndedIterator<Item = f64> + use<'a> {
        self.motion.frames.iter().map(|frame| frame.time)
    }

    /// True if a camera can move along with it, as there are no interfaces that would move.
    pub fn can_be_followed(&self) -> bool {
        self.medium().and_then(Medium::interfaces).is_none()
    }

    /// The medium at first, if it is known.
    fn medium(&self) -> Option<&'a Medium> {
        self.motion.frames.first()?.medium.as_ref()
    }

    /// The velocity of a flow that is the same everywhere and at all times, m/s; `None` of another one, in no fluid, and if it is not known.
    fn steady_flow(&self) -> Option<Vector2<f64>> {
        let medium = self.medium().filter(|medium| medium.is_uniform() && is_fluid(medium))?;
        self.motion.frames.iter().all(|frame| frame.medium.as_ref() == Some(medium)).then_some(medium.fluid.flow)
    }
}

fn is_fluid(medium: &Medium) -> bool {
    medium.fluid.density > 0.0 || medium.fluid.viscosity > 0.0
}

/// The properties that all pictures of a film share: camera and scale.
#[derive(Debug, Clone)]
pub struct FilmScene<'a> {
    motion: FilmedMotion<'a>,
    /// First and last time, s.
    pub window: [f64; 2],
    /// Velocity of the camera, m/s.
    velocity: Vector2<f64>,
    /// Velocity of the fluid in the picture, m/s; `None` where there are no specks.
    drift: Option<Vector2<f64>>,
    /// The point (m) at the left upper corner of the first picture.
    corner: Vector2<f64>,
    /// Pixels per metre.
    unit: f64,
    /// Height of a picture, px.
    height: f64,
    /// What each node moves over the window of a periodic motion, as seen by the camera, m: rounding, which is taken off so that the
    /// film closes.
    gap: Vec<Vector2<f64>>,
    /// Distance after which the specks repeat, px.
    cell: f64,
}

impl<'a> FilmScene<'a> {
    /// The pictures of `motion` within `window` (s), looked at so many times; `closed` where the last is to equal the first.
    pub fn of(motion: FilmedMotion<'a>, window: [f64; 2], pictures: usize, closed: bool) -> Self {
        let [first, last] = window;
        let (rod, layers) = (&motion.motion.rod, motion.medium().and_then(Medium::interfaces));
        let (start, end) = (motion.at(first), motion.at(last));
        let nodes = start.len().max(1) as f64;
        let middle = |points: &[Vector2<f64>]| points.iter().sum::<Vector2<f64>>() / nodes;
        let travel = middle(&end) - middle(&start);
        let extent = Bounds::of(start.iter().copied()).diagonal() + 2.0 * rod.reach();
        // With layers the camera is fixed.
        let follows = layers.is_none() && (closed || travel.norm() > FOLLOWED * extent);
        let velocity = if follows && last > first { travel / (last - first) } else { Vector2::zeros() };
        let gap = match closed {
            true => end.iter().zip(&start).map(|(end, start)| end - start - velocity * (last - first)).collect(),
            false => vec![Vector2::zeros(); start.len()],
        };
        let drift = motion.steady_flow().map(|flow| flow - velocity);
        let mut scene = Self {
            motion,
            window,
            velocity,
            drift,
            corner: Vector2::zeros(),
            unit: 1.0,
            height: 0.0,
            gap,
            cell: CELL[0],
        };
        let times = (0..pictures.max(2)).map(|n| first + (last - first) * n as f64 / (pictures.max(2) - 1) as f64);
        let seen = times.flat_map(|time| {
            let points = scene.points(time);
            let outline = rod.polygons(&points, 1.0, 0.0);
            points.into_iter().chain(outline.into_iter().flatten())
        });
        let bounds = Bounds::of(seen.filter(|point| point.iter().all(|x| x.is_finite())));
        let size = bounds.size();
        let [low, high] = HEIGHTS;
        let room = |height: f64| height - 2.0 * MARGIN - FOOT;
        // A motion without extent is drawn as if it were a metre long.
        let fits = |size: f64, room: f64| if size > 0.0 { room / size } else { f64::INFINITY };
        let unit = fits(size.x, WIDTH - 2.0 * MARGIN).min(fits(size.y, room(high)));
        scene.unit = if unit.is_finite() { unit } else { WIDTH };
        scene.height = (size.y * scene.unit + 2.0 * MARGIN + FOOT).clamp(low, high).round();
        let middle = bounds.middle();
        let half = Vector2::new(-0.5 * WIDTH, 0.5 * (scene.height - FOOT)) / scene.unit;
        scene.corner = middle + half;
        scene
    }

    /// The same with specks that are at the end of the film where they are at its start.
    pub fn looping(self) -> Self {
        let passed = self.pace() * (self.window[1] - self.window[0]);
        let cell = passed / (passed / CELL[0]).round().max(1.0);
        Self { cell: if cell < LEAST_CELL { CELL[0] } else { cell }, ..self }
    }

    /// Distance after which the specks repeat, px.
    #[cfg(test)]
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// The speed (px/s) at which the fluid goes by, at the motion's own speed.
    pub fn pace(&self) -> f64 {
        self.drift.map_or(0.0, |drift| drift.norm() * self.unit)
    }

    /// The nodes at a time as the camera sees them, m.
    fn points(&self, time: f64) -> Vec<Vector2<f64>> {
        let [first, last] = self.window;
        let part = if last > first { (time - first) / (last - first) } else { 0.0 };
        let points = self.motion.at(time).into_iter().zip(&self.gap);
        points.map(|(point, gap)| point - self.velocity * (time - first) - gap * part).collect()
    }

    /// The place of a point in the picture, px.
    fn pixel(&self, point: Vector2<f64>) -> Vector2<f64> {
        Vector2::new(point.x - self.corner.x, self.corner.y - point.y) * self.unit
    }

    /// The outline of the body at a time, as the data of a path, and the centre of the mark at its head, px.
    pub fn body(&self, time: f64) -> (String, [f64; 2]) {
        let points: Vec<_> = self.points(time).into_iter().map(|point| self.pixel(point)).collect();
        let polygons = self.motion.motion.rod.polygons(&points, self.unit, LEAST_HALF_WIDTH);
        let head = points.first().copied().unwrap_or_default();
        (polygons.iter().map(|polygon| path(polygon)).collect(), [head.x, head.y])
    }

    /// Radius of the mark at the head, px; `None` where it has no room.
    fn mark(&self) -> Option<f64> {
        let radius = 0.3 * self.motion.motion.rod.head_half_width() * self.unit;
        (radius > 1.0).then(|| radius.min(4.0))
    }

    /// The picture at a time.
    pub fn picture(&self, time: f64, clock: &str) -> String {
        let (body, head) = self.body(time);
        let shift = self.pace() * (time - self.window[0]) % self.cell;
        let mut svg = self.begin(self.motion.name, ""); // a GIF has no half transparent corners
        self.put_fluid(&mut svg, &format!(" transform=\"translate({} 0)\"", tenth(shift)), "");
        let _ = writeln!(svg, "<path class=\"body rim\" d=\"{body}\"{BODY}/>");
        if let Some(radius) = self.mark() {
            let _ = writeln!(
                svg,
                "<circle class=\"eye\" cx=\"{}\" cy=\"{}\" r=\"{radius:.1}\"{}/>",
                tenth(head[0]),
                tenth(head[1]),
                fill("eye")
            );
        }
        self.put_foot(&mut svg, clock);
        svg + "</svg>\n"
    }

    /// An animated picture that shows the window in `seconds`, over and over: so many keyframes, between which the outline is interpolated.
    pub fn animated(&self, seconds: f64, keyframes: usize, clock: &str, title: &str) -> String {
        let [first, last] = self.window;
        let keyframes = keyframes.max(2);
        let times = (0..keyframes).map(|n| first + (last - first) * n as f64 / (keyframes - 1) as f64);
        let (bodies, heads): (Vec<String>, Vec<[f64; 2]>) = times.map(|time| self.body(time)).unzip();
        let duration = clock_value(seconds);
        let animate = |name: &str, values: String| {
            format!(
                "<animate attributeName=\"{name}\" dur=\"{duration}s\" repeatCount=\"indefinite\" values=\"{values}\"/>"
            )
        };
        let list = |axis: usize| heads.iter().map(|head| tenth(head[axis]).to_string()).collect::<Vec<_>>().join(";");
        let still = bodies.first().cloned().unwrap_or_default();
        let mut svg = self.begin(title, " rx=\"8\"");
        let _ = writeln!(svg, "<!-- {MARK} -->");
        let pace = self.pace() * (last - first) / seconds;
        let passed = pace * seconds / WIDTH;
        let moves = match passed > AT_REST {
            true => format!(
                "<animateTransform attributeName=\"transform\" type=\"translate\" from=\"0 0\" to=\"{} 0\" dur=\"{}s\" repeatCount=\"indefinite\"/>",
                CELL[0],
                clock_value(CELL[0] / pace)
            ),
            false => String::new(),
        };
        self.put_fluid(&mut svg, "", &moves);
        let mark = |part: &str, [x, y]: [f64; 2], animation: &str| {
            let circle = |radius: f64| {
                format!(
                    "<circle class=\"eye\" cx=\"{}\" cy=\"{}\" r=\"{radius:.1}\"{}>{animation}</circle>",
                    tenth(x),
                    tenth(y),
                    fill("eye")
                )
            };
            self.mark().map_or_else(String::new, circle) + if part.is_empty() { "" } else { "\n" }
        };
        let head = heads.first().copied().unwrap_or_default();
        let animation = animate("cx", list(0)) + &animate("cy", list(1));
        let _ = write!(
            svg,
            "<g class=\"moving\"><path class=\"body rim\" d=\"{still}\"{BODY}>{}</path>{}</g>\n\
             <g class=\"still\" display=\"none\"><path class=\"body rim\" d=\"{still}\"{BODY}/>{}</g>\n",
            animate("d", bodies.join(";")),
            mark("", head, &animation),
            mark("", head, ""),
        );
        self.put_foot(&mut svg, clock);
        svg + "</svg>\n"
    }

    /// The head of a document, with its colours and the background, whose corners are as said.
    fn begin(&self, title: &str, corners: &str) -> String {
        let mut dark = String::new();
        for (class, property, [_, colour]) in COLOURS {
            let _ = write!(dark, ".{class}{{{property}:{colour}}}");
        }
        for (i, [_, colour]) in TINTS.iter().enumerate() {
            let _ = write!(dark, ".t{i}{{stop-color:{colour}}}");
        }
        let title = quick_xml::escape::escape(title);
        let (width, height) = (WIDTH, self.height);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" role=\"img\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"system-ui, sans-serif\" font-size=\"{FONT}\">\n<title>{title}</title>\n<style>@media (prefers-color-scheme:dark){{{dark}}}\
             @media (prefers-reduced-motion:reduce){{.moving{{display:none}}.still{{display:inline}}}}</style>\n"
        );
        let medium = self.motion.medium();
        let (class, paint) = match medium.and_then(|medium| Some((&medium.fluid, medium.interfaces()?))) {
            Some((first, layers)) => {
                self.put_layers(&mut svg, first, layers);
                ("layers", " fill=\"url(#layers)\"".to_string())
            }
            None if medium.is_some_and(is_fluid) => ("water", fill("water")),
            None => ("empty", fill("empty")),
        };
        let _ = writeln!(svg, "<rect class=\"{class}\" width=\"{width}\" height=\"{height}\"{corners}{paint}/>");
        svg
    }

    /// The tints of layered media, which blend where the fluids do.
    fn put_layers(&self, svg: &mut String, first: &Fluid, layers: &Layers) {
        let edges = || layers.iter().flat_map(|layer| [-0.5, 0.5].map(|part| layer.offset + part * layer.thickness));
        let (low, high) = edges().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (x.min(low), x.max(high)));
        let fluids: Vec<_> = std::iter::once(first).chain(layers.iter().map(|layer| &layer.fluid)).collect();
        let lighter =
            |a: &Fluid, b: &Fluid| a.density.total_cmp(&b.density).then(a.viscosity.total_cmp(&b.viscosity)).is_lt();
        let rank = |own: &Fluid| fluids.iter().filter(|other| lighter(other, own)).count();
        let deepest = fluids.iter().map(|fluid| rank(fluid)).max().unwrap_or(0).max(1);
        let tint = |i: usize| fluids.get(i).map_or(0, |fluid| rank(fluid) * 4 / deepest);
        let [from, to] = [low, high].map(|height| self.pixel(layers.normal * height));
        let _ = write!(
            svg,
            "<linearGradient id=\"layers\" gradientUnits=\"userSpaceOnUse\" x1=\"{}\" y1=\"{}\" x2=\"{}\" y2=\"{}\">",
            tenth(from.x),
            tenth(from.y),
            tenth(to.x),
            tenth(to.y)
        );
        for (i, edge) in edges().enumerate() {
            let tint = tint(i.div_ceil(2));
            let offset = (edge - low) / (high - low).max(f64::MIN_POSITIVE);
            let _ = write!(svg, "<stop class=\"t{tint}\" offset=\"{offset:.4}\" stop-color=\"{}\"/>", TINTS[tint][0]);
        }
        svg.push_str("</linearGradient>\n");
    }

    /// The specks in the fluid, which go along its drift.
    fn put_fluid(&self, svg: &mut String, attributes: &str, animation: &str) {
        let Some(drift) = self.drift else { return };
        let angle = if drift.norm() > 0.0 { (-drift.y).atan2(drift.x).to_degrees() } else { 0.0 };
        // A square that the picture is in however it is turned, and a cell more where the specks come from.
        let half = 0.5 * WIDTH.hypot(self.height);
        let mut specks = String::new();
        let rows = (half / CELL[1]).ceil() as i32;
        let columns = (half / self.cell).ceil() as i32;
        // As dense as in a cell of the usual size.
        let count = ((3.0 * self.cell / CELL[0]).round() as usize).clamp(1, 3);
        for row in -rows..rows {
            for column in -columns - 1..columns {
                for [x, y] in SPECKS[row.rem_euclid(2) as usize].into_iter().take(count) {
                    let (x, y) = ((f64::from(column) + x) * self.cell, (f64::from(row) + y) * CELL[1]);
                    // Specks that are never inside the picture are left out.
                    let turned = |x: f64| {
                        let (sin, cos) = angle.to_radians().sin_cos();
                        [x * cos - y * sin, x * sin + y * cos]
                    };
                    let inside = |[x, y]: [f64; 2]| x.abs() < 0.5 * WIDTH + 3.0 && y.abs() < 0.5 * self.height + 3.0;
                    if (0..=10).any(|part| inside(turned(x + f64::from(part) * 0.1 * self.cell))) {
                        let _ = write!(specks, "M{} {}h.1", tenth(x), tenth(y));
                    }
                }
            }
        }
        let _ = writeln!(
            svg,
            "<g transform=\"translate({} {}) rotate({})\"><path class=\"specks\" d=\"{specks}\"{} stroke-width=\"3.4\" \
             stroke-linecap=\"round\"{attributes}>{animation}</path></g>",
            tenth(0.5 * WIDTH),
            tenth(0.5 * self.height),
            tenth(angle),
            stroke("specks")
        );
    }

    /// The scale bar, and a word on the time.
    fn put_foot(&self, svg: &mut String, clock: &str) {
        let metres = round_below(0.22 * WIDTH / self.unit);
        let (length, y) = (metres * self.unit, self.height - 17.0);
        let _ = write!(
            svg,
            "<path class=\"bar\" d=\"M16 {y}h{}\"{} stroke-width=\"2.5\"/>\n\
             <text class=\"ink\" x=\"{}\" y=\"{}\"{ink}>{}</text>\n\
             <text class=\"ink\" x=\"{}\" y=\"{}\" text-anchor=\"end\"{ink}>{}</text>\n",
            tenth(length),
            stroke("bar"),
            tenth(16.0 + length + 8.0),
            y + 4.5,
            length_in_words(metres),
            WIDTH - 16.0,
            y + 4.5,
            quick_xml::escape::escape(clock),
            ink = fill("ink"),
        );
    }
}

/// How a body is drawn.
const BODY: &str = " fill=\"#0b6aa2\" stroke=\"#0b6aa2\" stroke-width=\".6\" stroke-linejoin=\"round\"";

fn light(class: &str) -> &'static str {
    COLOURS.iter().find(|(name, ..)| *name == class).map_or("", |(_, _, [light, _])| light)
}

fn fill(class: &str) -> String {
    format!(" fill=\"{}\"", light(class))
}

fn stroke(class: &str) -> String {
    format!(" stroke=\"{}\"", light(class))
}

/// The largest of 1, 2 and 5 times a power of ten that is not above `most`.
pub fn round_below(most: f64) -> f64 {
    let power = 10f64.powf(most.log10().floor());
    [5.0, 2.0, 1.0].iter().map(|digit| digit * power).find(|length| *length <= most * (1.0 + 1e-9)).unwrap_or(power)
}

/// A length with its unit.
fn length_in_words(metres: f64) -> String {
    let units = [(1e3, "km"), (1.0, "m"), (1e-2, "cm"), (1e-3, "mm"), (1e-6, "µm"), (1e-9, "nm")];
    let (size, unit) = units.into_iter().find(|(size, _)| metres >= 0.999 * size).unwrap_or(units[5]);
    format!("{} {unit}", in_sentence(metres / size, 3))
}

/// The box around points.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    low: Vector2<f64>,
    high: Vector2<f64>,
}

impl Bounds {
    fn of(points: impl Iterator<Item = Vector2<f64>>) -> Self {
        let none = Self { low: Vector2::repeat(f64::INFINITY), high: Vector2::repeat(f64::NEG_INFINITY) };
        let bounds =
            points.fold(none, |Self { low, high }, point| Self { low: low.inf(&point), high: high.sup(&point) });
        if bounds.low.x <= bounds.high.x { bounds } else { Self { low: Vector2::zeros(), high: Vector2::zeros() } }
    }

    fn size(&self) -> Vector2<f64> {
        self.high - self.low
    }

    fn diagonal(&self) -> f64 {
        self.size().norm()
    }

    fn middle(&self) -> Vector2<f64> {
        0.5 * (self.low + self.high)
    }
}

/// A duration (s) as SVG writes it: four digits, and no power of ten.
fn clock_value(seconds: f64) -> String {
    let decimals = (3.0 - seconds.log10().floor()).clamp(0.0, 12.0) as usize;
    let text = format!("{seconds:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
}

/// A number of px in tenths.
#[derive(Debug, Clone, Copy)]
struct Tenths(i64);

fn tenth(x: f64) -> Tenths {
    Tenths((10.0 * x).round() as i64)
}

impl std::fmt::Display for Tenths {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (sign, size) = (if self.0 < 0 { "-" } else { "" }, self.0.unsigned_abs());
        match (size / 10, size % 10) {
            (whole, 0) => write!(f, "{sign}{whole}"),
            (0, tenths) => write!(f, "{sign}.{tenths}"),
            (whole, tenths) => write!(f, "{sign}{whole}.{tenths}"),
        }
    }
}

/// A closed polygon (px) as the data of a path: its first corner, then the steps to the others. Steps are between rounded corners, so that
/// their rounding does not add up.
fn path(polygon: &[Vector2<f64>]) -> String {
    let mut corners = polygon.iter().map(|corner| [tenth(corner.x), tenth(corner.y)]);
    let Some([mut x, mut y]) = corners.next() else { return String::new() };
    let mut data = format!("M{x} {y}l");
    let mut apart = "";
    for [next_x, next_y] in corners {
        for step in [Tenths(next_x.0 - x.0), Tenths(next_y.0 - y.0)] {
            // A sign also separates numbers.
            let _ = if step.0 < 0 { write!(data, "{step}") } else { write!(data, "{apart}{step}") };
            apart = " ";
        }
        (x, y) = (next_x, next_y);
    }
    data + "z"
}

#[cfg(test)]
mod tests {
    use super::clock_value;

    #[test]
    fn durations_have_no_power_of_ten() {
        for (seconds, text) in
            [(5e-4, "0.0005"), (1.0, "1"), (1.6667, "1.667"), (12345.6, "12346"), (1.5e-7, "0.00000015")]
        {
            assert_eq!(clock_value(seconds), text);
        }
    }
}

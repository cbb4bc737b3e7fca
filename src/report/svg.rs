//! SVG documents: lines, dots, rectangles and texts, in colours that follow the light or dark theme of the reader.

use std::fmt::Write;

/// A colour for light and for dark pages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Colour(usize);

/// The colours of series, which people with colour-vision deficiency can distinguish (Okabe and Ito 2008), with a contrast of at
/// least three to the page; then those of the chart itself.
const PALETTE: [[&str; 2]; 13] = [
    ["#0072b2", "#4fa8e0"],
    ["#d55e00", "#f08a3c"],
    ["#009e73", "#2cc196"],
    ["#cc79a7", "#dd93bb"],
    ["#b87d00", "#f0b73a"],
    ["#2a94c8", "#8fd0f5"],
    ["#8a8a8a", "#a5a5a5"],
    ["#000000", "#f0f0f0"],
    ["#b4bcc4", "#5c6670"], // ghosts
    ["#1c2733", "#dfe6ec"], // ink
    ["#505a64", "#aab4be"], // labels
    ["#e2e7ec", "#333c46"], // grid
    ["#ffffff", "#161b21"], // paper
];

/// Number of series colours.
pub const SERIES: usize = 8;

/// Dash patterns, which distinguish series without colours.
const DASHES: [&str; SERIES] = ["", "9 3", "2 2.5", "9 3 2 3", "16 4", "5 2 1.5 2 1.5 2", "5 3", "1.5 4"];

/// The colours of series on light and on dark pages.
pub fn series_colours() -> &'static [[&'static str; 2]] {
    &PALETTE[..SERIES]
}

/// The dash pattern of series `k`; when colours repeat, patterns differ.
pub fn dashes(k: usize) -> &'static str {
    DASHES[(k + k / SERIES) % SERIES]
}

impl Colour {
    /// Earlier shapes and single cases in the background.
    pub const GHOST: Self = Self(8);
    /// Titles and axes.
    pub const INK: Self = Self(9);
    /// Labels.
    pub const SOFT: Self = Self(10);
    /// Grid lines.
    pub const GRID: Self = Self(11);
    /// The page.
    pub const PAPER: Self = Self(12);

    /// The colour of series `k`; from [`SERIES`] on they repeat.
    pub fn series(k: usize) -> Self {
        Self(k % SERIES)
    }

    fn light(self) -> &'static str {
        PALETTE[self.0][0]
    }
}

/// Alignment of a text at its point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// Left-aligned.
    Start,
    /// Centred.
    Middle,
    /// Right-aligned.
    End,
}

/// Approximate width of a text of this font size, px.
pub fn width(text: &str, size: f64) -> f64 {
    let narrow = |c: char| c.is_ascii() || matches!(c, '·' | '⁻' | '⁰' | '¹' | '²' | '³' | '⁴'..='⁹');
    text.chars().map(|c| if narrow(c) { 0.56 } else { 0.9 }).sum::<f64>() * size
}

/// A text of this font size, truncated to a width, px.
pub fn cut(text: &str, size: f64, available: f64) -> String {
    if width(text, size) <= available {
        return text.to_string();
    }
    let mut used = width("…", size);
    let fits = |c: &char| {
        used += width(c.encode_utf8(&mut [0; 4]), size);
        used <= available
    };
    text.chars().take_while(fits).chain(['…']).collect()
}

/// A text of this font size in at most `most` lines of a width (px); the rest is truncated.
pub fn wrapped(text: &str, size: f64, available: f64, most: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if width(line, size) + width(word, size) + width(" ", size) > available => {
                lines.push(word.to_string())
            }
            Some(line) => {
                line.push(' ');
                line.push_str(word);
            }
            None => lines.push(word.to_string()),
        }
    }
    if lines.len() > most {
        let rest = lines.split_off(most - 1).join(" ");
        lines.push(rest);
    }
    lines.iter().map(|line| cut(line, size, available)).collect()
}

/// Smallest font size of a title or an axis name, px, before it is truncated: nine on a phone, at the smallest width of figures
/// there.
const LEAST_SIZE: f64 = 11.0;

/// A text of this font size, which is reduced and then truncated if it does not fit a width, px; and its font size.
fn fitted(text: &str, size: f64, available: f64) -> (String, f64) {
    let size = size * (0.999 * available / width(text, size)).clamp((LEAST_SIZE / size).min(1.0), 1.0); // with a margin for rounding
    (cut(text, size, available), size)
}

/// Distance of the strokes of a hatched cell along its sides, px.
const HATCH: f64 = 7.0;

/// The attribute of a group with a tooltip.
pub const NOTE: &str = "class=\"note\"";

/// Writer of an SVG document.
#[derive(Debug)]
pub struct Svg(String);

impl Svg {
    /// An empty document with this size in px.
    pub fn new(width: f64, height: f64, title: &str) -> Self {
        let mut dark = String::new();
        for (i, [_, colour]) in PALETTE.iter().enumerate() {
            let _ = write!(dark, ".chart .s{i}{{stroke:{colour}}}.chart .f{i}{{fill:{colour}}}");
        }
        let mut svg = Self(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"chart\" role=\"img\" width=\"{w}\" height=\"{h}\" \
             viewBox=\"0 0 {w} {h}\" font-family=\"system-ui, sans-serif\">\n<title>{}</title>\n\
             <style>@media (prefers-color-scheme:dark){{{dark}}}</style>\n",
            escaped(title),
            w = decimal(width),
            h = decimal(height),
        ));
        svg.rectangle([0.0, 0.0], [width, height], Colour::PAPER);
        svg
    }

    /// A line through points; nothing for fewer than two.
    pub fn line(&mut self, points: &[(f64, f64)], colour: Colour, width: f64, dashes: &str) {
        if points.len() < 2 {
            return;
        }
        self.0 += "<polyline fill=\"none\" points=\"";
        let mut digits = [0; 16];
        for (x, y) in points {
            self.0.push_str(decimal(*x).text(&mut digits));
            self.0.push(',');
            self.0.push_str(decimal(*y).text(&mut digits));
            self.0.push(' ');
        }
        let dashes = if dashes.is_empty() { String::new() } else { format!(" stroke-dasharray=\"{dashes}\"") };
        let _ = writeln!(
            self.0,
            "\" class=\"s{}\" stroke=\"{}\" stroke-width=\"{width}\" stroke-linejoin=\"round\"{dashes}/>",
            colour.0,
            colour.light()
        );
    }

    /// Begins a group that has a tooltip.
    pub fn begin_note(&mut self, note: &str) {
        let lines: Vec<String> = note.lines().map(escaped).collect();
        let _ = writeln!(self.0, "<g {NOTE}><title>{}</title>", lines.join("\n"));
    }

    /// Ends it.
    pub fn end_note(&mut self) {
        self.0 += "</g>\n";
    }

    /// A dot.
    pub fn dot(&mut self, (x, y): (f64, f64), radius: f64, colour: Colour) {
        let (x, y) = (decimal(x), decimal(y));
        let _ = writeln!(
            self.0,
            "<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" class=\"f{}\" fill=\"{}\"/>",
            colour.0,
            colour.light()
        );
    }

    /// The mark of series `k`, of about this radius: a dot, a square, a diamond or a triangle; when colours repeat, marks differ.
    pub fn mark(&mut self, k: usize, (x, y): (f64, f64), radius: f64, colour: Colour) {
        let corners: &[(f64, f64)] = match (k + k / SERIES) % 4 {
            0 => return self.dot((x, y), radius, colour),
            1 => &[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)],
            2 => &[(0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)],
            _ => &[(0.0, -1.2), (1.2, 0.9), (-1.2, 0.9)],
        };
        self.0 += "<polygon points=\"";
        for (dx, dy) in corners {
            let _ = write!(self.0, "{},{} ", decimal(x + radius * dx), decimal(y + radius * dy));
        }
        let _ = writeln!(self.0, "\" class=\"f{}\" fill=\"{}\"/>", colour.0, colour.light());
    }

    /// A filled rectangle.
    pub fn rectangle(&mut self, at: [f64; 2], size: [f64; 2], colour: Colour) {
        self.field(at, size, colour.light(), &format!(" class=\"f{}\"", colour.0));
    }

    /// The same in a colour that does not depend on the theme.
    pub fn cell(&mut self, at: [f64; 2], size: [f64; 2], [r, g, b]: [u8; 3]) {
        self.field(at, size, &format!("#{r:02x}{g:02x}{b:02x}"), "");
    }

    /// Light strokes across a cell, from its lower left to its upper right.
    pub fn hatch(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2]) {
        self.0 += "<path d=\"";
        let mut along = HATCH / 2.0;
        while along < width + height {
            // Strokes at this distance of x + y from the upper left corner.
            let (left, right) = ((along - height).max(0.0), along.min(width));
            let [x0, y0, x1, y1] = [x + left, y + along - left, x + right, y + along - right].map(decimal);
            let _ = write!(self.0, "M{x0} {y0}L{x1} {y1}");
            along += HATCH;
        }
        let _ = writeln!(self.0, "\" stroke=\"#ffffff\" stroke-width=\"1.5\"/>");
    }

    /// Rectangles (left, top, width, height) in one colour that does not depend on the theme. They overlap slightly, to avoid gaps.
    pub fn cells(&mut self, cells: &[[f64; 4]], [r, g, b]: [u8; 3]) {
        self.0 += "<path d=\"";
        for cell in cells {
            let [x, y, width, height] = [cell[0], cell[1], cell[2] + 0.3, cell[3] + 0.3].map(decimal);
            let _ = write!(self.0, "M{x} {y}h{width}v{height}h-{width}z");
        }
        let _ = writeln!(self.0, "\" fill=\"#{r:02x}{g:02x}{b:02x}\" shape-rendering=\"crispEdges\"/>");
    }

    fn field(&mut self, at: [f64; 2], size: [f64; 2], fill: &str, class: &str) {
        let ([x, y], [width, height]) = (at.map(decimal), size.map(decimal));
        let _ = writeln!(
            self.0,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\"{class} fill=\"{fill}\"/>"
        );
    }

    /// A text with its baseline at a point.
    pub fn text(&mut self, (x, y): (f64, f64), text: &str, size: f64, anchor: Anchor, colour: Colour) {
        let place = format!("x=\"{}\" y=\"{}\"", decimal(x), decimal(y));
        self.words(&place, text, size, anchor, (&format!("f{}", colour.0), colour));
    }

    /// A text over lines, with a halo of paper.
    pub fn text_over_lines(&mut self, (x, y): (f64, f64), text: &str, size: f64, anchor: Anchor) {
        let halo = format!(
            "x=\"{}\" y=\"{}\" stroke=\"{}\" stroke-width=\"7\" stroke-linejoin=\"round\" \
             paint-order=\"stroke\"",
            decimal(x),
            decimal(y),
            Colour::PAPER.light()
        );
        let classes = format!("f{} s{}", Colour::SOFT.0, Colour::PAPER.0);
        self.words(&halo, text, size, anchor, (&classes, Colour::SOFT));
    }

    /// A title or the name of an axis within this width (px), centred at a point.
    pub fn heading(&mut self, at: (f64, f64), text: &str, size: f64, available: f64) {
        let (text, size) = fitted(text, size, available);
        self.text(at, &text, size, Anchor::Middle, Colour::INK);
    }

    /// The name of an axis, read from bottom to top, in two lines if it does not fit one.
    pub fn upright_name(&mut self, (x, y): (f64, f64), text: &str, size: f64, available: f64) {
        match &wrapped(text, LEAST_SIZE, available, 2)[..] {
            [first, second] => {
                self.upright((x - 4.0, y), first, LEAST_SIZE, Colour::INK);
                self.upright((x + 9.0, y), second, LEAST_SIZE, Colour::INK);
            }
            _ => self.upright_heading((x, y), text, size, available),
        }
    }

    /// A heading, read from bottom to top.
    pub fn upright_heading(&mut self, at: (f64, f64), text: &str, size: f64, available: f64) {
        let (text, size) = fitted(text, size, available);
        self.upright(at, &text, size, Colour::INK);
    }

    /// A vertical text, centred at a point.
    pub fn upright(&mut self, (x, y): (f64, f64), text: &str, size: f64, colour: Colour) {
        let place = format!("transform=\"translate({} {}) rotate(-90)\"", decimal(x), decimal(y));
        self.words(&place, text, size, Anchor::Middle, (&format!("f{}", colour.0), colour));
    }

    fn words(&mut self, place: &str, text: &str, size: f64, anchor: Anchor, (classes, colour): (&str, Colour)) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let _ = writeln!(
            self.0,
            "<text {place} font-size=\"{size}\" text-anchor=\"{anchor}\" class=\"{classes}\" fill=\"{}\">{}</text>",
            colour.light(),
            escaped(text)
        );
    }

    /// The document.
    pub fn finish(mut self) -> String {
        self.0 += "</svg>\n";
        self.0
    }
}

/// A coordinate, to a hundredth of a pixel.
#[derive(Debug, Clone, Copy)]
struct Decimal(i32);

fn decimal(x: f64) -> Decimal {
    Decimal((100.0 * x).round() as i32)
}

impl std::fmt::Display for Decimal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut digits = [0; 16];
        f.write_str(self.text(&mut digits))
    }
}

impl Decimal {
    /// Its digits without trailing zeros.
    fn text(self, buffer: &mut [u8; 16]) -> &str {
        let (mut rest, mut at) = (self.0.unsigned_abs(), buffer.len());
        let mut put = |digit: u8| {
            at -= 1;
            buffer[at] = digit;
        };
        let mut decimals = 2;
        while decimals > 0 && rest.is_multiple_of(10) {
            (rest, decimals) = (rest / 10, decimals - 1);
        }
        for _ in 0..decimals {
            put(b'0' + (rest % 10) as u8);
            rest /= 10;
        }
        if decimals > 0 {
            put(b'.');
        }
        loop {
            put(b'0' + (rest % 10) as u8);
            rest /= 10;
            if rest == 0 {
                break;
            }
        }
        if self.0 < 0 {
            put(b'-');
        }
        std::str::from_utf8(&buffer[at..]).unwrap_or_default()
    }
}

fn escaped(text: &str) -> String {
    let clean: String = text.chars().filter(|c| !c.is_control()).collect();
    quick_xml::escape::escape(clean.as_str()).into_owned()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]
    use super::*;

    /// Relative luminance of a colour such as `#0072b2` (WCAG 2.2).
    fn luminance(colour: &str) -> f64 {
        let channel = |at: usize| {
            let value = f64::from(u8::from_str_radix(&colour[at..at + 2], 16).unwrap_or(0)) / 255.0;
            if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * channel(1) + 0.7152 * channel(3) + 0.0722 * channel(5)
    }

    #[test]
    fn every_series_is_seen_on_both_pages_and_told_apart_without_colours() {
        for (side, paper) in PALETTE[Colour::PAPER.0].iter().enumerate() {
            for series in &PALETTE[..SERIES] {
                let [a, b] = [luminance(series[side]), luminance(paper)];
                let contrast = (a.max(b) + 0.05) / (a.min(b) + 0.05);
                assert!(contrast >= 3.0, "{} on {paper}: {contrast}", series[side]); // measured: at least 3.06
            }
        }
        let looks = |range: std::ops::Range<usize>| range.map(dashes).collect::<std::collections::BTreeSet<_>>().len();
        assert_eq!(looks(0..SERIES), SERIES);
        assert!((0..SERIES).all(|k| dashes(k) != dashes(k + SERIES)));
        // Other rods in an animation have the colours of series.
        let (style, player) = (include_str!("style.css"), include_str!("player.js"));
        assert_eq!(style.matches("--series-{{ loop.index0 }}").count(), 2, "light and dark");
        assert!(player.contains("\"var(--series-\" + rod.series % SERIES_COLOURS + \")\""));
        // A body in any fluid is seen: in percent of the rod's colour on the field's.
        let part =
            style.split("#outline { fill: color-mix(in srgb, var(--rod) ").nth(1).unwrap().split('%').next().unwrap();
        let part: f64 = part.parse::<f64>().unwrap() / 100.0;
        for theme in style.split(":root {").skip(1).take(2) {
            let channels = |name: &str| {
                let hex = theme.split(&format!("--{name}: #")).nth(1).unwrap();
                [0, 2, 4].map(|i| f64::from(u8::from_str_radix(&hex[i..i + 2], 16).unwrap()))
            };
            let (rod, field) = (channels("rod"), channels("field"));
            for medium in (0..5).map(|i| channels(&format!("medium-{i}"))) {
                let apart = |i: usize| (part * rod[i] + (1.0 - part) * field[i] - medium[i]).abs();
                let most = (0..3).map(apart).fold(0.0, f64::max);
                assert!(most > 40.0, "{most} of 255"); // measured: at least 44
            }
        }
        // The lines of any number of them differ from each other, from the first rod's and from that of centres of mass.
        let companions = (0..60).map(crate::report::page::Animation::series_of_companion);
        let seen: std::collections::BTreeSet<_> = companions.clone().chain([0, 1]).collect();
        assert_eq!(seen.len(), 62);
        for (i, series) in companions.enumerate() {
            let first = crate::report::page::Animation::series_of_companion(i % 6);
            assert!(![0, 1].contains(&(series % SERIES)) && series % SERIES == first, "{i}: {series}");
        }
        // Four marks in turn, independent of the colour.
        let mark = |k: usize| {
            let mut svg = Svg(String::new());
            svg.mark(k, (0.0, 0.0), 3.0, Colour::INK);
            svg.0
        };
        assert_eq!((0..SERIES).map(mark).collect::<std::collections::BTreeSet<_>>().len(), 4);
        assert!((0..SERIES).all(|k| mark(k) != mark(k + 1)));
        let looks = (0..4 * SERIES).map(|k| (k % SERIES, mark(k))).collect::<std::collections::BTreeSet<_>>();
        assert_eq!(looks.len(), 4 * SERIES, "dots of one colour have marks of their own");
    }

    #[test]
    fn a_text_is_wrapped_between_words_and_truncated_where_it_has_no_more_lines() {
        let lines = |text: &str, most| wrapped(text, 10.0, 62.0, most); // eleven letters
        assert_eq!(lines("glycerol & <syrup>", 2), ["glycerol &", "<syrup>"]);
        assert_eq!(lines("water of the usual sort", 2), ["water of", "the usual…"]);
        assert_eq!(lines("symplectic-euler", 3), ["symplecti…"]);
        assert_eq!(lines("", 3), [""]);
    }
}

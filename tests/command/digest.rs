//! Digests of what commands leave: the texts in their order, and of all numbers of one kind how many there are, their size, and a sum that
//! weighs each by its place, so that a moved, exchanged or lost thing is another number. A digest is kept in `tests/recorded` and compared
//! with a tolerance, see `common/recorded.rs`.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use crate::common::recorded::{TextPart, parts, rounded};

/// Numbers that are smaller are what rounding leaves of zero.
const ROUNDING: f64 = 1e-13;

pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Many numbers in two, and many words in one.
#[derive(Default)]
struct Totals {
    numbers: Vec<f64>,
    words: String,
}

impl Totals {
    fn take(&mut self, text: &str) {
        for part in parts(text) {
            match part {
                TextPart::Number(value, _) => self.numbers.push(if value.abs() < ROUNDING { 0.0 } else { value }),
                TextPart::Words(words) => self.words.push_str(words),
                TextPart::Anything => {}
            }
        }
        self.words.push('\n');
    }

    /// The sum of sizes, and the mean of what each is of it, with its sign and a weight from 1/2 to 3/2 that differs from place to place;
    /// plus three, so that the tolerance is one of that mean.
    fn shown(&self) -> String {
        let Self { numbers, words } = self;
        if numbers.len() == 1 {
            return format!(" {}", rounded(&format!("{:e}", numbers[0])));
        }
        let finite = || numbers.iter().map(|x| if x.is_finite() { *x } else { 1.0 });
        let size: f64 = finite().map(f64::abs).sum();
        let weight = |k: usize| 0.5 + ((k + 1) as f64 * 0.618_033_988_75).fract();
        let mean: f64 = finite().enumerate().map(|(k, x)| weight(k) * x).sum::<f64>() / size.max(f64::MIN_POSITIVE);
        let mut shown = String::new();
        if !numbers.is_empty() {
            shown = format!(" {:e} {:.6}", format!("{size:.6e}").parse::<f64>().unwrap(), mean + 3.0);
        }
        if words.chars().any(|c| c.is_alphanumeric()) {
            write!(shown, " {}", fingerprint(words)).unwrap();
        }
        shown
    }
}

/// A word that stands for a text.
pub fn fingerprint(text: &str) -> String {
    let of = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
    let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325, of);
    format!("h{:08x}", (hash >> 32) as u32 ^ hash as u32)
}

/// A tag with its attributes, and the text after it.
struct Element<'a> {
    name: &'a str,
    attributes: Vec<(&'a str, &'a str)>,
    text: &'a str,
}

/// The elements of XML without comments.
fn elements(text: &str) -> Vec<Element<'_>> {
    let mut elements = Vec::new();
    for piece in text.split('<').skip(1) {
        let Some((tag, text)) = piece.split_once('>') else { continue };
        if tag.starts_with(['/', '?', '!']) {
            continue;
        }
        let tag = tag.trim_end_matches('/');
        let (name, mut rest) = tag.split_once(char::is_whitespace).unwrap_or((tag, ""));
        let mut attributes = Vec::new();
        while let Some((key, after)) = rest.split_once("=\"") {
            let (value, after) = after.split_once('"').unwrap_or((after, ""));
            attributes.push((key.trim(), value));
            rest = after;
        }
        elements.push(Element { name, attributes, text: text.trim() });
    }
    elements
}

/// The digest of a figure.
pub fn figure(svg: &str) -> String {
    let mut texts = Vec::new();
    let mut kinds: BTreeMap<&str, (usize, BTreeMap<&str, Totals>)> = BTreeMap::new();
    let all = elements(svg);
    for element in &all {
        if !element.text.is_empty() && element.name != "style" {
            texts.push(element.text);
        }
        let (count, heaps) = kinds.entry(element.name).or_default();
        *count += 1;
        for (key, value) in &element.attributes {
            // The words of all attributes together: colours, kinds of lines and anchors.
            match *key {
                "xmlns" | "role" | "font-family" => {}
                "x" | "y" | "cx" | "cy" | "points" | "d" | "transform" => {
                    heaps.entry(key).or_default().take(value);
                }
                _ => heaps.entry("and").or_default().take(value),
            }
        }
    }
    let mut lines = format!("{}\n", rounded(&texts.join(" | ")));
    for (kind, (count, heaps)) in kinds {
        let heaps: String = heaps.iter().map(|(key, totals)| format!(", {key}{}", totals.shown())).collect();
        if kind != "style" && kind != "title" {
            writeln!(lines, "{kind} {count}{heaps}").unwrap();
        }
    }
    lines
}

/// The digest of a page.
pub fn page(html: &str) -> String {
    let (mut rest, mut lines, mut plain) = (html, String::new(), String::new());
    while let Some(start) = ["<svg", "<script", "<style", "<pre", "<table id=\"numbers\""]
        .iter()
        .filter_map(|begin| Some((rest.find(begin)?, *begin)))
        .min()
    {
        let (at, begin) = start;
        let name = &begin[1..].split(' ').next().unwrap();
        let end = format!("</{name}>");
        let until = rest[at..].find(&end).map_or(rest.len(), |length| at + length + end.len());
        let inner = &rest[at..until];
        plain.push_str(&rest[..at]);
        rest = &rest[until..];
        match *name {
            "svg" => {
                let mut totals = Totals::default();
                let all = elements(inner);
                all.iter().filter(|own| own.name != "svg").for_each(|element| {
                    element.attributes.iter().for_each(|(_, value)| totals.take(value));
                    totals.take(if element.name == "style" { "" } else { element.text });
                });
                writeln!(plain, "[svg {}{}]", all.len(), totals.shown()).unwrap();
            }
            "script" if inner.contains("application/json") => {
                let text = inner.split_once('>').unwrap().1.trim_end_matches("</script>");
                let value = serde_json::from_str(text).unwrap();
                plain.push_str(&json(&value));
            }
            "table" => {
                let names: String = inner.split("<tr><td>").skip(1).filter_map(|row| row.split('<').next()).collect();
                writeln!(plain, "[{} numbers {}]", inner.matches("<tr>").count(), fingerprint(&names)).unwrap();
            }
            // The scene's own text, and what is the same in every page.
            _ => writeln!(plain, "[{name}]").unwrap(),
        }
    }
    plain.push_str(rest);
    for line in plain.lines() {
        let line = line.replace("</td>", " | ").replace("</th>", " | ");
        let mut shown = String::new();
        for (i, piece) in line.split('<').enumerate() {
            shown.push_str(if i == 0 { piece } else { piece.split_once('>').map_or("", |(_, text)| text) });
        }
        let shown =
            plain_numbers(&shown).replace(env!("CARGO_PKG_VERSION"), "VERSION").replace(root().to_str().unwrap(), ".");
        if !shown.trim().is_empty() {
            writeln!(lines, "{}", rounded(shown.trim())).unwrap();
        }
    }
    lines
}

/// A line of a page with its numbers as programs write them.
fn plain_numbers(line: &str) -> String {
    let raised = |c: char| "⁰¹²³⁴⁵⁶⁷⁸⁹".chars().position(|digit| digit == c).map(|digit| digit.to_string());
    let mut pieces = line.split("·10");
    let mut plain = pieces.next().unwrap_or_default().to_string();
    for piece in pieces {
        let power: String =
            piece.chars().map_while(|c| if c == '⁻' { Some("-".to_string()) } else { raised(c) }).collect();
        let letters = power.chars().count();
        plain += &if letters > 0 { format!("e{power}") } else { "·10".to_string() };
        plain.extend(piece.chars().skip(letters));
    }
    plain.replace('\u{a0}', " ").replace('−', "-")
}

/// The digest of JSON: of what is at each path, lists as one.
pub fn json(value: &serde_json::Value) -> String {
    fn collect(value: &serde_json::Value, path: &str, heaps: &mut BTreeMap<String, Totals>) {
        match value {
            serde_json::Value::Object(entries) => {
                entries.iter().for_each(|(key, value)| collect(value, &format!("{path}.{key}"), heaps));
            }
            serde_json::Value::Array(items) => {
                // A scalar's position is in its weight, a list's length in the sum.
                heaps.entry(format!("{path} lists")).or_default().numbers.push(items.len() as f64);
                items.iter().for_each(|item| collect(item, &format!("{path}[]"), heaps));
            }
            serde_json::Value::Number(number) => {
                heaps.entry(path.to_string()).or_default().numbers.push(number.as_f64().unwrap());
            }
            serde_json::Value::String(text) => heaps.entry(path.to_string()).or_default().take(text),
            other => heaps.entry(path.to_string()).or_default().words += &other.to_string(),
        }
    }
    let mut heaps = BTreeMap::new();
    collect(value, "", &mut heaps);
    heaps.iter().map(|(path, totals)| format!("{path}:{}\n", totals.shown())).collect()
}

/// The digest of a table: a line for each column.
pub fn table(text: &str) -> String {
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).flexible(true).from_reader(text.as_bytes());
    let header = reader.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let mut lines = format!("{} rows\n", rows.len());
    for (i, name) in header.iter().enumerate() {
        let mut totals = Totals::default();
        rows.iter().filter_map(|row| row.get(i)).for_each(|cell| totals.take(cell));
        writeln!(lines, "{name}:{}", totals.shown()).unwrap();
    }
    lines
}

/// The digest of XML with many numbers in its texts: of each element with a name, in order.
pub fn xml(text: &str) -> String {
    let mut lines = String::new();
    for element in elements(text) {
        let attributes: String = element.attributes.iter().map(|(key, value)| format!(" {key}={value}")).collect();
        let mut totals = Totals::default();
        totals.take(element.text);
        writeln!(lines, "{}{attributes}:{} {}", element.name, totals.shown(), totals.numbers.len()).unwrap();
    }
    lines
}

/// The digest of any other text.
pub fn plain(text: &str) -> String {
    let mut totals = Totals::default();
    text.lines().for_each(|line| totals.take(line));
    format!("{} lines:{} {}\n", text.lines().count(), totals.shown(), totals.numbers.len())
}

/// The digest of a file, by its ending.
pub fn file(path: &Path) -> String {
    // Of any clone.
    let text = || String::from_utf8_lossy(&std::fs::read(path).unwrap()).replace(env!("CARGO_MANIFEST_DIR"), ".");
    match path.extension().map(|ending| ending.to_string_lossy().into_owned()).as_deref() {
        Some("svg") => figure(&text()),
        Some("html") => page(&text()),
        Some("csv") => table(&text()),
        Some("json") => json(&serde_json::from_str(&text()).unwrap()),
        Some("vtp" | "pvd") => xml(&text()),
        _ => plain(&text()),
    }
}

/// All files in a folder and those in it, sorted.
pub fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> =
        entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect();
    files.sort();
    files
}

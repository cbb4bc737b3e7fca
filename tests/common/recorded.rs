//! What a program told, kept in a file and compared line by line: numbers within a tolerance, everything else to the letter.

use std::path::{Path, PathBuf};

/// Set to record in place of comparing.
pub const WRITE: &str = "CAUDAL_WRITE_RECORDED";

/// Numbers differ by no more than this part of them.
const TOLERANCE: f64 = 2e-5;

/// A rod longer by this part is the same rod: what it changes by more than a quarter of the tolerance, is rounding or a time of the machine, and
/// recorded as [`ANYTHING`].
pub const LONGER: f64 = 1e-11;

/// In the place of a number that is not compared.
const ANYTHING: &str = "~";

/// A part of a line: a number with its text, what may be any number, or what is between numbers.
#[derive(Debug, Clone, PartialEq)]
enum Part<'a> {
    Words(&'a str),
    Number(f64, &'a str),
    Any,
}

/// The numbers of a line and what is between them. A digit in a name is part of it.
fn parts(line: &str) -> Vec<Part<'_>> {
    let bytes = line.as_bytes();
    let (mut parts, mut begin, mut i) = (Vec::new(), 0, 0);
    while i < bytes.len() {
        if bytes[i] == ANYTHING.as_bytes()[0] {
            if begin < i {
                parts.push(Part::Words(&line[begin..i]));
            }
            parts.push(Part::Any);
            (begin, i) = (i + 1, i + 1);
            continue;
        }
        let in_name = i > 0 && (bytes[i - 1].is_ascii_alphanumeric() || bytes[i - 1] == b'_' || bytes[i - 1] >= 0x80);
        let signed = usize::from(bytes[i] == b'-');
        if in_name || !bytes.get(i + signed).is_some_and(u8::is_ascii_digit) {
            i += 1;
            continue;
        }
        let mut end = i + signed;
        let digits = |mut at: usize| {
            while bytes.get(at).is_some_and(u8::is_ascii_digit) {
                at += 1;
            }
            at
        };
        end = digits(end);
        if bytes.get(end) == Some(&b'.') && bytes.get(end + 1).is_some_and(u8::is_ascii_digit) {
            end = digits(end + 1);
        }
        if bytes.get(end) == Some(&b'e') {
            let exponent = end + 1 + usize::from(matches!(bytes.get(end + 1), Some(b'-' | b'+')));
            if digits(exponent) > exponent {
                end = digits(exponent);
            }
        }
        if begin < i {
            parts.push(Part::Words(&line[begin..i]));
        }
        parts.push(Part::Number(line[i..end].parse().unwrap(), &line[i..end]));
        (begin, i) = (end, end);
    }
    if begin < line.len() {
        parts.push(Part::Words(&line[begin..]));
    }
    parts
}

/// The line with numbers of at most seven digits, and without fingerprints and the folder of the project.
pub fn rounded(line: &str) -> String {
    let shown = |part: Part<'_>| match part {
        Part::Words(words) => words.to_string(),
        Part::Number(_, own) if own.len() <= 8 => own.to_string(),
        Part::Number(value, _) => format!("{:e}", format!("{value:.6e}").parse::<f64>().unwrap()),
        Part::Any => ANYTHING.to_string(),
    };
    let line = line.replace(env!("CARGO_MANIFEST_DIR"), ".");
    let fingerprint = |word: &&str| word.len() == 32 && word.bytes().all(|byte| byte.is_ascii_hexdigit());
    let words = line.split(|c: char| !c.is_ascii_alphanumeric()).filter(fingerprint);
    let line = words.fold(line.clone(), |line, word| line.replace(word, "fingerprint"));
    parts(&line).into_iter().map(shown).collect()
}

/// What two lines, which differ in numbers, have in common.
pub fn common(line: &str, other: &str) -> String {
    let (own, others) = (parts(line), parts(other));
    let same = |(part, other): (&Part<'_>, &Part<'_>)| match (part, other) {
        (Part::Number(a, own), Part::Number(b, _)) if are_near(*a, *b, 0.25 * TOLERANCE) => (*own).to_string(),
        (Part::Words(words), _) => (*words).to_string(),
        _ => ANYTHING.to_string(),
    };
    assert_eq!(own.len(), others.len(), "{line} {other}");
    own.iter().zip(&others).map(same).collect()
}

fn are_near(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * a.abs().max(b.abs())
}

pub fn are_alike(before: &str, now: &str) -> bool {
    let (before, now) = (parts(before), parts(now));
    before.len() == now.len()
        && before.iter().zip(&now).all(|pair| match pair {
            (Part::Number(a, _), Part::Number(b, _)) => are_near(*a, *b, TOLERANCE),
            (Part::Any, Part::Number(..)) => true,
            (a, b) => a == b,
        })
}

/// Compares what `made` tells of a rod longer by no part with the file `name` of tests/recorded, or records it there.
///
/// # Panics
/// Where it tells something else.
pub fn is_as_recorded(name: &str, made: impl Fn(f64) -> String) {
    let path: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recorded").join(format!("{name}.txt"));
    let lines = |text: String| text.lines().map(rounded).collect::<Vec<_>>();
    if std::env::var_os(WRITE).is_some() {
        let [own, other] = [0.0, LONGER].map(|longer| lines(made(longer)));
        let kept: String = own.iter().zip(&other).map(|(line, other)| common(line, other) + "\n").collect();
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, kept).unwrap();
        return;
    }
    let now = lines(made(0.0));
    let before = std::fs::read_to_string(&path).unwrap_or_default();
    let before: Vec<&str> = before.lines().collect();
    let differing = (0..before.len().max(now.len())).filter(|i| match (before.get(*i), now.get(*i)) {
        (Some(before), Some(now)) => !are_alike(before, now),
        _ => true,
    });
    let shown = |lines: Option<&str>| lines.unwrap_or("nothing").to_string();
    let changed: Vec<String> = differing
        .map(|i| format!("{}: was {}\n  is  {}", i + 1, shown(before.get(i).copied()), shown(now.get(i).map(|s| &**s))))
        .collect();
    assert!(
        changed.is_empty(),
        "{name}: {} lines changed; if they are meant to, {WRITE}=1 records them anew\n{}",
        changed.len(),
        changed[..changed.len().min(12)].join("\n")
    );
}

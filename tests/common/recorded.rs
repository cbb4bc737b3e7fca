//! What a program told, kept in a file and compared line by line: numbers within a tolerance, everything else to the letter.

use std::path::{Path, PathBuf};

/// Set to record in place of comparing.
pub const WRITE: &str = "CAUDAL_WRITE_RECORDED";

/// Numbers differ by no more than this part of them.
const TOLERANCE: f64 = 2e-5;

/// A rod longer by this part is the same rod: what it changes by more than a quarter of the tolerance, is rounding or a time of the machine, and
/// recorded as [`ANYTHING`].
pub const LONGER: f64 = 1e-11;

/// In the place of a number, or of a line, that is not compared.
const ANYTHING: &str = "~";

/// A number in a text, or what is between numbers.
#[derive(Debug, Clone, PartialEq)]
pub enum TextPart<'a> {
    /// What is between numbers.
    Words(&'a str),
    /// A number and its text.
    Number(f64, &'a str),
    /// What is not compared.
    Anything,
}

/// The numbers of a text and what is between them. A digit in a name is part of it.
pub fn parts(text: &str) -> Vec<TextPart<'_>> {
    let bytes = text.as_bytes();
    let digits = |mut at: usize| {
        while bytes.get(at).is_some_and(u8::is_ascii_digit) {
            at += 1;
        }
        at
    };
    let (mut parts, mut begin, mut i) = (Vec::new(), 0, 0);
    while i < bytes.len() {
        if bytes[i] == ANYTHING.as_bytes()[0] {
            if begin < i {
                parts.push(TextPart::Words(&text[begin..i]));
            }
            parts.push(TextPart::Anything);
            (begin, i) = (i + 1, i + 1);
            continue;
        }
        let before = i.checked_sub(1).map_or(b' ', |before| bytes[before]);
        let in_name = before.is_ascii_alphanumeric() || matches!(before, b'_' | b'#' | b'.') || before >= 0x80;
        let first = i + usize::from(bytes[i] == b'-');
        let mut end = digits(first);
        if in_name || end == first {
            i += 1;
            continue;
        }
        if bytes.get(end) == Some(&b'.') && digits(end + 1) > end + 1 {
            end = digits(end + 1);
        }
        let exponent = end + 1 + usize::from(matches!(bytes.get(end + 1), Some(b'-' | b'+')));
        if bytes.get(end) == Some(&b'e') && digits(exponent) > exponent {
            end = digits(exponent);
        }
        if begin < i {
            parts.push(TextPart::Words(&text[begin..i]));
        }
        parts.push(TextPart::Number(text[i..end].parse().unwrap(), &text[i..end]));
        (begin, i) = (end, end);
    }
    if begin < bytes.len() {
        parts.push(TextPart::Words(&text[begin..]));
    }
    parts
}

/// The line with numbers of at most seven digits.
pub fn rounded(line: &str) -> String {
    let shown = |part: TextPart<'_>| match part {
        TextPart::Words(words) => words.to_string(),
        TextPart::Number(_, own) if own.len() <= 8 || is_whole(own) => own.to_string(),
        TextPart::Number(value, _) => format!("{:e}", format!("{value:.6e}").parse::<f64>().unwrap()),
        TextPart::Anything => ANYTHING.to_string(),
    };
    parts(line).into_iter().map(shown).collect()
}

/// Whole numbers, such as references and counts, are near if they are the same.
fn are_near([(a, own), (b, other)]: [(f64, &str); 2], tolerance: f64) -> bool {
    own == other || !(is_whole(own) && is_whole(other)) && (a - b).abs() <= tolerance * a.abs().max(b.abs())
}

fn is_whole(text: &str) -> bool {
    text.bytes().all(|byte| byte.is_ascii_digit())
}

/// What two lines have in common.
fn common(line: &str, other: &str) -> String {
    let (own, others) = (parts(line), parts(other));
    let alike = |pair| matches!(pair, (TextPart::Number(..), TextPart::Number(..))) || pair.0 == pair.1;
    if own.len() != others.len() || !own.iter().cloned().zip(others.iter().cloned()).all(alike) {
        return ANYTHING.to_string();
    }
    let same = |(part, other): (&TextPart<'_>, &TextPart<'_>)| match (part, other) {
        (TextPart::Number(a, own), TextPart::Number(b, other))
            if are_near([(*a, *own), (*b, *other)], 0.25 * TOLERANCE) =>
        {
            (*own).to_string()
        }
        (TextPart::Words(words), _) => (*words).to_string(),
        _ => ANYTHING.to_string(),
    };
    own.iter().zip(&others).map(same).collect()
}

/// The line without fingerprints and the folder of the project.
fn masked(line: &str) -> String {
    let line = line.replace(env!("CARGO_MANIFEST_DIR"), ".");
    let fingerprint = |word: &&str| word.len() == 32 && word.bytes().all(|byte| byte.is_ascii_hexdigit());
    let words = line.split(|c: char| !c.is_ascii_alphanumeric()).filter(fingerprint);
    words.fold(line.clone(), |line, word| line.replace(word, "fingerprint"))
}

fn are_alike(before: &str, now: &str) -> bool {
    let (old, new) = (parts(before), parts(now));
    before == ANYTHING
        || old.len() == new.len()
            && old.iter().zip(&new).all(|pair| match pair {
                (TextPart::Number(a, own), TextPart::Number(b, other)) => {
                    are_near([(*a, *own), (*b, *other)], TOLERANCE)
                }
                (TextPart::Anything, TextPart::Number(..)) => true,
                (a, b) => a == b,
            })
}

/// Compares what `made` tells of a rod longer by no part with the file `name` of tests/recorded, or records it there.
///
/// # Panics
/// Where it tells something else.
pub fn is_as_recorded(name: &str, made: impl Fn(f64) -> String) {
    let path: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recorded").join(format!("{name}.txt"));
    let lines = |text: String| text.lines().map(|line| rounded(&masked(line))).collect::<Vec<_>>();
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

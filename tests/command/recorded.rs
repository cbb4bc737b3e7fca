//! What the program printed and wrote for a few scenes, sweeps, studies and designs is kept in `tests/recorded`: a changed number, word or
//! row is a changed line there, whatever computed it. Whether the numbers are right is for the other tests; this one notices that one of
//! thousands is no longer what it was. A change that is meant is recorded anew, and its diff read:
//!
//!     CAUDAL_WRITE_RECORDED=1 cargo test --test command recorded

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Set to record in place of comparing.
const WRITE: &str = "CAUDAL_WRITE_RECORDED";

/// Numbers differ by no more than this part of them.
const TOLERANCE: f64 = 2e-5;

/// A rod longer by this part is the same rod: what it changes by more than a quarter of the tolerance, is rounding or a time of the machine, and
/// recorded as [`ANYTHING`].
const LONGER: f64 = 1e-11;

/// In the place of a number that is not compared.
const ANYTHING: &str = "~";

/// What is recorded: its name, the command without its folder, the length of the scene's rod (m), and the files of that folder.
struct Recorded {
    name: &'static str,
    arguments: &'static [&'static str],
    length: f64,
    files: &'static [&'static str],
}

const RUN: &[&str] = &["summary.json", "trajectory.csv", "nodes.csv"];

const ALL: &[Recorded] = &[
    Recorded {
        name: "run-eel",
        arguments: &["run", "models/eel.toml", "--set", "solver.duration_s=1.1", "--set", "record.interval_s=0.27"],
        length: 0.4,
        files: RUN,
    },
    Recorded {
        name: "run-driven-head",
        arguments: &[
            "run",
            "models/driven-head.toml",
            "--set",
            "solver.duration_s=2.0",
            "--set",
            "record.interval_s=0.51",
        ],
        length: 0.3,
        files: RUN,
    },
    Recorded {
        name: "run-dipping-tail",
        arguments: &[
            "run",
            "models/dipping-tail.toml",
            "--set",
            "solver.duration_s=2.0",
            "--set",
            "record.interval_s=0.63",
        ],
        length: 0.3,
        files: RUN,
    },
    Recorded {
        name: "run-worm-over-a-wall",
        arguments: &[
            "run",
            "models/worm-over-a-wall.toml",
            "--set",
            "solver.duration_s=0.6",
            "--set",
            "record.interval_s=0.2",
        ],
        length: 0.001,
        files: RUN,
    },
    Recorded {
        name: "run-sinking-sphere",
        arguments: &["run", "models/validation/sinking-sphere.toml"],
        length: 0.0001,
        files: &["summary.json"],
    },
    Recorded {
        name: "run-beck-column-damped",
        arguments: &[
            "run",
            "models/beck-column.toml",
            "--set",
            "rod.damping_time_s=0.01",
            "--set",
            "solver.duration_s=1.0",
            "--set",
            "record.interval_s=0.3",
        ],
        length: 1.0,
        files: RUN,
    },
    Recorded {
        name: "run-snake-as-shape",
        arguments: &["run", "models/snake.toml", "--set", "solver.model=shape", "--set", "record.interval_s=3.0"],
        length: 0.6,
        files: &["summary.json", "trajectory.csv"],
    },
    Recorded {
        name: "run-sperm-overdamped",
        arguments: &["run", "models/sperm.toml", "--set", "solver.model=overdamped", "--set", "record.interval_s=0.2"],
        length: 5.8e-05,
        files: &["summary.json", "trajectory.csv"],
    },
    Recorded { name: "check-eel", arguments: &["check", "models/eel.toml"], length: 0.4, files: &[] },
    Recorded { name: "check-flag", arguments: &["check", "models/flag.toml"], length: 0.4, files: &[] },
    Recorded {
        name: "check-sperm",
        arguments: &["check", "models/sperm.toml", "--set", "solver.model=auto"],
        length: 5.8e-05,
        files: &[],
    },
    Recorded { name: "check-dipping-tail", arguments: &["check", "models/dipping-tail.toml"], length: 0.3, files: &[] },
    Recorded {
        name: "check-silicone-tail-auto",
        arguments: &[
            "check",
            "models/silicone-tail.toml",
            "--set",
            "drag.law=auto",
            "--set",
            "reactive=auto",
            "--set",
            "rod.loss_factor=0.2",
        ],
        length: 0.12,
        files: &[],
    },
    Recorded {
        name: "check-sphere",
        arguments: &["check", "models/validation/sinking-sphere.toml"],
        length: 0.0001,
        files: &[],
    },
    Recorded { name: "variables", arguments: &["variables", "models/dipping-tail.toml"], length: 0.3, files: &[] },
    Recorded {
        name: "modes-silicone-tail",
        arguments: &["study", "modes", "models/silicone-tail.toml", "--count", "5"],
        length: 0.12,
        files: &["modes.csv"],
    },
    Recorded {
        name: "stability-beck",
        arguments: &[
            "study",
            "stability",
            "models/beck-column.toml",
            "--vary",
            "load",
            "--points",
            "4",
            "--set",
            "rod.nodes=9",
        ],
        length: 1.0,
        files: &["critical.csv"],
    },
    Recorded {
        name: "stability-flag",
        arguments: &[
            "study",
            "stability",
            "models/flag.toml",
            "--vary",
            "flow",
            "--points",
            "4",
            "--set",
            "rod.nodes=9",
        ],
        length: 0.4,
        files: &["critical.csv"],
    },
    Recorded {
        name: "fluid-driven-head",
        arguments: &["study", "fluid", "models/driven-head.toml", "--set", "solver.duration_s=2.0"],
        length: 0.3,
        files: &["laws.csv"],
    },
    Recorded {
        name: "accuracy-driven-head",
        arguments: &[
            "study",
            "accuracy",
            "models/driven-head.toml",
            "--nodes",
            "9",
            "--steps",
            "1e-2,5e-3",
            "--tolerances",
            "1e-3",
            "--set",
            "solver.duration_s=1.0",
        ],
        length: 0.3,
        files: &["accuracy.csv"],
    },
    Recorded { name: "sweep", arguments: &["sweep", "tests/recorded/sweep.toml"], length: 0.12, files: &["table.csv"] },
    Recorded {
        name: "design-tip",
        arguments: &["design", "models/design-tip.toml", "--set", "design.iterations=4"],
        length: 1.0,
        files: &["joints.csv", "checks.csv"],
    },
    Recorded {
        name: "design-identify-drag",
        arguments: &["design", "models/design-identify-drag.toml"],
        length: 0.3,
        files: &["joints.csv", "numbers.csv", "checks.csv"],
    },
    Recorded {
        name: "design-identify",
        arguments: &["design", "models/design-identify.toml"],
        length: 1.0,
        files: &["joints.csv", "checks.csv"],
    },
    Recorded {
        name: "design-driven-head",
        arguments: &[
            "design",
            "models/design-driven-head.toml",
            "--set",
            "design.iterations=2",
            "--set",
            "rod.nodes=9",
            "--set",
            "solver.duration_s=3.0",
        ],
        length: 1.0,
        files: &["joints.csv", "checks.csv", "tolerances.csv"],
    },
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// What a command prints and writes, of a rod that is `longer` by this part of its length.
fn made(recorded: &Recorded, longer: f64) -> String {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_caudal"));
    command.current_dir(root()).args(recorded.arguments);
    if !matches!(recorded.arguments[0], "check" | "variables") {
        command.arg("--out").arg(&out);
    }
    if longer != 0.0 && recorded.arguments[0] != "variables" {
        command.arg("--set").arg(format!("rod.length_m={:e}", recorded.length * (1.0 + longer)));
    }
    let output = command.output().unwrap();
    let said = [&output.stderr[..], &output.stdout].concat();
    let said = String::from_utf8(said).unwrap();
    let mut text = format!("$ caudal {}, which ends with {:?}\n", recorded.arguments.join(" "), output.status.code());
    let by_times = recorded.arguments[1] == "accuracy"; // it advises what was quickest
    for line in said.lines().filter(|line| !by_times && !line.contains("open report.html")) {
        // How long it took is another every time.
        let line = if line.contains("Newton iterations,") { line.rsplit_once(", ").unwrap().0 } else { line };
        writeln!(text, "{}", rounded(line)).unwrap();
    }
    for file in recorded.files {
        let path = out.join(file);
        let content = std::fs::read_to_string(&path).unwrap_or_else(|_| {
            let there: Vec<_> = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
            panic!("{}: no {file} among {there:?}", recorded.name)
        });
        writeln!(text, "\n== {file}").unwrap();
        let lines = if file.ends_with(".csv") { columns(&content) } else { content };
        for line in lines.lines() {
            writeln!(text, "{}", rounded(line)).unwrap();
        }
    }
    text
}

/// The columns of a table, a line each, so that a changed one is a changed line.
fn columns(table: &str) -> String {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(table.as_bytes());
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let column = |i: usize| rows.iter().map(|row| &row[i]).collect::<Vec<_>>().join(", ") + "\n";
    (0..rows[0].len()).map(column).collect()
}

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
fn rounded(line: &str) -> String {
    let shown = |part: Part<'_>| match part {
        Part::Words(words) => words.to_string(),
        Part::Number(_, own) if own.len() <= 8 => own.to_string(),
        Part::Number(value, _) => format!("{:e}", format!("{value:.6e}").parse::<f64>().unwrap()),
        Part::Any => ANYTHING.to_string(),
    };
    let line = line.replace(root().to_str().unwrap(), ".");
    let fingerprint = |word: &&str| word.len() == 32 && word.bytes().all(|byte| byte.is_ascii_hexdigit());
    let words = line.split(|c: char| !c.is_ascii_alphanumeric()).filter(fingerprint);
    let line = words.fold(line.clone(), |line, word| line.replace(word, "fingerprint"));
    parts(&line).into_iter().map(shown).collect()
}

/// What two lines, which differ in numbers, have in common.
fn common(line: &str, other: &str) -> String {
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

fn are_alike(before: &str, now: &str) -> bool {
    let (before, now) = (parts(before), parts(now));
    before.len() == now.len()
        && before.iter().zip(&now).all(|pair| match pair {
            (Part::Number(a, _), Part::Number(b, _)) => are_near(*a, *b, TOLERANCE),
            (Part::Any, Part::Number(..)) => true,
            (a, b) => a == b,
        })
}

fn kept(name: &str) -> PathBuf {
    root().join("tests/recorded").join(format!("{name}.txt"))
}

/// What is made of all, in two threads.
fn all<T: Send>(of: impl Fn(&'static Recorded) -> T + Sync) -> Vec<(&'static Recorded, T)> {
    let next = std::sync::atomic::AtomicUsize::new(0);
    let some = || {
        let next = || ALL.get(next.fetch_add(1, std::sync::atomic::Ordering::Relaxed));
        std::iter::from_fn(next).map(|recorded| (recorded, of(recorded))).collect::<Vec<_>>()
    };
    std::thread::scope(|scope| {
        let other = scope.spawn(some);
        some().into_iter().chain(other.join().unwrap()).collect()
    })
}

#[test]
fn what_the_program_says_is_what_it_said() {
    if std::env::var_os(WRITE).is_some() {
        for (Recorded { name, .. }, [own, other]) in all(|recorded| [0.0, LONGER].map(|longer| made(recorded, longer)))
        {
            let lines = own.lines().zip(other.lines()).map(|(line, other)| common(line, other) + "\n");
            std::fs::write(kept(name), lines.collect::<String>()).unwrap();
        }
        return;
    }
    let mut changed = Vec::new();
    for (Recorded { name, .. }, now) in all(|recorded| made(recorded, 0.0)) {
        let before = std::fs::read_to_string(kept(name)).unwrap_or_default();
        let (old, new): (Vec<_>, Vec<_>) = (before.lines().collect(), now.lines().collect());
        let differing = (0..old.len().max(new.len())).filter(|i| match (old.get(*i), new.get(*i)) {
            (Some(old), Some(new)) => !are_alike(old, new),
            _ => true,
        });
        changed.extend(differing.take(5).map(|i| {
            let [old, new] = [&old, &new].map(|lines| *lines.get(i).unwrap_or(&"nothing"));
            format!("{name}.txt:{}:\n  - {old}\n  + {new}", i + 1)
        }));
    }
    assert!(
        changed.is_empty(),
        "the first differences of each; if they are meant, {WRITE}=1 …\n{}",
        changed.join("\n")
    );
}

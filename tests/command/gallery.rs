//! The films of `docs/src/gallery.md` and of the README are what the commands beside them make. To make them again:
//!
//!     CAUDAL_WRITE_RECORDED=1 cargo test --test command gallery

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use crate::common::recorded::WRITE;
use crate::digest::root;

/// Most bytes of a film.
const LARGEST: usize = 300_000;

/// Numbers of films may differ by this, px: by the rounding of a coordinate to tenths.
const TOLERANCE: f64 = 0.21;

fn caudal(folder: &Path, arguments: &[String]) {
    let output = Command::new(env!("CARGO_BIN_EXE_caudal")).current_dir(folder).args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// The commands between backquotes, or in a shell block, of which the first runs a scene and the second exports a film.
fn commands(line: &str) -> Vec<Vec<String>> {
    let words = |command: &str| command.split_whitespace().skip(1).map(str::to_string).collect();
    line.split('`').filter(|part| part.starts_with("caudal ")).map(words).collect()
}

/// The film that `export` makes of the run of `scene`.
fn film(scene: &Path, run: &[String], export: &[String]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene.to_str().unwrap().to_string();
    caudal(folder.path(), &[&["run".to_string(), scene], &run[2..]].concat());
    caudal(folder.path(), export);
    std::fs::read_to_string(folder.path().join(&export[2])).unwrap()
}

/// The numbers of a film, and what is between them. A sign, or a point after tenths, begins a number.
fn numbers(svg: &str) -> (Vec<f64>, String) {
    let (mut numbers, mut words, mut digits) = (Vec::new(), String::new(), String::new());
    for letter in svg.chars().chain([' ']) {
        let goes_on = letter.is_ascii_digit() || letter == '.' && !digits.contains('.');
        if !goes_on && digits.chars().any(|c| c.is_ascii_digit()) {
            numbers.push(digits.parse().unwrap());
            digits.clear();
            words.push('#');
        }
        match letter {
            _ if goes_on => digits.push(letter),
            '-' => digits = "-".to_string(),
            // Whether a blank or a sign is between two numbers depends on rounding.
            ' ' => digits.clear(),
            letter => {
                digits.clear();
                words.push(letter);
            }
        }
    }
    (numbers, words)
}

/// Keeps a film in `path`, or compares it with what is there.
fn is_kept(path: &Path, film: &str) {
    let name = path.display();
    assert!(film.len() < LARGEST, "{name}: {} bytes", film.len());
    assert!(!film.contains("<script") && !film.contains("http://www.w3.org/1999/xlink"), "{name} runs as an image");
    // The first keyframe is the last.
    for values in film.split("values=\"").skip(1).map(|rest| rest.split('"').next().unwrap()) {
        assert_eq!(values.split(';').next(), values.split(';').next_back(), "{name} does not close");
    }
    assert!(film.contains("<animate attributeName=\"d\"") && film.contains("prefers-reduced-motion"), "{name}");
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(path, film).unwrap();
        return;
    }
    let kept = std::fs::read_to_string(path).unwrap_or_default();
    let ((own, words), (others, other_words)) = (numbers(film), numbers(&kept));
    assert!(words == other_words, "{name} is another film now: see the top of this file");
    let furthest = own.iter().zip(&others).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(furthest < TOLERANCE, "{name} differs by {furthest} px: see the top of this file");
}

#[test]
fn the_films_of_the_gallery_are_what_their_commands_make() {
    let text = std::fs::read_to_string(root().join("docs/src/gallery.md")).unwrap();
    let mut seen = BTreeSet::new();
    let mut picture = None;
    for line in text.lines() {
        if let Some(path) = line.strip_prefix("![").and_then(|line| line.split("](").nth(1)?.strip_suffix(')')) {
            picture = Some(path.to_string());
        }
        if let [run, export] = &commands(line)[..]
            && run[0] == "run"
            && run.len() > 1
        {
            let path = picture.take().unwrap();
            assert_eq!(path, format!("gallery/{}", export[2]), "{line}");
            is_kept(&root().join("docs/src").join(&path), &film(&root().join(&run[1]), run, export));
            seen.insert(export[2].clone());
        }
    }
    assert!(picture.is_none() && seen.len() >= 12, "{seen:?}");
}

/// The README's ten lines, and the film of them at its top.
#[test]
fn the_film_of_the_readme_is_what_its_commands_make() {
    let text = std::fs::read_to_string(root().join("README.md")).unwrap();
    let scene = text.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("swimmer.toml");
    std::fs::write(&path, scene).unwrap();
    let export = text.lines().find(|line| line.starts_with("caudal export out/swimmer swimmer.svg")).unwrap();
    let export: Vec<String> =
        export.split('#').next().unwrap().split_whitespace().skip(1).map(str::to_string).collect();
    assert!(text.contains("](docs/src/pictures/swimmer.svg)"));
    let made = film(&path, &["run".into(), "swimmer.toml".into()], &export);
    is_kept(&root().join("docs/src/pictures/swimmer.svg"), &made);
}

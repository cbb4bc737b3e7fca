//! The library's layers: each module imports only what stands above it in `src/lib.rs` and in the `mod.rs` of its folder, and no two
//! files import each other, directly or through others.
//!
//! A wing is a folder that `lib.rs` declares without `pub` and re-exports the modules of: their paths do not name it.

#![allow(clippy::unwrap_used, reason = "a failure ends the test")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// An import: the line where it stands, and the module that it takes something from.
type Imports = Vec<(usize, String)>;

/// Every module of the library by its path, `fluid::laws::cox`, with its file and its text.
fn modules() -> BTreeMap<String, (String, String)> {
    fn visit(folder: &Path, module: &str, found: &mut BTreeMap<String, (String, String)>) {
        let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        entries.sort();
        for path in entries {
            let stem = path.file_stem().unwrap().to_str().unwrap().to_string();
            let inner = if module.is_empty() { stem.clone() } else { format!("{module}::{stem}") };
            if path.is_dir() {
                visit(&path, &inner, found);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let name = if stem == "mod" { module.to_string() } else { inner };
                let text = std::fs::read_to_string(&path).unwrap();
                found.insert(name, (path.display().to_string(), text));
            }
        }
    }
    let mut found = BTreeMap::new();
    visit(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), "", &mut found);
    let wings = wings(&found["lib"].1);
    found = found.into_iter().map(|(name, content)| (without_wing(&name, &wings).to_string(), content)).collect();
    // The command is a program over the library.
    found.retain(|name, _| name != "main" && name != "cli" && !name.starts_with("cli::"));
    found
}

/// The wings that the text of `lib.rs` declares.
fn wings(library: &str) -> Vec<String> {
    code(library).lines().filter_map(|line| Some(line.strip_prefix("mod ")?.strip_suffix(';')?.to_string())).collect()
}

/// The path of a module as others write it.
fn without_wing<'a>(name: &'a str, wings: &[String]) -> &'a str {
    match name.split_once("::") {
        Some((first, rest)) if wings.iter().any(|wing| wing == first) => rest,
        _ => name,
    }
}

/// The text without comments, and without the tests at its end; lines stay where they are.
fn code(text: &str) -> String {
    let text = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
    text.lines().map(|line| line.split("//").next().unwrap_or_default().to_string() + "\n").collect()
}

/// The paths in `tree`, what follows `use`: `a::{b, c::{self, d}}` are `a::b`, `a::c` and `a::c::d`.
fn paths_of(tree: &str) -> Vec<String> {
    let Some((before, inside)) = tree.split_once('{') else {
        return vec![tree.split(" as ").next().unwrap_or_default().trim().to_string()];
    };
    let inside = &inside[..inside.rfind('}').unwrap_or(inside.len())];
    let (mut paths, mut depth, mut start) = (Vec::new(), 0, 0);
    let mut parts = Vec::new();
    for (i, c) in inside.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&inside[start..i]);
                start = i + 1;
            }
            _ => {}
        }
    }
    parts.push(&inside[start..]);
    for part in parts.into_iter().map(str::trim).filter(|part| !part.is_empty()) {
        for path in paths_of(part) {
            let joined = if path == "self" {
                before.trim().trim_end_matches("::").to_string()
            } else {
                format!("{}{path}", before.trim())
            };
            paths.push(joined);
        }
    }
    paths
}

/// The module of the library that `path`, as `module` writes it, leads into.
fn resolve(path: &str, module: &str, known: &BTreeMap<String, (String, String)>) -> Option<String> {
    let mut parts: Vec<&str> = path.split("::").map(str::trim).collect();
    let mut place: Vec<&str> = if module.is_empty() { Vec::new() } else { module.split("::").collect() };
    match parts[0] {
        "crate" => place.clear(),
        "self" => {}
        "super" => {
            while parts.get(1) == Some(&"super") {
                place.pop();
                parts.remove(0);
            }
            place.pop();
        }
        _ => return None,
    }
    place.extend(&parts[1..]);
    (1..=place.len()).rev().map(|length| place[..length].join("::")).find(|name| known.contains_key(name))
}

/// What `module` imports, by `use` or by a path in its code.
fn imports(module: &str, text: &str, known: &BTreeMap<String, (String, String)>) -> Imports {
    let text = code(text);
    let line_of = |at: usize| text[..at].matches('\n').count() + 1;
    let mut found = Vec::new();
    for root in ["crate::", "super::", "self::"] {
        for (at, _) in text.match_indices(root) {
            let before = text[..at].chars().next_back().unwrap_or(' ');
            if before.is_alphanumeric() || before == '_' || before == ':' {
                continue;
            }
            let statement = text[..at].rfind([';', '}', '{']).map_or(0, |end| end + 1);
            let is_use = text[statement..at].trim_end().ends_with("use");
            let rest = &text[at..];
            let end = if is_use {
                rest.find(';').unwrap_or(rest.len())
            } else {
                rest.find(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')).unwrap_or(rest.len())
            };
            for path in paths_of(&rest[..end]) {
                found.extend(
                    resolve(&path, module, known).filter(|other| other != module).map(|other| (line_of(at), other)),
                );
            }
        }
    }
    found
}

/// The modules in the order in which they are declared, from `src/lib.rs` down.
fn order(known: &BTreeMap<String, (String, String)>) -> Vec<String> {
    let wings = wings(&known["lib"].1);
    fn visit(module: &str, wings: &[String], known: &BTreeMap<String, (String, String)>, order: &mut Vec<String>) {
        let key = if module.is_empty() { "lib" } else { module };
        for line in code(&known[key].1).lines() {
            let declared = line
                .trim()
                .trim_start_matches("pub")
                .trim_start_matches("(crate)")
                .trim_start_matches("(super)")
                .trim();
            if let Some(name) = declared.strip_prefix("mod ").and_then(|rest| rest.strip_suffix(';')) {
                let is_inner = !module.is_empty() && !wings.iter().any(|wing| wing == module);
                let inner = if is_inner { format!("{module}::{name}") } else { name.to_string() };
                order.push(inner.clone());
                visit(&inner, wings, known, order);
            }
        }
    }
    let mut found = Vec::new();
    visit("", &wings, known, &mut found);
    found
}

#[test]
fn modules_import_only_what_stands_above_them_in_lib_rs() {
    let known = modules();
    let top = |name: &str| name.split("::").next().unwrap_or_default().to_string();
    let mut layers: Vec<String> = order(&known).iter().map(|name| top(name)).collect();
    layers.dedup();
    let rank = |name: &str| layers.iter().position(|layer| *layer == top(name));
    assert!(
        layers.len() > 5 && known.keys().filter(|name| *name != "lib").all(|name| rank(name).is_some()),
        "{layers:?}"
    );
    let mut wrong = Vec::new();
    for (module, (file, text)) in known.iter().filter(|(name, _)| *name != "lib") {
        for (line, other) in imports(module, text, &known) {
            if rank(&other) > rank(module) {
                wrong.push(format!("{file}:{line} imports {other}, which stands below it"));
            }
        }
    }
    wrong.dedup();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    let known = modules();
    let edges: BTreeMap<&str, BTreeSet<String>> = (known.iter().filter(|(name, _)| *name != "lib"))
        .map(|(name, (_, text))| {
            (name.as_str(), imports(name, text, &known).into_iter().map(|(_, other)| other).collect())
        })
        .collect();
    assert!(edges.values().map(BTreeSet::len).sum::<usize>() > 300, "imports are found");
    // Whatever imports nothing that is left is taken away: what remains lies in or above a circle, and so the other way round.
    let mut left: BTreeSet<&str> = edges.keys().copied().collect();
    loop {
        let imported: BTreeSet<&str> = left.iter().flat_map(|name| edges[name].iter().map(String::as_str)).collect();
        let before = left.len();
        left = left
            .iter()
            .copied()
            .filter(|name| imported.contains(name) && edges[name].iter().any(|other| left.contains(other.as_str())))
            .collect();
        if left.len() == before {
            break;
        }
    }
    let in_circles = left.iter().map(|name| {
        let others: Vec<&str> = edges[name].iter().map(String::as_str).filter(|other| left.contains(other)).collect();
        format!("{name} imports {}", others.join(", "))
    });
    assert!(left.is_empty(), "{}", in_circles.collect::<Vec<_>>().join("\n"));
}

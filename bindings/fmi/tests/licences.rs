//! The dependencies of the FMU library are listed in THIRD-PARTY.txt with their licences, and every FMU contains this file.
#![allow(clippy::unwrap_used, missing_docs, reason = "a failure ends the test")]

mod common;

use std::collections::BTreeSet;
use std::io::Read;
use std::process::Command;

use caudal::fmu::Standard;

/// Advice if the file is out of date.
const ADVICE: &str = "THIRD-PARTY.txt is out of date: python3 bindings/fmi/third_party.py writes it";

#[test]
fn every_crate_that_is_linked_is_named_with_its_licence_and_no_other_version_of_it() {
    let text = include_str!("../../../THIRD-PARTY.txt");
    let list = text.split("=====").next().unwrap();
    let listed: BTreeSet<String> = list.lines().filter(|line| line.contains(": ")).map(str::to_string).collect();
    let mut tree = Command::new(env!("CARGO"));
    tree.args(["tree", "--locked", "-p", "caudal", "-p", "caudal-fmi", "-e", "normal,no-proc-macro"])
        .args(["--prefix", "none", "--no-dedupe", "--format", "{p}: {l}"])
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    let output = tree.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut linked = 0;
    for line in String::from_utf8(output.stdout).unwrap().lines().filter(|line| !line.is_empty()) {
        // Our own packages have a folder after the version.
        if !line.contains(" (/") && !line.contains(":\\") {
            let named = line.replacen(" v", " ", 1);
            assert!(listed.contains(&named), "{named}: {ADVICE}");
            linked += 1;
        }
    }
    assert!(linked > 50, "{linked}");
    let locked = include_str!("../../../Cargo.lock").replace("\r", "");
    for line in listed {
        let (name, version) = line.split(": ").next().unwrap().split_once(' ').unwrap();
        let package = format!("name = \"{name}\"\nversion = \"{version}\"\n");
        assert!(locked.contains(&package), "{line}: {ADVICE}");
        assert!(
            text.split("=====").skip(1).any(|part| part.contains(&format!("{name} {version}: "))),
            "{line}: {ADVICE}"
        );
    }
}

#[test]
fn every_fmu_has_the_licences_of_all_its_parts() {
    let folder = tempfile::tempdir().unwrap();
    for standard in [Standard::Fmi2, Standard::Fmi3] {
        let path = common::write(&common::document("baseline", &["rod.nodes=3"]), standard, folder.path());
        let mut archive = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
        let mut text = String::new();
        archive.by_name("documentation/licenses/THIRD-PARTY.txt").unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(text, include_str!("../../../THIRD-PARTY.txt"));
    }
}

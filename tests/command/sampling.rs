//! Whatever plays a motion samples it at least twelve times per period of the fastest drive, or says that it cannot; and exports keep to the
//! results that they are made of.

#![cfg(feature = "pictures")]

use std::path::Path;
use std::process::Output;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;

use crate::eel::{self, EEL};

/// The eel with 100 steps per period.
fn scene() -> String {
    EEL.replace("time_step_s = 1e-2", "time_step_s = 2e-3")
}

fn place() -> tempfile::TempDir {
    eel::place(&scene())
}

fn caudal(folder: &Path, arguments: &str) -> Output {
    eel::caudal(folder, &arguments.split(' ').collect::<Vec<_>>())
}

fn done(folder: &Path, arguments: &str) -> String {
    eel::done(folder, &arguments.split(' ').collect::<Vec<_>>())
}

/// The data of a page in the script with this id.
fn data(page: &Path, id: &str) -> Value {
    let text = std::fs::read_to_string(page).unwrap();
    let json = text.split(&format!("<script id=\"{id}\" type=\"application/json\">")).nth(1).unwrap();
    serde_json::from_str(json.split("</script>").next().unwrap()).unwrap()
}

fn times(motion: &Value) -> Vec<f64> {
    motion["times"].as_array().unwrap().iter().map(|time| time.as_f64().unwrap()).collect()
}

/// Frames per period of a drive (Hz), and the first and last time.
fn rate(motion: &Value, frequency: f64) -> (f64, [f64; 2]) {
    let times = times(motion);
    let longest = times.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    (1.0 / (frequency * longest), [times[0], times[times.len() - 1]])
}

/// The sizes of the delays of a GIF, hundredths of a second.
fn delays(file: &Path) -> Vec<u16> {
    let mut decoder = gif::DecodeOptions::new().read_info(std::fs::File::open(file).unwrap()).unwrap();
    std::iter::from_fn(|| decoder.read_next_frame().unwrap().map(|frame| frame.delay)).collect()
}

#[test]
fn a_page_plays_at_least_twelve_frames_per_period_and_says_if_it_plays_the_last_periods() {
    let folder = place();
    let adaptive = "integrator = \"esdirk3\"\ntolerance = 1e-3\n";
    let own = scene();
    let adaptive = own.replace("integrator = \"newmark\"\ntime_step_s = 2e-3\n", adaptive);
    for (duration, scene) in [(0.6, &own), (15.0, &own), (40.0, &own), (40.0, &adaptive)] {
        std::fs::write(folder.path().join("eel.toml"), scene).unwrap();
        done(folder.path(), &format!("run eel.toml --set solver.duration_s={duration} --out run --force"));
        let motion = data(&folder.path().join("run/report.html"), "motion");
        let (rate, [first, last]) = rate(&motion, 5.0);
        let case = format!("{duration} s: {rate} frames per period from {first} s to {last} s");
        assert!(rate > 12.0 * (1.0 - 1e-6) && (last - duration).abs() < 1e-6, "{case}");
        assert!(times(&motion).len() <= 1202, "{case}");
        let note = motion["note"].as_str();
        assert_eq!(note.is_some(), first > 0.0, "{case}: {note:?}");
        assert_eq!(note.is_some(), duration > 20.0, "{case}: {note:?}");
        assert!(note.is_none_or(|note| note.contains("Shown are the last periods, from t = ")), "{note:?}");
    }
}

#[test]
fn a_case_of_a_sweep_keeps_the_frames_of_its_last_periods_if_those_of_the_run_would_be_too_few() {
    let folder = place();
    let sweep =
        "scene = \"eel.toml\"\n[set]\nsolver.duration_s = 4.0\n[axes]\nactuation.frequency_hz = [1.0, 5.0, 9.0]\n";
    std::fs::write(folder.path().join("sweep.toml"), sweep).unwrap();
    done(folder.path(), "sweep sweep.toml --out out");
    let data = data(&folder.path().join("out/report.html"), "data");
    for (case, frequency) in [("0", 1.0), ("1", 5.0), ("2", 9.0)] {
        let motion = &data["motions"][case];
        let (rate, [first, last]) = rate(motion, frequency);
        assert!(rate > 12.0 * (1.0 - 1e-6), "{frequency} Hz: {rate} frames per period");
        assert!(times(motion).len() <= 60 && (last - 4.0).abs() < 1e-6, "{frequency} Hz: {:?}", times(motion));
        assert_eq!(first > 0.0, frequency > 4.9, "{frequency} Hz from {first} s");
        assert_eq!(motion["note"].is_string(), first > 0.0, "{frequency} Hz");
    }
    // The paths of the centres of mass are those of whole runs.
    let paths = std::fs::read_to_string(folder.path().join("out/paths.svg")).unwrap();
    assert!([">0<", ">4<"].iter().all(|label| paths.contains(label)), "{paths}");
}

#[test]
fn runs_of_equal_motions_are_equal_in_a_film_however_they_are_recorded_or_the_page_says_why_not() {
    let folder = place();
    for (name, every) in [("fine", 1), ("other", 3), ("coarse", 40)] {
        done(
            folder.path(),
            &format!("run eel.toml --set solver.duration_s=40 --set record.every={every} --out {name}"),
        );
    }
    let film = |runs: &str| {
        done(folder.path(), &format!("compare {runs} --out both --force"));
        data(&folder.path().join("both/report.html"), "motion")
    };
    let points = |rod: &Value| -> Vec<f32> {
        let bytes = STANDARD.decode(rod["points"].as_str().unwrap()).unwrap();
        bytes.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect()
    };
    let both = film("fine other");
    let apart = points(&both).iter().zip(points(&both["beside"][0])).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(apart < 2e-4, "{apart} m"); // of 1 m: 2e-5 m were measured, and 9e-2 m with straight lines between thinned rows
    let (rate, [first, last]) = rate(&both, 5.0);
    assert!(rate > 23.9 && first > 30.0 && (last - 40.0).abs() < 1e-9, "{rate} from {first} to {last}");
    let note = both["note"].as_str().unwrap();
    assert!(note.contains("Shown are the last periods") && !note.contains("coarse"), "{note}");
    let note = film("fine coarse")["note"].as_str().unwrap().to_string();
    assert!(note.contains("too coarse for a film: coarse has 2.5 rows per period"), "{note}");
}

#[test]
fn an_export_never_replaces_a_result_in_any_folder() {
    let folder = place();
    std::fs::write(folder.path().join("sweep.toml"), "scene = \"eel.toml\"\n[axes]\nrod.nodes = [5, 9]\n").unwrap();
    for make in [
        "run eel.toml --out run",
        "run eel.toml --out other",
        "sweep sweep.toml --out sweep",
        "compare run other --out both",
    ] {
        done(folder.path(), make);
    }
    let mut checked = 0;
    for place in ["run", "other", "sweep", "both"] {
        let figures = std::fs::read_dir(folder.path().join(place)).unwrap();
        let figures: Vec<_> = figures
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|e| e == "svg"))
            .collect();
        for figure in figures.iter().take(2) {
            let before = std::fs::read(figure).unwrap();
            let name = figure.file_name().unwrap().to_string_lossy();
            for force in ["", " --force"] {
                let output = caudal(folder.path(), &format!("export run {place}/{name}{force}"));
                let said = String::from_utf8_lossy(&output.stderr).into_owned();
                assert_eq!(output.status.code(), Some(2), "{place}/{name}{force}: {said}");
                assert!(
                    said.contains("holds a file of a ") && said.contains("not a film") && !said.contains("--force"),
                    "{said}"
                );
                assert_eq!(std::fs::read(figure).unwrap(), before, "{place}/{name}{force}");
                checked += 1;
            }
        }
    }
    assert_eq!(checked, 16);
    done(folder.path(), "export run run/film.svg");
    done(folder.path(), "export run run/film.svg"); // its own is replaced
}

#[test]
fn the_exports_of_a_run_that_was_interrupted_end_where_it_ended() {
    let folder = place();
    done(folder.path(), "run eel.toml --out run");
    let summary = folder.path().join("run/summary.json");
    let mut content: Value = serde_json::from_str(&std::fs::read_to_string(&summary).unwrap()).unwrap();
    (content["complete"], content["end_time_s"]) = (false.into(), 0.32.into());
    std::fs::write(&summary, content.to_string()).unwrap();
    let said = done(folder.path(), "export run --gif --vtk");
    assert!(said.contains("note: the run in run ended at t = 0.32 s, and so do its exports"), "{said}");
    assert_eq!(delays(&folder.path().join("run/eel.gif")).len(), 40, "1.6 beats of a second each");
    let rows = std::fs::read_dir(folder.path().join("run/vtk"))
        .unwrap()
        .filter(|entry| entry.as_ref().unwrap().path().extension().is_some_and(|e| e == "vtp"));
    assert_eq!(rows.count(), 161);
    let refused = caudal(folder.path(), "export run --gif --from 0.4");
    assert!(
        String::from_utf8_lossy(&refused.stderr).contains("allowed: a part of the run, 0 to 0.32 s"),
        "{refused:?}"
    );
}

#[test]
fn films_are_slowed_to_a_beat_per_second_go_where_they_are_sent_and_say_what_they_cannot_show() {
    let folder = place();
    done(folder.path(), "run eel.toml --out run");
    let said = done(folder.path(), "export run film.gif --out films --until 20");
    assert!(said.contains("note: --until 20: the run ends at t = 0.6 s, and so do its films"), "{said}");
    let made = delays(&folder.path().join("films/film.gif"));
    assert_eq!((made.len(), made.iter().sum::<u16>()), (75, 300), "three beats of a second each");
    let said = done(folder.path(), "export run fast.gif --speed 1");
    assert!(said.contains("note: fast.gif has 5 pictures per period of the fastest drive"), "{said}");
    done(folder.path(), "export run fast.svg --speed 1000");
    let film = std::fs::read_to_string(folder.path().join("fast.svg")).unwrap();
    let durations: Vec<&str> = film.split("dur=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    assert!(
        !durations.is_empty()
            && durations.iter().all(|text| text.bytes().all(|b| b.is_ascii_digit() || b == b'.' || b == b's')),
        "{durations:?}"
    );
    let said = done(folder.path(), "export run --png --figures shape --out pictures");
    assert!(said.contains("1 file in pictures"), "{said}");
}

#[test]
fn an_svg_film_has_twelve_keyframes_per_period_of_the_fastest_of_several_drives_or_is_refused() {
    let folder = place();
    let head = "\n[head]\nkind = \"driven\"\nposition_m = { amplitude = [0.0, 0.01], frequency_hz = 1.0 }\n\
                angle_rad = { amplitude = 0.05, frequency_hz = 9.0, phase_rad = 1.5707963267948966 }\n";
    let own = scene();
    let passive =
        own.split("[actuation]").next().unwrap().to_string() + "[medium]" + own.split("[medium]").nth(1).unwrap();
    std::fs::write(folder.path().join("two.toml"), passive + head).unwrap();
    done(folder.path(), "export two.toml film.svg --from 1 --until 3 --set solver.duration_s=3.0");
    let film = std::fs::read_to_string(folder.path().join("film.svg")).unwrap();
    let values = film.split("values=\"").nth(1).unwrap().split('"').next().unwrap();
    let keyframes = values.split(';').count() - 1;
    // Two seconds, with 18 periods of the head's angle.
    assert!((12 * 18..=12 * 18 + 1).contains(&keyframes), "{keyframes}");
    let refused = caudal(folder.path(), "export two.toml long.svg --from 0 --until 3 --set solver.duration_s=3.0");
    let said = String::from_utf8(refused.stderr).unwrap();
    assert!(said.contains("found 325 pictures, 12 per cycle; allowed in an SVG: 301"), "{said}");
}

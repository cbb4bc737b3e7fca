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

/// The passive eel, whose head moves by the first amplitude (m) at 1 Hz and turns by the second (rad) at a frequency (Hz).
fn two_drives([way, angle]: [f64; 2], frequency: f64) -> String {
    let own = scene();
    let (before, after) = (own.split("[actuation]").next().unwrap(), own.split("[medium]").nth(1).unwrap());
    format!(
        "{before}[medium]{after}\n[head]\nkind = \"driven\"\nposition_m = {{ amplitude = [0.0, {way}], frequency_hz = 1.0 }}\n\
         angle_rad = {{ amplitude = {angle}, frequency_hz = {frequency}, phase_rad = 1.5707963267948966 }}\n"
    )
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
fn the_fastest_drive_that_is_seen_decides_how_densely_a_page_plays_a_run() {
    let folder = place();
    // Turns by 0.02 and 0.003 rad move the rod by 8.2 and 1.2 mm in the root mean square, and one by 1e-6 rad by less than a micrometre.
    for (angle, frequency, is_seen) in [(0.02, 9.0, true), (0.003, 9.0, true), (1e-6, 90.0, false)] {
        std::fs::write(folder.path().join("two.toml"), two_drives([0.1, angle], frequency)).unwrap();
        done(folder.path(), "run two.toml --set solver.duration_s=13 --out run --force");
        let motion = data(&folder.path().join("run/report.html"), "motion");
        let (rate, [first, _]) = rate(&motion, if is_seen { frequency } else { 1.0 });
        let case = format!("{angle} rad at {frequency} Hz: {rate} frames per period from {first} s");
        assert!(rate > 12.0 * (1.0 - 1e-6), "{case}");
        assert_eq!(first > 0.0, is_seen, "{case}");
    }
}

#[test]
fn designs_and_studies_play_at_least_twelve_frames_per_period_or_the_last_periods() {
    let folder = place();
    let design = EEL.to_string()
        + "\n[design]\ngoal = \"cycle_forward_speed_m_s\"\nvariables = [\"rod.youngs_modulus_pa\"]\n\
           number_bounds = [0.8, 1.2]\nstarts = 1\niterations = 1\n";
    let two = two_drives([0.1, 0.1], 9.0);
    for (command, text, duration, frequency) in [
        ("design", &design, 2.0, 5.0),
        ("design", &design, 15.0, 5.0),
        ("study fluid", &scene(), 2.0, 5.0),
        ("study fluid", &scene(), 15.0, 5.0),
        ("study fluid", &two, 2.0, 9.0),
        ("study fluid", &two, 12.0, 9.0),
    ] {
        std::fs::write(folder.path().join("scene.toml"), text).unwrap();
        done(folder.path(), &format!("{command} scene.toml --set solver.duration_s={duration} --out out --force"));
        let motion = data(&folder.path().join("out/report.html"), "motion");
        let (rate, [first, last]) = rate(&motion, frequency);
        let case = format!("{command} of {duration} s: {rate} frames per period from {first} s to {last} s");
        assert!(rate > 12.0 * (1.0 - 1e-6) && (last - duration).abs() < 1e-6, "{case}");
        assert_eq!(first > 0.0, duration > 10.0, "{case}");
        assert_eq!(
            motion["note"].as_str().is_some_and(|note| note.contains("Shown are the last periods")),
            first > 0.0,
            "{case}"
        );
    }
}

/// A fish that turns a little, by another angle under each law.
const FISH: &str = r#"
name = "fish"
[rod]
nodes = 9
length_m = 0.3
section = "ellipse"
outer_radius_m = [[0.0, 0.006], [0.3, 0.012], [0.85, 0.005], [1.0, 0.004]]
depth_m = [[0.0, 0.02], [0.35, 0.07], [0.85, 0.02], [1.0, 0.08]]
youngs_modulus_pa = 5e6
density_kg_m3 = 1000.0
[actuation]
kind = "travelling-wave"
kappa_amp = 6.0
frequency_hz = 2.0
wavelength_m = 0.4
envelope = [0.1, 0.9]
[medium]
viscosity_pa_s = 1e-3
density_kg_m3 = 1000.0
[drag]
law = "cross-flow"
[reactive]
[solver]
time_step_s = 1e-2
duration_s = 30.0
"#;

#[test]
fn the_rods_of_a_study_of_fluids_are_in_the_middle_of_their_lanes_at_the_first_time_that_is_shown() {
    let folder = place();
    std::fs::write(folder.path().join("fish.toml"), FISH).unwrap();
    for duration in [2.0, 30.0] {
        done(folder.path(), &format!("study fluid fish.toml --set solver.duration_s={duration} --out out --force"));
        let motion = data(&folder.path().join("out/report.html"), "motion");
        assert_eq!(rate(&motion, 2.0).1[0] > 0.0, duration > 10.0, "{duration} s: the last periods");
        // The mean height of the nodes at the first time, relative to the first rod's centre of mass.
        let frames = times(&motion).len();
        let height = |rod: &Value| -> f64 {
            let bytes = STANDARD.decode(rod["points"].as_str().unwrap()).unwrap();
            let all: Vec<f32> =
                bytes.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
            let first = &all[..all.len() / frames];
            first.chunks_exact(2).map(|point| f64::from(point[1])).sum::<f64>() * 2.0 / first.len() as f64
        };
        let heights: Vec<f64> =
            std::iter::once(&motion).chain(motion["beside"].as_array().unwrap()).map(height).collect();
        assert!(heights.len() > 1, "{heights:?}");
        // A lane is as wide as the widest motion in it: 0.07 to 0.4 m were measured.
        for lane in heights.windows(2).map(|pair| pair[0] - pair[1]) {
            assert!((0.05..0.5).contains(&lane), "{duration} s: a lane of {lane} m");
        }
    }
}

#[test]
fn a_page_of_a_motion_in_long_steps_says_that_the_beat_may_look_slower_than_it_is() {
    let folder = place();
    std::fs::write(folder.path().join("sweep.toml"), "scene = \"eel.toml\"\n[axes]\nrod.nodes = [5]\n").unwrap();
    for (step, rate) in [(0.016, None), (0.025, Some("8")), (0.04, Some("5"))] {
        std::fs::write(
            folder.path().join("eel.toml"),
            EEL.replace("time_step_s = 1e-2", &format!("time_step_s = {step}")),
        )
        .unwrap();
        for (command, id) in [("run eel.toml", "motion"), ("sweep sweep.toml", "data")] {
            done(folder.path(), &format!("{command} --out out-{id}-{step}"));
            let data = data(&folder.path().join(format!("out-{id}-{step}/report.html")), id);
            let note = if id == "data" { &data["motions"]["0"]["note"] } else { &data["note"] }.as_str();
            assert_eq!(note.is_some(), rate.is_some(), "{command} in steps of {step} s: {note:?}");
            if let Some((note, rate)) = note.zip(rate) {
                let expected =
                    [format!("{rate} steps per period of the fastest drive"), "smaller solver.time_step_s".into()];
                assert!(expected.iter().all(|words| note.contains(words)), "{note}");
            }
        }
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
    for (name, every) in [("fine", 1), ("other", 3), ("coarse", 40), ("ends", 20_000)] {
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
    let note = film("fine ends")["note"].as_str().unwrap().to_string();
    assert!(note.contains("too coarse for a film: ends has fewer than two rows"), "{note}");
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
    std::fs::write(folder.path().join("two.toml"), two_drives([0.01, 0.05], 9.0)).unwrap();
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

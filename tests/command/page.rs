//! report.html works in a browser: it is one file, its script runs, the tail moves, and every figure is there.

use std::path::{Path, PathBuf};
use std::process::Command;

/// A Chromium on this machine. Without one, says that the page was not opened.
pub fn chromium() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    let names = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
    let found = std::env::split_paths(&folders)
        .flat_map(|folder| names.map(|name| folder.join(name)))
        .find(|candidate| candidate.is_file());
    if found.is_none() {
        crate::skip::skip("the report in a browser", "install Chromium (Debian: apt-get install chromium)");
    }
    found
}

/// What a browser shows of a page in a window of 390 px: how wide it is, what is wider than the window, out of reach or too small to be
/// read, and the colour behind it.
pub fn narrow(browser: &Path, page: &Path, more: &[String]) -> (f64, String, String) {
    let script = r##"<script>
        const frame = document.createElement("iframe");
        frame.style = "width: 390px; height: 800px; border: 0";
        frame.onload = () => {
          const page = frame.contentDocument, root = page.documentElement;
          // What scrolls sideways by itself may be wider inside.
          const scrolled = (node) => node && node !== page.body && (["auto", "scroll"].includes(frame.contentWindow.getComputedStyle(node).overflowX) || scrolled(node.parentElement));
          const over = [...page.querySelectorAll("svg, figure, button, input, select, output, p, pre, h1, h2, table")]
            .filter((node) => !node.closest("[hidden]") && !scrolled(node.parentElement))
            .filter((node) => { const box = node.getBoundingClientRect(); return box.left < 0 || box.right > 390 || box.width === 0 && node.id !== "more"; })
            .map((node) => node.tagName + "#" + node.id);
          const size = (text) => parseFloat(frame.contentWindow.getComputedStyle(text).fontSize) * Math.hypot(text.getScreenCTM().a, text.getScreenCTM().b);
          const sizes = [...page.querySelectorAll(".figures svg text")].map(size);
          if (Math.min(...sizes) < 9) over.push("labels of " + Math.min(...sizes) + " px");
          document.body.dataset.width = root.scrollWidth;
          document.body.dataset.over = over.join(" ");
          document.body.dataset.paper = frame.contentWindow.getComputedStyle(page.body).backgroundColor;
        };
        frame.srcdoc = document.getElementById("page").textContent;
        document.body.append(frame);
    </script>"##;
    let source = std::fs::read_to_string(page).unwrap().replace("</script", "<\\/script").replace("<!--", "<\\!--");
    let unescape = r#"document.getElementById("page").textContent.replaceAll("<\/script", "</" + "script")"#;
    let script = script.replace(r#"document.getElementById("page").textContent"#, unescape);
    let outer = page.with_file_name("narrow.html");
    let text = format!("<body><script id=\"page\" type=\"text/plain\">{source}</script>{script}</body>");
    std::fs::write(&outer, text).unwrap();
    let shown = browse(browser, &outer, 2000, &[&["--dump-dom".to_string()], more].concat());
    std::fs::remove_file(outer).unwrap();
    let body = shown.split('<').find(|element| element.starts_with("body")).unwrap();
    let of_body =
        |name: &str| body.split(&format!("data-{name}=\"")).nth(1).unwrap().split('"').next().unwrap().to_string();
    (of_body("width").parse().unwrap(), of_body("over"), of_body("paper"))
}

/// What the browser prints after `milliseconds` of the page's own time.
pub fn browse(browser: &Path, page: &Path, milliseconds: u32, more: &[String]) -> String {
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .arg("--window-size=1200,900")
        .arg(format!("--virtual-time-budget={milliseconds}"))
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .args(more)
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// A page needs no other file, and no network.
pub fn assert_self_contained(source: &str) {
    for outside in ["src=", "href=", "@import", "url("] {
        assert!(
            !source.replace("url(#", "").contains(outside),
            "the page is one self-contained file, without {outside}"
        );
    }
}

/// The value of an attribute of the element with an id.
pub fn attribute<'a>(page: &'a str, id: &str, name: &str) -> &'a str {
    let element = page.split('<').find(|element| element.contains(&format!("id=\"{id}\""))).unwrap();
    element.split(&format!(" {name}=\"")).nth(1).and_then(|rest| rest.split('"').next()).unwrap_or_default()
}

/// Runs the command with these arguments, the last of which takes the path of `folder`, in the folder of the project.
fn command_to(folder: &Path, arguments: &[&str]) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_caudal"));
    let output = command.current_dir(env!("CARGO_MANIFEST_DIR")).args(arguments).arg(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn the_report_plays_the_tail_in_a_browser() {
    let folder = tempfile::tempdir().unwrap();
    let status = Command::new(env!("CARGO_BIN_EXE_caudal"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["run", "models/baseline-smooth.toml", "--set", "solver.duration_s=10.0", "--out"])
        .arg(folder.path())
        .output()
        .unwrap();
    assert!(status.status.success());
    let path = folder.path().join("report.html");
    let source = std::fs::read_to_string(&path).unwrap();
    assert_self_contained(&source);
    let Some(browser) = chromium() else { return };
    // A busy machine may draw few frames in the page's time; one that never moves fails at every length of it.
    let (page, frame) = [2000, 5000, 9000]
        .into_iter()
        .map(|milliseconds| browse(&browser, &path, milliseconds, &["--dump-dom".to_string()]))
        .find_map(|page| match attribute(&page, "stage", "data-frame").parse::<usize>().unwrap() {
            0 => None,
            frame => Some((page, frame)),
        })
        .expect("the animation moves");
    let frames: usize = attribute(&page, "stage", "data-frames").parse().expect("the script ran to its end");
    assert!(frames >= 200 && frame < frames, "frame {frame} of {frames}");
    assert_eq!(attribute(&page, "rod", "points").split_whitespace().count(), 9, "the rod has its nodes");
    assert_eq!(page.matches("<figure>").count(), 12);
    assert!(page.contains("net_displacement_m"));
    // What a person would see: the rod's and the trace's colours are on the picture, not only in the text.
    let count = pixels_on(&browser, &path, folder.path());
    assert!(count([0, 114, 178]) > 500, "the rod is drawn: {} pixels", count([0, 114, 178]));
    assert!(count([213, 94, 0]) > 50, "the centre of mass is drawn: {} pixels", count([213, 94, 0]));
    // On a telephone nothing is cut, and the page is as light or dark as its reader likes.
    let dark = ["--blink-settings=preferredColorScheme=0".to_string()];
    for (more, paper) in [(&[][..], "rgb(255, 255, 255)"), (&dark, "rgb(22, 27, 33)")] {
        let (width, over, found) = narrow(&browser, &path, more);
        assert!(width <= 390.0, "{width} px");
        assert_eq!((over.as_str(), found.as_str()), ("", paper));
    }
    // The camera follows where it is told to, and the slowest and the fastest speeds are there.
    let script = r##"<script>
        const centre = () => [part("com").getAttribute("cx"), part("com").getAttribute("cy")].join(" ");
        const go = (k) => { part("time").value = k; part("time").oninput(); };
        go(0); document.body.dataset.still = centre(); go(400); document.body.dataset.moved = centre();
        part("follow").checked = true; part("follow").onchange();
        go(0); document.body.dataset.view = centre(); go(400); document.body.dataset.later = centre();
        document.body.dataset.speeds = [...part("speed").options].map((option) => option.value).join(" ");
    </script></body>"##;
    let followed = folder.path().join("followed.html");
    std::fs::write(&followed, source.replace("</body>", script)).unwrap();
    let page = browse(&browser, &followed, 1000, &["--dump-dom".to_string()]);
    let body = page.split('<').find(|element| element.starts_with("body")).unwrap();
    let of_body = |name: &str| body.split(&format!("data-{name}=\"")).nth(1).unwrap().split('"').next().unwrap();
    let [still, moved, view, later] = ["still", "moved", "view", "later"].map(|name| {
        let numbers: Vec<f64> = of_body(name).split(' ').map(|x| x.parse().unwrap()).collect();
        numbers
    });
    let apart = |a: &[f64], b: &[f64]| (a[0] - b[0]).hypot(a[1] - b[1]);
    assert!(apart(&still, &moved) > 1.0 && apart(&view, &later) < 1e-9, "{still:?} {moved:?} {view:?} {later:?}");
    assert!(of_body("speeds").starts_with("0.001 ") && of_body("speeds").ends_with(" 100"), "{}", of_body("speeds"));
}

#[test]
fn the_report_of_a_sweep_sorts_filters_and_plays_in_a_browser() {
    let folder = tempfile::tempdir().unwrap();
    command_to(folder.path(), &["sweep", "models/sweep-192.toml", "--set", "solver.duration_s=0.02", "--out"]);
    let path = folder.path().join("report.html");
    let source = std::fs::read_to_string(&path).unwrap();
    assert_self_contained(&source);
    assert!(source.len() < 5_000_000, "{} bytes", source.len());
    let Some(browser) = chromium() else { return };
    // What a reader does: sorts by displacement, keeps one fluid and the larger amplitude, and clicks the third row.
    let script = r##"<script>
        const headed = (text) => [...document.querySelectorAll("#heads th")].findIndex((head) => head.textContent.startsWith(text));
        const filter = (text, value, event) => {
          const field = document.querySelectorAll("#filters th")[headed(text)].firstChild;
          field.value = value; field.dispatchEvent(new Event(event));
        };
        const shown = () => [...document.querySelectorAll("#rows tr")];
        document.body.dataset.before = shown().length;
        document.querySelectorAll("#heads th")[headed("net displacement in x")].click();
        filter("fluid", "glycerol-like", "change");
        filter("kappa_amp", "1.2", "change");
        filter("Newton", "> 0", "input");
        document.body.dataset.after = shown().map((row) => row.dataset.case).join(" ");
        shown()[2].click();
        document.body.dataset.clicked = document.querySelector("tr.chosen").dataset.case;
    </script></body>"##;
    let page = folder.path().join("clicked.html");
    std::fs::write(&page, source.replace("</body>", script)).unwrap();
    let page = browse(&browser, &page, 3000, &["--dump-dom".to_string()]);
    let body = page.split('<').find(|element| element.starts_with("body")).unwrap();
    let of_body = |name: &str| body.split(&format!("data-{name}=\"")).nth(1).unwrap().split('"').next().unwrap();
    assert_eq!(of_body("before"), "192");
    let mut reader = csv::Reader::from_path(folder.path().join("table.csv")).unwrap();
    let header = reader.headers().unwrap().clone();
    let place = |name: &str| header.iter().position(|column| column == name).unwrap();
    let (fluid, kappa, dx) = (place("fluid"), place("actuation.kappa_amp"), place("net_displacement_m"));
    let mut expected: Vec<(f64, String)> = reader
        .records()
        .map(|row| row.unwrap())
        .filter(|row| &row[fluid] == "glycerol-like" && &row[kappa] == "1.2")
        .map(|row| (format!("{:.5e}", row[dx].parse::<f64>().unwrap()).parse().unwrap(), row[0].to_string()))
        .collect();
    assert_eq!(expected.len(), 48);
    expected.sort_by(|a, b| a.0.total_cmp(&b.0));
    let expected: Vec<_> = expected.into_iter().map(|(_, case)| case).collect();
    assert_eq!(of_body("after"), expected.join(" "));
    assert_eq!(of_body("clicked"), expected[2]);
    assert_eq!(attribute(&page, "stage", "data-case"), expected[2]);
    assert_eq!(attribute(&page, "rod", "points").split_whitespace().count(), 9, "the rod has its nodes");
    assert!(attribute(&page, "stage", "data-frames").parse::<usize>().unwrap() >= 30);
    assert_eq!(narrow(&browser, &path, &[]).1, "");
    let svgs = std::fs::read_dir(folder.path()).unwrap();
    let svgs =
        svgs.filter(|entry| entry.as_ref().unwrap().path().extension().is_some_and(|kind| kind == "svg")).count();
    assert_eq!((page.matches("<figure>").count(), svgs), (svgs, 25));
}

/// What a script at the end of the page leaves in the data of its body, by their names.
pub fn after<'a>(browser: &Path, path: &Path, script: &str, names: &'a [&str]) -> Vec<(&'a str, String)> {
    let source = std::fs::read_to_string(path).unwrap();
    let tried = path.with_file_name("tried.html");
    std::fs::write(&tried, source.replace("</body>", &format!("<script>(() => {{{script}}})();</script></body>")))
        .unwrap();
    let page = browse(browser, &tried, 3000, &["--dump-dom".to_string()]);
    let body = page.split('<').find(|element| element.starts_with("body")).unwrap().to_string();
    let of = |name: &str| {
        let value = body.split(&format!("data-{name}=\"")).nth(1);
        value.unwrap_or_else(|| panic!("{name}: {body}")).split('"').next().unwrap().to_string()
    };
    names.iter().map(|name| (*name, of(name))).collect()
}

/// Moves the mouse in the first chart of the page that is over time, to a part of its width, with more keys of the event.
const POINTER: &str = r##"
    const over_time = [...document.querySelectorAll(".plot")].filter((plot) => plot.textContent.includes("time (s)"));
    const over = (plot) => plot.querySelector(".u-over");
    function mouse(kind, plot, part, more) {
      const box = over(plot).getBoundingClientRect();
      const at = { clientX: box.left + part * box.width, clientY: box.top + 0.5 * box.height, movementX: 1, bubbles: true, view: window, ...more };
      (kind === "mouseup" ? document : over(plot)).dispatchEvent(new MouseEvent(kind, at));
    }
    const legend = (plot) => [...plot.querySelectorAll(".u-legend .u-value")].map((value) => value.textContent);
"##;

#[test]
fn charts_say_values_enlarge_hide_curves_and_share_their_cursor_with_the_player_and_keys_move_it() {
    let folder = tempfile::tempdir().unwrap();
    command_to(folder.path(), &["run", "models/tendon-fish.toml", "--set", "solver.duration_s=2.0", "--out"]);
    let Some(browser) = chromium() else { return };
    let script = format!(
        "{POINTER}{}",
        r##"
        const frame = () => Number(part("stage").dataset.frame), clock = () => part("clock").textContent;
        halt(0);
        const plot = over_time[0], next = over_time[1];
        mouse("mouseenter", plot, 0.5); mouse("mousemove", plot, 0.5);
        setTimeout(() => {
          document.body.dataset.value = legend(plot).join(" ");
          document.body.dataset.shared = legend(next)[0];
          document.body.dataset.followed = clock();
          for (const kind of ["mousemove", "mousedown", "mouseup", "click"]) mouse(kind, plot, 0.25, { button: 0 });
          document.body.dataset.sought = clock();
          document.body.dataset.address = location.hash;
          const line = next.querySelector(".shown").getBoundingClientRect(), box = over(next).getBoundingClientRect();
          document.body.dataset.line = (line.left - box.left) / box.width;
          const at = frame();
          const key = (name) => document.body.dispatchEvent(new KeyboardEvent("keydown", { key: name, bubbles: true }));
          key("ArrowRight"); document.body.dataset.right = frame() - at;
          key("End"); document.body.dataset.end = frame() === motion.times.length - 1;
          key("Home"); document.body.dataset.home = frame();
          key(" "); document.body.dataset.plays = part("play").textContent; key(" ");
          part("time").dispatchEvent(new KeyboardEvent("keydown", { key: " ", bubbles: true }));
          document.body.dataset.slider = part("play").textContent; key(" ");
          plot.querySelectorAll(".u-series")[1].querySelector("th").click();
          document.body.dataset.hidden = plot.querySelectorAll(".u-series.u-off").length;
          mouse("mousedown", plot, 0.25, { button: 0, buttons: 1 }); mouse("mousemove", plot, 0.75, { buttons: 1 });
          setTimeout(() => {
            mouse("mouseup", plot, 0.75, { button: 0 });
            setTimeout(() => {
              mouse("mousemove", plot, 0.0001);
              setTimeout(() => {
                document.body.dataset.enlarged = legend(plot)[0];
                halt(1);
                for (const name of ["curvature", "moment", "power"]) {
                  part("colour").value = name; part("colour").onchange();
                  document.body.dataset[name] = new Set([...part("segments").children].map((segment) => segment.getAttribute("fill"))).size;
                }
                document.body.dataset.outline = part("outline").getAttribute("points").split(" ").length;
                document.body.dataset.tendons = [...part("tendons").children].filter((line) => line.getAttribute("points")).length;
              }, 50);
            }, 50);
          }, 50);
        }, 50);"##
    );
    let names = [
        "value",
        "shared",
        "followed",
        "sought",
        "address",
        "line",
        "right",
        "end",
        "home",
        "plays",
        "slider",
        "hidden",
        "enlarged",
        "curvature",
        "moment",
        "power",
        "outline",
        "tendons",
        "charts",
    ];
    let found = after(&browser, &folder.path().join("report.html"), &script, &names);
    let of = |name: &str| found.iter().find(|(known, _)| *known == name).unwrap().1.as_str();
    // The middle of two seconds, with the velocity that the table has there.
    let mut reader = csv::Reader::from_path(folder.path().join("trajectory.csv")).unwrap();
    let header = reader.headers().unwrap().clone();
    let place = |name: &str| header.iter().position(|column| column == name).unwrap();
    let (time, x) = (place("time_s"), place("x_com_m"));
    let rows: Vec<[f64; 2]> = (reader.records().map(Result::unwrap))
        .map(|row| [time, x].map(|column| row[column].parse().unwrap()))
        .collect();
    let values: Vec<f64> = of("value").split(' ').map(|value| value.parse().unwrap()).collect();
    let middle = rows.iter().position(|row| (row[0] - values[0]).abs() < 1e-6).unwrap();
    assert!((values[0] - 1.0).abs() < 0.02, "{}", of("value"));
    let slope = (rows[middle + 1][1] - rows[middle - 1][1]) / (rows[middle + 1][0] - rows[middle - 1][0]);
    // The velocity is that of the centre of mass: measured difference to its differences 0.1 %.
    assert!((values[1] - slope).abs() < 0.02 * slope.abs(), "{} {slope}", of("value"));
    assert_eq!(of("shared"), values[0].to_string());
    assert!(of("followed") == "t = 1.000 s", "{}", of("followed"));
    assert!(of("sought") == "t = 0.500 s", "{}", of("sought"));
    let address: f64 = of("address").trim_start_matches("#t=").parse().unwrap();
    assert!((address - 0.5).abs() < 0.01, "{}", of("address"));
    // On its own axis, which goes a little beyond the run.
    let line: f64 = of("line").parse().unwrap();
    assert!((line - 0.25).abs() < 0.01, "{line}");
    assert_eq!([of("right"), of("end"), of("home"), of("plays"), of("hidden")], ["1", "true", "0", "Pause", "1"]);
    assert_eq!(of("slider"), "Pause", "the space bar plays also after the slider was used");
    // From a quarter of the run on.
    assert!((of("enlarged").parse::<f64>().unwrap() - 0.5).abs() < 0.02, "{}", of("enlarged"));
    for name in ["curvature", "moment", "power"] {
        assert!(of(name).parse::<usize>().unwrap() > 2, "{name} has {} colours", of(name));
    }
    assert_eq!((of("outline"), of("tendons")), ("52", "2"));
    assert!(of("charts").parse::<usize>().unwrap() >= 8, "{}", of("charts"));
}

#[test]
fn an_address_with_a_time_shows_that_moment() {
    let folder = tempfile::tempdir().unwrap();
    command_to(folder.path(), &["run", "models/servo-tail.toml", "--set", "solver.duration_s=1.0", "--out"]);
    let Some(browser) = chromium() else { return };
    let address = PathBuf::from(format!("{}#t=0.6&colour=moment", folder.path().join("report.html").display()));
    let page = browse(&browser, &address, 2000, &["--dump-dom".to_string()]);
    assert!(page.contains(">t = 0.600 s</output>"), "it stands at the time of the address");
    assert_eq!(attribute(&page, "play", "type"), "button");
    assert!(!attribute(&page, "holder", "d").is_empty() && !attribute(&page, "force", "d").is_empty(), "a held head");
    assert_eq!(attribute(&page, "stream", "d").matches('l').count(), 15, "the stream");
}

#[test]
fn the_player_shows_twelve_pictures_per_period_on_a_screen_and_its_clock_and_address_tell_frames_apart() {
    let folder = tempfile::tempdir().unwrap();
    command_to(folder.path(), &["run", "models/servo-tail.toml", "--set", "solver.duration_s=1.0", "--out"]);
    let Some(browser) = chromium() else { return };
    let source = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    // The motion over windows of such lengths (s) from such times (s) on, with such periods (s) of the fastest drive.
    let script = r##"<script>
        const own = motion, results = [];
        const moved = (from, span, period) => ({ ...own, period, times: own.times.map((t) => from + span * t) });
        for (const span of [1, 3, 30, 300]) for (const period of [undefined, 1, 0.2, 1 / 33, 1 / 200, 1e-3]) {
          play(moved(0, span, period));
          const speed = Number(part("speed").value);
          if (!(60 * period / speed >= 12 - 1e-9 || period === undefined)) results.push("speed " + speed + " at " + span + " s, " + period + " s");
          if (speed === 0.001 && period !== 1e-3) results.push("slow " + speed + " at " + span + " s, " + period + " s");
          if (span === 3 && speed !== 1 && !(period < 0.2)) results.push("not in time at a period of " + period + " s");
        }
        // A browser takes some 200 addresses in half a minute.
        for (const [from, span] of [[0, 1], [0, 15], [0, 2000], [1995.1, 4.9], [1990, 10], [1e5, 1e-3]]) {
          play(moved(from, span, 0.1));
          for (let k = 0; k + 1 < motion.times.length; k += 29) {
            halt(motion.times[k + 1]); const next = part("clock").textContent;
            halt(motion.times[k]);
            if (part("clock").textContent === next) results.push("clock " + next);
            if (at(within_run(asked("t"))) !== k) results.push("address " + location.hash + " of " + motion.times[k]);
          }
        }
        document.body.dataset.wrong = results.slice(0, 9).join("; ");
    </script></body>"##;
    let page = folder.path().join("speeds.html");
    std::fs::write(&page, source.replace("</body>", script)).unwrap();
    let page = browse(&browser, &page, 3000, &["--dump-dom".to_string()]);
    let body = page.split('<').find(|element| element.starts_with("body")).unwrap();
    assert_eq!(body.split("data-wrong=\"").nth(1).and_then(|rest| rest.split('"').next()), Some(""), "{body}");
}

#[test]
fn a_click_in_a_map_plays_its_case_beside_another_and_one_on_a_dot_gives_its_keys() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("map.toml");
    std::fs::write(
        &scene,
        "scene = \"SCENE\"\n[axes]\nactuation.frequency_hz = [1.0, 2.0, 3.0]\nactuation.kappa_amp = [0.5, 1.0]\n[record]\nframes = 20\n"
            .replace("SCENE", &format!("{}/models/glycerol.toml", env!("CARGO_MANIFEST_DIR"))),
    )
    .unwrap();
    let out = folder.path().join("out");
    let output = Command::new(env!("CARGO_BIN_EXE_caudal"))
        .args(["sweep".as_ref(), scene.as_os_str(), "--set".as_ref(), "solver.duration_s=0.5".as_ref()])
        .args(["--out".as_ref(), out.as_os_str()])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let Some(browser) = chromium() else { return };
    let script = r##"
        const figure = document.querySelector("figure[data-cells]"), svg = figure.querySelector("svg");
        const { columns, rows, cases } = JSON.parse(figure.dataset.cells);
        const click = (column, row) => {
          const box = svg.getBoundingClientRect(), view = svg.viewBox.baseVal;
          const x = (columns[column] + columns[column + 1]) / 2, y = (rows[row] + rows[row + 1]) / 2;
          svg.dispatchEvent(new MouseEvent("click", { clientX: box.left + x / view.width * box.width, clientY: box.top + y / view.height * box.height, bubbles: true }));
        };
        click(2, 0); document.body.dataset.first = part("stage").dataset.case + " " + part("what").textContent;
        part("together").checked = true;
        click(0, 1); document.body.dataset.second = part("what").textContent;
        document.body.dataset.beside = part("beside").children.length + " " + part("legend").textContent.trim();
        const corners = (outline) => outline.getAttribute("points").split(" ").length;
        document.body.dataset.bodies = corners(part("outline")) + " " + corners(part("beside").querySelector("polygon"));
    "##;
    let found = after(&browser, &out.join("report.html"), script, &["first", "second", "beside", "bodies"]);
    // Cases are numbered by the first axis, then the second.
    assert_eq!(found[0].1, "4 Case 4: actuation.frequency_hz = 3.0, actuation.kappa_amp = 0.5");
    assert_eq!(
        found[1].1,
        "Case 1: actuation.frequency_hz = 1.0, actuation.kappa_amp = 1.0; beside it Case 4: actuation.frequency_hz = 3.0, \
         actuation.kappa_amp = 0.5"
    );
    assert_eq!(found[2].1, "1 Beside it:case&nbsp;4");
    // Both sides of the body at each of 9 nodes.
    assert_eq!(found[3].1, "18 18");

    let out = folder.path().join("study");
    let output = Command::new(env!("CARGO_BIN_EXE_caudal"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["study", "accuracy", "models/baseline-smooth.toml", "--set", "solver.duration_s=0.2", "--out"])
        .arg(&out)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let script = r##"
        const note = [...document.querySelectorAll("svg .note")].find((note) => note.textContent.includes('"newmark"\nsolver.beta = 0.25\nsolver.gamma = 0.5'));
        note.dispatchEvent(new MouseEvent("click", { bubbles: true }));
        document.body.dataset.keys = note.closest("figure").querySelector(".copied").textContent.replaceAll("\n", "|");
        document.body.dataset.dots = document.querySelectorAll("svg .note").length;
    "##;
    let found = after(&browser, &out.join("report.html"), script, &["keys", "dots"]);
    // The keys make a scene whose run has the row of the table.
    let keys: Vec<&str> = found[0].1.split('|').collect();
    let expected = [
        "solver.model = &quot;full&quot;",
        "solver.integrator = &quot;newmark&quot;",
        "solver.beta = 0.25",
        "solver.gamma = 0.5",
    ];
    assert_eq!(&keys[..4], &expected);
    assert!(keys[4].starts_with("solver.time_step_s = ") && keys[5] == "rod.nodes = 9", "{keys:?}");
    assert!(found[1].1.parse::<usize>().unwrap() > 20, "{}", found[1].1);
}

#[test]
fn what_is_printed_has_legible_names_of_axes_and_breaks_no_number() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = folder.path().join("sweep.toml");
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/models/eel.toml");
    std::fs::write(
        &sweep,
        format!("scene = {model:?}\n[set]\nrod.nodes = 9\nsolver.duration_s = 1.0\n[axes]\nactuation.frequency_hz = [1.5, 2.5]\nactuation.kappa_amp = [5.0, 8.0]\n"),
    )
    .unwrap();
    let run = ["run", model, "--set", "rod.nodes=9", "--set", "solver.duration_s=1.0", "--out"].map(String::from);
    let [run_out, sweep_out] = ["run", "swept"].map(|name| folder.path().join(name));
    for (arguments, out) in
        [(run.to_vec(), &run_out), (vec!["sweep".into(), sweep.display().to_string(), "--out".into()], &sweep_out)]
    {
        let output = Command::new(env!("CARGO_BIN_EXE_caudal")).args(arguments).arg(out).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    let Some(browser) = chromium() else { return };
    // Names of axes are drawn by these sizes of pixels that are a third of those of the page.
    let script = r##"
        const fonts = {}, fill = CanvasRenderingContext2D.prototype.fillText;
        CanvasRenderingContext2D.prototype.fillText = function (text, ...rest) { fonts[text] = Number(/([\d.]+)px/.exec(this.font)[1]); fill.call(this, text, ...rest); };
        dispatchEvent(new Event("beforeprint"));
        setTimeout(() => {
          document.body.dataset.names = Object.keys(fonts).filter((text) => /[(].*[)]$/.test(text)).length;
          document.body.dataset.least = Math.min(...Object.values(fonts)) / 3;
          document.body.dataset.frames = motion.times.length;
          document.body.dataset.still = [part("stage").dataset.frame, document.querySelectorAll("#earlier polyline").length].join(" ");
          dispatchEvent(new Event("afterprint"));
          document.body.dataset.left = document.querySelectorAll("#earlier polyline").length;
        }, 200);
    "##;
    let page = std::fs::read_to_string(run_out.join("report.html")).unwrap();
    assert!(
        page.contains(".controls, .on-screen") && !page.contains(".moving"),
        "the picture is printed without its controls"
    );
    let found = after(&browser, &run_out.join("report.html"), script, &["names", "least", "frames", "still", "left"]);
    let last = found[2].1.parse::<usize>().unwrap() - 1;
    assert_eq!(
        (found[3].1.as_str(), found[4].1.as_str()),
        (format!("{last} 5").as_str(), "0"),
        "the last frame, and earlier shapes"
    );
    let [names, least]: [f64; 2] = std::array::from_fn(|k| found[k].1.parse().unwrap());
    assert!(names >= 8.0 && least >= 9.0, "{names} names of axes, the smallest text has {least} px"); // measured: 9
    let script = r##"
        dispatchEvent(new Event("beforeprint"));
        const tables = [...document.querySelectorAll("#printed table")];
        const heads = (table) => [...table.querySelectorAll("th")].map((head) => head.textContent);
        document.body.dataset.tables = tables.length;
        document.body.dataset.rows = tables.map((table) => table.querySelectorAll("tbody tr").length).join(" ");
        document.body.dataset.levels = new Set(tables.map((table) => heads(table).slice(0, 3).join(" "))).size;
        document.body.dataset.columns = tables.reduce((all, table) => all + heads(table).length - 3, 3) - columns.length;
        document.body.dataset.words = [...document.querySelectorAll("#printed td:not(.number)")].map((cell) => cell.textContent).filter((text) => /^[−-]?[\d.]/.test(text)).length;
    "##;
    let names = ["tables", "rows", "levels", "columns", "words"];
    let found = after(&browser, &sweep_out.join("report.html"), script, &names);
    let of = |k: usize| found[k].1.as_str();
    let tables: usize = of(0).parse().unwrap();
    assert!(tables > 1, "{tables}");
    assert_eq!([of(1), of(2), of(3), of(4)], [vec!["4"; tables].join(" ").as_str(), "1", "0", "0"]);
    let page = std::fs::read_to_string(sweep_out.join("report.html")).unwrap();
    assert!(
        page.contains("td.number { white-space: nowrap; }") && page.contains(".scroll, #player { display: none; }")
    );
}

/// A clamped rod of a micrometre that waves.
const MICROMETRE: &str = r#"
head = { kind = "clamped" }
rod = { nodes = 9, length_m = 1e-6, outer_radius_m = 2e-8, youngs_modulus_pa = 1e6, density_kg_m3 = 1000.0 }
actuation = { kind = "travelling-wave", kappa_amp = 1e6, frequency_hz = 2, wavelength_m = 1e-6, envelope = [0.3, 0.7] }
solver = { duration_s = 0.3, time_step_s = 0.001 }
"#;

/// Counts the pixels near a colour on a picture of the page at `path`, which is left in `folder`.
fn pixels_on(browser: &Path, path: &Path, folder: &Path) -> impl Fn([u8; 3]) -> usize {
    let picture = folder.join("page.png");
    browse(browser, path, 2000, &[format!("--screenshot={}", picture.display())]);
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&picture).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let channels = reader.next_frame(&mut pixels).unwrap().color_type.samples();
    let near = |pixel: &[u8], colour: [u8; 3]| pixel.iter().zip(colour).all(|(a, b)| a.abs_diff(b) < 12);
    move |colour| pixels.chunks_exact(channels).filter(|pixel| near(&pixel[..3], colour)).count()
}

#[test]
fn a_rod_of_a_micrometre_is_drawn_and_times_are_those_of_a_person() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("micrometre.toml");
    std::fs::write(&scene, MICROMETRE).unwrap();
    let out = folder.path().join("out");
    let output = Command::new(env!("CARGO_BIN_EXE_caudal"))
        .args(["run".as_ref(), scene.as_os_str(), "--out".as_ref(), out.as_os_str()])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let path = out.join("report.html");
    let source = std::fs::read_to_string(&path).unwrap();
    // Not a whole period: the figures are of the run.
    assert!(source.contains("shapes of the run.") && source.contains("Power over the run"), "not a period");
    assert!(source.contains("up to t = 0.3&nbsp;s") && source.contains("shape at t = 0.3 s"), "rounded times");
    let Some(browser) = chromium() else { return };
    let count = pixels_on(&browser, &path, folder.path());
    let [rod, centre] = [[0, 114, 178], [213, 94, 0]].map(count);
    assert!(rod > 500 && centre > 50, "{rod} pixels of the rod, {centre} of its centre of mass");
}

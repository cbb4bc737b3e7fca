//! report.html works in a browser: it is one file, its script runs, the tail moves, and every figure is there.

use std::path::{Path, PathBuf};
use std::process::Command;

/// A Chromium on this machine. Without one, says that the page was not opened.
fn chromium() -> Option<PathBuf> {
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

/// What a browser shows of a page in a window of 390 px: how wide it is, what is wider than the window or out of reach, and the
/// colour behind it.
fn narrow(browser: &Path, page: &Path, more: &[String]) -> (f64, String, String) {
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
fn browse(browser: &Path, page: &Path, milliseconds: u32, more: &[String]) -> String {
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

/// The value of an attribute of the element with an id.
fn attribute<'a>(page: &'a str, id: &str, name: &str) -> &'a str {
    let element = page.split('<').find(|element| element.contains(&format!("id=\"{id}\""))).unwrap();
    element.split(&format!(" {name}=\"")).nth(1).and_then(|rest| rest.split('"').next()).unwrap_or_default()
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
    for outside in ["src=", "href=", "@import", "url("] {
        assert!(
            !source.replace("url(#", "").contains(outside),
            "the page is one self-contained file, without {outside}"
        );
    }
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
    assert_eq!(page.matches("<figure>").count(), 8);
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
        part("follow").checked = true; part("follow").onchange();
        document.body.dataset.view = part("stage").getAttribute("viewBox");
        part("time").value = 400; part("time").oninput();
        document.body.dataset.later = part("stage").getAttribute("viewBox");
        document.body.dataset.speeds = [...part("speed").options].map((option) => option.value).join(" ");
    </script></body>"##;
    let followed = folder.path().join("followed.html");
    std::fs::write(&followed, source.replace("</body>", script)).unwrap();
    let page = browse(&browser, &followed, 1000, &["--dump-dom".to_string()]);
    let body = page.split('<').find(|element| element.starts_with("body")).unwrap();
    let of_body = |name: &str| body.split(&format!("data-{name}=\"")).nth(1).unwrap().split('"').next().unwrap();
    let [view, later] = ["view", "later"].map(|name| {
        let numbers: Vec<f64> = of_body(name).split(' ').map(|x| x.parse().unwrap()).collect();
        numbers
    });
    assert!(view[0] != later[0] && (view[2] - later[2]).abs() < 1e-9, "{view:?} {later:?}");
    assert!(of_body("speeds").starts_with("0.001 ") && of_body("speeds").ends_with(" 100"), "{}", of_body("speeds"));
}

#[test]
fn the_report_of_a_sweep_sorts_filters_and_plays_in_a_browser() {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_caudal"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["sweep", "models/sweep-192.toml", "--set", "solver.duration_s=0.02", "--out"])
        .arg(folder.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let path = folder.path().join("report.html");
    let source = std::fs::read_to_string(&path).unwrap();
    for outside in ["src=", "href=", "@import", "url("] {
        assert!(
            !source.replace("url(#", "").contains(outside),
            "the page is one self-contained file, without {outside}"
        );
    }
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

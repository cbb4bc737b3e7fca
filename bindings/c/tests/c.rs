//! The C library: its header is up to date; a user's C program compiles without warnings, runs clean under the sanitizers and
//! valgrind, and computes a trajectory bit-identical to that of the stepper.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a failure ends the test")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

#[path = "../../../tests/common/skip.rs"]
mod skip;

use engine::scene::Document;
use engine::stepper::Stepper;
use skip::skip;

fn here() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn the_header_is_what_cbindgen_makes_of_the_library() {
    let mut made = Vec::new();
    let config = cbindgen::Config::from_file(here().join("cbindgen.toml")).unwrap();
    cbindgen::Builder::new()
        .with_config(config)
        .with_src(here().join("src/lib.rs"))
        .generate()
        .unwrap()
        .write(&mut made);
    let path = here().join("include/caudal.h");
    if std::env::var_os("CAUDAL_WRITE_HEADER").is_some() {
        std::fs::write(&path, &made).unwrap();
    }
    let there = std::fs::read(&path).unwrap_or_default();
    assert!(there == made, "include/caudal.h is out of date: CAUDAL_WRITE_HEADER=1 cargo test -p caudal-c writes it");
}

fn run(command: &mut Command) -> Output {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let text = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned()).concat();
    assert!(output.status.success(), "{command:?}: {text}");
    output
}

/// True if a `program` of this Debian package can be run. Otherwise prints that the test is skipped.
fn there_is(program: &str, package: &str) -> bool {
    let found = Command::new(program).arg("--version").output().is_ok();
    if !found {
        skip(program, &format!("install it (Debian: apt-get install {package})"));
    }
    found
}

/// Installs the library into `folder`, as a user would.
fn install(folder: &Path) {
    run(Command::new("sh").arg(here().join("install.sh")).arg(folder).env("CAUDAL_PROFILE", "dev"));
}

/// Compiles the example, with `more` arguments.
fn compile(folder: &Path, name: &str, more: &[&str]) -> PathBuf {
    compile_source(folder, "examples/steer.c", name, more)
}

/// Compiles a program of one file.
fn compile_source(folder: &Path, source: &str, name: &str, more: &[&str]) -> PathBuf {
    let program = folder.join(name);
    run(Command::new("cc")
        .args(["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-g", "-O1"])
        .arg(here().join(source))
        .arg(format!("-I{}", folder.join("include").display()))
        .args(more)
        .arg("-o")
        .arg(&program));
    program
}

#[test]
fn a_c_host_compiles_without_a_warning_and_runs_clean() {
    if !there_is("cc", "gcc libc6-dev") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    install(folder.path());
    let lib = folder.path().join("lib");
    let flags = [format!("-L{}", lib.display()), format!("-Wl,-rpath,{}", lib.display())];
    let shared = compile(folder.path(), "shared", &[&flags[0], &flags[1], "-lcaudal"]);
    let archive = lib.join("libcaudal.a");
    let still = compile(folder.path(), "static", &[archive.to_str().unwrap(), "-lm", "-lpthread", "-ldl"]);
    let checked = compile(
        folder.path(),
        "checked",
        &["-fsanitize=address,undefined", "-fno-sanitize-recover=all", &flags[0], &flags[1], "-lcaudal"],
    );
    let scene = here().join("../../models/baseline-smooth.toml");
    let output = run(Command::new(&shared).arg(&scene));
    for program in [&still, &checked] {
        let other = run(Command::new(program).arg(&scene));
        assert_eq!(output.stdout, other.stdout);
        assert_eq!(String::from_utf8_lossy(&other.stderr), "");
    }
    let quick = ["--quiet", "--error-exitcode=9", "--leak-check=full", "--show-leak-kinds=definite,indirect,possible"];
    if there_is("valgrind", "valgrind") {
        let checked = run(Command::new("valgrind").args(quick).arg(&shared).arg(&scene));
        assert_eq!(output.stdout, checked.stdout);
        assert_eq!(String::from_utf8_lossy(&checked.stderr), "");
    }

    // The same controller, applied directly to the stepper.
    let document = Document::read(&scene).unwrap();
    let mut tail = Stepper::of(&document.scene().unwrap()).unwrap();
    let mut expected = String::new();
    let joints = tail.get("natural_curvature_1_m").unwrap().len();
    for step in 0..100 {
        let wanted = -5.0 * tail.get_scalar("y_com_m").unwrap();
        tail.set("natural_curvature_1_m", &vec![wanted; joints]).unwrap();
        tail.do_step(0.01).unwrap();
        if step % 10 == 9 {
            let [x, y] = ["x_com_m", "y_com_m"].map(|name| tail.get_scalar(name).unwrap());
            for value in [tail.time(), x, y] {
                expected += &format!("{:016x} ", value.to_bits());
            }
            expected += &format!("{:016x}\n", wanted.to_bits());
        }
    }
    let bits = |line: &str| {
        let bits = |text: &str| format!("{:016x}", text.parse::<f64>().unwrap().to_bits());
        line.split(' ').map(bits).collect::<Vec<_>>().join(" ") + "\n"
    };
    let found: String = String::from_utf8_lossy(&output.stdout).lines().map(bits).collect();
    assert_eq!(expected, found, "to the bit");
}

#[test]
fn inputs_have_rates_the_time_is_one_and_a_thread_that_ends_is_answered() {
    if !there_is("cc", "install a C compiler (Debian: apt-get install gcc libc6-dev)") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    install(folder.path());
    let lib = folder.path().join("lib");
    let flags = [format!("-L{}", lib.display()), format!("-Wl,-rpath,{}", lib.display())];
    let program =
        compile_source(folder.path(), "tests/ends.c", "ends", &[&flags[0], &flags[1], "-lcaudal", "-lpthread"]);
    run(Command::new(program).arg(here().join("../../models/driven-head.toml")));
}

#[test]
fn pkg_config_knows_how_to_compile_and_link() {
    if !there_is("pkg-config", "pkg-config") || !there_is("cc", "gcc libc6-dev") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    install(folder.path());
    let flags = run(Command::new("pkg-config")
        .args(["--cflags", "--libs", "caudal"])
        .env("PKG_CONFIG_PATH", folder.path().join("lib/pkgconfig")));
    let flags = String::from_utf8(flags.stdout).unwrap();
    let rpath = format!("-Wl,-rpath,{}", folder.path().join("lib").display());
    let program = folder.path().join("steer");
    run(Command::new("cc")
        .arg(here().join("examples/steer.c"))
        .args(flags.split_whitespace())
        .arg(rpath)
        .arg("-o")
        .arg(&program));
    run(Command::new(program).arg(here().join("../../models/baseline-smooth.toml")));
}

/// The first block of this kind on a page of the guide that starts with `begins`.
fn of_page(page: &str, kind: &str, begins: &str) -> String {
    let page = std::fs::read_to_string(here().join("../../docs/src").join(page)).unwrap();
    let fence = format!("```{kind}\n");
    let blocks = page.split(&fence).skip(1).map(|rest| rest.split("```").next().unwrap());
    blocks.filter(|block| block.starts_with(begins)).map(str::to_string).next().unwrap()
}

#[test]
fn the_program_of_the_page_of_hosts_is_built_and_prints_as_it_says() {
    if !there_is("pkg-config", "pkg-config") || !there_is("cc", "gcc libc6-dev") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let prefix = folder.path().join("installed");
    install(&prefix);
    std::fs::write(folder.path().join("turn.c"), of_page("hosts.md", "c", "")).unwrap();
    let scene = of_page("own-tail.md", "toml", "# silicone-tail.toml");
    std::fs::write(folder.path().join("silicone-tail.toml"), scene).unwrap();
    let session = of_page("hosts.md", "console", "$ cc turn.c").replace("PREFIX", &prefix.display().to_string());
    let (commands, printed): (Vec<&str>, Vec<&str>) = session.lines().partition(|line| line.starts_with("$ "));
    let script = commands.iter().map(|line| line.trim_start_matches("$ ")).collect::<Vec<_>>().join("\n");
    let output = run(Command::new("sh").arg("-euc").arg(script).current_dir(folder.path()));
    assert_eq!(String::from_utf8_lossy(&output.stdout).lines().collect::<Vec<_>>(), printed);
}

#[test]
fn the_cmake_of_the_page_of_hosts_builds_a_host() {
    if !there_is("cmake", "cmake") || !there_is("c++", "g++") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let prefix = folder.path().join("installed");
    install(&prefix);
    std::fs::write(folder.path().join("CMakeLists.txt"), of_page("hosts.md", "cmake", "")).unwrap();
    std::fs::copy(here().join("examples/cmake/surge.cpp"), folder.path().join("host.cpp")).unwrap();
    let command = of_page("hosts.md", "console", "$ cmake").replace("=PREFIX", &format!("={}", prefix.display()));
    run(Command::new("sh").arg("-euc").arg(command.trim_start_matches("$ ")).current_dir(folder.path()));
    run(Command::new(folder.path().join("build/host")).arg(here().join("../../models/heaving-foil.toml")));
}

#[test]
fn cmake_finds_the_package_and_a_cpp_host_keeps_the_momentum() {
    if !there_is("cmake", "cmake") || !there_is("c++", "g++") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    install(folder.path());
    let build = folder.path().join("build");
    run(Command::new("cmake")
        .arg("-S")
        .arg(here().join("examples/cmake"))
        .arg("-B")
        .arg(&build)
        .arg(format!("-DCMAKE_PREFIX_PATH={}", folder.path().display()))
        .args(["-DCMAKE_BUILD_TYPE=Debug", "-DCMAKE_CXX_FLAGS=-Wall -Wextra -Wpedantic -Werror"]));
    run(Command::new("cmake").arg("--build").arg(&build));
    let scene = here().join("../../models/heaving-foil.toml");
    let [shared, still] = ["surge-caudal", "surge-caudal-static"]
        .map(|name| String::from_utf8(run(Command::new(build.join(name)).arg(&scene)).stdout).unwrap());
    assert_eq!(shared, still);
    let last: Vec<f64> = shared.lines().nth(5).unwrap().split(' ').map(|text| text.parse().unwrap()).collect();
    assert!((last[0] - 3.0).abs() < 1e-9 && last[2] < -5e-3, "the foil drives the vehicle ahead: {shared}");
    let lost: f64 = shared.lines().last().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    assert!(lost < 2e-6, "{shared}"); // measured: 4.4e-7
}

#[test]
fn the_example_steers_every_scene_of_the_models() {
    if !there_is("cc", "gcc libc6-dev") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    install(folder.path());
    let lib = folder.path().join("lib");
    let flags = [format!("-L{}", lib.display()), format!("-Wl,-rpath,{}", lib.display())];
    let program = compile(folder.path(), "steer", &[&flags[0], &flags[1], "-lcaudal"]);
    let mut steered = 0;
    for entry in std::fs::read_dir(here().join("../../models")).unwrap() {
        let path = entry.unwrap().path();
        let is_scene = |path: &Path| {
            let toml = path.extension().is_some_and(|extension| extension == "toml");
            toml && !std::fs::read_to_string(path).unwrap().lines().any(|line| line.starts_with("scene ="))
        };
        // The finest meshes would take minutes.
        if is_scene(&path) && Document::read(&path).unwrap().scene().unwrap().rod.nodes.get() <= 2000 {
            run(Command::new(&program).arg(&path));
            steered += 1;
        }
    }
    assert!(steered >= 15, "{steered}");
}

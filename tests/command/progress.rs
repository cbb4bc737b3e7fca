//! Progress of long commands: on a terminal they show what is done, the rate and the time left, and leave nothing of it at their end; elsewhere,
//! and with --quiet, they show nothing.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use crate::digest::root;

/// What a command prints while it works.
enum Shown {
    /// A count of this unit with its rate, and the time left.
    Rate(&'static str),
    /// The time so far: it has one answer, or parts that cannot be compared.
    TimeSoFar,
}

/// Every command that can take long, as it takes seconds at least, and what it shows.
const LONG: [(&str, Shown); 11] = [
    ("run models/eel.toml --set solver.duration_s=1e5 --set record.interval_s=10 --out OUT", Shown::Rate("s/s")),
    (
        "run models/eel.toml --verify --set solver.duration_s=200 --set record.interval_s=1 --out OUT",
        Shown::Rate("for comparison"),
    ),
    ("sweep SWEEP --out OUT", Shown::Rate("cases/")),
    ("design models/design-silicone-eel.toml --out OUT", Shown::Rate("iterations/")),
    ("check models/fine-1e6.toml", Shown::TimeSoFar),
    ("study modes models/eel.toml --set rod.nodes=2001 --out OUT", Shown::TimeSoFar),
    ("study scaling models/eel.toml --nodes 17,33,65,129,257 --steps 3000 --out OUT", Shown::Rate("simulations/")),
    ("study accuracy models/driven-head.toml --out OUT", Shown::Rate("simulations/")),
    ("study fluid models/eel.toml --set solver.duration_s=1000 --out OUT", Shown::Rate("simulations/")),
    ("study stability models/driven-head.toml --points 12 --out OUT", Shown::Rate("simulations/")),
    ("export models/eel.toml --gif --fps 50 --speed 0.05 --out OUT", Shown::Rate("pictures/")),
];

/// Commands that are done at once.
const SHORT: [&str; 8] = ["compare", "fmu", "variables", "new", "schema", "completions", "man", "help"];

/// A command under a pseudo-terminal, whose output comes in pieces.
struct Terminal {
    child: Child,
    pieces: Receiver<String>,
    /// All that came so far.
    output: String,
}

impl Terminal {
    /// `None`, with a word on it, where there is no pseudo-terminal.
    fn of(command: &str, variables: &[(&str, &str)]) -> Option<Self> {
        let version = Command::new("script").arg("--version").output();
        if !version.is_ok_and(|output| output.status.success()) {
            crate::skip::skip("progress on a terminal", "it needs `script` of util-linux");
            return None;
        }
        let mut script = Command::new("script");
        script.current_dir(root()).args(["-qec", command, "/dev/null"]).env("TERM", "xterm").env_remove("NO_COLOR");
        script.envs(variables.iter().copied()).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = script.spawn().unwrap();
        let mut out = child.stdout.take().unwrap();
        let (sender, pieces) = channel();
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = out.read(&mut bytes) {
                let _ = sender.send(String::from_utf8_lossy(&bytes[..count]).into_owned());
            }
        });
        Some(Self { child, pieces, output: String::new() })
    }

    /// Waits until the output has all of these, or the program ended.
    fn wait_for(&mut self, words: &[&str], most: Duration) -> bool {
        let begun = Instant::now();
        while begun.elapsed() < most {
            match self.pieces.recv_timeout(Duration::from_millis(50)) {
                Ok(piece) => self.output += &piece,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            // In one line.
            if self.output.split(['\r', '\n']).any(|line| words.iter().all(|word| line.contains(word))) {
                return true;
            }
        }
        false
    }

    /// Presses Ctrl-C so many times and waits for the end; what is on the screen then.
    fn interrupt(self, times: usize) -> Vec<String> {
        self.interrupt_saying(times, &mut String::new())
    }

    /// The same; `all` gets all that was ever on the screen.
    fn interrupt_saying(mut self, times: usize, all: &mut String) -> Vec<String> {
        for _ in 0..times {
            let _ = self.child.stdin.as_mut().unwrap().write_all(b"\x03"); // it may have ended
            std::thread::sleep(Duration::from_millis(200));
        }
        self.wait_for(&["no such words"], Duration::from_secs(120));
        let _ = self.child.kill();
        let _ = self.child.wait();
        assert!(!self.output.contains('\x1b'), "an escape code: {:?}", self.output);
        all.push_str(&self.output);
        screen(&self.output)
    }
}

/// The lines of a terminal after this output, which returns to the start of its lines and writes over them.
fn screen(output: &str) -> Vec<String> {
    let mut lines = vec![Vec::new()];
    let mut column = 0;
    for letter in output.chars() {
        match letter {
            '\r' => column = 0,
            '\n' => {
                lines.push(Vec::new());
                column = 0;
            }
            letter => {
                let line = lines.last_mut().unwrap();
                line.resize(line.len().max(column + 1), ' ');
                line[column] = letter;
                column += 1;
            }
        }
    }
    lines.into_iter().map(|line| line.into_iter().collect::<String>().trim_end().to_string()).collect()
}

/// Many cases that take a while.
fn sweep(folder: &Path) -> String {
    let path = folder.join("sweep.toml");
    let scene = root().join("models/eel.toml");
    let text = format!(
        "scene = {scene:?}\nrecord.played = 0\n[axes]\nactuation.kappa_amp = {{ from = 1.0, to = 14.0, count = 2000 }}\n"
    );
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_string()
}

fn command(line: &str, folder: &Path) -> String {
    let line = line.replace("SWEEP", &sweep(folder)).replace("OUT", folder.join("out").to_str().unwrap());
    format!("{} {line}", env!("CARGO_BIN_EXE_caudal"))
}

#[test]
fn every_command_either_shows_its_progress_or_is_short() {
    let help = Command::new(env!("CARGO_BIN_EXE_caudal")).arg("--help").output().unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    let commands = help.split("Commands:").nth(1).unwrap().split("Options:").next().unwrap();
    for name in
        commands.lines().filter_map(|line| line.strip_prefix("  ")?.split(' ').next().filter(|name| !name.is_empty()))
    {
        let long = LONG.iter().any(|(line, _)| line.split(' ').next() == Some(name));
        assert!(long != SHORT.contains(&name), "{name}: list it in LONG, with a call that takes seconds, or in SHORT");
    }
}

#[test]
fn a_long_command_on_a_terminal_shows_rate_and_time_left_and_clears_them_at_ctrl_c() {
    let mut wrong = Vec::new();
    for (line, shown) in &LONG {
        let folder = tempfile::tempdir().unwrap();
        let Some(mut terminal) = Terminal::of(&command(line, folder.path()), &[]) else { return };
        let words = match shown {
            Shown::Rate(unit) => vec![*unit, " left", " of ", " %"],
            Shown::TimeSoFar => vec!["so far"],
        };
        if !terminal.wait_for(&words, Duration::from_secs(60)) {
            wrong.push(format!("{line}: {:?}", screen(&terminal.output)));
        }
        let screen = terminal.interrupt(1);
        let is_left = |line: &String| {
            ["█", "░", "seconds left", "minutes left", "seconds so far", "^C"].iter().any(|word| line.contains(word))
        };
        if screen.iter().any(is_left) {
            wrong.push(format!("{line} leaves {screen:?}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn the_cases_of_a_sweep_are_counted_to_the_last() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("few.toml");
    let scene = root().join("models/cantilever.toml");
    let axis = "rod.nodes = [27, 28, 29, 30, 31, 32, 33, 34, 35]";
    std::fs::write(&path, format!("scene = {scene:?}\n[set]\nsolver.duration_s = 200.0\n[axes]\n{axis}\n")).unwrap();
    let line = format!("sweep {} --jobs 1 --out OUT", path.display());
    let Some(terminal) = Terminal::of(&command(&line, folder.path()), &[]) else { return };
    let mut shown = String::new();
    let screen = terminal.interrupt_saying(0, &mut shown);
    let counts = shown.split(" %  ").skip(1).filter_map(|rest| rest.split_once(" of 9 cases")?.0.parse().ok());
    let mut counts: Vec<u32> = counts.collect();
    assert!(counts.is_sorted() && counts.iter().all(|count| *count <= 9), "{counts:?}");
    counts.dedup();
    assert!(counts.len() >= 2, "{counts:?}: {screen:?}");
}

#[test]
fn a_second_ctrl_c_leaves_no_progress_on_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let Some(mut terminal) =
        Terminal::of(&command("design models/design-silicone-eel.toml --out OUT", folder.path()), &[])
    else {
        return;
    };
    assert!(terminal.wait_for(&[" %", " iterations"], Duration::from_secs(60)));
    let screen = terminal.interrupt(2);
    assert!(screen.iter().all(|line| !line.contains(['█', '░'])), "{screen:?}");
}

#[test]
fn the_progress_has_no_escape_codes_and_the_quiet_command_none_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let run = "run models/eel.toml --set solver.duration_s=400 --force --out OUT";
    for (variables, more, shows) in [
        (&[][..], "", true),
        (&[("NO_COLOR", "1")], "", true),
        (&[("TERM", "dumb")], "", false),
        (&[], " --quiet", false),
    ] {
        let Some(mut terminal) = Terminal::of(&command(&format!("{run}{more}"), folder.path()), variables) else {
            return;
        };
        assert_eq!(terminal.wait_for(&[" left"], Duration::from_secs(60)), shows, "{variables:?} {more}");
        let screen = terminal.interrupt(0);
        let said: Vec<_> = screen.iter().filter(|line| !line.is_empty()).collect();
        assert_eq!(
            said.last().map(|line| line.contains("open report.html")),
            (more.is_empty()).then_some(true),
            "{said:?}"
        );
    }
    // Without a terminal.
    let line = command(run, folder.path());
    let output = Command::new("sh").current_dir(root()).args(["-c", &line]).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
    assert!(String::from_utf8_lossy(&output.stdout).lines().last().unwrap().ends_with("open report.html"));
}

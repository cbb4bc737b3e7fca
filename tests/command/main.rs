//! The command: scenes, overrides, folders, sweeps, studies and pages.

#[path = "../common/mod.rs"]
mod common;
#[path = "../common/skip.rs"]
mod skip;

mod check;
mod command;
mod compare;
mod digest;
mod documents;
mod eel;
mod figures;
mod folders;
mod gallery;
mod keeping;
mod messages;
mod overrides;
mod page;
mod pictures;
#[cfg(target_os = "linux")]
mod progress;
mod recorded;
mod reference;
mod results;
mod sampling;
mod scenes;
mod studies;
mod sweep;

/// Presses Ctrl-C for a program.
#[cfg(unix)]
fn interrupt(child: &std::process::Child) {
    // The shell's own `kill`: the program of that name is not on every system.
    let signalled =
        std::process::Command::new("sh").args(["-c", &format!("kill -INT {}", child.id())]).status().unwrap();
    assert!(signalled.success());
}

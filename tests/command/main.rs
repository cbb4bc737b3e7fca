//! The command: scenes, overrides, folders, sweeps, studies and pages.

#[path = "../common/mod.rs"]
mod common;
#[path = "../common/skip.rs"]
mod skip;

mod check;
mod command;
mod folders;
mod keeping;
mod overrides;
mod page;
mod reference;
mod results;
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

/// Whether this system has a font, which pictures need; says what is skipped where it has none.
#[cfg(feature = "pictures")]
fn has_font(what: &str) -> bool {
    use caudal::report::picture::{PictureFormat, SvgRenderer};
    let drawn =
        SvgRenderer::new().bytes("<svg xmlns='http://www.w3.org/2000/svg' width='1' height='1'/>", PictureFormat::Png);
    if let Err(reason) = &drawn {
        assert!(reason.contains("no font"), "{reason}");
        skip::skip(what, reason);
    }
    drawn.is_ok()
}

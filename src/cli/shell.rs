//! `caudal schema`, `caudal completions` and `caudal man`: files for editors and shells.

use std::path::Path;
use std::process::ExitCode;

use caudal::error::{Error, Result};
use caudal::files::write_file;
use caudal::scene::Scene;
use caudal::sweep::Sweep;
use clap::{Command, CommandFactory};
use clap_complete::Shell;

use super::{Cli, print, print_unless_quiet};

/// Prints the JSON Schema of scenes, or of sweeps.
pub fn schema(sweep: bool) -> Result<ExitCode> {
    let schema = match sweep {
        true => Sweep::schema(),
        false => scene(),
    };
    print(&format!("{schema:#}"));
    Ok(ExitCode::SUCCESS)
}

#[cfg(feature = "design")]
fn scene() -> serde_json::Value {
    let mut schema = Scene::schema();
    schema["properties"]["design"] = caudal::design::DesignTable::schema();
    schema
}

#[cfg(not(feature = "design"))]
fn scene() -> serde_json::Value {
    Scene::schema()
}

/// Prints the completion script for `shell`.
pub fn completions(shell: Shell) -> ExitCode {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "caudal", &mut text);
    print(String::from_utf8_lossy(&text).trim_end());
    ExitCode::SUCCESS
}

/// Writes a man page for the command and one for each subcommand to `folder`.
pub fn man(folder: &Path) -> Result<ExitCode> {
    let mut pages = Vec::new();
    collect(Cli::command(), "caudal", &mut pages);
    for (name, command) in &pages {
        let path = folder.join(format!("{name}.1"));
        let mut text = Vec::new();
        let made = clap_mangen::Man::new(command.clone()).title(name).render(&mut text);
        made.map_err(|e| Error::Write { path: path.clone(), reason: e.to_string() })?;
        write_file(&path, text)?;
    }
    print_unless_quiet(&format!("{} pages in {}: man {}/caudal.1", pages.len(), folder.display(), folder.display()));
    Ok(ExitCode::SUCCESS)
}

fn collect(command: Command, name: &str, pages: &mut Vec<(String, Command)>) {
    for part in command.get_subcommands() {
        collect(part.clone(), &format!("{name}-{}", part.get_name()), pages);
    }
    let spoken = name.replace('-', " ");
    pages.push((name.to_string(), command.display_name(spoken.clone()).bin_name(spoken)));
}

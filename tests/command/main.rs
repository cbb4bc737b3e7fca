//! The command: scenes, overrides, folders, sweeps, studies and pages.

#[path = "../common/mod.rs"]
mod common;

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

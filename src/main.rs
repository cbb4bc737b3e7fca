//! The command `caudal`: a thin face over the library.

#![warn(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::todo)]

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}

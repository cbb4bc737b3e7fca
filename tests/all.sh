#!/bin/sh
# Every check there is: formatting, lints, tests, documentation, and what the project may depend on. All of them are run,
# whichever fail; those that did, and what this machine could not run, are listed at the end.
#
#     sh tests/all.sh                   needs Rust, a C compiler and Python; what else it uses comes from PyPI and crates.io
#     sh tests/all.sh --skip-nothing    fails where anything was skipped
set -u
cd "$(dirname "$0")/.." || exit 1
mkdir -p target
CAUDAL_SKIPPED=$PWD/target/skipped.txt
export CAUDAL_SKIPPED
: >"$CAUDAL_SKIPPED"
failed=

# Runs a check; goes on where it fails.
times=
check() {
    printf '\n## %s\n' "$*"
    begin=$(date +%s)
    "$@" || failed="$failed
    $*"
    times="$times
    $(($(date +%s) - begin)) s: $*"
}

skip() {
    echo "SKIPPED $1: $2" >&2
    echo "$1: $2" >>"$CAUDAL_SKIPPED"
}

# Python, with the hosts, checkers and tools that the tests use.
if missing=$(sh tests/hosts.sh); then
    missing=
    PATH="$PWD/target/hosts/bin:$PATH"
else
    skip "all that needs Python" "$missing"
fi

check cargo fmt --all --check
check cargo clippy --workspace --all-targets --locked -- --deny warnings
for features in "" faer report fmu design,parquet cli; do
    check cargo clippy --quiet --no-default-features --features "$features" --locked -- --deny warnings
done
check cargo test --workspace --locked --no-fail-fast
[ -n "$missing" ] || check sh bindings/python/tests/all.sh

# The library of FMUs as it goes into releases: what it needs at run time, and that a host takes it.
portable() {
    sh bindings/fmi/portable.sh &&
        target/debug/caudal fmu models/driven-head.toml --out target/portable.fmu \
            --library "target/$(rustc -vV | sed -n 's/^host: //p')/release/libcaudal_fmi.so" &&
        python -m fmpy simulate target/portable.fmu --stop-time 0.05
}
[ -n "$missing" ] || [ "$(uname -s)" != Linux ] || check portable

RUSTDOCFLAGS="--deny warnings" check cargo doc --workspace --no-deps --locked

# The guide as a book.
PATH="$PATH:$PWD/target/tools/bin"
command -v mdbook >/dev/null ||
    check cargo install --quiet --debug --locked --no-default-features --version 0.5.4 --root target/tools mdbook
check mdbook build docs

# Advisories need a network and are checked by hand before a release.
command -v cargo-deny >/dev/null || check cargo install --quiet --debug --locked --root target/tools --version 0.20.2 cargo-deny
check cargo deny --workspace --all-features check licenses bans sources

printf '\ntook:%s\n' "$times"
if [ -s "$CAUDAL_SKIPPED" ]; then
    printf '\nskipped on this machine:\n'
    sort -u "$CAUDAL_SKIPPED" | sed 's/^/    /'
    [ "${1:-}" != --skip-nothing ] || failed="$failed
    something was skipped"
fi
if [ -n "$failed" ]; then
    printf '\nfailed:%s\n' "$failed"
    exit 1
fi
echo "all checks passed"

#!/bin/sh
# Builds and runs every test, of Rust and of Python, whichever fail; those that did, and what this machine could not run, are listed at
# the end.
#
#     sh tests/all.sh                   needs Rust, a C compiler and Python; what else it uses comes from PyPI and crates.io
#     sh tests/all.sh --skip-nothing    fails where anything was skipped
set -u
cd "$(dirname "$0")/.." || exit 1
mkdir -p target
CAUDAL_SKIPPED=$PWD/target/skipped.txt
export CAUDAL_SKIPPED
: >"$CAUDAL_SKIPPED"
. tests/check.sh

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

check cargo test --workspace --locked --no-fail-fast
[ -n "$missing" ] || check sh bindings/python/tests/all.sh

if [ -s "$CAUDAL_SKIPPED" ]; then
    printf '\nskipped on this machine:\n'
    sort -u "$CAUDAL_SKIPPED" | sed 's/^/    /'
    [ "${1:-}" != --skip-nothing ] || failed="$failed
    something was skipped"
fi
finish

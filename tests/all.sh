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

beside=$PWD/target/beside
rm -f "$beside.times" "$beside.failed"
nice -n 10 sh tests/beside.sh "$beside" >"$beside.txt" 2>&1 &
trap 'trap - INT TERM; kill 0' INT TERM

check cargo fmt --all --check
check cargo clippy --workspace --all-targets --locked -- --deny warnings
check cargo test --workspace --locked --no-fail-fast
[ -n "$missing" ] || check sh bindings/python/tests/all.sh
RUSTDOCFLAGS="--deny warnings" check cargo doc --workspace --no-deps --locked

wait
cat "$beside.txt"
times="$times
  beside them:$(cat "$beside.times")"
failed="$failed$(cat "$beside.failed" || printf '\n    sh tests/beside.sh')"

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

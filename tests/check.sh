# For the scripts that run checks, which source it: runs each of them, whichever fail, and keeps what failed and how long each took.
failed=
times=

check() {
    printf '\n## %s\n' "$*"
    begin=$(date +%s)
    "$@" || failed="$failed
    $*"
    times="$times
    $(($(date +%s) - begin)) s: $*"
}

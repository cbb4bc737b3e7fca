# For the scripts that run checks, which source it: `check` runs a command, whichever failed before it, and keeps what failed and how
# long it took; `finish` shows both and ends the script.
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

finish() {
    printf '\ntook:%s\n' "$times"
    if [ -n "$failed" ]; then
        printf '\nfailed:%s\n' "$failed"
        exit 1
    fi
    echo "all checks passed"
}

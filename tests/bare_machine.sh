#!/bin/sh
# Runs the README's two commands as a new reader would: in a Debian made for this, which has a C compiler, Python, git and this
# machine's Rust toolchain and nothing else, by an ordinary user in a fresh clone of the last commit. For releases: it takes as
# long as both commands from nothing, and as root on a Debian with debootstrap only.
#
#     sh tests/bare_machine.sh [FOLDER]        default target/bare; removed and made anew
#
# Shows the end of each command and how long it took.
set -eu
cd "$(dirname "$0")/.."
bare=$(mkdir -p "${1:-target/bare}" && cd "${1:-target/bare}" && pwd)
leave() {
    umount "$bare/proc" "$bare/dev/shm" "$bare/dev" 2>/dev/null || true
}
trap leave EXIT
leave
rm -rf --one-file-system "$bare"

debootstrap --variant=minbase --include=gcc,libc6-dev,python3,git,ca-certificates \
    "$(. /etc/os-release && echo "$VERSION_CODENAME")" "$bare" >"$bare.log" 2>&1 || { tail "$bare.log"; exit 1; }
mount -t proc proc "$bare/proc"
mount --bind /dev "$bare/dev"
mount -t tmpfs -o mode=1777 tmpfs "$bare/dev/shm"
# How this machine reaches the registries.
cp /etc/resolv.conf /etc/hosts "$bare/etc/"
cp /etc/ssl/certs/ca-certificates.crt "$bare/etc/ssl/certs/"
[ ! -f /etc/pip.conf ] || cp /etc/pip.conf "$bare/etc/"
cp -a "$(rustc --print sysroot)" "$bare/opt/rust"

chroot "$bare" useradd --create-home reader
git clone --quiet . "$bare/home/reader/caudal"
chroot "$bare" chown -R reader: /home/reader

as_reader() {
    chroot --userspec=reader: "$bare" env -i PATH=/opt/rust/bin:/usr/bin:/bin HOME=/home/reader LANG=C.UTF-8 \
        SSL_CERT_FILE=/etc/ssl/certs/ca-certificates.crt ${https_proxy:+"https_proxy=$https_proxy"} \
        sh -c "cd ~/caudal && $1"
}
run() {
    printf '\n$ %s\n' "$1"
    started=$(date +%s)
    ended=0
    as_reader "$1" >"$bare/$2.log" 2>&1 || ended=$?
    tail -n 15 "$bare/$2.log"
    printf 'ended with %s after %s s\n' "$ended" "$(($(date +%s) - started))"
    [ "$ended" = 0 ] || failed=1
}
failed=0
run "cargo run --release -- run models/baseline.toml" first
run "sh tests/all.sh" second
exit "$failed"

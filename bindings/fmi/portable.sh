#!/bin/sh
# The library of FMUs for Linux as it goes into releases: linked against glibc 2.28 (2018: Debian 10, RHEL 8, Ubuntu 18.10 and all
# that came after) by zig's linker, and without libgcc_s. It needs cargo, and python3 with `pip install ziglang`.
#
#     sh bindings/fmi/portable.sh            # target/TRIPLE/release/libcaudal_fmi.so, its symbols checked
#     caudal fmu SCENE --library target/x86_64-unknown-linux-gnu/release/libcaudal_fmi.so
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
baseline=2.28
triple=${1:-$(rustc -vV | sed -n 's/^host: //p')}
case $triple in
*-unknown-linux-gnu) ;;
*) echo "$triple: no target of glibc" >&2; exit 1 ;;
esac
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/linker" <<EOF
#!/bin/sh
exec python3 -m ziglang cc -target ${triple%%-*}-linux-gnu.$baseline "\$@"
EOF
chmod +x "$folder/linker"
variable=CARGO_TARGET_$(echo "$triple" | tr 'a-z-' 'A-Z_')_LINKER
export "$variable=$folder/linker"
cargo build --release --locked --manifest-path "$root/Cargo.toml" -p caudal-fmi --lib --target "$triple"
python3 "$root/bindings/fmi/needs.py" "${CARGO_TARGET_DIR:-$root/target}/$triple/release/libcaudal_fmi.so" $baseline

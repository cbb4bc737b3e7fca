#!/bin/sh
# Installs caudal as a C library: header, shared and static library, and a pkg-config file.
#
#   sh bindings/c/install.sh [PREFIX]        default /usr/local; CAUDAL_PROFILE chooses cargo's profile, default release
set -eu
prefix=${1:-/usr/local}
profile=${CAUDAL_PROFILE:-release}
here=$(cd "$(dirname "$0")" && pwd)
cargo build --locked --manifest-path "$here/Cargo.toml" --profile "$profile"
target=${CARGO_TARGET_DIR:-$here/../../target}/$([ "$profile" = dev ] && echo debug || echo "$profile")
version=$(sed -n '/^\[workspace.package\]/,/^$/s/^version = "\(.*\)"/\1/p' "$here/../../Cargo.toml")

mkdir -p "$prefix/include" "$prefix/lib/pkgconfig"
prefix=$(cd "$prefix" && pwd)
cp "$here/include/caudal.h" "$prefix/include/"
for library in libcaudal.a libcaudal.so libcaudal.dylib; do
    [ ! -f "$target/$library" ] || cp "$target/$library" "$prefix/lib/"
done
cat > "$prefix/lib/pkgconfig/caudal.pc" <<END
prefix=$prefix
libdir=\${prefix}/lib
includedir=\${prefix}/include

Name: caudal
Description: Simulates bio-inspired tails and swimmers
Version: $version
Cflags: -I\${includedir}
Libs: -L\${libdir} -lcaudal
Libs.private: -lm -lpthread -ldl
END
echo "caudal $version is in $prefix"

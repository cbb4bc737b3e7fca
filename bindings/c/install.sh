#!/bin/sh
# Installs caudal as a C library: header, shared and static library, and what pkg-config and CMake look for.
#
#   sh bindings/c/install.sh [PREFIX]        default /usr/local; CAUDAL_PROFILE chooses cargo's profile, default release
set -eu
prefix=${1:-/usr/local}
profile=${CAUDAL_PROFILE:-release}
here=$(cd "$(dirname "$0")" && pwd)
cargo build --locked --manifest-path "$here/Cargo.toml" --profile "$profile"
target=${CARGO_TARGET_DIR:-$here/../../target}/$([ "$profile" = dev ] && echo debug || echo "$profile")
version=$(sed -n '/^\[workspace.package\]/,/^$/s/^version = "\(.*\)"/\1/p' "$here/../../Cargo.toml")

mkdir -p "$prefix/include" "$prefix/lib/pkgconfig" "$prefix/lib/cmake/caudal"
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

# The package of `find_package(caudal)`: targets caudal::caudal and caudal::caudal-static, found beside this very file.
cat > "$prefix/lib/cmake/caudal/caudalConfig.cmake" <<'END'
get_filename_component(_caudal "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
include(CMakeFindDependencyMacro)
find_dependency(Threads)
if(NOT TARGET caudal::caudal)
    add_library(caudal::caudal SHARED IMPORTED)
    set_target_properties(caudal::caudal PROPERTIES
        IMPORTED_LOCATION "${_caudal}/lib/${CMAKE_SHARED_LIBRARY_PREFIX}caudal${CMAKE_SHARED_LIBRARY_SUFFIX}"
        IMPORTED_NO_SONAME TRUE
        INTERFACE_INCLUDE_DIRECTORIES "${_caudal}/include")
    add_library(caudal::caudal-static STATIC IMPORTED)
    set_target_properties(caudal::caudal-static PROPERTIES
        IMPORTED_LOCATION "${_caudal}/lib/${CMAKE_STATIC_LIBRARY_PREFIX}caudal${CMAKE_STATIC_LIBRARY_SUFFIX}"
        INTERFACE_INCLUDE_DIRECTORIES "${_caudal}/include"
        INTERFACE_LINK_LIBRARIES "Threads::Threads;${CMAKE_DL_LIBS};m")
endif()
unset(_caudal)
END
cat > "$prefix/lib/cmake/caudal/caudalConfigVersion.cmake" <<END
set(PACKAGE_VERSION $version)
if(PACKAGE_FIND_VERSION VERSION_LESS_EQUAL PACKAGE_VERSION)
    # Before 1.0 a minor version may break what the last one had.
    string(REGEX MATCH "^[0-9]+\\.[0-9]+" _caudal_asked "\${PACKAGE_FIND_VERSION}.0")
    if(PACKAGE_VERSION MATCHES "^\${_caudal_asked}\\.")
        set(PACKAGE_VERSION_COMPATIBLE TRUE)
    endif()
    unset(_caudal_asked)
    if(PACKAGE_FIND_VERSION VERSION_EQUAL PACKAGE_VERSION)
        set(PACKAGE_VERSION_EXACT TRUE)
    endif()
endif()
END
echo "caudal $version is in $prefix"

#!/bin/sh
# Installs the Python package beside the FMU hosts in target/hosts, and runs the tests of the Python package and of the
# examples of co-simulation. Where Python or a package is missing it says what was skipped; with
# CAUDAL_HOSTS=required it fails.
set -eu
cd "$(dirname "$0")/../../.."
python=target/hosts/bin/python

skip() {
    echo "SKIPPED: the Python package was not tested: $1" >&2
    [ "${CAUDAL_HOSTS:-}" != required ]
    exit
}

[ -x "$python" ] || python3 -m venv target/hosts || skip "install Python 3 with its venv module"
"$python" -m pip install --quiet -r bindings/fmi/tests/requirements.txt -r bindings/python/tests/requirements.txt \
    -r bindings/fmi/examples/requirements.txt ||
    skip "the packages of these requirements.txt must be within reach of pip"

CAUDAL_PROFILE=dev "$python" -m pip install --quiet --no-deps --force-reinstall ./bindings/python
CAUDAL_COMMAND="$PWD/target/debug/caudal" "$python" -m pytest --quiet -p no:cacheprovider \
    bindings/python/tests bindings/python/examples bindings/fmi/examples

#!/bin/sh
# Installs the Python package beside the FMU hosts in target/hosts, and runs the tests of the Python package and of the
# examples of co-simulation, in two processes: many of them wait.
set -eu
cd "$(dirname "$0")/../../.."
sh tests/hosts.sh
python=target/hosts/bin/python
CAUDAL_PROFILE=dev "$python" -m pip install --quiet --no-deps --force-reinstall ./bindings/python
CAUDAL_COMMAND="$PWD/target/debug/caudal" "$python" -m pytest --quiet -p no:cacheprovider --numprocesses 2 --dist worksteal --durations 15 \
    bindings/python/tests bindings/python/examples bindings/fmi/examples

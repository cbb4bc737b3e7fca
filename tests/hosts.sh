#!/bin/sh
# Makes target/hosts: a virtual environment of Python with the hosts and checkers of FMUs, the tools and the packages that
# the tests need, all from PyPI and without root rights. Does nothing where it is there and up to date; else it says what is
# missing and ends with 1.
set -eu
cd "$(dirname "$0")/.."
folder=target/hosts
requirements="bindings/fmi/tests/requirements.txt bindings/python/tests/requirements.txt bindings/fmi/examples/requirements.txt"
wanted=$(cat $requirements)
[ "$(cat $folder/requirements.txt 2>/dev/null)" != "$wanted" ] || exit 0

command -v python3 >/dev/null || { echo "install Python 3.11 or later (Debian: apt-get install python3)"; exit 1; }
mkdir -p target
# One at a time: tests ask for the environment too.
exec 9>target/hosts.lock
! command -v flock >/dev/null || flock 9
[ "$(cat $folder/requirements.txt 2>/dev/null)" != "$wanted" ] || exit 0

if [ ! -x $folder/bin/pip ]; then
    rm -rf $folder
    python3 -m venv $folder >/dev/null 2>&1 || {
        # Debian's python3 comes without the pip that venv installs: it is taken from PyPI.
        rm -rf $folder
        python3 -m venv --without-pip $folder || { echo "python3 has no module venv"; exit 1; }
        $folder/bin/python - <<'END'
import hashlib, json, subprocess, sys, tempfile, urllib.parse, urllib.request
from pathlib import Path

index = "https://pypi.org/simple/pip/"
request = urllib.request.Request(index, headers={"Accept": "application/vnd.pypi.simple.v1+json"})
with urllib.request.urlopen(request, timeout=60) as answer:
    files = json.load(answer)["files"]
wheel = next(file for file in files if file["filename"] == "pip-26.3-py3-none-any.whl")
with urllib.request.urlopen(urllib.parse.urljoin(index, wheel["url"]), timeout=60) as answer:
    content = answer.read()
if hashlib.sha256(content).hexdigest() != wheel["hashes"]["sha256"]:
    sys.exit(f"{wheel['filename']} is not what PyPI says it is")
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder, wheel["filename"])
    path.write_bytes(content)
    subprocess.run([sys.executable, f"{path}/pip", "install", "--quiet", "--no-index", str(path)], check=True)
END
    } || { echo "pip could not be installed: PyPI must be within reach"; exit 1; }
fi
$folder/bin/python -m pip install --quiet $(printf -- "-r %s " $requirements) || {
    echo "the packages of $requirements must be within reach of pip"
    exit 1
}
printf '%s\n' "$wanted" >$folder/requirements.txt

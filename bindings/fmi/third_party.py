"""Writes THIRD-PARTY.txt, which goes into every FMU: the crates that its library is linked from and the font of its
figures, their licences and notices.

    python3 bindings/fmi/third_party.py        # after a change of dependencies; it fetches what is not there

Crates are those of the library by itself and of the library as it is built beside the command, whose features it then has, on
Linux, macOS and Windows; macros apart, which stay behind in the compiler. Of a choice of licences with MIT in it MIT is taken.
Each text stands there once, after the copyright notices of all crates that come with it.
"""

import json
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
TARGETS = ["x86_64-unknown-linux-gnu", "aarch64-apple-darwin", "x86_64-pc-windows-msvc"]


def crates():
    """Name and version of every linked crate but our own."""
    command = ["cargo", "tree", "--locked", "-p", "caudal", "-p", "caudal-fmi", "-e", "normal,no-proc-macro"]
    found = set()
    for target in TARGETS:
        options = ["--target", target, "--prefix", "none", "--no-dedupe"]
        tree = subprocess.run([*command, *options], cwd=ROOT, check=True, capture_output=True, text=True).stdout
        found |= {tuple(line.split()[:2]) for line in tree.splitlines() if line}
    return sorted((name, version.removeprefix("v")) for name, version in found if not name.startswith("caudal"))


def licence_files(folder: Path):
    """The files with a crate's licence: of several that of MIT."""
    files = sorted(file for file in folder.iterdir() if re.match(r"(?i)(licen[cs]e|copying|unlicense)", file.name) and file.is_file())
    mit = [file for file in files if "MIT" in file.name.upper()]
    return mit or files


def main() -> None:
    metadata = subprocess.run(
        ["cargo", "metadata", "--locked", "--format-version", "1"], cwd=ROOT, check=True, capture_output=True, text=True
    )
    packages = {(package["name"], package["version"]): package for package in json.loads(metadata.stdout)["packages"]}
    listed, texts = [], {}
    for name, version in crates():
        package = packages[name, version]
        listed.append(f"{name} {version}: {package['license']}")
        files = licence_files(Path(package["manifest_path"]).parent)
        if not files:
            # Some crates name their licence only; their authors are those of Cargo.toml.
            named = f"(The crates above name this licence and bring no text: {package['license']})"
            texts.setdefault(named, (named, []))[1].append((f"{name} {version}", package["authors"]))
        for file in files:
            lines = file.read_text(errors="replace").replace("\r", "").splitlines()
            notices = [line.strip() for line in lines if re.match(r"\s*(Portions )?Copyright\b.*(\d{4}|\([cC]\)|©)", line)]
            body = "\n".join(line.rstrip() for line in lines if line.strip() not in notices).strip()
            key = re.sub(r"\W+", "", body).lower()
            texts.setdefault(key, (body, []))[1].append((f"{name} {version}", notices))
    parts = ["Libraries of other authors that are linked into caudal's library of FMUs.\n\n" + "\n".join(listed)]
    for body, entries in texts.values():
        notices = [f"{crate}: {'; '.join(notices) or 'no notice of its own'}" for crate, notices in entries]
        parts.append("\n".join(notices) + "\n\n" + body)
    parts.append((ROOT / "src/report/fonts/LICENSE-DejaVu.txt").read_text().strip())
    (ROOT / "THIRD-PARTY.txt").write_text(f"\n\n{'=' * 100}\n\n".join(parts) + "\n")


if __name__ == "__main__":
    main()

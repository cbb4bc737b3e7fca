"""What a run, a sweep and a design cost beside their steps, as processor time and memory of the command, as tables in Markdown.

    python3 benches/costs.py [COMMAND ...] [--only run,fluids,cases,design]

Each COMMAND is an executable (by default target/release/caudal); with two, as before and after a change, each cell has both. Times
are user and system time of the fastest of three runs, or of one where that takes seconds. They change by some percent from run to run,
memory does not.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MODELS = ROOT / "models"
# Repeated only where a run takes less, s.
SHORT = 2.0
# Characters of a summary with all its numbers, before the positions of the nodes.
HEAD = 20_000


def cost(command, arguments, folder, codes=(0,)):
    """Processor time (s) and peak memory (MB) of the command, or None if it ends with none of the codes."""
    best, peak = float("inf"), 0.0
    for _ in range(3):
        with open(Path(folder) / "log", "w") as log:
            process = subprocess.Popen([command, "--quiet", *map(str, arguments)], stdout=log, stderr=log, cwd=folder)
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in codes:
            return None
        best = min(best, usage.ru_utime + usage.ru_stime)
        peak = max(peak, usage.ru_maxrss / 1024)
        if best > SHORT:
            break
    return best, peak


def sets(keys):
    return [argument for key, value in keys.items() for argument in ("--set", f"{key}={value}")]


def run(command, scene, keys, folder):
    return cost(command, ["run", MODELS / scene, *sets(keys), "--force", "--out", Path(folder) / "out"], folder)


def table(title, header, rows):
    print(f"\n{title}\n\n| {' | '.join(header)} |\n|{'---|' * len(header)}")
    for row in rows:
        print(f"| {' | '.join(row)} |", flush=True)
    print(flush=True)


def digits(value):
    return f"{value:.2f}" if value >= 0.1 else f"{value:.3f}"


def each(commands, measure, show):
    """The cells of a column: one for each command, or both in one."""
    found = [measure(command) for command in commands]
    return " → ".join("fails" if one is None else show(one) for one in found)


def runs(commands, folder):
    """Two steps of models/fine-1e6.toml: the whole run, over its iterations as ten more steps tell what one takes."""

    def measure(nodes):
        def of(command):
            found = []
            for steps in (2, 12):
                keys = {"rod.nodes": nodes, "solver.duration_s": 1e-3 * steps}
                seconds, memory = run(command, "fine-1e6.toml", keys, folder)
                # Not all positions: a command's peak memory counts from that of this process.
                with open(Path(folder) / "out/summary.json") as summary:
                    iterations = int(re.search(r'"newton_iterations": (\d+)', summary.read(HEAD)).group(1))
                found.append((seconds, iterations, memory))
            (two, iterations, memory), (twelve, all_iterations, _) = found
            return two, iterations * (twelve - two) / (all_iterations - iterations), memory

        return of

    rows = []
    for nodes in (9, 129, 1001, 10_001, 100_001, 1_000_001):
        show = lambda one: f"{digits(one[0])} s, {one[0] / max(one[1], 1e-9):.2f} times, {one[2]:.0f} MB"
        rows.append([str(nodes), each(commands, measure(nodes), show)])
    table("Two steps: the run, over its steps, memory", ["N", "run"], rows)


def fluids(commands, folder):
    """One step of models/cantilever.toml in fluids of several viscosities."""
    rows = []
    for nodes in (33, 257, 1001, 4001):
        keys = {"rod.nodes": nodes, "solver.duration_s": 2e-3}

        def of(command):
            found = [
                run(command, "cantilever.toml", keys | {"medium.viscosity_pa_s": viscosity}, folder)
                for viscosity in (1e-3, 5.0, 500.0)
            ]
            times = [one[0] for one in found]
            return times, max(times) / min(times), max(one[1] for one in found)

        show = lambda one: f"{', '.join(map(digits, one[0]))} s, {one[1]:.2f} times, {one[2]:.0f} MB"
        rows.append([str(nodes), each(commands, of, show)])
    table("One step in water, oil and syrup: most over least, memory", ["N", "run"], rows)


def sweep(command, scene, cases, keys, folder):
    """Processor time of a sweep, s, and the size of its report, MB."""
    path = Path(folder) / "sweep.toml"
    lines = "\n".join(f"{key} = {value}" for key, value in keys.items())
    levels = [0.5 + i / cases for i in range(cases)]
    path.write_text(f'scene = "{MODELS / scene}"\n[set]\n{lines}\n[axes]\nactuation.frequency_hz = {levels}\n')
    out = Path(folder) / f"sweep-{cases}"
    found = cost(command, ["sweep", path, "--jobs", 1, "--force", "--out", out, "--restart"], folder)
    found = found or cost(command, ["sweep", path, "--jobs", 1, "--force", "--out", out], folder)
    return found and (*found, (out / "report.html").stat().st_size / 1e6)


def cases(commands, folder):
    """Sweeps of two steps a case, and of many cases."""
    show = lambda one: f"{digits(one[0])} s, {one[1]:.0f} MB, report {one[2]:.1f} MB"
    rows = []
    for count, nodes, steps in (
        (20, 33, 2),
        (20, 1001, 2),
        (20, 10_001, 2),
        (10, 9, 20),
        (100, 9, 20),
        (1000, 9, 20),
        (10_000, 9, 20),
    ):
        keys = {"rod.nodes": nodes, "solver.time_step_s": 1e-3, "solver.duration_s": 1e-3 * steps}
        of = lambda command: sweep(command, "baseline-smooth.toml", count, keys, folder)
        rows.append([str(count), str(nodes), str(steps), each(commands, of, show)])
    table("Sweeps on one thread", ["cases", "N", "steps", "sweep"], rows)


def design(commands, folder):
    """Designs of models/design-tip.toml from one start: six iterations at most."""
    rows = []
    for nodes in (17, 65, 257):
        for knots in (5, 31):
            if knots > nodes:
                continue
            keys = {
                "rod.nodes": nodes,
                "design.knots": [round(i / (knots - 1), 6) for i in range(knots)],
                "design.starts": 1,
                "design.iterations": 6,
                "design.data": f'"{MODELS / "design-tip.csv"}"',
            }
            out = Path(folder) / "design"

            def of(command):
                # A search that is cut off ends with 1.
                arguments = ["design", MODELS / "design-tip.toml", *sets(keys), "--force", "--out", out]
                found = cost(command, arguments, folder, codes=(0, 1))
                if found is None:
                    print((Path(folder) / "log").read_text(), file=sys.stderr)
                    return None
                iterations = len(json.loads((out / "design.json").read_text())["answer"]["history"])
                return found[0], iterations, found[0] / iterations

            show = lambda one: f"{digits(one[0])} s, {one[1]} iterations, {digits(one[2])} s each"
            rows.append([str(nodes), str(knots), each(commands, of, show)])
    table("Designs of a tip", ["N", "knots", "design"], rows)


PARTS = {"run": runs, "fluids": fluids, "cases": cases, "design": design}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commands", nargs="*", default=[ROOT / "target/release/caudal"])
    parser.add_argument("--only", default=",".join(PARTS))
    arguments = parser.parse_args()
    commands = [str(Path(command).resolve()) for command in arguments.commands]
    with tempfile.TemporaryDirectory() as folder:
        for part in arguments.only.split(","):
            PARTS[part](commands, folder)


if __name__ == "__main__":
    main()

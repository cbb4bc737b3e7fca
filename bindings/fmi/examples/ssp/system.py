"""Systems of tails behind a vehicle as SSP files, and two hosts that run them: FMPy and ecos.

`write` joins FMUs to one file by their variables; the vehicle is body.py, the tails are FMUs of ../vehicle/tail.toml. Either
host exchanges all values at once, after every step (Jacobi), the pose and rates as they are then: `head.input = "now"`.

    python system.py tail.fmu mirrored.fmu              # the tail, and the same with -kappa_amp; needs FMPy, ecospy, tbb and pythonfmu
"""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

HERE = Path(__file__).parent
#: What a tail takes from a joint of the vehicle, and what it gives back: names there and here.
POSE = ["x_m", "y_m", "angle_rad", "vx_m_s", "vy_m_s", "spin_rad_s"]
FORCES = ["force_x_n", "force_y_n", "moment_n_m"]


def build_body(folder: Path) -> Path:
    """The vehicle's FMU."""
    vehicle = HERE.parent / "vehicle"
    command = [sys.executable, "-m", "pythonfmu", "build", "-f", HERE / "body.py", "-d", folder, vehicle / "vehicle.py"]
    environment = {**os.environ, "PYTHONPATH": str(vehicle)}
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
    return folder / "Body.fmu"


def write(path: Path, body: Path, tails: dict[str, Path]) -> None:
    """Writes a system of the body and tails, by the names of its joints where they are held."""

    def component(name, source, connectors):
        lines = "".join(
            f'<ssd:Connector name="{connector}" kind="{kind}"><ssc:Real/></ssd:Connector>' for connector, kind in connectors
        )
        return (
            f'<ssd:Component name="{name}" type="application/x-fmu-sharedlibrary" source="resources/{source}">'
            f"<ssd:Connectors>{lines}</ssd:Connectors></ssd:Component>"
        )

    ports = [(name, "output") for name in POSE]
    joins = []
    parts = []
    for joint in tails:
        ports += [(f"{joint}_{name}", "output") for name in POSE] + [(f"{joint}_{name}", "input") for name in FORCES]
        tail = f"{joint}_tail"
        own = [(f"head_{name}", "input") for name in POSE] + [(f"head_{name}", "output") for name in FORCES]
        parts.append(component(tail, f"{joint}.fmu", own))
        joins += [("body", f"{joint}_{name}", tail, f"head_{name}") for name in POSE]
        joins += [(tail, f"head_{name}", "body", f"{joint}_{name}") for name in FORCES]
    connections = "".join(
        f'<ssd:Connection startElement="{a}" startConnector="{b}" endElement="{c}" endConnector="{d}"/>' for a, b, c, d in joins
    )
    text = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" '
        'xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" version="1.0" name="swimmer">'
        f'<ssd:System name="swimmer"><ssd:Elements>{component("body", "body.fmu", ports)}{"".join(parts)}</ssd:Elements>'
        f"<ssd:Connections>{connections}</ssd:Connections></ssd:System></ssd:SystemStructureDescription>\n"
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", text)
        archive.write(body, "resources/body.fmu")
        for joint, fmu in tails.items():
            archive.write(fmu, f"resources/{joint}.fmu")


def with_fmpy(path: Path, step: float, count: int):
    """Rows of the body's pose after each step."""
    from fmpy.ssp.simulation import simulate_ssp

    result = simulate_ssp(str(path), stop_time=(count - 0.5) * step, step_size=step)
    return [[float(row[f"body.{name}"]) for name in POSE] for row in result]


def with_ecos(path: Path, step: float, count: int):
    """The same."""
    from ecos_host import EcosSimulation

    rows = []
    with EcosSimulation(step_size=step, ssp_path=str(path)) as simulation:
        simulation.init()
        for _ in range(count):
            simulation.step()
            rows.append([simulation.get_real(f"body::{name}") for name in POSE])
    return rows


def main(tail: str, mirrored: str) -> None:
    """Runs one tail and two in both hosts."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        body = build_body(folder)
        for title, tails in [("one tail", {"stern": tail}), ("two tails", {"port": tail, "starboard": mirrored})]:
            path = folder / "swimmer.ssp"
            write(path, body, tails)
            for host in (with_fmpy, with_ecos):
                x, y, angle, *_ = host(path, 4e-3, 500)[-1]
                print(f"{title}, {host.__name__}: after 2 s at {x:.5f} m, {y:.5f} m, turned by {angle:.5f} rad")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(f"usage: {sys.argv[0]} tail.fmu mirrored.fmu")
    main(*sys.argv[1:])

"""Systems of tails behind a vehicle as SSP files, and two hosts that run them: FMPy and ecos.

`write` joins FMUs to one file by their variables; the vehicle is body.py, the tails are FMUs of ../vehicle/tail.toml. `write_loop`
closes the loop of controller.py around a tail with a hinged head. Either host exchanges all values at
once, after every step (Jacobi), the pose and rates as they are then: `head.input = "now"`.

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


def build(script: str, folder: Path, *files: Path) -> Path:
    """The FMU of a script beside this one, with the files that it needs."""
    command = [sys.executable, "-m", "pythonfmu", "build", "-f", HERE / script, "-d", folder, *files]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(str(file.parent) for file in files)}
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
    return folder / f"{Path(script).stem.capitalize()}.fmu"


def build_body(folder: Path) -> Path:
    """The vehicle's FMU."""
    return build("body.py", folder, HERE.parent / "vehicle/vehicle.py")


def write(path: Path, parts: dict[str, Path], joins: list[tuple[str, str, str, str]], shown: dict[str, list[str]]) -> None:
    """Writes a system of FMUs by their names, with its connections, part and output to part and input, and outputs that are shown."""
    connectors = {name: [(output, "output") for output in shown.get(name, [])] for name in parts}
    for a, b, c, d in joins:
        if b not in shown.get(a, []):
            connectors[a].append((b, "output"))
        connectors[c].append((d, "input"))

    def component(name):
        lines = "".join(
            f'<ssd:Connector name="{connector}" kind="{kind}"><ssc:Real/></ssd:Connector>' for connector, kind in connectors[name]
        )
        return (
            f'<ssd:Component name="{name}" type="application/x-fmu-sharedlibrary" source="resources/{name}.fmu">'
            f"<ssd:Connectors>{lines}</ssd:Connectors></ssd:Component>"
        )

    connections = "".join(
        f'<ssd:Connection startElement="{a}" startConnector="{b}" endElement="{c}" endConnector="{d}"/>' for a, b, c, d in joins
    )
    text = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" '
        'xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" version="1.0" name="swimmer">'
        f'<ssd:System name="swimmer"><ssd:Elements>{"".join(map(component, parts))}</ssd:Elements>'
        f"<ssd:Connections>{connections}</ssd:Connections></ssd:System></ssd:SystemStructureDescription>\n"
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", text)
        for name, fmu in parts.items():
            archive.write(fmu, f"resources/{name}.fmu")


def write_swimmer(path: Path, body: Path, tails: dict[str, Path]) -> None:
    """Writes a system of the body and tails, by the names of its joints where they are held."""
    joins = []
    for joint in tails:
        tail = f"{joint}_tail"
        joins += [("body", f"{joint}_{name}", tail, f"head_{name}") for name in POSE]
        joins += [(tail, f"head_{name}", "body", f"{joint}_{name}") for name in FORCES]
    write(path, {"body": body} | {f"{joint}_tail": fmu for joint, fmu in tails.items()}, joins, {"body": POSE})


def write_loop(path: Path, controller: Path, tail: Path) -> None:
    """Writes a system of a controller and the tail whose hinged head it turns."""
    joins = [("tail", f"hinge_{name}", "controller", name) for name in ("angle_rad", "spin_rad_s")]
    joins.append(("controller", "torque_n_m", "tail", "hinge_added_torque_n_m"))
    write(path, {"controller": controller, "tail": tail}, joins, {"tail": ["hinge_angle_rad"]})


def with_fmpy(path: Path, step: float, count: int, part: str = "body", outputs: list[str] = POSE):
    """Rows of the outputs of a part after each step, by default of the body's pose."""
    from fmpy.ssp.simulation import simulate_ssp

    result = simulate_ssp(str(path), stop_time=(count - 0.5) * step, step_size=step)
    return [[float(row[f"{part}.{name}"]) for name in outputs] for row in result]


def with_ecos(path: Path, step: float, count: int, part: str = "body", outputs: list[str] = POSE):
    """The same."""
    from ecos_host import EcosSimulation

    rows = []
    with EcosSimulation(step_size=step, ssp_path=str(path)) as simulation:
        simulation.init()
        for _ in range(count):
            simulation.step()
            rows.append([simulation.get_real(f"{part}::{name}") for name in outputs])
    return rows


def main(tail: str, mirrored: str) -> None:
    """Runs one tail and two in both hosts."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        body = build_body(folder)
        for title, tails in [("one tail", {"stern": tail}), ("two tails", {"port": tail, "starboard": mirrored})]:
            path = folder / "swimmer.ssp"
            write_swimmer(path, body, tails)
            for host in (with_fmpy, with_ecos):
                x, y, angle, *_ = host(path, 4e-3, 500)[-1]
                print(f"{title}, {host.__name__}: after 2 s at {x:.5f} m, {y:.5f} m, turned by {angle:.5f} rad")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(f"usage: {sys.argv[0]} tail.fmu mirrored.fmu")
    main(*sys.argv[1:])

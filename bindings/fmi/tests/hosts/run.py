"""Drives FMUs by one of the hosts and checkers that people use. Arguments: its name in HOSTS, and a folder.

The folder holds NAME-2.fmu and NAME-3.fmu; expected.json has for each NAME the step, the tip's y after each of a number
of steps, and for one of them the same with another number of nodes. Everything is compared to the bit. Ends with 77 where the host cannot
be loaded on this machine.
"""

import importlib
import json
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import fmpy
from fmpy import read_model_description, simulate_fmu
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from lxml import etree

sys.path.append(str(Path(__file__).parents[2] / "examples/ssp"))  # ecos_host
folder = Path(sys.argv[2])
expected = json.loads((folder / "expected.json").read_text())
failures = []


def check(what, good, detail=""):
    print(("ok    " if good else "FAIL  ") + what + (f": {detail}" if detail and not good else ""))
    if not good:
        failures.append(what)


def fmpy_host(name, scene):
    fmpy_steps(name, scene)
    fmpy_terminals(name)
    if "other_nodes" in scene:
        fmpy_nodes(name, scene)


def fmpy_steps(name, scene):
    step, tips = scene["step"], scene["tip_y_m"]
    for version in (2, 3):
        fmu = str(folder / f"{name}-{version}.fmu")
        problems = validate_fmu(fmu)
        check(f"FMPy finds nothing wrong with {name}, FMI {version}", not problems, problems)
        messages = []
        result = simulate_fmu(
            fmu, stop_time=step * len(tips), output_interval=step, output=["tip_y_m"],
            logger=lambda *arguments: messages.append(arguments),
        )
        check(f"FMPy steps {name}, FMI {version}, to the bit", list(result["tip_y_m"][1:]) == tips)
        check(f"{name}, FMI {version}, is quiet", not messages, messages)


def fmpy_terminals(name):
    """FMPy brings the standard's schema of terminals and icons, and does not use it by itself."""
    schema = etree.XMLSchema(etree.parse(Path(fmpy.__file__).with_name("schema") / "fmi3/fmi3TerminalsAndIcons.xsd"))
    with zipfile.ZipFile(folder / f"{name}-3.fmu") as archive:
        valid = schema.validate(etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml")))
    check(f"the terminals of {name} are valid", valid, schema.error_log)


def fmpy_nodes(name, scene):
    """The structural parameter through FMPy's low-level API."""
    fmu = str(folder / f"{name}-3.fmu")
    description = read_model_description(fmu)
    references = {variable.name: variable.valueReference for variable in description.modelVariables}
    slave = FMU3Slave(
        guid=description.guid, unzipDirectory=fmpy.extract(fmu),
        modelIdentifier=description.coSimulation.modelIdentifier, instanceName="nodes",
    )
    nodes = scene["other_nodes"]
    slave.instantiate()
    slave.enterConfigurationMode()
    slave.setUInt64([references["nodes"]], [nodes])
    slave.exitConfigurationMode()
    slave.enterInitializationMode(startTime=0)
    slave.exitInitializationMode()
    heights, time = [], 0.0
    for _ in scene["other_y_m"]:
        slave.doStep(currentCommunicationPoint=time, communicationStepSize=scene["step"])
        time += scene["step"]
        heights.append(list(slave.getFloat64([references["y_m"]], nValues=nodes)))
    slave.terminate()
    slave.freeInstance()
    check(f"FMPy sets {nodes} nodes", heights == scene["other_y_m"])


def fmutool(name, scene):
    for version in (2, 3):
        run = subprocess.run(
            [Path(sys.executable).with_name("fmutool"), "-input", folder / f"{name}-{version}.fmu", "-check"],
            capture_output=True, text=True,
        )
        text = run.stdout + run.stderr
        good = run.returncode == 0 and "seems to be compliant" in text and "No semantic error" in text
        check(f"fmutool finds {name}, FMI {version}, compliant", good, text)


def ecos(name, scene):
    from ecos_host import EcosSimulation, EcosSimulationStructure

    for version in (2, 3):
        structure = EcosSimulationStructure()
        structure.add_model("tail", str(folder / f"{name}-{version}.fmu"))
        with EcosSimulation(step_size=scene["step"], structure=structure) as simulation:
            simulation.init()
            tips = []
            for _ in scene["tip_y_m"]:
                simulation.step()
                tips.append(simulation.get_real("tail::tip_y_m"))
        check(f"ecos steps {name}, FMI {version}, to the bit", tips == scene["tip_y_m"])


def cosim(name, scene):
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    step = scene["step"]
    description = read_model_description(str(folder / f"{name}-2.fmu"))
    tip = next(v.valueReference for v in description.modelVariables if v.name == "tip_y_m")
    execution = CosimExecution.from_step_size(step_size=round(step * 1e9))
    slave = execution.add_local_slave(CosimLocalSlave(fmu_path=str(folder / f"{name}-2.fmu"), instance_name="tail"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer=observer)
    tips = []
    for _ in scene["tip_y_m"]:
        execution.step()
        tips.append(observer.last_real_values(slave_index=slave, variable_references=[tip])[0])
    check(f"libcosim steps {name} to the bit", tips == scene["tip_y_m"])


#: What drives each host, and the module that loads its library.
HOSTS = {
    "fmpy": (fmpy_host, "fmpy"),
    "fmutool": (fmutool, "fmu_manipulation_toolbox"),
    "ecos": (ecos, "ecos_host"),
    "libcosim": (cosim, "libcosimpy.CosimExecution"),
}

host, module = HOSTS[sys.argv[1]]
try:
    importlib.import_module(module)
except (ImportError, OSError) as error:
    print(error)
    sys.exit(77)
for name, scene in expected.items():
    host(name, scene)
print(f"{len(failures)} failures")
sys.exit(bool(failures))

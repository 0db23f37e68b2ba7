"""Own code against libraries: lines of each piece, and what a library costs to have and to import.

    python benchmarks/bench_own_code.py [--python INTERPRETER] [--json]

Lines are all lines of the piece's files. A library is measured where ``--python`` has it (one of a
venv beside, since most were weighed and left out): megabytes on the disk, milliseconds of processor
and megabytes of memory for its import, the least of three processes. A picture of featuretype,
480 x 360 px, is ray cast for comparison with what a renderer's first picture takes. For
docs/adr/own-code.md.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PIECES = {
    "disk cache": ["controller/cache"],
    "YAML with lines": [
        "controller/yaml_text.py",
        "controller/config/*yaml*.py",
        "controller/cad/reading/*csg_text.py",
    ],
    "mesh files": ["controller/cad/reading/meshes"],
    "imaging": ["controller/imaging"],
    "calibration": ["controller/commissioning/calibration"],
    "siting": ["controller/commissioning/siting"],
    "journal": ["controller/cell/journal"],
    "state machine": ["controller/cell/machine/machine.py", "controller/cell/machine/table.py"],
    "plan page and part sheet": ["controller/results/plan_page", "controller/results/sheet"],
    "arm driver": ["drivers/umi_scara"],
    "Robotiq driver": ["drivers/gripper_modbus"],
    "Modbus link": ["drivers/modbus_link"],
    "V4L2 capture": ["drivers/camera_v4l2"],
    "shared clock": ["drivers/clock.py", "drivers/*shared_time.py", "emulators/clock.py"],
    "FUSE server": ["emulators/camera_v4l2/wires/*fuse*.py"],
    "V4L2 device": ["emulators/camera_v4l2"],
    "Modbus servers": ["emulators/modbus"],
    "emulated world": ["emulators/world"],
}
LIBRARIES = (
    "linuxpy.video.raw",
    "linuxpy.video.device",
    "mfusepy",
    "pyfuse3",
    "pymodbus.server",
    "vtkmodules.vtkRenderingOpenGL2",
)
OWN_MODULES = tuple(ROOT.glob("drivers/camera_v4l2/kernel/abi.py"))
PROBE = """
import importlib.util, json, os, resource, sys, time
name = sys.argv[1]
def resident_mb():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 2**20
begin, before = time.process_time(), resident_mb()
if name.endswith(".py"):
    spec = importlib.util.spec_from_file_location("probed", name)
    module = importlib.util.module_from_spec(spec)
    sys.modules["probed"] = module
    spec.loader.exec_module(module)
    folder = name
else:
    module = importlib.import_module(name)
    folder = os.path.dirname(sys.modules[name.split(".")[0]].__file__)
    if name.split(".")[0] == name and not hasattr(module, "__path__"):
        folder = module.__file__
import_ms = 1e3 * (time.process_time() - begin)
memory_mb = resident_mb() - before
files = [os.path.join(root, name) for root, _, names in os.walk(folder) for name in names]
size = sum(map(os.path.getsize, files or [folder]))
print(json.dumps({"import_ms": import_ms, "memory_mb": memory_mb, "disk_mb": size / 1e6}))
"""


def count_lines(patterns: list[str]) -> int:
    """Return the lines of all Python files that patterns name, or hold as folders."""
    files = []
    for pattern in patterns:
        found = [*ROOT.glob(pattern if pattern.endswith(".py") else f"{pattern}/**/*.py")]
        if not found:
            raise FileNotFoundError(pattern)
        files += found
    return sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)


def measure_import(python: str, name: str) -> dict[str, Any]:
    """Return what the import of a module takes, or the error's last words."""
    rows = []
    for _ in range(3):
        done = subprocess.run(
            [python, "-c", PROBE, name], capture_output=True, text=True, cwd="/", check=False
        )
        if done.returncode:
            return {"error": (done.stderr.strip().splitlines() or ["?"])[-1]}
        rows.append(json.loads(done.stdout))
    return {key: round(min(row[key] for row in rows), 1) for key in rows[0]}


def picture_ms() -> float:
    """Return milliseconds of processor of a ray cast picture, the least of five."""
    import numpy as np
    import trimesh

    from controller.imaging import RayCaster

    mesh = trimesh.load(ROOT / "recipes/parts/featuretype.stl", force="mesh")
    assert isinstance(mesh, trimesh.Trimesh)
    caster = RayCaster(mesh)
    x, y = np.meshgrid(np.linspace(-0.2, 0.2, 480), np.linspace(-0.15, 0.15, 360))
    directions = np.stack([x.ravel(), y.ravel(), -np.ones(x.size)], axis=1)
    eye = mesh.bounds.mean(axis=0) + np.array([0.0, 0.0, 400.0])
    taken = []
    for _ in range(5):
        begin = time.process_time()
        caster.first_hit(eye, directions)
        taken.append(1e3 * (time.process_time() - begin))
    return round(min(taken), 1)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--python", default=sys.executable, help="that has the libraries")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    lines = {name: count_lines(paths) for name, paths in PIECES.items()}
    imports = {name: measure_import(args.python, name) for name in LIBRARIES}
    imports |= {path.name: measure_import(sys.executable, str(path)) for path in OWN_MODULES}
    found = {"lines": lines, "imports": imports, "picture_ms": picture_ms()}
    if args.json:
        print(json.dumps({"own_code": found}))
        return 0
    for name, count in lines.items():
        print(f"{name:28}{count:7} lines")
    print(f"\n{'import':34}{'disk MB':>9}{'CPU ms':>9}{'memory MB':>11}")
    for name, row in imports.items():
        if "error" in row:
            print(f"{name:34}  {row['error'][:70]}")
        else:
            print(f"{name:34}{row['disk_mb']:9.1f}{row['import_ms']:9.1f}{row['memory_mb']:11.1f}")
    print(f"\na picture of 480 x 360 rays: {found['picture_ms']} ms")
    return 0


if __name__ == "__main__":
    sys.exit(main())

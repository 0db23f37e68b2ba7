"""`cellctl init --driver`: a package with a driver of one's own, its emulator and its tests.

The templates below `starter/drivers` are Python as it stands, which linters and types are checked
on; laid out, their module is the package, and ACME is the name given.
"""

import re
from pathlib import Path
from typing import Final

from controller.config import EMULATED_CELL, ConfigError
from controller.setup.drivers import installed_drivers

from ..inputs.checks import check_empty_folder
from .starter_project import tell_files

TEMPLATES: Final = Path(__file__).parent / "starter" / "drivers"
MODULE: Final = "controller.cli.project.starter.drivers."
NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,30}")
DEVICES: Final = {  # device of the cell file that a driver of each kind is tried as
    "arm": "arm",
    "camera": "inspection",
    "gripper": "gripper",
    "lights": "lights",
}
ADDRESS: Final = "127.0.0.1:5020"  # of the emulators, as their `--port` has it
MORE_KEYS: Final = {
    "gripper": ", transport: tcp, unit: 1",
    "lights": ", transport: tcp, analog_unit: 1",
}
# The arm of the template: on a pedestal beside the table, with the gripper of the emulated cell.
ARM_SECTION: Final = """\
  pose: {position: [-120, 0, 0], x_axis: [1, 0, 0], y_axis: [0, 1, 0]}   # world: under its turret
  column: [-210, -30, -90, 90, 0, 310]   # world: what it stands on
  jaw_max_mm: 85.0
  shape: {upper_mm: 420, fore_mm: 390, tool_mm: 177, park_deg: [0, 110, -110, 0, 90, 0]}
"""
PYPROJECT: Final = """\
[build-system]
requires = ["setuptools>=77"]
build-backend = "setuptools.build_meta"

[project]
name = "{package}"
version = "0.1"
description = "Driver of the {label} {kind} for cellctl"
requires-python = ">=3.11"
dependencies = ["cellctl"]

[project.optional-dependencies]
test = ["pytest>=8"]

[project.entry-points."cellctl.drivers"]
"{kind}.{name}" = "{package}:DRIVER"

[project.scripts]
{package}_emulator = "{package}.emulator:main"

[tool.setuptools]
packages = ["{package}"]

[tool.pytest.ini_options]
testpaths = ["tests"]
"""


def lay_out_driver(folder: Path, name: str, kind: str, *, as_json: bool) -> int:
    """Write an installable package with a driver into a new or empty folder; return the exit code.

    Parameters
    ----------
    folder : new or empty
    name : of the driver, as a cell file is to give it
    kind : key of `DEVICES`
    as_json : print one JSON object instead of lines

    Raises
    ------
    ConfigError : the name cannot be one, or is taken; the folder cannot be used
    """
    if not NAME.fullmatch(name):
        raise ConfigError(
            f"--driver `{name}`: begins with a letter; small letters, digits and _, 31 at most"
        )
    if (taken := installed_drivers(kind).get(name)) is not None:
        raise ConfigError(
            f"--driver `{name}`: there is a {kind} driver of this name ({taken.value}); "
            "take another one"
        )
    check_empty_folder(folder)
    words = {
        "name": name,
        "kind": kind,
        "package": f"{name}_{kind}",
        "device": DEVICES[kind],
        "label": name.upper(),
        "address": ADDRESS,
    }
    files = {
        "README.md": (TEMPLATES / "README.md").read_text(encoding="utf-8").format_map(words),
        "pyproject.toml": PYPROJECT.format_map(words),
        "cell.yaml": cell_text(name, kind),
    }
    for source in sorted((TEMPLATES / kind).glob("*.py")):
        is_test = source.name.startswith("test_")
        files[f"{'tests' if is_test else words['package']}/{source.name}"] = _filled(source, words)
    for source in sorted((TEMPLATES / "tests").glob("*.py")):
        files[f"tests/{source.name}"] = _filled(source, words)
    for file, text in files.items():
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    tell_files(folder, files, "pip install -e '.[test]', pytest", as_json=as_json)
    return 0


def _filled(source: Path, words: dict[str, str]) -> str:
    """Return a template as the package has it.

    Templates that all kinds share are written for the gripper.
    """
    text = source.read_text(encoding="utf-8")
    for written in (words["kind"], "gripper"):
        text = text.replace(MODULE + written, words["package"])
    camel = "".join(part.capitalize() for part in words["name"].split("_"))
    text = text.replace('DEVICE = "gripper"', f'DEVICE = "{words["device"]}"')
    text = text.replace("ACME", words["label"]).replace("Acme", camel)
    return text.replace("driver: acme", f"driver: {words['name']}")


def cell_text(name: str, kind: str) -> str:
    """Return the emulated cell with one device of another make."""
    text = EMULATED_CELL.read_text(encoding="utf-8")
    device = DEVICES[kind]
    line = f"{{driver: {name}, address: {ADDRESS}{MORE_KEYS.get(kind, '')}}}"
    text, count = re.subn(rf"(?m)^(  {device}: +)\{{address: emulated.*\}}$", rf"\1{line}", text)
    assert count == 1, f"the emulated cell has {count} lines of {device}"
    if kind != "arm":
        return text
    found = re.search(r"(?ms)^arm:\n(.*?)(?=^  # [^\n]*\n  arm_gripper:|^  arm_gripper:)", text)
    assert found is not None
    return text[: found.start(1)] + ARM_SECTION + text[found.end(1) :]

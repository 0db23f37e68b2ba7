"""What `cellctl doctor` and the start of a run say of this computer, by what each driver states."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from controller.cli.devices.doctor_checks import machine_checks
from controller.config import load_cell
from controller.setup import drivers as setup_drivers
from controller.setup.drivers import find_driver
from drivers.camera_genicam import Aravis

ROOT = Path(__file__).resolve().parents[2]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"


def checks(folder: Path, **devices: str) -> dict[str, dict[str, object]]:
    """Return the checks of the emulated cell with other devices in it, by name."""
    lines = CELL.read_text(encoding="utf-8").splitlines()
    for name, section in devices.items():
        (at,) = (i for i, line in enumerate(lines) if line.startswith(f"  {name}:") and "{" in line)
        lines[at] = f"  {name}: {section}"
    path = folder / "cell.yaml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return {one["check"]: one for one in machine_checks(load_cell(path), folder)}


def test_the_emulated_cell_needs_neither_a_library_nor_a_node(tmp_path: Path) -> None:
    found = checks(tmp_path)
    assert not [name for name in found if "needs" in name or "permission" in name]


def test_a_missing_library_is_named_with_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = find_driver("camera", "genicam")

    def missing() -> str:
        return Aravis.load("libnothing.so.9").version

    def found(kind: str, name: str) -> object:
        without = dataclasses.replace(driver, needs=missing)
        return without if name == "genicam" else find_driver(kind, name)

    monkeypatch.setattr("controller.cli.devices.doctor_checks.find_driver", found)
    check = checks(tmp_path, overhead="{driver: genicam, address: 10.1.1.1}")
    assert check["overhead driver needs"]["ok"] is False
    assert "apt-get install libaravis-0.8-0" in str(check["overhead driver needs"]["found"])
    assert "inspection driver needs" not in check


@pytest.mark.parametrize(
    ("name", "section", "group"),
    [
        ("overhead", "{address: /dev/null-video}", "video"),
        ("arm", "{address: /dev/null-tty}", "dialout"),
        ("gripper", "{address: /dev/null-tty, transport: rtu}", "dialout"),
    ],
)
def test_a_device_node_asks_for_the_group_of_its_driver(
    tmp_path: Path, name: str, section: str, group: str
) -> None:
    check = checks(tmp_path, **{name: section})[f"{name} permission"]
    assert check["ok"] is False
    assert f"group {group}" in str(check["remedy"])


@pytest.mark.parametrize("driver", ["genicam", "folder"])
def test_a_camera_that_is_no_device_node_asks_for_no_group(tmp_path: Path, driver: str) -> None:
    found = checks(tmp_path, overhead=f"{{driver: {driver}, address: /srv/pictures}}")
    assert "overhead permission" not in found


def test_every_own_driver_of_a_serial_line_or_a_node_states_its_group() -> None:
    stated = {
        f"{kind}.{name}": find_driver(kind, name).node_group
        for kind in ("arm", "gripper", "lights", "io", "camera")
        for name, entry in setup_drivers.installed_drivers(kind).items()
        if entry.value.startswith("drivers.")
    }
    without = {name for name, group in stated.items() if not group}
    assert without == {
        "arm.umi_rtx_recorded",
        "arm.ur",
        "camera.folder",
        "camera.genicam",
        "camera.video",
    }
    assert {stated["camera.v4l2"], stated["arm.umi_rtx"]} == {"video", "dialout"}

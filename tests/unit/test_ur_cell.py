"""A Universal Robots arm as a cell file names it: found, checked, described, built."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from installed_here import register
from ur_cell import EMULATED_CELL, SHAPE, write_ur_cell
from ur_controller import UrController

from controller.cell.devices import DeviceBuilder, resolve
from controller.config import ConfigError, load_cell
from controller.planning.motion import tcp_pose
from controller.setup.drivers import require_drivers
from controller.setup.layout import build_layout
from drivers.clock import REAL_TIME
from drivers.supervisor import BlindStop
from drivers.ur_arm import UrArm, UrModel


@pytest.fixture(autouse=True)
def installed(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have this checkout's drivers, whatever an older installation offers."""
    monkeypatch.syspath_prepend(str(register(tmp_path_factory.mktemp("installed"))))


def built(path: Path) -> object:
    cell = load_cell(path)
    require_drivers(path, cell)
    where = resolve(cell, dict.fromkeys(cell.emulated_devices, "nowhere"))
    return DeviceBuilder(cell, where, REAL_TIME).device("arm")


def test_the_cell_file_gives_arm_address_load_and_ports(tmp_path: Path) -> None:
    settings = "{payload_kg: 1.5, script_port: 40001, host: 10.0.0.8}"
    arm = built(write_ur_cell(tmp_path / "cell.yaml", "10.0.0.9:40004", settings))
    assert isinstance(arm, UrArm)
    assert arm.model == "Universal Robots UR5e"
    blind = arm.blind_stop()
    assert isinstance(blind, BlindStop)
    assert blind.place == "10.0.0.8:40001"
    assert blind.frames == (b"stopj(17.453293)\n",)


async def test_it_is_connected_by_its_cell_file_alone(tmp_path: Path) -> None:
    robot = UrController()
    async with robot.serving():
        settings = ", ".join(
            f"{n}_port: {robot.ports[n]}" for n in ("dashboard", "script", "gripper")
        )
        address = f"127.0.0.1:{robot.ports['rtde']}"
        arm = built(write_ur_cell(tmp_path / "cell.yaml", address, f"{{{settings}}}"))
        assert isinstance(arm, UrArm)
        async with arm:
            np.testing.assert_allclose(await arm.read_q(), robot.q)


def test_the_layout_has_the_arm_turned_round_behind_the_table(tmp_path: Path) -> None:
    layout = build_layout(load_cell(write_ur_cell(tmp_path / "cell.yaml", "10.0.0.9")))
    assert isinstance(layout.arm, UrModel)
    T = tcp_pose(layout, layout.park_q[None])[0]
    np.testing.assert_allclose(T[:3, 0], [0, 0, -1], atol=1e-9)  # the tool hangs
    # by hand: shoulder 200 deg up, elbow 130 deg on; wrist 1's and the tool's offsets are across
    a, b = np.radians(-110.0), np.radians(20.0)
    ahead = 425 * np.cos(a) + 392.2 * np.cos(b) + 99.7
    np.testing.assert_allclose(T[0, 3], -350 + ahead, atol=1e-6)
    np.testing.assert_allclose(abs(T[1, 3]), 133.3, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"shape": SHAPE.replace("ur5e", "ur6")}, "model: 'ur6' is none of ur3e, ur5e, ur10e, ur5"),
        ({"shape": SHAPE.replace("model", "modell")}, "arm.shape.modell`; did you mean `model`"),
        ({"settings": "{paylod_kg: 1}"}, "settings.paylod_kg`; did you mean `payload_kg`"),
        ({"settings": "{rtde_hz: 1000}"}, "rtde_hz: 20 to 500, not 1000"),
        ({"address": "10.0.0.9:rtde"}, "address: host or host:port of the controller"),
    ],
)
def test_what_is_wrong_in_the_file_is_named(
    change: dict[str, str], words: str, tmp_path: Path
) -> None:
    path = write_ur_cell(tmp_path / "cell.yaml", **({"address": "10.0.0.9"} | change))
    with pytest.raises(ConfigError, match=words):
        built(path)


def test_a_file_that_describes_an_rtx_is_no_ur(tmp_path: Path) -> None:
    text = EMULATED_CELL.read_text()
    own = next(line for line in text.splitlines() if line.startswith("  arm:"))
    path = tmp_path / "cell.yaml"
    path.write_text(text.replace(own, "  arm: {driver: ur, address: 10.0.0.9}"))
    with pytest.raises(ConfigError, match=r"`arm\.shape`.* missing"):
        built(path)

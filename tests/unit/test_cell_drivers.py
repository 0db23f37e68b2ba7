"""Drivers by entry point: cellctl's own, one of somebody else's, and what is wrong with others."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from acme_device import acme_device
from installed_here import register

from controller.cell.batch import Dispatcher
from controller.cell.custody.openings import Occupancy, judge_fixed
from controller.cell.devices import DeviceBuilder, resolve
from controller.cell.machine import Effect
from controller.cell.plans.planning import model_hash
from controller.cli import main
from controller.cli.project.starter.drivers.arm import model as six_axis_model
from controller.config import EMULATED_CELL, ConfigError, load_cell
from controller.planning.motion import tcp_pose
from controller.setup.drivers import (
    KIND_OF,
    find_driver,
    installed_drivers,
    read_settings,
    require_drivers,
    require_force,
)
from controller.setup.layout import build_layout
from drivers.clock import CellClock
from drivers.errors import ArmStalledError, LinkError, SilentLineError
from drivers.kinds import Driver, Hold, Signal

ACME = Path(__file__).resolve().parents[1] / "data" / "acme"
OWN_GRIPPER = "gripper:     {address: emulated, transport: tcp, unit: 9}"
CellFile = Callable[[str], Path]


@pytest.fixture(autouse=True)
def installed(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install this checkout as it is now."""
    monkeypatch.syspath_prepend(str(register(tmp_path_factory.mktemp("installed"))))


@pytest.fixture
def acme(monkeypatch: pytest.MonkeyPatch) -> None:
    """Install the example package, as far as Python sees."""
    monkeypatch.syspath_prepend(str(ACME))


@pytest.fixture
def cell_file(tmp_path: Path) -> CellFile:
    def write(gripper: str) -> Path:
        text = EMULATED_CELL.read_text()
        assert OWN_GRIPPER in text
        path = tmp_path / "cell.yaml"
        path.write_text(text.replace(OWN_GRIPPER, f"gripper: {gripper}"))
        return path

    return write


def test_every_device_of_the_emulated_cell_has_an_installed_driver() -> None:
    cell = load_cell(EMULATED_CELL)
    assert set(KIND_OF) == set(type(cell.devices).model_fields)
    for name, kind in KIND_OF.items():
        driver = find_driver(kind, getattr(cell.devices, name).driver)
        assert isinstance(driver, Driver)
    require_drivers(EMULATED_CELL, cell)


@pytest.mark.usefixtures("acme")
def test_a_gripper_of_somebody_else_is_opened_and_driven_by_the_cell(cell_file: CellFile) -> None:
    async def drive() -> None:
        async with acme_device() as device:
            path = cell_file(
                f"{{driver: acme, address: '127.0.0.1:{device.port}', "
                "settings: {max_opening_mm: 60}}"
            )
            cell = load_cell(path)
            require_drivers(path, cell)
            where = resolve(cell, dict.fromkeys(cell.emulated_devices, "nowhere"))
            gripper = DeviceBuilder(cell, where, CellClock(min_timeout_wall_s=60.0)).gripper()
            status = await gripper.connect()
            opening = judge_fixed(status, Signal.NOT_OK, gripper.max_opening_mm)
            assert opening.occupancy is Occupancy.UNREADABLE  # never activated
            await gripper.activate()
            await gripper.open_to(50.0)
            assert device.opening_mm == 50.0
            opening = judge_fixed(await gripper.status(), Signal.NOT_OK, gripper.max_opening_mm)
            assert opening.occupancy is Occupancy.EMPTY
            device.part_mm = 30.0
            grasp = await gripper.close_on(30.0, force_n=40.0)
            assert (grasp.object_detected, grasp.opening_mm) == (True, 30.0)
            assert await gripper.hold() is Hold.HELD
            opening = judge_fixed(await gripper.status(), Signal.NOT_OK, gripper.max_opening_mm)
            assert opening.occupancy is Occupancy.HOLDS
            device.part_mm = None
            await gripper.wait_lost()
            assert await gripper.hold() is Hold.LOST
            await gripper.aclose()

    asyncio.run(asyncio.wait_for(drive(), 60))


@pytest.mark.usefixtures("acme")
async def test_a_gripper_that_is_not_there_is_a_link_error(cell_file: CellFile) -> None:
    path = cell_file("{driver: acme, address: '127.0.0.1:1', settings: {max_opening_mm: 60}}")
    cell = load_cell(path)
    where = resolve(cell, dict.fromkeys(cell.emulated_devices, "nowhere"))
    gripper = DeviceBuilder(cell, where, CellClock(min_timeout_wall_s=60.0)).gripper()
    with pytest.raises(LinkError, match=r"127\.0\.0\.1:1"):
        await gripper.connect()


@pytest.mark.usefixtures("acme")
def test_an_unknown_driver_is_answered_with_those_installed(cell_file: CellFile) -> None:
    own = {"acme", "onrobot_rg", "robotiq_2f"}
    assert set(installed_drivers("gripper")) == own
    path = cell_file("{driver: akme, address: here}")
    line = path.read_text().splitlines().index("  gripper: {driver: akme, address: here}") + 1
    with pytest.raises(ConfigError) as raised:
        require_drivers(path, load_cell(path))
    assert str(raised.value) == (
        f"{path}:{line}: no gripper driver `akme` is installed; did you mean `acme`? "
        "(installed: acme, onrobot_rg, robotiq_2f)"
    )


def test_a_driver_of_another_kind_is_not_offered() -> None:
    with pytest.raises(ConfigError, match=r"no arm driver `robotiq_2f` .*installed: umi_rtx"):
        find_driver("arm", "robotiq_2f")


@pytest.mark.usefixtures("acme")
@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ("{max_openin_mm: 60}", "did you mean `max_opening_mm`?"),
        ("{max_opening_mm: wide}", "`devices.gripper.settings.max_opening_mm`: "),
        ("{move_s: 3}", "`devices.gripper.settings.max_opening_mm`: "),
    ],
)
def test_wrong_settings_are_named(settings: str, words: str, cell_file: CellFile) -> None:
    path = cell_file(f"{{driver: acme, address: 'here:1', settings: {settings}}}")
    with pytest.raises(ConfigError) as raised:
        require_drivers(path, load_cell(path))
    assert words in str(raised.value)
    assert str(raised.value).startswith(f"{path}:")


def test_the_speed_of_the_fixed_gripper_is_a_setting(cell_file: CellFile) -> None:
    line = "{{address: 'here:502', settings: {{speed_mm_s: {}}}}}"
    path = cell_file(line.format(10))
    with pytest.raises(ConfigError, match=r"speed must be 20\.\.150 mm/s, not 10 mm/s"):
        require_drivers(path, load_cell(path))
    cell = load_cell(cell_file(line.format(30)))
    where = resolve(cell, dict.fromkeys(cell.emulated_devices, "nowhere"))
    gripper: Any = DeviceBuilder(cell, where, CellClock()).gripper()
    while hasattr(gripper, "_device"):  # the driver, within what corrects its openings
        gripper = gripper._device
    assert gripper.config.default_speed_mm_s == 30.0


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (
            "{at_end: repeat}",
            "`devices.overhead.settings.at_end`: Input should be 'stop' or 'loop'",
        ),
        (
            "{next_by: name}",
            "`devices.overhead.settings.next_by`: Input should be 'look' or 'time'",
        ),
        ("{loop: true}", "unknown key `devices.overhead.settings.loop`"),
    ],
)
@pytest.mark.parametrize("driver", ["folder", "video"])
def test_wrong_settings_of_pictures_from_files_are_named_with_their_line(
    driver: str, settings: str, words: str, tmp_path: Path
) -> None:
    own = "  overhead:    {address: emulated}"
    line = f"  overhead: {{driver: {driver}, address: pictures, settings: {settings}}}"
    text = EMULATED_CELL.read_text()
    assert own in text
    path = tmp_path / "cell.yaml"
    path.write_text(text.replace(own, line))
    with pytest.raises(ConfigError) as raised:
        require_drivers(path, load_cell(path))
    number = path.read_text().splitlines().index(line) + 1
    assert str(raised.value).startswith(f"{path}:{number}: ")
    assert words in str(raised.value)


def test_a_driver_without_settings_refuses_them(cell_file: CellFile) -> None:
    path = cell_file("{address: emulated, unit: 9}")
    own = "  lights:      {address: emulated, transport: tcp, analog_unit: 1, relay_unit: 2}"
    text = path.read_text()
    assert own in text
    path.write_text(text.replace(own, "  lights: {address: emulated, settings: {force: 3}}"))
    with pytest.raises(ConfigError, match="this driver has no settings"):
        require_drivers(path, load_cell(path))


@dataclass(frozen=True)
class Picky:
    """Settings with a rule of their own."""

    width_mm: float

    def __post_init__(self) -> None:
        if self.width_mm > 10:
            raise ValueError("at most 10 mm")


def test_a_rule_of_the_drivers_own_is_reported() -> None:
    driver = Driver(Picky, lambda site, settings: settings)
    assert read_settings(driver, {"width_mm": 3}, "here").width_mm == 3.0
    with pytest.raises(ConfigError, match=r"^`here\.settings`: at most 10 mm"):
        read_settings(driver, {"width_mm": 11}, "here")


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("raise RuntimeError('no licence')", "cannot be loaded: RuntimeError('no licence')"),
        ("", "cannot be loaded: AttributeError"),
        ("DRIVER = 3", "is not a `drivers.kinds.Driver`"),
    ],
)
def test_a_package_that_offers_no_driver_is_named(
    code: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = f"broken_{abs(hash(code))}"
    (tmp_path / f"{name}.py").write_text(code)
    info = tmp_path / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[cellctl.drivers]\narm.broken = {name}:DRIVER\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(ConfigError) as raised:
        find_driver("arm", "broken")
    assert "arm driver `broken`" in str(raised.value)
    assert words in str(raised.value)


SIX_AXIS = ACME.parent / "six_axis"
SHAPE = "{upper_mm: 420, fore_mm: 390, tool_mm: 177, park_deg: [0, 110, -110, 0, 90, 0]}"


@pytest.fixture
def six_axis(monkeypatch: pytest.MonkeyPatch) -> None:
    """Install a package with an arm of six revolute joints, as far as Python sees."""
    monkeypatch.syspath_prepend(str(SIX_AXIS))


@pytest.fixture
def six_axis_file(tmp_path: Path) -> CellFile:
    """Write the emulated cell with that arm on a pedestal, farther back than the UMI."""

    def write(shape: str, more: str = "", driver: str = "six_axis") -> Path:
        lines = EMULATED_CELL.read_text().splitlines()
        first = lines.index("arm:")
        last = next(i for i in range(first + 1, len(lines)) if lines[i][:1].strip())
        kept = "\n".join(lines[first + 1 : last])
        gripper = kept[kept.index("  arm_gripper:") :]
        arm = (
            "arm:\n"
            "  pose: {position: [-120, 0, 0], x_axis: [1, 0, 0], y_axis: [0, 1, 0]}\n"
            "  jaw_max_mm: 85.0\n"
            "  column: [-210, -30, -90, 90, 0, 310]\n"
            f"  shape: {shape}\n{more}{gripper}"
        )
        text = "\n".join([*lines[:first], arm, *lines[last:]])
        own = next(line for line in lines if line.startswith("  arm:"))
        path = tmp_path / "cell.yaml"
        path.write_text(text.replace(own, f"  arm: {{driver: {driver}, address: here}}"))
        return path

    return write


@pytest.mark.usefixtures("six_axis")
def test_an_arm_of_another_make_is_described_by_its_driver(six_axis_file: CellFile) -> None:
    path = six_axis_file(SHAPE)
    cell = load_cell(path)
    require_drivers(path, cell)
    layout = build_layout(cell)
    # by hand: the turret 120 mm behind the origin, upper arm 110 deg up, forearm level, tool down
    a = np.radians(110.0)
    tip = [-120 + 60 + 420 * np.cos(a) + 390, 0, 430 + 420 * np.sin(a) - 177]
    np.testing.assert_allclose(tcp_pose(layout, layout.park_q[None])[0, :3, 3], tip, atol=1e-9)
    np.testing.assert_allclose(layout.column.half_mm, [90, 90, 155])
    assert [link.name for link in layout.arm.links] == ["turret", "upper", "fore", "wrist"]


@pytest.mark.usefixtures("six_axis")
@pytest.mark.parametrize(
    ("shape", "more", "words"),
    [
        (SHAPE.replace("upper", "uper"), "", "key `arm.shape.uper_mm`; did you mean `upper_mm`?"),
        (SHAPE.replace("420", "long"), "", "`arm.shape.upper_mm`: "),
        (SHAPE.replace("420", "50"), "", "`arm.shape`: upper arm and forearm are longer than"),
        (SHAPE.replace(", 0]", "]"), "", "`arm.shape.park_deg.5`: "),
        (SHAPE, "  upper_mm: 253.5\n", "describes a UMI RTX"),
        (SHAPE, "  jaw_max: 80\n", "unknown key `arm.jaw_max`; did you mean `jaw_max_mm`?"),
    ],
)
def test_a_wrong_shape_is_named_with_its_line(
    shape: str, more: str, words: str, six_axis_file: CellFile
) -> None:
    path = six_axis_file(shape, more)
    with pytest.raises(ConfigError) as raised:
        require_drivers(path, load_cell(path))
    where, _, message = str(raised.value).partition(": ")
    assert words in message
    line = int(where.removeprefix(f"{path}:"))
    key = more.split(":")[0] if more else "  shape"
    assert path.read_text().splitlines()[line - 1].startswith(key)


def test_a_driver_that_knows_no_shape_is_named(six_axis_file: CellFile) -> None:
    path = six_axis_file(SHAPE, driver="umi_rtx")
    with pytest.raises(ConfigError, match="`umi_rtx` does not say how its arm is built"):
        require_drivers(path, load_cell(path))


@pytest.mark.usefixtures("six_axis")
def test_the_keys_of_a_umi_rtx_describe_no_other_drivers_arm(tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    text = EMULATED_CELL.read_text()
    own = next(line for line in text.splitlines() if line.startswith("  arm:"))
    path.write_text(text.replace(own, "  arm: {driver: six_axis, address: here}"))
    with pytest.raises(ConfigError) as raised:
        require_drivers(path, load_cell(path))
    line = path.read_text().splitlines().index("arm:") + 1
    assert str(raised.value).startswith(f"{path}:{line}: `arm.shape` is missing")


@pytest.mark.usefixtures("six_axis")
def test_an_emulated_cell_with_another_arm_is_refused_with_the_reason(
    six_axis_file: CellFile, capsys: pytest.CaptureFixture[str]
) -> None:
    path = six_axis_file(SHAPE)
    for command in ("doctor", "emulate"):
        assert main([command, "--cell", str(path)]) == 2
        said = capsys.readouterr().err
        words = f"{path}: `arm.shape` describes an arm of the driver `six_axis`, which cannot be"
        assert f"{words} emulated" in said


@pytest.mark.usefixtures("six_axis")
def test_plans_are_kept_apart_by_what_the_model_holds_and_by_its_source(
    six_axis_file: CellFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    six, umi = build_layout(load_cell(six_axis_file(SHAPE))), build_layout(load_cell(EMULATED_CELL))
    assert model_hash(six.arm) != model_hash(umi.arm)
    source = Path(six_axis_model.__file__).read_text()
    hashes = []
    for name, text in (("same", source), ("other", source.replace("90.0", "91.0", 1))):
        (tmp_path / name).mkdir()
        (tmp_path / name / "model.py").write_text(text)
        monkeypatch.setattr(six_axis_model, "__file__", str(tmp_path / name / "model.py"))
        hashes.append(model_hash(six.arm))
    assert hashes[0] != hashes[1]


@pytest.mark.usefixtures("acme")
def test_two_packages_with_one_name_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "other-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: other\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[cellctl.drivers]\ngripper.acme = other:DRIVER\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(ConfigError, match="two packages offer the gripper driver `acme`"):
        find_driver("gripper", "acme")


@pytest.mark.parametrize(
    ("error", "message", "code"),
    [
        (
            ArmStalledError("acme: blocked"),
            "the arm met something it should not have: acme: blocked; look before you clear it",
            "stall",
        ),
        (SilentLineError("acme: no answer"), "in step home: acme: no answer", "silent_line"),
    ],
)
async def test_errors_of_an_arm_of_another_make_read_like_those_of_ours(
    error: Exception, message: str, code: str
) -> None:
    async def fail(_: Effect) -> None:
        raise error

    nobody: Any = None
    actions: Any = SimpleNamespace(perform=fail)
    gate: Any = SimpleNamespace()
    dispatcher = Dispatcher(actions, nobody, nobody, (), nobody, gate, nobody, nobody)
    note = await dispatcher._outcome_of(Effect.HOME)
    assert (note.message, note.code) == (message, code)


RECIPES = Path(__file__).resolve().parents[2] / "recipes"


@pytest.mark.parametrize(
    ("model", "force_n", "max_n"), [("rg2", 40.5, 40), ("rg2", 40.0, None), ("rg6", 121.0, 120)]
)
def test_a_recipe_that_asks_for_more_force_than_the_gripper_has_is_refused(
    cell_file: CellFile, tmp_path: Path, model: str, force_n: float, max_n: int | None
) -> None:
    cell = load_cell(
        cell_file(f"{{driver: onrobot_rg, address: emulated, settings: {{model: {model}}}}}")
    )
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text(f"name: x\npart: x.step\ngrasp:\n  force_n: {force_n}\n")
    if max_n is None:
        require_force(recipe, force_n, cell)
        return
    with pytest.raises(ConfigError, match=rf"recipe.yaml:4: .*presses with {max_n} N at the most"):
        require_force(recipe, force_n, cell)


def test_check_and_run_refuse_such_a_recipe_before_anything_begins(
    cell_file: CellFile, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = cell_file("{driver: onrobot_rg, address: emulated, settings: {model: rg2}}")
    for command in ("check", "run"):
        words = [command, str(RECIPES / "holder.yaml"), "--cell", str(cell)]
        words += ["--runs", str(tmp_path / "runs")] if command == "run" else []
        assert main(words) == 2
        error = capsys.readouterr().err
        assert "60 N" in error
        assert "40 N at the most" in error
    assert not (tmp_path / "runs").exists()


def test_a_gripper_whose_driver_states_no_limit_has_that_of_the_cell_file(
    acme: None, cell_file: CellFile, tmp_path: Path
) -> None:
    settings = "{max_opening_mm: 60}"
    cell = load_cell(cell_file(f"{{driver: acme, address: 10.0.0.1:1, settings: {settings}}}"))
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text("grasp: {force_n: 201}")
    require_force(recipe, 200.0, cell)
    with pytest.raises(ConfigError, match=r"201 N, .* 200 N at the most"):
        require_force(recipe, 201.0, cell)

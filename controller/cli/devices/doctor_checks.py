"""`cellctl doctor`: is everything there that a run needs? Moves nothing."""

import asyncio
import os
import platform
import shutil
import signal
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from controller.cell.devices import Devices, resolve
from controller.cell.devices.clocks import devices_with_time, find_clock
from controller.cell.devices.emulator import emulated_cell, emulator_command
from controller.cell.devices.interlocks import REQUIRED_SIGNALS, settled_signal
from controller.cell.journal import JOURNAL_NAME, why_not_there
from controller.cell.lock import hold_cell
from controller.config import Cell, ConfigError, load_cell
from controller.setup.drivers import KIND_OF, find_driver, require_drivers
from drivers.errors import DeviceError
from drivers.kinds import IoBlock, MotorWatchdog, Signal
from messages import key, say

from ..inputs.checks import make_folder
from ..terminal.output import emit, print_line, stdout
from .doctor_pictures import take_pictures

Check = dict[str, Any]

PACKAGES = ("pymodbus", "pyserial", "opencv-python-headless", "numpy", "trimesh")
MIN_DISK_MB = 500
RUNS = "runs"  # default folder of runs, with their journal


@dataclass(frozen=True, slots=True)
class Looking:
    """The looks that go with the checks.

    Attributes
    ----------
    runs_dir : folder of the runs in which the cell's lock is held meanwhile; None for no lock
    pictures : folder for pictures of the cameras; None for none
    watch_s : for how long pictures are taken
    """

    runs_dir: Path | None = None
    pictures: Path | None = None
    watch_s: float = 0.0

    def check(self) -> None:
        """Check the options, and make the folder of the pictures.

        Raises
        ------
        ConfigError : pictures are wanted without the lock, a time without pictures, or the folder
            cannot be made
        """
        if self.pictures is None:
            if self.watch_s:
                raise ConfigError("--watch requires --pictures")
            return
        if self.runs_dir is None:
            raise ConfigError(
                "--pictures switches lamps: add --runs FOLDER, so that no run can start meanwhile"
            )
        make_folder(self.pictures, "--pictures")


def examine(cell_path: Path, looking: Looking, *, as_json: bool) -> int:
    """Check machine and devices; return 1 if a check failed.

    Parameters
    ----------
    cell_path : cell file
    looking : lock and pictures
    as_json : print one JSON object for each check

    Raises
    ------
    ConfigError : the cell file is wrong
    CellBusyError : another process has the cell
    """
    looking.check()
    cell = load_cell(cell_path)
    require_drivers(cell_path, cell)
    checks = machine_checks(cell, looking.runs_dir or Path(RUNS))
    emulator: Any = (
        emulated_cell(emulator_command(cell_path, (), speed=1.0, seed=1))
        if cell.emulated_devices
        else nullcontext({})
    )
    runs_dir = looking.runs_dir
    lock = nullcontext() if runs_dir is None else hold_cell(runs_dir, cell, "doctor")
    with lock, _ending_as_by_ctrl_c(), emulator as ready:
        checks += asyncio.run(_devices(cell, ready, looking, as_json=as_json))
    bad = [check for check in checks if not check["ok"]]
    if as_json:
        for check in checks:
            emit(check)
    else:
        for check in checks:
            mark = "ok  " if check["ok"] else "BAD "
            stdout.print(
                f"{mark}{check['check']:22} {check['found']}",
                style=None if check["ok"] else "bold red",
                markup=False,
            )
            if not check["ok"]:
                print_line(f"      {check['remedy']}")
        print_line("all well" if not bad else f"{len(bad)} of {len(checks)} checks failed")
    return 1 if bad else 0


@contextmanager
def _ending_as_by_ctrl_c() -> Iterator[None]:
    """Have SIGTERM end the block as Ctrl-C does, so that lamps are dark afterwards."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _check(name: str, found: str, *, ok: bool, remedy: str = "") -> Check:
    return {"check": name, "ok": ok, "found": found, "remedy": remedy}


def machine_checks(cell: Cell, runs_dir: Path) -> list[Check]:
    """Return the checks of this computer: versions, disk space, permissions. Opens no device.

    Parameters
    ----------
    cell : its devices' files are looked at
    runs_dir : folder of the journal
    """
    return [*_machine(), _journal(runs_dir), *_drivers_needs(cell), *_permissions(cell)]


def _journal(runs_dir: Path) -> Check:
    why = why_not_there(runs_dir / JOURNAL_NAME)
    return _check(
        "journal",
        why or say("{runs_dir}: on a disk of this computer", runs_dir=runs_dir),
        ok=not why,
        remedy=key("keep the runs in a folder on a disk of this computer (--runs)"),
    )


def _machine() -> list[Check]:
    checks = [_check("python", platform.python_version(), ok=True)]  # pip refuses one too old
    for package in PACKAGES:
        try:
            checks.append(_check(package, version(package), ok=True))
        except PackageNotFoundError:
            checks.append(
                _check(
                    package,
                    key("not installed"),
                    ok=False,
                    remedy=f"pip install {package}",
                )
            )
    free_mb = shutil.disk_usage(Path.cwd()).free // 2**20
    checks.append(
        _check(
            "disk",
            say("{free_mb} MB free", free_mb=free_mb),
            ok=free_mb > MIN_DISK_MB,
            remedy=say("make room: runs need {min_disk_mb} MB and more", min_disk_mb=MIN_DISK_MB),
        )
    )
    return checks


def _drivers_needs(cell: Cell) -> list[Check]:
    """Return whether what the drivers need of this computer is installed."""
    checks = []
    for name, kind in KIND_OF.items():
        driver = getattr(cell.devices, name).driver
        needs = find_driver(kind, driver).needs
        if needs is None:
            continue
        try:
            checks.append(
                _check(
                    say("{name} driver needs", name=name),
                    say("{driver}: {needs}", driver=driver, needs=needs()),
                    ok=True,
                )
            )
        except DeviceError as error:
            remedy = key("install it, or name another driver in the cell file")
            checks.append(
                _check(say("{name} driver needs", name=name), str(error), ok=False, remedy=remedy)
            )
    return checks


def _permissions(cell: Cell) -> list[Check]:
    checks = []
    for name, kind in KIND_OF.items():
        section = getattr(cell.devices, name)
        address, group = section.address, find_driver(kind, section.driver).node_group
        if not group or not address.startswith("/"):
            continue
        there = Path(address).exists()
        allowed = there and os.access(address, os.R_OK | os.W_OK)
        checks.append(
            _check(
                say("{name} permission", name=name),
                say(
                    "{address}: {access}",
                    address=address,
                    access=_access(there=there, allowed=allowed),
                ),
                ok=allowed,
                remedy=say("add the user to the group {group}, or check the cable", group=group),
            )
        )
    return checks


async def _watchdog(io: IoBlock) -> str:
    """Prove the block's watchdog, if anything depends on it; return its action on the motors."""
    if isinstance(io, MotorWatchdog):
        await io.prove_watchdog()
    if not isinstance(io, MotorWatchdog) or io.watchdog_s is None:
        return key("none in the motors' supply: a computer that freezes does not stop the arm")
    return say(
        "takes the motors' supply away after {watchdog_s:g} s of silence", watchdog_s=io.watchdog_s
    )


def _access(*, there: bool, allowed: bool) -> str:
    if not there:
        return key("is not there")
    return key("may be used") if allowed else key("may not be used")


def _report_picture(found: dict[str, Any], *, as_json: bool) -> None:
    if as_json:
        emit(found)
    else:
        print_line(f"picture: {found['camera']} camera, {found['lamp']}: {found['file']}")


async def _devices(
    cell: Cell, ready: dict[str, Any], looking: Looking, *, as_json: bool
) -> list[Check]:
    clock = find_clock(cell, ready).open()
    devices = Devices.build(cell, resolve(cell, ready.get("devices", {})), clock)
    checks: list[Check] = []
    timed = devices_with_time(cell)

    async def ask(name: str, asking: Callable[[], Awaitable[object]]) -> None:
        kind = key("real") if name in timed else key("from files")
        kind = key("emulated") if name in cell.emulated_devices else kind
        try:
            found = await asking()
        except DeviceError as error:
            checks.append(
                _check(
                    name, str(error), ok=False, remedy=key("see the message; then run doctor again")
                )
            )
        else:
            checks.append(_check(name, say("{found} ({kind})", found=found, kind=kind), ok=True))

    async def lights() -> str:
        await devices.lights.connect()
        return devices.lights.model

    async def arm() -> str:
        identity = await devices.arm.connect()
        model = devices.arm.model
        if identity.was_restarted:
            return say("{model}, was restarted: homing needed", model=model)
        return model

    async def camera(name: str) -> str:
        device = devices.overhead if name == "overhead" else devices.inspection
        await device.connect()
        return f"{device.model}, {device.shape[1]} x {device.shape[0]} px"

    async def gripper() -> str:
        status = await devices.gripper.connect()
        active = "active" if status.is_activated else key("not activated")
        return say(
            "{model}, {active}, {opening_mm:.0f} mm",
            model=devices.gripper.model,
            active=active,
            opening_mm=status.opening_mm,
        )

    async def pictures(folder: Path) -> Check:
        files: list[str] = []

        def taken(found: dict[str, Any]) -> None:
            files.append(found["file"])
            _report_picture(found, as_json=as_json)

        try:
            await take_pictures(devices, clock, folder, looking.watch_s, taken)
        except (DeviceError, OSError) as error:
            remedy = key("see the message; then run doctor again")
            return _check("pictures", str(error), ok=False, remedy=remedy)
        return _check("pictures", say("{files_count} taken", files_count=len(files)), ok=True)

    async with clock.attending():
        try:
            await ask("io", devices.io.connect)
            await ask("watchdog", lambda: _watchdog(devices.io))
            await ask("arm", arm)
            await ask("gripper", gripper)
            await ask("lights", lights)
            await ask("overhead", lambda: camera("overhead"))
            await ask("inspection", lambda: camera("inspection"))
            for name, remedy in REQUIRED_SIGNALS.items():
                found = await settled_signal(devices.io, name, clock)
                checks.append(_check(name, found.value, ok=found is Signal.OK, remedy=remedy))
            if looking.pictures is not None:
                checks.append(await pictures(looking.pictures))
        finally:
            await devices.aclose()
    clock.close()
    return checks

"""`cellctl teach`: jog to a place, take the position, show its effect on the file, write it."""

import difflib
import sys
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, get_args

import numpy as np

from controller.bring_up.jogging import TakenOver
from controller.bring_up.procedure import (
    AIM_MM,
    TRAYS,
    CommissioningFolder,
    StepEnd,
    TrayName,
    calibrated_text,
    taught_trays,
    with_values,
)
from controller.config import Cell, ConfigError, load_cell, load_yaml
from controller.config.calibration_reference import CalibrationReference
from controller.config.calibrations import (
    TraysCalibration,
    digest_of,
    read_calibrations,
    write_calibration,
)
from controller.config.cell import UmiSection
from controller.config.files import read_text, write_whole
from controller.setup.layout import build_layout
from controller.setup.software import software_versions

from ..inputs.checks import check_writable_folder
from ..running.entering import user_name
from ..terminal.output import emit, print_line, warn
from .arguments import TeachOptions
from .jogging import check_jog, run_jog

PARK: Final = "park"
STATION: Final = "station"
MIN_FREE_BYTES: Final = 1 << 20
# A tray's middle is pointed at from above; a gripper tilted more points beside it.
MAX_TILT_DEG: Final = 30.0
MAX_FROM_DRAWING_MM: Final = 100.0


@dataclass(frozen=True, slots=True)
class TaughtChange:
    """A change to write.

    Attributes
    ----------
    words : description of the item taken, for people
    text : of the cell file, for the checks without the trays' new hash
    trays : the calibration to write first; None if the cell file alone changes
    """

    words: str
    text: str
    trays: TraysCalibration | None = None


def teach(options: TeachOptions) -> int:
    """Jog to a place, and write it after showing the difference; return the exit code.

    Raises
    ------
    ConfigError : a file or an option is wrong
    """
    path, what = options.cell_path, options.what.value
    cell = load_cell(path)
    teacher = Teacher(path, cell, what, options.operator or user_name())
    teacher.check()
    check_jog(options, cell)
    record, taken = run_jog(options, cell, teacher.why_not)
    if record.outcome is not StepEnd.PASSED or taken is None:
        if record.outcome is StepEnd.PASSED:
            warn("cellctl: nothing was taken, and nothing written")
        return 1
    change = teacher.change(taken)
    difference = teacher.difference(change)
    if options.as_json:
        emit({"event": "taught", "what": what, "words": change.words, "difference": difference})
    else:
        print_line(change.words)
        for line in difference:
            print_line(line)
    if not options.answers and not _is_confirmed():
        warn("cellctl: nothing was written")
        return 1
    teacher.write(change)
    if not options.as_json:
        print_line(f"written: {path}")
    return 0


class Teacher:
    """Turns a position into a change of the cell file or of a file it refers to.

    Parameters
    ----------
    path, cell : the cell file, and what it describes as calibrated
    what : a tray, `park` or `station`
    by : name of the person who teaches
    """

    def __init__(self, path: Path, cell: Cell, what: str, by: str) -> None:
        self._path, self._cell, self._what, self._by = path, cell, what, by
        self._layout = build_layout(cell)

    def check(self) -> None:
        """Check before anything moves that the taught position can be written.

        Raises
        ------
        ConfigError : it cannot
        """
        check_writable_folder(self._path.parent, "--cell", MIN_FREE_BYTES)
        T = np.eye(4)
        tray = self._layout.trays.get(self._what)
        T[:3, 3] = self._layout.station_mm if tray is None else (*tray.centre_mm, 0.0)
        self.difference(self.change(TakenOver(np.asarray(self._layout.park_q, dtype=float), T)))

    def why_not(self, taken: TakenOver) -> str:
        """Return the reason why a position cannot be taken; empty if it can."""
        try:
            change = self.change(taken)
            self._as_written(change)
        except ConfigError as error:
            return str(error)
        if self._what not in TRAYS:
            return ""
        T = taken.T_world_tcp
        tilt_deg = float(np.degrees(np.arccos(np.clip(-T[2, 0], -1.0, 1.0))))
        if tilt_deg > MAX_TILT_DEG:
            return f"the gripper is {tilt_deg:.0f} deg off straight down: point it at the tray"
        drawn = load_yaml(self._path, Cell).trays
        centre = np.array(getattr(drawn, self._what).centre)
        off_mm = float(np.linalg.norm(T[:2, 3] - centre))
        if off_mm > MAX_FROM_DRAWING_MM:
            return (
                f"that is {off_mm:.0f} mm from where the tray is drawn: the tray stands elsewhere, "
                "or the drawing is wrong; correct the cell file first"
            )
        return ""

    def change(self, taken: TakenOver) -> TaughtChange:
        """Return the change to be written for a position.

        Raises
        ------
        ConfigError : the cell file has no place for it
        """
        text = read_text(self._path, "a cell file")
        if self._what == PARK:
            return self._park(text, taken)
        x, y, z = (round(float(v), 1) for v in taken.T_world_tcp[:3, 3])
        if self._what == STATION:
            self._require_drawing()
            values = {"position": f"[{x}, {y}, {z}]"}
            return TaughtChange(
                f"station at x {x} y {y} z {z} mm", with_values(text, "station", values)
            )
        name = _tray(self._what)
        arm = self._cell.calibration.get("arm")
        own_mm = UNCALIBRATED_U_MM if arm is None else self._cell.arm.uncertainty.position_mm
        trays = taught_trays(
            self._known_trays(),
            name,
            (x, y),
            u_mm=float(np.hypot(own_mm, AIM_MM)),
            arm=arm,
            now=datetime.now(UTC).replace(microsecond=0),
            by=self._by,
            software=f"cellctl {software_versions()['cellctl']}",
            cell=self._cell.name,
        )
        words = f"tray {name}: its middle at x {x} y {y} mm, standard uncertainty {trays.u_mm} mm"
        return TaughtChange(words, text, trays)

    def _park(self, text: str, taken: TakenOver) -> TaughtChange:
        if not isinstance(self._cell.arm, UmiSection):
            raise ConfigError(
                "park can be taught for the UMI RTX only; other arms have theirs in `arm.shape`"
            )
        self._require_drawing()
        q = taken.q
        degrees = dict(zip(("shoulder", "elbow", "yaw"), np.degrees(q[:3]), strict=True)) | dict(
            zip(("pitch", "roll"), np.degrees(q[4:]), strict=True)
        )
        shown = ", ".join(f"{joint}: {_short(value)}" for joint, value in degrees.items())
        values = {"park_deg": f"{{{shown}}}", "park_zed_mm": _short(q[3])}
        words = f"park at {shown} deg, zed {_short(q[3])} mm"
        return TaughtChange(words, with_values(text, "arm", values))

    def _require_drawing(self) -> None:
        """Require the cell file to be a drawing: a commissioned one has none of its own.

        Raises
        ------
        ConfigError : the cell file was written by a commissioning
        """
        if (
            CommissioningFolder(self._path.parent).cell_file == self._path
            and (self._path.parent / "steps").is_dir()
        ):
            raise ConfigError(
                f"{self._path}: `cellctl commission` wrote this file and overwrites it; teach "
                f"`{self._what}` in the cell file as drawn: --cell DRAWING"
            )

    def _known_trays(self) -> TraysCalibration | None:
        reference = self._cell.calibration.get("trays")
        if reference is None:
            return None
        found = read_calibrations(self._path, {"trays": reference})["trays"]
        return found if isinstance(found, TraysCalibration) else None

    def _trays_file(self) -> str:
        reference = self._cell.calibration.get("trays")
        return reference.file if reference is not None else "calibrations/trays.json"

    def _as_written(self, change: TaughtChange) -> str:
        """Return the cell file's text after the change, checked as a cell file.

        Raises
        ------
        ConfigError : it would describe no cell
        """
        text = change.text
        if change.trays is not None:
            reference = CalibrationReference(
                file=self._trays_file(), sha256=digest_of(change.trays)
            )
            text = calibrated_text(text, {**self._cell.calibration, "trays": reference})
        draft = self._path.parent / ".taught.yaml"
        write_whole(draft, text)
        try:
            load_yaml(draft, Cell)
        finally:
            draft.unlink(missing_ok=True)
        return text

    def difference(self, change: TaughtChange) -> list[str]:
        """Return the differences that a change makes, line by line.

        Raises
        ------
        ConfigError : the cell file would describe no cell
        """
        before = read_text(self._path, "a cell file")
        lines = _unified(before, self._as_written(change), str(self._path))
        if change.trays is None:
            return lines
        known = self._known_trays()
        path = self._path.parent / self._trays_file()
        if known is None and path.exists():
            raise ConfigError(
                f"{path}: exists, but `calibration` of the cell file does not name it; name it "
                "there with its hash, or move it away"
            )
        old = "" if known is None else _centres(known)
        return [*_unified(old, _centres(change.trays), str(path)), *lines]

    def write(self, change: TaughtChange) -> None:
        """Write a taken position: the calibration first, then the cell file that names it.

        Raises
        ------
        ConfigError : a file cannot be written
        """
        text = self._as_written(change)
        if change.trays is not None:
            write_calibration(self._path.parent / self._trays_file(), change.trays)
        write_whole(self._path, text)
        load_cell(self._path)


UNCALIBRATED_U_MM: Final = 7.5  # half the largest TCP error of an uncalibrated arm


def _tray(what: str) -> TrayName:
    names: tuple[TrayName, ...] = TRAYS
    for name in names:
        if name == what:
            return name
    raise ConfigError(
        f"{what:.40}: must be one of {', '.join((*get_args(TrayName), PARK, STATION))}"
    )


def _short(value: float) -> str:
    return f"{round(float(value), 2) + 0.0:g}"


def _centres(trays: TraysCalibration) -> str:
    rows = [f"{name}: {list(centre)}\n" for name, centre in sorted(trays.centres.items())]
    return "".join([*rows, f"u_mm: {trays.u_mm}\n"])


def _unified(before: str, after: str, name: str) -> list[str]:
    found = difflib.unified_diff(
        before.splitlines(), after.splitlines(), name, name, "now", "as taught", n=1, lineterm=""
    )
    return list(found)


def _is_confirmed() -> bool:
    """Return whether a person at the terminal confirms the change."""
    if not sys.stdin.isatty():
        return False
    warn("Write this? Type `yes`:")
    confirm: Callable[[], str] = sys.stdin.readline
    return confirm().strip() == "yes"

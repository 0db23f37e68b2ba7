"""Installed drivers: entry points of the group `cellctl.drivers` (docs/drivers.md)."""

import dataclasses
import difflib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import TypeAdapter, ValidationError

from controller.cache import digest_of
from controller.config import Cell, ConfigError, line_in
from controller.config.cell import OtherArmSection
from controller.yaml_text import Location
from drivers.kinds import GROUP, ArmDescription, ArmDriver, Driver

Checked = TypeVar("Checked")

KIND_OF: Final = {  # kind of each device of the cell file
    "arm": "arm",
    "gripper": "gripper",
    "lights": "lights",
    "io": "io",
    "overhead": "camera",
    "inspection": "camera",
}


def installed_drivers(kind: str) -> dict[str, EntryPoint]:
    """Return the entry points of a kind of device, by the driver's name.

    Raises
    ------
    ConfigError : two packages offer the same name
    """
    found: dict[str, EntryPoint] = {}
    for entry in entry_points(group=GROUP):
        of, _, name = entry.name.partition(".")
        if of != kind:
            continue
        if name in found and found[name].value != entry.value:
            raise ConfigError(
                f"two packages offer the {kind} driver `{name}` ({found[name].value} and "
                f"{entry.value}); uninstall one"
            )
        found[name] = entry
    return found


def find_driver(kind: str, name: str) -> Driver[Any, Any]:
    """Return an installed driver.

    Parameters
    ----------
    kind : ``arm``, ``gripper``, ``lights``, ``io`` or ``camera``
    name : as the cell file gives it

    Raises
    ------
    ConfigError : it is not installed, cannot be loaded, or is not a driver
    """
    installed = installed_drivers(kind)
    if name not in installed:
        known = ", ".join(sorted(installed)) or "none; install cellctl again"
        near = difflib.get_close_matches(name, installed, n=1)
        hint = f"; did you mean `{near[0]}`?" if near else ""
        raise ConfigError(f"no {kind} driver `{name}` is installed{hint} (installed: {known})")
    entry = installed[name]
    try:
        driver = entry.load()
    except Exception as error:  # importing somebody else's package may raise anything
        raise ConfigError(
            f"{kind} driver `{name}`: {entry.value} cannot be loaded: {error!r:.200}"
        ) from error
    if not isinstance(driver, Driver):
        raise ConfigError(f"{kind} driver `{name}`: {entry.value} is not a `drivers.kinds.Driver`")
    return driver


def read_settings(driver: Driver[Any, Any], given: Mapping[str, Any], where: str) -> Any:  # noqa: ANN401  (the driver's own dataclass)
    """Return a driver's settings, checked against its dataclass.

    Parameters
    ----------
    driver : the driver
    given : the section ``settings:`` of the cell file
    where : for messages, such as ``devices.gripper``

    Raises
    ------
    ConfigError : an unknown key, a missing key, or a value that the driver refuses
    """
    return _checked(driver.settings, given, f"{where}.settings")


def read_shape(driver: Driver[Any, Any], cell: Cell) -> Any:  # noqa: ANN401  (the driver's own dataclass)
    """Return ``arm.shape`` of a cell file as the dataclass of the arm's driver.

    None for a driver that asks for none, or a cell file that has none.

    Raises
    ------
    ConfigError : an unknown key, a missing key, or a value that the driver refuses
    """
    if not isinstance(driver, ArmDriver) or not isinstance(cell.arm, OtherArmSection):
        return None
    return _checked(driver.shape, cell.arm.shape, "arm.shape")


def describe_arm(name: str, given: Mapping[str, Any]) -> ArmDescription[Any]:
    """Return an arm as its driver describes it.

    Parameters
    ----------
    name : name of the driver
    given : the section ``arm.shape`` of the cell file

    Raises
    ------
    ConfigError : the driver is not installed, has no shape, or refuses this one
    """
    driver = find_driver("arm", name)
    if not isinstance(driver, ArmDriver):
        raise ConfigError(
            f"`arm.shape`: arm driver `{name}` does not say how its arm is built (`ArmDriver`); "
            "`devices.arm.driver` names the driver of the arm that this describes"
        )
    shape = _checked(driver.shape, given, "arm.shape")
    try:
        described = driver.describe(shape)
    except ValueError as error:
        raise ConfigError(f"`arm.shape`: {error}") from error
    if not isinstance(described, ArmDescription):
        raise ConfigError(f"arm driver `{name}`: `describe` returns no `ArmDescription`")
    try:
        digest_of(described.model)
    except TypeError as error:
        raise ConfigError(
            f"arm driver `{name}`: its model must be a dataclass of numbers and arrays, by which "
            f"cached plans are found again: {error}"
        ) from error
    return described


def _checked(model: type[Checked], given: Mapping[str, Any], where: str) -> Checked:
    """Return a driver's dataclass, filled from a section of the cell file.

    Raises
    ------
    ConfigError : an unknown key, a missing key, or a value that the driver refuses
    """
    known = [field.name for field in dataclasses.fields(model)]  # type: ignore[arg-type]  # a dataclass
    for key in given:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean `{near[0]}`?" if near else f"known here: {', '.join(known)}"
            if not known:
                hint = f"this driver has no {where.rpartition('.')[2]}"
            raise ConfigError(f"unknown key `{where}.{key}`; {hint}")
    try:
        return TypeAdapter(model).validate_python(dict(given))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join([where, *map(str, first["loc"])])
        raise ConfigError(f"`{key}`: {first['msg'].removeprefix('Value error, ')}") from error
    except ValueError as error:
        raise ConfigError(f"`{where}`: {error}") from error


def require_drivers(path: Path, cell: Cell) -> None:
    """Check that the driver of each device is installed and takes its settings.

    Parameters
    ----------
    path : path of the cell file, for messages
    cell : as read from that file

    Raises
    ------
    ConfigError : a driver is not installed or refuses its settings; names the device's line
    """
    for name, kind in KIND_OF.items():
        section = getattr(cell.devices, name)
        with _at_line(path, ("devices", name)):
            read_settings(find_driver(kind, section.driver), section.settings, f"devices.{name}")
    arm = cell.devices.arm.driver
    if isinstance(cell.arm, OtherArmSection):
        with _at_line(path, ("arm", "shape")):
            describe_arm(arm, cell.arm.shape)
    elif isinstance(find_driver("arm", arm), ArmDriver):
        with _at_line(path, ("arm",)):
            raise ConfigError(
                f"`arm.shape` is missing, by which the driver `{arm}` describes its arm; the keys "
                "here describe a UMI RTX"
            )


def require_force(path: Path, force_n: float, cell: Cell) -> None:
    """Check that the fixed gripper presses as hard as a recipe requires.

    Parameters
    ----------
    path : path of the recipe, for messages
    force_n : `grasp.force_n` of the recipe
    cell : cell whose gripper it is

    Raises
    ------
    ConfigError : it does not, or its driver is not installed
    """
    max_force_n = _max_force_n(cell)
    if force_n > max_force_n:
        with _at_line(path, ("grasp", "force_n")):
            raise ConfigError(
                f"`grasp.force_n`: {force_n:g} N, the fixed gripper of cell {cell.name} "
                f"({cell.devices.gripper.driver}) presses with {max_force_n:g} N at the most; ask "
                "for less"
            )


def _max_force_n(cell: Cell) -> float:
    """Return the largest force of a cell's fixed gripper [N].

    Raises
    ------
    ConfigError : its driver is not installed, or refuses its settings
    """
    section, own_force_n = cell.devices.gripper, cell.fixed_gripper.jaws.force_n
    driver = find_driver("gripper", section.driver)
    if driver.max_force_n is None:
        return own_force_n
    settings = read_settings(driver, section.settings, "devices.gripper")
    return min(own_force_n, driver.max_force_n(settings))


@contextmanager
def _at_line(path: Path, location: Location) -> Iterator[None]:
    """Prefix a ConfigError raised within with file and line."""
    try:
        yield
    except ConfigError as error:
        line = line_in(path, location)
        where = f"{path}:{line}" if line is not None else f"{path}"
        raise ConfigError(f"{where}: {error}") from error

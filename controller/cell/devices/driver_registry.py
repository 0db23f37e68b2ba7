"""Which drivers are installed: entry points of the group `cellctl.drivers` (docs/drivers.md)."""

import dataclasses
import difflib
from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from controller.config import Cell, ConfigError, line_in
from drivers.kinds import GROUP, Driver

KIND_OF: Final = {  # of each device of the cell file
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
    ConfigError : it is not installed, cannot be loaded, or is none
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
    except Exception as error:  # whatever a package of somebody else's does when it is imported
        raise ConfigError(
            f"{kind} driver `{name}`: {entry.value} cannot be loaded: {error!r:.200}"
        ) from error
    if not isinstance(driver, Driver):
        raise ConfigError(f"{kind} driver `{name}`: {entry.value} is no `drivers.kinds.Driver`")
    return driver


def read_settings(driver: Driver[Any, Any], given: Mapping[str, Any], where: str) -> Any:  # noqa: ANN401  (the driver's own dataclass)
    """Return a driver's settings, checked against its dataclass.

    Parameters
    ----------
    driver : whose settings
    given : what stands under ``settings:``
    where : for messages, such as ``devices.gripper``

    Raises
    ------
    ConfigError : an unknown key, a missing one, or a value that it refuses
    """
    known = [field.name for field in dataclasses.fields(driver.settings)]
    for key in given:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean `{near[0]}`?" if near else f"known here: {', '.join(known)}"
            if not known:
                hint = "this driver has no settings"
            raise ConfigError(f"unknown key `{where}.settings.{key}`; {hint}")
    try:
        return TypeAdapter(driver.settings).validate_python(dict(given))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"`{where}.settings.{key}`: {first['msg']}") from error
    except ValueError as error:
        raise ConfigError(f"`{where}.settings`: {error}") from error


def require_drivers(path: Path, cell: Cell) -> None:
    """Check that the driver of each device is installed and takes its settings.

    Parameters
    ----------
    path : of the cell file, for messages
    cell : as it was read from there

    Raises
    ------
    ConfigError : with the line of the device
    """
    for name, kind in KIND_OF.items():
        section = getattr(cell.devices, name)
        try:
            read_settings(find_driver(kind, section.driver), section.settings, f"devices.{name}")
        except ConfigError as error:
            line = line_in(path, ("devices", name))
            where = f"{path}:{line}" if line is not None else f"{path}"
            raise ConfigError(f"{where}: {error}") from error

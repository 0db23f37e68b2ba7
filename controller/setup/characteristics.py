"""The characteristics of a part by its recipe, its set of views and the cell that measures them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from controller.arrays import FloatArray
from controller.cad.compiled import CompiledPart
from controller.config import ConfigError, Recipe, line_in
from controller.config.cell import AccuracySection, Cell
from controller.config.characteristics import CharacteristicSection, GivenSection
from controller.config.recipe import InspectionSection
from controller.imaging import Camera
from controller.inspection.characteristics import (
    Accuracy,
    Asked,
    AskedError,
    Characteristic,
    CharacteristicKind,
    Station,
    characteristics_of,
)
from controller.inspection.dimensions import MeasuringSettings

from .optics import build_camera


def part_characteristics(
    path: Path,
    recipe: Recipe | None,
    part: CompiledPart,
    given: Sequence[GivenSection] | None = None,
) -> tuple[Characteristic, ...]:
    """Return the characteristics to be measured on a part.

    Parameters
    ----------
    path : path of the recipe, or of the set of views where there is none, for messages
    recipe : with a class of tolerances, and limits of its own; None for those of an empty recipe
    part : part with the statements of its file
    given : only these are measured; None for all that follow from CAD file and recipe

    Raises
    ------
    ConfigError : an entry names what the part does not have, or its limits make no sense
    """
    section = InspectionSection() if recipe is None else recipe.inspection
    changes = [_asked(entry) for entry in section.characteristics]
    chosen = None if given is None else [_given(entry) for entry in given]
    try:
        found = characteristics_of(part, section.tolerance_class, chosen, changes)
        if section.required == "stated":
            found = tuple(replace(c, is_required=not c.is_general) for c in found)
        return found
    except AskedError as error:
        if error.index >= len(changes):
            where = f"{path}: `characteristics.{error.index - len(changes)}`"
            raise ConfigError(f"{where}: {error}") from error
        line = line_in(path, ("inspection", "characteristics", error.index))
        where = f"{path}:{line}" if line is not None else f"{path}"
        raise ConfigError(
            f"{where}: `inspection.characteristics`: {error}; `cellctl compile` lists them all"
        ) from error


def _asked(section: CharacteristicSection) -> Asked:
    return Asked(
        name=section.id or "",
        faces=tuple(int(face[1:]) for face in section.faces or ()),
        kind=None if section.kind is None else CharacteristicKind(section.kind),
        nominal_mm=section.nominal,
        lower_mm=section.lower,
        upper_mm=section.upper,
        plus_mm=section.plus,
        minus_mm=section.minus,
        fit=section.fit or "",
        is_critical=section.critical,
        ignore=section.ignore or "",
    )


def _given(section: GivenSection) -> Asked:
    return Asked(
        name=section.id or "",
        kind=None if section.kind is None else CharacteristicKind(section.kind),
        p_part_mm=None if section.p_part_mm is None else np.array(section.p_part_mm, dtype=float),
        axis=None if section.axis is None else np.array(section.axis, dtype=float),
        nominal_mm=section.nominal_mm,
        lower_mm=section.lower,
        upper_mm=section.upper,
        is_critical=section.critical,
        source="set",
    )


def build_accuracy(section: AccuracySection) -> Accuracy:
    """Return the measuring accuracy of a cell."""
    return Accuracy(**section.model_dump())


def measuring_settings(section: AccuracySection) -> MeasuringSettings:
    """Return the uncertainties of measuring that the cell file states, before any picture."""
    return MeasuringSettings(
        lit_edge_px=section.light_px,
        lens_px=section.lens_px,
        scale=section.scale,
        temperature_k=section.temperature_k,
    )


def station_of(cell: Cell) -> Station:
    """Return the camera at the station, for measuring."""
    camera = build_camera(cell.cameras.inspection)
    return station_at(camera, np.array(cell.station.position, dtype=float))


def station_at(camera: Camera, p_world_mm: FloatArray) -> Station:
    """Return a camera at a world point (3,), for measuring."""
    distance = float((p_world_mm - camera.position_mm) @ camera.T_world_cam[:3, 2])
    mm_per_px = camera.mm_per_px(p_world_mm)
    return Station(mm_per_px, distance, mm_per_px * max(camera.size_px))

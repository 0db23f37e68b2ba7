"""Answers about the table: what stands there, its turns, and the codes on it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller import recognition as recognising
from controller.arrays import FloatArray, Grey
from controller.cell.journal.rows import SightingFields
from controller.imaging import Camera, ViewMaps, inverse_pose, render_maps, transform, view_roi
from controller.imaging.codes import read_codes as find_codes

from ...devices.lamps import TABLE_LAMPS
from ..job import Context, Job, context

# Border round the part in which its code is sought: how far off its pose may be in a view that is
# not judged yet, with the quiet zone of a code at its rim.
CODE_MARGIN_PX: Final = 40


def recognise(job: Job, backlit: Grey, lit: Mapping[str, Grey]) -> tuple[recognising.Sighting, ...]:
    """Return the objects recognised on the table.

    Parameters
    ----------
    job : recipe and cell
    backlit : picture of the light table
    lit : pictures of the same by lamp
    """
    c = context(job)
    pictures = [lit[lamp] for lamp in TABLE_LAMPS if lamp in lit]
    seen = recognising.recognise(
        backlit, c.overhead, c.library, "backlit", usable=c.glowing, lit=pictures
    )
    return tuple(_read_as_wanted(s, c) for s in seen.sightings)


def _read_as_wanted(s: recognising.Sighting, c: Context) -> recognising.Sighting:
    """Return a sighting as the first part of the batch that matches; unchanged if it is one."""
    if s.part in c.wanted:
        return s
    may_be = {one.part for one in s.ambiguous_with}
    name = next((name for name in c.wanted if name in may_be), None)
    return s if name is None else s.read_as(name, c.library)


def unseen_turns(
    job: Job, sightings: tuple[SightingFields, ...]
) -> tuple[tuple[float, ...] | None, ...]:
    """Return the turns about the vertical [deg] under which each object looks the same, 0 first.

    None means any turn. An unknown object has the turn 0 only.

    Parameters
    ----------
    job : recipe and cell
    sightings : objects on the table
    """
    entries = {entry.name: entry for entry in context(job).library.entries}
    found: list[tuple[float, ...] | None] = []
    for seen in sightings:
        entry = None if seen.part is None else entries.get(seen.part)
        turns = np.zeros(1) if entry is None else entry.turns_of(seen.pose_index)
        found.append(tuple(np.degrees(turns).tolist()) if len(turns) else None)
    return tuple(found)


@dataclass(frozen=True, eq=False, slots=True)
class SeenCode:
    """A code in pictures of the part.

    Attributes
    ----------
    text, fields : all it says; by identifier, where it has fields
    picture : number of the first picture that shows it
    corners_mm : (4, 3) corners in the part frame; None beside the part
    """

    text: str
    fields: Mapping[str, str]
    picture: int
    corners_mm: FloatArray | None


def read_codes(
    job: Job, pictures: tuple[Grey, ...], T_world_part: FloatArray, *, is_held: bool
) -> tuple[SeenCode, ...]:
    """Return the codes that pictures of one view show, each text once.

    Parameters
    ----------
    job : recipe, which names the symbology and where the code is, and cell
    pictures : (height, width) each, under one lamp or another
    T_world_part : (4, 4) pose of the part there
    is_held : before the inspection camera; otherwise on the table
    """
    c = context(job)
    asked = c.recipe.serial_code
    camera = c.inspection if is_held else c.overhead
    roi = view_roi(c.solid.mesh.vertices, T_world_part, camera, CODE_MARGIN_PX)
    if asked is None or roi is None:
        return ()
    maps = render_maps(c.posed.caster, T_world_part, camera, roi)
    x0, y0, x1, y1 = roi if asked.at == "part" else (0, 0, *camera.size_px)
    found: dict[str, SeenCode] = {}
    for number, picture in enumerate(pictures):
        for code in find_codes(picture[y0:y1, x0:x1], (asked.code,)):
            corners_px = code.corners_px + np.array((x0, y0))
            corners_mm = _on_part(c, maps, T_world_part, camera, corners_px)
            if (corners_mm is None) == (asked.at == "beside"):
                found.setdefault(
                    code.text, SeenCode(code.text, dict(code.fields), number, corners_mm)
                )
    return tuple(found.values())


def _on_part(
    c: Context, maps: ViewMaps, T_world_part: FloatArray, camera: Camera, corners_px: FloatArray
) -> FloatArray | None:
    """Return the corners (4, 3) of a code in the part frame; None if its middle is not on it."""
    x, y = np.round(corners_px.mean(axis=0)).astype(int) - maps.roi[:2]
    height, width = maps.triangle.shape
    if not (0 <= x < width and 0 <= y < height) or maps.triangle[y, x] < 0:
        return None
    triangle = maps.triangle[y, x]
    T_part_world = inverse_pose(T_world_part)
    eye = transform(T_part_world, camera.position_mm[None])[0]
    lines = camera.sight_lines(corners_px) @ T_part_world[:3, :3].T
    normal = c.solid.mesh.face_normals[triangle]
    on_face = c.solid.mesh.triangles[triangle][0]
    far = ((on_face - eye) @ normal) / (lines @ normal)
    corners_mm: FloatArray = eye + far[:, None] * lines
    return corners_mm

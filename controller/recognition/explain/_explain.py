"""Explanation of a recognition: a picture, and the figures of its stages."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.arrays import Grey
from controller.imaging import Camera

from ..identification.sighting import Recognition
from ..library import Library
from ._facts import object_facts
from ._page import draw_page
from ._tables import StageTable, stage_tables


@dataclass(frozen=True, eq=False, slots=True)
class Explanation:
    """The stages of a recognition, in a picture and in tables.

    Attributes
    ----------
    picture : (h, w, 3) uint8 blue, green, red: the table with what was found, details below
    tables : the stages, first to last
    """

    picture: NDArray[np.uint8]
    tables: tuple[StageTable, ...]


def explain(
    picture: Grey, camera: Camera, library: Library, seen: Recognition, title: str = ""
) -> Explanation:
    """Return the explanation of `recognise`'s result for a picture.

    Parameters
    ----------
    picture, camera, library : inputs of the recognition
    seen : its answer
    title : written on the picture

    Raises
    ------
    ValueError : the picture is not of the camera's size
    """
    if picture.shape != camera.size_px[::-1]:
        raise ValueError(f"a picture {picture.shape[::-1]} from a camera of {camera.size_px}")
    facts = object_facts(picture, camera, library, seen)
    return Explanation(
        draw_page(picture, camera, library, facts, title), stage_tables(seen, facts, library)
    )

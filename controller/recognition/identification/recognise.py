"""Recognition: from a picture of the table to sightings of part, stable pose and place.

The order is the paper's (references.md P3.0). Things are cut out of the picture. Each is sought as
one part (`lone`): its outline searches the library, the best candidates are fitted edge by edge
under full perspective, and the evidence for each decides; under lamps, edges propose others. What
is no part as a whole is taken apart (`clusters`); what stays unknown under several lamps is looked
at wider (`wider`).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from controller.arrays import BoolArray, Grey
from controller.imaging import Camera

from ..library import Library
from ..segmentation import Segmentation, brightest_of, segment
from .clusters import Answers, each_once, taken_apart, taken_apart_backlit
from .lone import identify
from .scene import TableScene
from .sighting import Recognition, Sighting, Trace
from .wider import looked_wider


def recognise(
    picture: Grey,
    camera: Camera,
    library: Library,
    lighting: Literal["backlit", "front", "auto"] = "auto",
    usable: BoolArray | None = None,
    lit: Sequence[Grey] = (),
) -> Recognition:
    """Return the things on the table, the largest first.

    An empty table is an empty answer.

    Parameters
    ----------
    picture : (height, width) grey
    camera : overhead, calibrated
    library : library of the possible parts, made for this camera
    lighting : a light table, lamps above a matt one, or "auto" to tell from the picture
    usable : (height, width) mask of the area for parts (the backlit area); elsewhere nothing is
        visible
    lit : pictures of the same scene under other lamps. Before a light table they decide what
        silhouettes cannot, parts that lie on others among it; under lamps all pictures are judged
        as one

    Raises
    ------
    ValueError : the picture is not of the camera's size, or not 8 bits deep
    """
    width, height = camera.size_px
    if picture.shape != (height, width):
        raise ValueError(f"a picture {picture.shape[::-1]} from a camera of {camera.size_px}")
    scene = TableScene((*lit, picture), camera, library, True, usable)
    is_backlit = lighting != "front"
    if is_backlit or not lit:
        found = segment(picture, lighting, usable, scene.least_px)
        is_backlit = found.lighting == "backlit"
    if is_backlit:
        return _recognition([taken_apart_backlit(r, scene) for r in found.regions], found)
    pictures = (brightest_of((picture, *lit)), picture, *lit) if lit else (picture,)
    scene = replace(scene, pictures=pictures, is_backlit=False)
    if lit:
        found = segment(pictures[0], "front", usable, scene.least_px)
    every: list[Answers] = [(region, [identify(region, scene)]) for region in found.regions]
    every, wider = looked_wider(every, scene) if lit else (every, [])
    every = taken_apart(every, scene)
    if wider:
        every = sorted([*every, *wider], key=lambda one: -one[0].area_px)
    return _recognition(each_once(every), found)


def _recognition(every: Sequence[Answers], found: Segmentation) -> Recognition:
    """Return the answers about all regions as one, numbered through."""
    sightings: list[Sighting] = []
    traces: list[Trace] = []
    for _, answers in every:
        first = len(sightings)
        for seen, trace in answers:
            below = tuple(first + k for k in seen.lies_on)
            sightings.append(replace(seen, lies_on=below) if below else seen)
            traces.append(trace)
    return Recognition(tuple(sightings), tuple(traces), found)

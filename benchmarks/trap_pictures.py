"""Pictures that are not what they should be: faults of light, lens, camera, files, and of the hold.

Each fault changes the pictures of a stored set, one view or all of them, by what a generator draws.
The part stays as it is. Those of the tracer (trace_held_sensor.py) are among them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from trace_held_light import LAMPS
from trace_held_sensor import TRAPS as TRACED
from trace_held_sensor import Pictures

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Words = dict[str, Any]
BACKLIGHT, LIT = LAMPS[0], LAMPS[1:]
WHITE = 255
Fault = Callable[[Pictures, np.random.Generator, Pictures], Words]


def grey(values: Array) -> Picture:
    return np.asarray(np.clip(np.round(values), 0, WHITE), np.uint8)


def _one(pictures: Pictures, rng: np.random.Generator) -> int:
    return int(rng.integers(len(pictures)))


def _lamp(rng: np.random.Generator, lamps: tuple[str, ...] = LAMPS) -> str:
    return str(lamps[int(rng.integers(len(lamps)))])


def on_part(view: dict[str, Picture], rng: np.random.Generator) -> Array:
    """Return a point (u, v) on the part, or on what holds it: dark before the panel."""
    panel = view[BACKLIGHT].astype(np.float64)
    dark = cv2.erode((panel < 0.4 * np.percentile(panel, 95)).astype(np.uint8), np.ones((15, 15)))
    height, width = dark.shape
    near = np.zeros_like(dark)
    near[height // 5 : -height // 5, width // 5 : -width // 5] = 1
    v, u = np.nonzero(dark * near)
    if not len(u):
        return np.array([width / 2, height / 2])
    k = int(rng.integers(len(u)))
    return np.array([u[k], v[k]], float)


def _grid(picture: Picture) -> tuple[Array, Array]:
    v, u = np.mgrid[0 : picture.shape[0], 0 : picture.shape[1]]
    return u.astype(float), v.astype(float)


# ------------------------------------------------------------------ light


def _glared(picture: Picture, at: Array, size: float) -> Picture:
    """Return a picture with a bright disc, burnt out, and its bloom."""
    u, v = _grid(picture)
    d = np.hypot(u - at[0], v - at[1]) / size
    return grey(picture + 300.0 * (d < 1) + 90.0 * np.exp(-np.maximum(d - 1, 0) * 3))


def glare_one(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """A reflection on the part in one picture."""
    i, lamp = _one(pictures, rng), _lamp(rng, LIT)
    at, size = on_part(pictures[i], rng), float(rng.uniform(8, 45))
    pictures[i][lamp] = _glared(pictures[i][lamp], at, size)
    return {"view": i, "lamp": lamp, "at_px": at.tolist(), "size_px": size}


def glare_all(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """A lamp of the room on the part, in all lit pictures."""
    size = float(rng.uniform(8, 45))
    for view in pictures:
        at = on_part(view, rng)
        for lamp in LIT:
            view[lamp] = _glared(view[lamp], at, size)
    return {"size_px": size}


def _scaled(by: float, add: float = 0.0) -> Callable[[Picture], Picture]:
    return lambda p: grey(by * p.astype(np.float64) + add)


def _change_one(
    pictures: Pictures, rng: np.random.Generator, lamps: tuple[str, ...],
    change: Callable[[Picture], Picture],
) -> Words:  # fmt: skip
    i, lamp = _one(pictures, rng), _lamp(rng, lamps)
    pictures[i][lamp] = change(pictures[i][lamp])
    return {"view": i, "lamp": lamp}


def _change_lamp(
    pictures: Pictures, rng: np.random.Generator, lamps: tuple[str, ...],
    change: Callable[[Picture], Picture],
) -> Words:  # fmt: skip
    lamp = _lamp(rng, lamps)
    for view in pictures:
        view[lamp] = change(view[lamp])
    return {"lamp": lamp}


def burnt_one(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    return _change_one(pictures, rng, LIT, _scaled(float(rng.uniform(2, 4))))


def burnt_all(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    return _change_lamp(pictures, rng, LIT, _scaled(float(rng.uniform(2, 4))))


def white_one(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    return _change_one(pictures, rng, LAMPS, lambda p: np.full_like(p, WHITE))


def dimmed_one(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    return _change_one(pictures, rng, LAMPS, _scaled(0.5))


def dimmed_all(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    return _change_lamp(pictures, rng, LAMPS, _scaled(0.5))


def dead_one(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    return _change_one(pictures, rng, LAMPS, _scaled(0.0, 2.0))


def stray_light(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """Daylight in the cell: all pictures of a lamp lighter by as much."""
    return _change_lamp(pictures, rng, LIT, _scaled(1.0, float(rng.uniform(15, 50))))


def uneven(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """A lamp that is brighter to one side."""
    angle, by = rng.uniform(0, 2 * np.pi), float(rng.uniform(0.2, 0.5))

    def change(p: Picture) -> Picture:
        u, v = _grid(p)
        along = (u / p.shape[1] - 0.5) * np.cos(angle) + (v / p.shape[0] - 0.5) * np.sin(angle)
        return grey(p * (1 + 2 * by * along))

    return _change_lamp(pictures, rng, LIT, change) | {"by": by}


def panel_left_on(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """The panel is on while a lamp is."""
    lamp, share = _lamp(rng, LIT), float(rng.uniform(0.3, 1.0))
    for view in pictures:
        view[lamp] = grey(view[lamp] + share * view[BACKLIGHT].astype(np.float64))
    return {"lamp": lamp, "share": share}


def both_lamps_on(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """A lamp that does not go off, while the other is on."""
    lamp = _lamp(rng, LIT)
    other = next(name for name in LIT if name != lamp)
    for view in pictures:
        view[lamp] = grey(view[lamp] + 0.6 * view[other].astype(np.float64))
    return {"lamp": lamp}


# ------------------------------------------------------------------ lens and camera


def _blurred(sigma_px: float) -> Callable[[Picture], Picture]:
    return lambda p: np.asarray(cv2.GaussianBlur(p, (0, 0), sigma_px), np.uint8)


def blur_one(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    sigma = float(rng.uniform(1.5, 4))
    return _change_one(pictures, rng, LAMPS, _blurred(sigma)) | {"sigma_px": sigma}


def blur_view(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    i, sigma = _one(pictures, rng), float(rng.uniform(1.5, 4))
    for lamp in LAMPS:
        pictures[i][lamp] = _blurred(sigma)(pictures[i][lamp])
    return {"view": i, "sigma_px": sigma}


def noise(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    sigma = float(rng.uniform(5, 15))
    for view in pictures:
        for lamp in LAMPS:
            view[lamp] = grey(view[lamp] + sigma * rng.standard_normal(view[lamp].shape))
    return {"sigma": sigma}


def bright_pixels(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """Pixels of the sensor that stay light, and a column, in all pictures."""
    height, width = pictures[0][BACKLIGHT].shape
    v, u = rng.integers(0, height, 60), rng.integers(0, width, 60)
    column = int(width / 2 + rng.uniform(-150, 150))
    for view in pictures:
        for lamp in LAMPS:
            view[lamp] = view[lamp].copy()
            view[lamp][v, u] = 240
            view[lamp][:, column] = 200
    return {"column": column}


def mirrored_pictures(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """The camera's driver mirrors its pictures."""
    for view in pictures:
        for lamp in LAMPS:
            view[lamp] = np.ascontiguousarray(view[lamp][:, ::-1])
    return {}


def _moved(by: Array) -> Callable[[Picture], Picture]:
    T = np.array([[1, 0, by[0]], [0, 1, by[1]]], float)
    return lambda p: np.asarray(
        cv2.warpAffine(p, T, (p.shape[1], p.shape[0]), borderMode=cv2.BORDER_REPLICATE), np.uint8
    )


def _shift(rng: np.random.Generator) -> Array:
    a = rng.uniform(0, 2 * np.pi)
    return np.asarray(rng.uniform(2, 6) * np.array([np.cos(a), np.sin(a)]))


def shifted_one(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    by = _shift(rng)
    return _change_one(pictures, rng, LAMPS, _moved(by)) | {"by_px": by.tolist()}


# ------------------------------------------------------------------ in front


def covered_one(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """A finger or a cloth over a piece of the part, in all pictures of a view."""
    return _cover(pictures, rng, [_one(pictures, rng)])


def covered_all(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    return _cover(pictures, rng, range(len(pictures)))


def _cover(pictures: Pictures, rng: np.random.Generator, views: Iterable[int]) -> Words:
    half = rng.uniform(10, 50, 2)
    said = []
    for i in views:
        at = on_part(pictures[i], rng)
        u, v = _grid(pictures[i][BACKLIGHT])
        inside = (np.abs(u - at[0]) < half[0]) & (np.abs(v - at[1]) < half[1])
        for lamp in LAMPS:
            dark = np.where(inside, rng.uniform(8, 30) + rng.standard_normal(u.shape), 0)
            pictures[i][lamp] = grey(np.where(inside, dark, pictures[i][lamp]))
        said.append([int(i), *at.tolist()])
    return {"half_px": half.tolist(), "at_px": said}


def cable(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """A cable hangs across a view."""
    i, wide = _one(pictures, rng), float(rng.uniform(4, 16))
    at, a = on_part(pictures[i], rng), rng.uniform(0, np.pi)
    u, v = _grid(pictures[i][BACKLIGHT])
    inside = np.abs((u - at[0]) * np.sin(a) - (v - at[1]) * np.cos(a)) < wide / 2
    for lamp in LAMPS:
        soft = cv2.GaussianBlur(inside.astype(np.float64), (0, 0), 0.8)
        pictures[i][lamp] = grey(pictures[i][lamp] * (1 - soft) + 14.0 * soft)
    return {"view": i, "wide_px": wide}


def hair(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """A short dark hair on the part, in the lit pictures of a view."""
    i = _one(pictures, rng)
    at, a = on_part(pictures[i], rng), rng.uniform(0, np.pi)
    ends = at + np.array([[1.0], [-1.0]]) * rng.uniform(6, 25) * np.array([np.cos(a), np.sin(a)])
    for lamp in LIT:
        soft = np.zeros(pictures[i][lamp].shape)
        cv2.line(soft, *np.round(ends).astype(int).tolist(), 1.0, 1)
        soft = cv2.GaussianBlur(soft, (0, 0), 0.7)
        pictures[i][lamp] = grey(pictures[i][lamp] * (1 - np.minimum(soft, 0.9)))
    return {"view": i, "at_px": at.tolist()}


# ------------------------------------------------------------------ files


def _two(pictures: Pictures, rng: np.random.Generator) -> tuple[int, int]:
    i, j = rng.choice(len(pictures), 2, replace=False)
    return int(i), int(j)


def swapped_lamp(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """Two views' pictures of one lamp are exchanged."""
    (i, j), lamp = _two(pictures, rng), _lamp(rng)
    pictures[i][lamp], pictures[j][lamp] = pictures[j][lamp], pictures[i][lamp]
    return {"views": [i, j], "lamp": lamp}


def stale_view(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """A view has the pictures of another one."""
    i, j = _two(pictures, rng)
    pictures[i] = dict(pictures[j])
    return {"view": i, "is": j}


def stale_picture(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """A lit picture of a view is the other lamp's, once more."""
    i = _one(pictures, rng)
    pictures[i][LIT[0]] = pictures[i][LIT[1]]
    return {"view": i}


def lamps_swapped_one(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    i = _one(pictures, rng)
    a, b = LIT[0], LIT[1]
    pictures[i][a], pictures[i][b] = pictures[i][b], pictures[i][a]
    return {"view": i}


def other_part_one(pictures: Pictures, rng: np.random.Generator, other: Pictures) -> Words:
    """One view has the pictures of another specimen."""
    i = _one(pictures, rng)
    pictures[i] = dict(other[min(i, len(other) - 1)])
    return {"view": i}


def other_part_all(pictures: Pictures, rng: np.random.Generator, other: Pictures) -> Words:
    for i in range(len(pictures)):
        pictures[i] = dict(other[i % len(other)])
    return {}


def view_missing(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    i = _one(pictures, rng)
    pictures[i] = {}
    return {"view": i}


def lamp_missing(pictures: Pictures, rng: np.random.Generator, _other: Pictures) -> Words:
    """A view has no picture under one of its lamps."""
    i, lamp = _one(pictures, rng), _lamp(rng, LIT)
    pictures[i] = {k: p for k, p in pictures[i].items() if k != lamp}
    return {"view": i, "lamp": lamp}


def _traced(name: str) -> Fault:
    return lambda pictures, rng, _other: TRACED[name](pictures, rng)


FAULTS: dict[str, Fault] = {
    f.__name__: f
    for f in (
        glare_one, glare_all, covered_one, covered_all, cable, hair, shifted_one, burnt_one,
        burnt_all, white_one, dimmed_one, dimmed_all, dead_one, stray_light, uneven, panel_left_on,
        both_lamps_on, blur_one, blur_view, noise, bright_pixels, mirrored_pictures, swapped_lamp,
        stale_view, stale_picture, lamps_swapped_one, other_part_one, other_part_all, view_missing,
        lamp_missing,
    )
} | {name: _traced(name) for name in TRACED}  # fmt: skip

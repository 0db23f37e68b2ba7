"""From radiance to 8-bit pictures: exposure, lens, noise; and what may go wrong with a picture.

The traps are faults of the station, not of the part: lamps, focus, dirt, files. They are made on
radiance where light does it, on pictures where a cable or a program does it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from trace_held_light import LAMPS

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Words = dict[str, Any]
Radiance = dict[str, NDArray[np.float32]]  # by lamp
Pictures = list[dict[str, Picture]]  # view by view, by lamp


def draw_sensor(rng: np.random.Generator) -> Words:
    """Return lens and sensor; noise in grey levels, shot noise as variance a grey level."""
    return {
        "blur_px": round(rng.uniform(0.55, 0.95), 3),
        "vignette": round(rng.uniform(0.05, 0.16), 3),
        "read": round(rng.uniform(0.25, 1.2), 3),
        "shot": round(float(np.exp(rng.uniform(np.log(0.0007), np.log(0.006)))), 5),
        "veil": round(rng.uniform(0.001, 0.006), 5),
        "drift": 0.02,
    }


def exposures(views: list[Radiance], labels: list[NDArray[np.int8]]) -> dict[str, float]:
    """Return a gain by lamp, so that the part's bright areas, over all views, are light grey."""
    out = {"backlight": 0.9}
    for lamp in LAMPS[1:]:
        bright = [
            np.percentile(view[lamp][label == 0], 96)
            for view, label in zip(views, labels, strict=True)
            if (label == 0).any()
        ]
        out[lamp] = round(float(0.78 / max(np.percentile(bright, 95), 1e-3)), 5)
    return out


def develop(
    light: NDArray[np.float32], gain: float, sensor: Words, rng: np.random.Generator
) -> Picture:
    """Return the 8-bit picture of radiance (height, width), 1 being white at gain 1."""
    height, width = light.shape
    v, u = np.mgrid[0:height, 0:width]
    middle = (width - 1) / 2 + sensor.get("off_axis_px", 0.0), (height - 1) / 2
    r2 = ((u - middle[0]) ** 2 + (v - middle[1]) ** 2) / (width**2 + height**2) * 4
    grey = cv2.GaussianBlur(light, (0, 0), sensor["blur_px"]).astype(np.float64)
    small = cv2.resize(np.minimum(light, 3.0), None, fx=1 / 8, fy=1 / 8,
                       interpolation=cv2.INTER_AREA)  # fmt: skip
    veil = cv2.GaussianBlur(small, (0, 0), 20)
    grey += sensor["veil"] * cv2.resize(veil, (width, height), interpolation=cv2.INTER_LINEAR)
    drift = 1.0 + sensor["drift"] * rng.uniform(-1, 1)
    grey *= 255.0 * gain * drift * (1.0 - sensor["vignette"] * r2)
    noise = np.sqrt(sensor["read"] ** 2 + sensor["shot"] * np.maximum(grey, 0.0))
    grey += noise * rng.standard_normal(grey.shape)
    out: Picture = np.clip(np.round(grey), 0, 255).astype(np.uint8)
    return out


def _each(pictures: Pictures, change: Callable[[Picture], Picture]) -> None:
    for view in pictures:
        for lamp in view:
            view[lamp] = change(view[lamp])


def lamp_swapped(pictures: Pictures, rng: np.random.Generator) -> Words:
    """The ring's and the side lamp's cables are exchanged."""
    for view in pictures:
        view["ring"], view["side"] = view["side"], view["ring"]
    return {"views": list(range(len(pictures)))}


def lamp_dead(pictures: Pictures, rng: np.random.Generator) -> Words:
    lamp = LAMPS[int(rng.integers(3))]
    for view in pictures:
        view[lamp] = np.clip(
            np.round(1.0 + 0.5 * rng.standard_normal(view[lamp].shape)), 0, 255
        ).astype(np.uint8)
    return {"lamp": lamp, "views": list(range(len(pictures)))}


def glare(pictures: Pictures, rng: np.random.Generator) -> Words:
    """A reflection somewhere in the room: one wide bright spot in lit pictures."""
    said = []
    for i, view in enumerate(pictures):
        lamp = LAMPS[1 + int(rng.integers(2))]
        height, width = view[lamp].shape
        at = width / 2 + rng.uniform(-150, 150), height / 2 + rng.uniform(-120, 120)
        size = rng.uniform(18, 60)
        v, u = np.mgrid[0:height, 0:width]
        d2 = ((u - at[0]) ** 2 + 2.2 * (v - at[1]) ** 2) / size**2
        add = 420.0 * np.exp(-d2) + 40.0 * np.exp(-d2 / 6)
        view[lamp] = np.clip(view[lamp] + add, 0, 255).astype(np.uint8)
        said.append([i, lamp, round(at[0]), round(at[1]), round(size)])
    return {"spots": said}


def blur(pictures: Pictures, rng: np.random.Generator) -> Words:
    """The part shook: every picture is smeared along a line."""
    length, angle = rng.uniform(5, 10), rng.uniform(0, np.pi)
    t = np.linspace(-length / 2, length / 2, 41)
    kernel = np.zeros((15, 15))
    for s in t:
        x, y = 7 + s * np.cos(angle), 7 + s * np.sin(angle)
        i, j = int(np.floor(y)), int(np.floor(x))
        a, b = y - i, x - j
        for di, dj, w in (
            (0, 0, (1 - a) * (1 - b)),
            (1, 0, a * (1 - b)),
            (0, 1, (1 - a) * b),
            (1, 1, a * b),
        ):
            kernel[i + di, j + dj] += w
    kernel /= kernel.sum()
    _each(pictures, lambda p: np.asarray(cv2.filter2D(p, -1, kernel), np.uint8))
    return {"length_px": length, "angle_deg": float(np.degrees(angle))}


def defocus(pictures: Pictures, rng: np.random.Generator) -> Words:
    radius = rng.uniform(2.5, 5)
    y, x = np.mgrid[-7:8, -7:8]
    disk = np.clip(radius + 0.5 - np.hypot(x, y), 0, 1)
    disk /= disk.sum()
    _each(pictures, lambda p: np.asarray(cv2.filter2D(p, -1, disk), np.uint8))
    return {"radius_px": radius}


def shifted(pictures: Pictures, rng: np.random.Generator) -> Words:
    """Lit pictures are off against the backlit one by some pixels: the part slipped."""
    a = rng.uniform(0, 2 * np.pi)
    by = rng.uniform(3, 7) * np.array([np.cos(a), np.sin(a)])
    affine = np.array([[1, 0, by[0]], [0, 1, by[1]]])
    for view in pictures:
        for lamp in LAMPS[1:]:
            height, width = view[lamp].shape
            view[lamp] = np.asarray(
                cv2.warpAffine(
                    view[lamp], affine, (width, height), borderMode=cv2.BORDER_REPLICATE
                ),
                np.uint8,
            )
    return {"by_px": by.tolist()}


def views_swapped(pictures: Pictures, rng: np.random.Generator) -> Words:
    i, j = rng.choice(len(pictures), 2, replace=False)
    pictures[i], pictures[j] = pictures[j], pictures[i]
    return {"views": [int(i), int(j)]}


def dirt(pictures: Pictures, rng: np.random.Generator) -> Words:
    """Dirt on the window before the lens: the same dim blots in every picture."""
    height, width = pictures[0]["ring"].shape
    v, u = np.mgrid[0:height, 0:width]
    factor = np.ones((height, width))
    said = []
    for _ in range(int(rng.integers(3, 8))):
        at = width / 2 + rng.uniform(-260, 260), height / 2 + rng.uniform(-200, 200)
        size, deep = rng.uniform(5, 22), rng.uniform(0.2, 0.7)
        d = np.hypot(u - at[0], (v - at[1]) * rng.uniform(0.7, 1.4)) / size
        factor *= 1 - deep / (1 + np.exp((d - 1) * 6))
        said.append([round(at[0]), round(at[1]), round(size), round(deep, 2)])
    _each(pictures, lambda p: np.clip(np.round(p * factor), 0, 255).astype(np.uint8))
    return {"spots": said}


TRAPS: dict[str, Callable[[Pictures, np.random.Generator], Words]] = {
    f.__name__: f
    for f in (lamp_swapped, blur, glare, shifted, lamp_dead, defocus, dirt, views_swapped)
}
IN_FRONT = "gripper_in_front"  # made where the scene is, not on pictures

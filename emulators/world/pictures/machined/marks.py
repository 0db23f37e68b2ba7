"""Tool marks, sparkling facets, dust and oil film on a face, as tables looked up in mm.

All tables repeat; their periods are longer than the faces of small parts, and every face begins
elsewhere in them.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from ...shapes import Array
from ..geometry import Array32

_SIDE: Final = 1024
MARK_MM: Final = 0.15  # pitch of the finest tool marks
MARK_LONG_MM: Final = 4.0  # length over which a mark stays the same
FEED_MM: Final = 0.6  # pitch of coarser marks, one for each pass of the tool
FEED_LONG_MM: Final = 25.0
MARK_TILT: Final = 0.045  # slope of their flanks, root mean square
FEED_TILT: Final = 0.025
MARK_ALBEDO: Final = 0.02
SPARKLE_MM: Final = 0.25
SPARKLE_SHARE: Final = 0.004  # share of all places
SPARKLE_TILT: Final = 0.2
SPARKLE_GLOSS: Final = 3.0
DUST_MM: Final = 0.1
DUST_PER_MM2: Final = 0.01
DUST_RADIUS_MM: Final = (0.06, 0.22)
DUST_ALBEDO: Final = (0.25, 0.85)
OIL_MM: Final = 0.4
OIL_PATCH_MM: Final = 8.0
OIL_SHARE: Final = 0.25  # share of a face
OIL_GLOSS: Final = 1.6  # factor of the highlight where the film is full
OIL_SHINE: Final = 1.8
OIL_ALBEDO: Final = 0.90


@dataclass(frozen=True, slots=True, eq=False)
class Marked:
    """The effect of marks on some places of a surface, (n,) each.

    Attributes
    ----------
    across, along : slopes that tilt the normal
    albedo, gloss, shine : factors on those of the material; `dust` of the place is covered by dust
        of albedo `dust_albedo`
    """

    across: Array32
    along: Array32
    albedo: Array32
    gloss: Array32
    shine: Array32
    dust: Array32
    dust_albedo: Array32

    def applied(self, plain: tuple[Array32, Array32, Array32]) -> tuple[Array32, Array32, Array32]:
        """Return albedo, gloss and shine with the marks, of those without."""
        albedo, gloss, shine = plain
        bare = np.float32(1.0) - self.dust
        covered = albedo * self.albedo * bare + self.dust_albedo * self.dust
        return covered, gloss * self.gloss * bare, shine * self.shine


class Marks:
    """The marks of one part.

    Parameters
    ----------
    rng : draws all of them
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._fine = _soft(rng, 0.0, 0.0)
        self._coarse = _soft(rng, 0.6, 0.0)
        sparkles = rng.random((_SIDE, _SIDE)) < SPARKLE_SHARE
        self._sparkle = sparkles.astype(np.float32)
        self._sparkle_tilt = [
            (sparkles * rng.normal(0.0, SPARKLE_TILT, sparkles.shape)).astype(np.float32)
            for _ in range(2)
        ]
        self._dust, self._dust_albedo = _specks(rng)
        film = _soft(rng, OIL_PATCH_MM / OIL_MM, OIL_PATCH_MM / OIL_MM)
        start = float(np.quantile(film, 1.0 - OIL_SHARE))
        self._oil = np.clip(2.0 * (film - start), 0.0, 1.0).astype(np.float32)

    def at(self, across_mm: Array, along_mm: Array, footprint_mm: Array) -> Marked:
        """Return the marks at places of faces.

        Parameters
        ----------
        across_mm, along_mm : (n,) across the tool marks and along them
        footprint_mm : (n,) footprint of a pixel there; finer marks average out in it
        """
        fine = _look_up(self._fine, across_mm / MARK_MM, along_mm / MARK_LONG_MM)
        fine = fine * _left(footprint_mm, MARK_MM)
        coarse = _look_up(self._coarse, across_mm / FEED_MM, along_mm / FEED_LONG_MM)
        coarse = coarse * _left(footprint_mm, FEED_MM)
        place = (across_mm / SPARKLE_MM, along_mm / SPARKLE_MM)
        few = _left(footprint_mm, SPARKLE_MM)
        sparkle = _look_up(self._sparkle, *place) * few
        tilts = [_look_up(one, *place) * few for one in self._sparkle_tilt]
        dust = _look_up(self._dust, across_mm / DUST_MM, along_mm / DUST_MM)
        dust_albedo = _look_up(self._dust_albedo, across_mm / DUST_MM, along_mm / DUST_MM)
        oil = _look_up(self._oil, across_mm / OIL_MM, along_mm / OIL_MM)
        one = np.float32(1.0)
        return Marked(
            across=np.float32(MARK_TILT) * fine + np.float32(FEED_TILT) * coarse + tilts[0],
            along=tilts[1],
            albedo=(one + np.float32(MARK_ALBEDO) * fine) * (one + (OIL_ALBEDO - one) * oil),
            gloss=(one + np.float32(SPARKLE_GLOSS - 1.0) * sparkle)
            * (one + np.float32(OIL_GLOSS - 1.0) * oil),
            shine=one + np.float32(OIL_SHINE - 1.0) * oil,
            dust=dust,
            dust_albedo=dust_albedo,
        )


def _left(footprint_mm: Array, pitch_mm: float) -> Array32:
    """Return the share of independent marks that remains in the mean over a pixel."""
    left: Array32 = np.minimum(1.0, np.sqrt(pitch_mm / footprint_mm)).astype(np.float32)
    return left


def _soft(rng: np.random.Generator, across: float, along: float) -> Array32:
    """Return noise of standard deviation 1, smooth over a width; it repeats seamlessly."""
    noise = rng.standard_normal((_SIDE, _SIDE))
    if across or along:
        fx, fy = np.fft.rfftfreq(_SIDE)[None], np.fft.fftfreq(_SIDE)[:, None]
        keep = np.exp(-2.0 * np.pi**2 * ((across * fx) ** 2 + (along * fy) ** 2))
        noise = np.fft.irfft2(np.fft.rfft2(noise) * keep, s=noise.shape)
    soft: Array32 = ((noise - noise.mean()) / noise.std()).astype(np.float32)
    return soft


def _specks(rng: np.random.Generator) -> tuple[Array32, Array32]:
    """Return the share of each place that dust covers, and the dust's albedo there."""
    cover = np.zeros((_SIDE, _SIDE), np.float32)
    albedo = np.full((_SIDE, _SIDE), np.mean(DUST_ALBEDO), np.float32)
    count = rng.poisson(DUST_PER_MM2 * (_SIDE * DUST_MM) ** 2)
    bits = 3
    for x, y, radius, kind in zip(
        rng.uniform(8.0, _SIDE - 8.0, count),
        rng.uniform(8.0, _SIDE - 8.0, count),
        rng.uniform(*DUST_RADIUS_MM, count) / DUST_MM,
        rng.integers(0, 2, count),
        strict=True,
    ):
        at = (round(float(x) * 2**bits), round(float(y) * 2**bits))
        size = max(1, round(float(radius) * 2**bits))
        cv2.circle(cover, at, size, 1.0, -1, cv2.LINE_8, bits)
        wide = max(1, round(float(radius + 2.0) * 2**bits))
        cv2.circle(albedo, at, wide, DUST_ALBEDO[kind], -1, cv2.LINE_8, bits)
    return np.asarray(cv2.GaussianBlur(cover, (5, 5), 0.8), np.float32), albedo


def _look_up(table: Array32, x: Array, y: Array) -> Array32:
    """Return a table's values between its places, (n,) -> (n,); it repeats."""
    column, row = np.floor(x), np.floor(y)
    fx, fy = (x - column).astype(np.float32), (y - row).astype(np.float32)
    u, v = column.astype(np.int64) % _SIDE, row.astype(np.int64) % _SIDE
    u1, v1 = (u + 1) % _SIDE, (v + 1) % _SIDE
    upper = table[v, u] * (1.0 - fx) + table[v, u1] * fx
    lower = table[v1, u] * (1.0 - fx) + table[v1, u1] * fx
    found: Array32 = upper * (1.0 - fy) + lower * fy
    return found

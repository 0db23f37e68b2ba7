"""Joint paths round obstacles: this arm draws in and goes over them.

In both of its drawn postures the upper arm stands up and the elbow is bent the way it was.
"""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["detours", "drawn"]

Floats = NDArray[np.float64]
JointPath = list[Floats]

_SHOULDER, _ELBOW, _WRIST1, _WRIST2 = range(1, 5)
UPRIGHT_RAD: Final = -np.pi / 2
# lean of the upper arm away from the work, and bend of the elbow: drawn in, and higher and farther
POSTURES: Final = tuple(map(tuple, np.radians([[10.0, 110.0], [0.0, 70.0]]).tolist()))


def drawn(q: Floats, posture: int = 0, *, hangs: bool = True) -> Floats:
    """Return joints (..., 6) in a drawn posture above their base joint.

    Parameters
    ----------
    q : (..., 6)
    posture : index into `POSTURES`
    hangs : True to point the tool straight down, False to keep the wrist's joints
    """
    lean, bend = POSTURES[posture]
    out = np.array(q, np.float64)
    side = np.where(out[..., _ELBOW] < 0.0, -1.0, 1.0)
    out[..., _SHOULDER] = UPRIGHT_RAD - side * lean
    out[..., _ELBOW] = side * bend
    if hangs:
        # shoulder + elbow + wrist 1 = -90 deg with wrist 2 at -90 deg, or both turned round
        down = np.where(out[..., _WRIST2] > 0.0, 1.0, -1.0) * np.pi / 2
        pitch = down - out[..., _SHOULDER] - out[..., _ELBOW]
        was = np.asarray(q)[..., _WRIST1]
        out[..., _WRIST1] = was + (pitch - was + np.pi) % (2 * np.pi) - np.pi
        out[..., _WRIST2] = down
    return out


def detours(a: Floats, b: Floats) -> Iterator[Sequence[JointPath]]:
    """Yield joint paths from (6,) to (6,) over each drawn posture."""
    for posture in range(len(POSTURES)):
        keep_a, keep_b = (drawn(q, posture, hangs=False) for q in (a, b))
        hang_a, hang_b = (drawn(q, posture) for q in (a, b))
        yield [
            [a, keep_a, b],
            [a, keep_b, b],
            [a, keep_a, keep_b, b],
            [a, hang_a, b],
            [a, hang_b, b],
            [a, hang_a, hang_b, b],
            [a, keep_a, hang_a, hang_b, keep_b, b],
        ]

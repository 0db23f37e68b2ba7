"""Reasons why no view shows a piece of the bare part, with evidence and advice."""

from __future__ import annotations

import numpy as np

from controller.arrays import BoolArray
from controller.cad import Solid
from messages import key, say

from ...model import HiddenEvidence, VisibilityTable

MAJORITY = 0.5  # share of a piece's samples
NEVER_RAD = np.radians(89.5)  # a surface at a flatter angle than this is invisible


def why_hidden(
    solid: Solid,
    evidence: VisibilityTable | HiddenEvidence,
    piece: BoolArray,
    max_incidence_deg: float,
) -> tuple[str, str]:
    """Return the reason and the smallest change that would help, for samples (n,) never visible.

    Parameters
    ----------
    solid : the part; its faces are named
    evidence : object of the search
    piece : (n,) the samples asked about, at least one
    max_incidence_deg : up to which a sample counts as seen
    """
    best = np.degrees(evidence.best_incidence_rad[piece])
    before = evidence.blocker[piece]
    faces, counts = np.unique(before[before >= 0], return_counts=True)
    blocker = solid.faces[int(faces[np.argmax(counts)])].label if len(faces) else ""
    if evidence.too_coarse[piece].mean() >= MAJORITY:
        return (
            say(
                "too coarse in every picture: seen past the part {median:.0f} "
                "degrees from its normal at best, with fewer pixels to the "
                "millimetre than are required",
                median=np.median(best),
            ),
            key(
                "a longer focal length, a camera nearer by, or fewer pixels required in the recipe"
            ),
        )
    if evidence.blurred[piece].mean() >= MAJORITY:
        return (
            say(
                "out of focus in every picture: seen past the part {median:.0f} "
                "degrees from its normal at best, but nearer or farther than the "
                "picture is sharp",
                median=np.median(best),
            ),
            key("a smaller aperture, which is sharp over more depth"),
        )
    stands = (
        say("; {blocker} stands before a look straight at it", blocker=blocker) if blocker else ""
    )
    seen = evidence.best_incidence_rad[piece] < NEVER_RAD
    if seen.mean() >= MAJORITY:
        flattest = float(np.quantile(best[seen], 0.9))
        return (
            say(
                "hidden by the part itself: seen {median:.0f} degrees from its "
                "normal at best, where {max_incidence_deg:.0f} count as "
                "seen{stands}",
                median=np.median(best[seen]),
                max_incidence_deg=max_incidence_deg,
                stands=stands,
            ),
            say(
                "accept views up to {angle_deg:.0f} degrees from the normal in the recipe",
                angle_deg=np.ceil(flattest),
            ),
        )
    return (
        say(
            "hidden by the part itself: no place of the camera sees it at all{stands}",
            stands=stands,
        ),
        key("look at it with a probe or a mirror, or leave it out in the recipe"),
    )

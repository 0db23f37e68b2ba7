"""Collision proof of a motion without known ends, for all configurations it may pass.

A phase is a box in joint space, proven as a whole: a piece of it is free if the arm, at its middle,
has more clearance than any of its points travels to the piece's border; otherwise the piece is
halved across the joint that moves it most. So no configuration in between is missed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from controller.arrays import FloatArray

from ..model.arm import SweepPhase
from ._kinematics import tcp_pose
from .scene import SELF_MARGIN_MM, Scene
from .segments import MARGIN_MM

SWEEP_MARGIN_MM = 10.0  # includes the estimated position of a part in jaws that had no power
MAX_PIECES = 60_000  # pieces of one phase; a phase that needs more is not proven
# Pieces smaller than this count as contact where they are not free [mm of travel].
FINEST_MM = 8.0
_MOVE_COUNTS = (1, 4, 16)  # number of short moves that one may consist of


@dataclass(frozen=True, slots=True, eq=False)
class Swept:
    """Result of a proof of swept space.

    Attributes
    ----------
    phase : phase in which something comes too close; empty if all is free
    touches : name of what comes too close
    tcp_mm : (3,) position of the TCP there, in the world
    pieces : number of pieces of joint space examined
    """

    phase: str = ""
    touches: str = ""
    tcp_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pieces: int = 0

    @property
    def is_free(self) -> bool:
        """True if all of it keeps the margin."""
        return not self.phase


def prove_sweep(
    scene: Scene, phases: Sequence[SweepPhase], margin_mm: float = SWEEP_MARGIN_MM
) -> Swept:
    """Return the proof that phases keep the margin, or their first configuration that does not.

    Parameters
    ----------
    scene : load on the arm, and the obstacles
    phases : in order
    margin_mm : margin to everything but the arm itself, which keeps `SELF_MARGIN_MM`
    """
    pieces = 0
    for phase in phases:
        found = _prove(scene, phase, margin_mm)
        pieces += found.pieces
        if not found.is_free:
            return Swept(found.phase, found.touches, found.tcp_mm, pieces)
    return Swept(pieces=pieces)


@dataclass(frozen=True, slots=True, eq=False)
class ProvenMove:
    """A move divided into short ones, each free of contact for any order of its motors.

    Attributes
    ----------
    waypoints : (6,) waypoints from its beginning (left out) to its end; none if it is not proven
    swept : findings of the proof
    """

    waypoints: tuple[FloatArray, ...]
    swept: Swept


def prove_move(
    scene: Scene, q_from: FloatArray, q_to: FloatArray, margin_mm: float = MARGIN_MM
) -> ProvenMove:
    """Return a move along a joint line that is free of contact for any timing of its motors.

    Motors of a move run each at its own whole speed, and two boards start and stop one after the
    other. The shorter the moves that it is made of, the less that matters.

    Parameters
    ----------
    scene : load on the arm, and the obstacles
    q_from, q_to : (6,) rows of joints
    margin_mm : margin to everything but the arm itself, which keeps `SELF_MARGIN_MM`
    """
    arm, swept = scene.layout.arm, Swept()
    for count in _MOVE_COUNTS:
        points = q_from + np.linspace(0.0, 1.0, count + 1)[:, None] * (q_to - q_from)
        phases = [arm.move_sweep(a, b) for a, b in pairwise(points)]
        swept = prove_sweep(scene, phases, margin_mm)
        if swept.is_free:
            return ProvenMove((*points[1:-1], q_to), swept)
    return ProvenMove((), swept)


def _prove(scene: Scene, phase: SweepPhase, margin_mm: float) -> Swept:
    low, high, names = phase.low[None], phase.high[None], scene.names()
    far = scene.reach_mm()
    count = 0
    while len(low):
        count += len(low)
        middle, half = (low + high) / 2, (high - low) / 2
        q = middle @ phase.join.T
        travel = half * _radii(scene, phase, q, half, far)
        bound = travel.sum(axis=1)
        own = SELF_MARGIN_MM + bound
        tight = np.flatnonzero(scene.contacts(q, margin_mm + bound, None, None, None, own) >= 0)
        if len(tight) == 0:
            return Swept(pieces=count)
        # at its middle each piece has to be free, or it is no use to cut it
        hits = scene.contacts(q[tight], margin_mm)
        fine = (hits < 0) & (bound[tight] < FINEST_MM)
        bad = np.flatnonzero((hits >= 0) | fine)
        if len(bad) or count > MAX_PIECES:
            k = int(bad[0]) if len(bad) else 0
            hit = int(hits[k])
            if hit < 0:
                one = tight[k : k + 1]
                wide = margin_mm + bound[one], SELF_MARGIN_MM + bound[one]
                hit = int(scene.contacts(q[one], wide[0], None, None, None, wide[1])[0])
            x, y, z = tcp_pose(scene.layout, q[tight[k]])[:3, 3]
            return Swept(phase.what, names[hit], (float(x), float(y), float(z)), count)
        rows = np.arange(len(tight))
        across = travel[tight].argmax(axis=1)
        cut = middle[tight, across]
        low_1, high_1 = low[tight].copy(), high[tight].copy()
        high_1[rows, across] = cut
        low_2, high_2 = low[tight].copy(), high[tight].copy()
        low_2[rows, across] = cut
        low, high = np.concatenate([low_1, low_2]), np.concatenate([high_1, high_2])
    return Swept(pieces=count)


def _radii(
    scene: Scene, phase: SweepPhase, q: FloatArray, half: FloatArray, far: tuple[float, float]
) -> FloatArray:
    """Return the largest travel of any point per independent angle (n, 6) [mm per rad or mm]."""
    ends = phase.low @ phase.join.T, phase.high @ phase.join.T
    radii = scene.layout.arm.radii_mm(*ends, *far)
    return np.broadcast_to(np.abs(phase.join).T @ radii, q.shape)

"""A Universal Robots e-Series arm as a chain; universal_robots.md 1.

Each link's frame has its origin on the joint that turns it and z along that joint's axis, with the
joint's offset d behind it: the Denavit-Hartenberg frame before, moved by a and turned by alpha. A
gripper is on the flange: the approach x of its TCP is the flange's z, the jaws' axis y lies in the
flange's plane.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from emulators.ur_arm import DH_ALPHA_RAD, JOINTS, UrFacts

from ..chain import TCP, Chain, Link
from ..shapes import Array, Box
from .umi import at

# Shoulder and upper arm turn above and beside the round base, whose box is square.
BESIDE_BASE: Final = ("base", "shoulder")
_Z: Final = (0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """What the links of one model take up [mm].

    Attributes
    ----------
    upper_mm, fore_mm : distance of upper arm and forearm from the base's axis, along the shoulder's
        (``shoulder_offset``, ``elbow_offset`` of the maker's description of the arm)
    wrist_mm : distance from wrist 1's frame back to the forearm's end (its ``mesh_offset``)
    shoulder_half_mm, fore_half_mm, wrist_half_mm : half the width of shoulder and upper arm, of the
        forearm, of the wrists: within their outlines, so that contacts are not imagined
    """

    upper_mm: float
    fore_mm: float
    wrist_mm: float
    shoulder_half_mm: float
    fore_half_mm: float
    wrist_half_mm: float


BODIES: Final = {
    "ur3e": Body(
        upper_mm=120.0,
        fore_mm=27.0,
        wrist_mm=104.0,
        shoulder_half_mm=42.0,
        fore_half_mm=34.0,
        wrist_half_mm=30.0,
    ),
    "ur5e": Body(
        upper_mm=138.0,
        fore_mm=7.0,
        wrist_mm=127.0,
        shoulder_half_mm=52.0,
        fore_half_mm=40.0,
        wrist_half_mm=35.0,
    ),
    "ur10e": Body(
        upper_mm=176.2,
        fore_mm=39.3,
        wrist_mm=135.0,
        shoulder_half_mm=66.0,
        fore_half_mm=48.0,
        wrist_half_mm=35.0,
    ),
}


@dataclass(frozen=True, eq=False)
class UrShape:
    """One arm of the series with a gripper on its flange.

    Attributes
    ----------
    facts : its lengths
    body : what its links take up
    flange_to_tcp_mm : flange to TCP, along the flange's axis
    jaws_rad : direction of the jaws' axis, about the flange's axis from its x
    park_q : (6,) joints in which it was left
    """

    facts: UrFacts
    body: Body
    flange_to_tcp_mm: float
    jaws_rad: float
    park_q: tuple[float, ...]

    @cached_property
    def chain(self) -> Chain:
        """The arm from its base, the frame *base* of its controller."""
        facts, boxes = self.facts, self._boxes()
        links = []
        T_before, on = np.eye(4), ""  # by a and alpha of the joint before
        rows = zip(JOINTS, facts.dh_a_mm, facts.dh_d_mm, DH_ALPHA_RAD, strict=True)
        for joint, a_mm, d_mm, alpha_rad in rows:
            T_on_link = T_before @ at(0.0, 0.0, d_mm)
            drive = {joint: 1.0}
            links.append(
                Link(
                    joint, on, T_on_link, _Z, drive=drive, boxes=boxes[joint],
                    meets_base=joint not in BESIDE_BASE,
                )
            )  # fmt: skip
            T_before, on = at(a_mm, 0.0, 0.0) @ _about_x(alpha_rad), joint
        c, s = math.cos(self.jaws_rad), math.sin(self.jaws_rad)
        T_flange_tcp = np.eye(4)
        # columns: the flange's z; the jaws' axis; what is square to both
        T_flange_tcp[:3, :3] = ((0.0, c, -s), (0.0, s, c), (1.0, 0.0, 0.0))
        T_flange_tcp[2, 3] = self.flange_to_tcp_mm
        links.append(Link(TCP, on, T_before @ T_flange_tcp))
        return Chain(JOINTS, tuple(links), {joint: {joint: 1.0} for joint in JOINTS})

    def _boxes(self) -> dict[str, tuple[Box, ...]]:
        facts, body = self.facts, self.body
        thick, fore, wrist = body.shoulder_half_mm, body.fore_half_mm, body.wrist_half_mm
        return {
            "base": (_box("shoulder", (-thick, thick), (-thick, thick), (-thick, thick)),),
            "shoulder": (
                _box(
                    "upper arm",
                    (facts.a2_mm - fore, thick),
                    (-thick, thick),
                    (body.upper_mm - thick, body.upper_mm + thick),
                ),
            ),
            "elbow": (
                _box(
                    "forearm",
                    (facts.a3_mm, fore),
                    (-fore, fore),
                    (body.fore_mm - fore, body.fore_mm + fore),
                ),
            ),
            "wrist1": (_box("wrist 1", (-wrist, wrist), (-wrist, wrist), (-body.wrist_mm, wrist)),),
            "wrist2": (_box("wrist 2", (-wrist, wrist), (-wrist, wrist), (-wrist, wrist)),),
            "wrist3": (_box("wrist 3", (-wrist, wrist), (-wrist, wrist), (-wrist, 0.0)),),
        }


def _box(name: str, *sides: tuple[float, float]) -> Box:
    low, high = np.array(sides, dtype=float).T
    return Box(name, low, high)


def _about_x(angle_rad: float) -> Array:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    T = np.eye(4)
    T[1:3, 1:3] = ((c, -s), (s, c))
    return T

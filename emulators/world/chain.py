"""An arm of any kind as a chain of links: which joints move each, what it takes up, where it is.

Knows no make of arm and no motor's stops; `arms` describes the arms that can be emulated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np

from .shapes import Array, Box

TCP: Final = "arm gripper"
"""Name of the last frame: origin between the fingertips, x the approach, y the jaws' axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A rigid body of the chain, or a frame between two of them.

    Attributes
    ----------
    name : of its frame
    on : name of the link that carries it; empty for the arm's base
    T_on_link : (4, 4) pose of its frame on that link while its drive is 0 [mm]
    axis : (3,) unit vector in its frame that it turns about, or slides along; None if it is fixed
    slides : True if it slides
    drive : share of each joint's value in its turn or travel, by the joint's name
    boxes : boxes in its frame
    is_solid : its boxes may run into things; otherwise they are only seen, as those beside the
        column that they slide along
    meets_base : False where the arm is built so that it cannot run into what it stands on, whose
        box in the layout may be wider than that
    """

    name: str
    on: str
    T_on_link: Array
    axis: tuple[float, float, float] | None = None
    slides: bool = False
    drive: Mapping[str, float] = field(default_factory=dict)
    boxes: tuple[Box, ...] = ()
    is_solid: bool = True
    meets_base: bool = True


@dataclass(frozen=True, eq=False)
class Chain:
    """Links from the base outwards, moved by joints, which motors move.

    Attributes
    ----------
    joints : names of the joints, in the order of a configuration q (n,) [rad, mm]
    links : each behind the one that carries it; the last one is the frame `TCP`
    motors : by how much each motor moves each joint, by their names; two motors of a bevel gear
        share two joints

    Raises
    ------
    ValueError : a link is on none before it, has no axis for its drive, or names no joint; the
        motors do not move each joint in just one way
    """

    joints: tuple[str, ...]
    links: tuple[Link, ...]
    motors: Mapping[str, Mapping[str, float]]

    def __post_init__(self) -> None:
        known = {""}
        for link in self.links:
            if link.on not in known or link.name in known:
                raise ValueError(f"link {link.name}: on {link.on!r}, which is not before it")
            if (link.axis is None) != (not link.drive) or not set(link.drive) <= set(self.joints):
                raise ValueError(f"link {link.name}: an axis and the joints that drive it, or none")
            known.add(link.name)
        if not self.links or self.links[-1].name != TCP:
            raise ValueError(f"the last link is {TCP!r}")
        effect = self.effect
        if effect.shape[0] != effect.shape[1] or np.linalg.matrix_rank(effect) < len(effect):
            raise ValueError("as many motors as joints, and each joint moved by them in one way")

    @cached_property
    def effect(self) -> Array:
        """Change of each joint with each motor, (joints, motors)."""
        return np.array(
            [[one.get(joint, 0.0) for one in self.motors.values()] for joint in self.joints]
        )

    @cached_property
    def _bases(self) -> Array:
        """Each link's pose on its carrier, as sums over 1, cos, sin and value: (links, 4, 16)."""
        bases = np.zeros((len(self.links), 4, 4, 4))
        for basis, link in zip(bases, self.links, strict=True):
            still = np.eye(4)
            if link.axis is not None and link.slides:
                basis[3, :3, 3] = link.axis
            elif link.axis is not None:
                x, y, z = link.axis
                K = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
                # Rodrigues: 1 + sin K + (1 - cos) K K
                still[:3, :3] += K @ K
                basis[1, :3, :3], basis[2, :3, :3] = -K @ K, K
            basis[0] = still
            basis[:] = link.T_on_link @ basis
        return bases.reshape(len(self.links), 4, 16)

    @cached_property
    def _drives(self) -> Array:
        """Share of each joint in each link's drive, (links, joints)."""
        return np.array(
            [[link.drive.get(joint, 0.0) for joint in self.joints] for link in self.links]
        )

    @cached_property
    def _carriers(self) -> tuple[int, ...]:
        numbers = {"": -1} | {link.name: number for number, link in enumerate(self.links)}
        return tuple(numbers[link.on] for link in self.links)

    def poses(self, T_world_base: Array, q: Sequence[float]) -> dict[str, Array]:
        """Return the links' poses ``T_world_*`` (4, 4) at a configuration, by name [mm].

        Parameters
        ----------
        T_world_base : (4, 4) pose of the frame that the first link is on
        q : (joints,) values in the order of `joints` [rad, mm]
        """
        drive = self._drives @ np.asarray(q, dtype=float)
        shares = np.stack([np.ones_like(drive), np.cos(drive), np.sin(drive), drive], axis=1)
        on_carrier = (shares[:, None] @ self._bases).reshape(-1, 4, 4)
        poses: list[Array] = []
        for carrier, T in zip(self._carriers, on_carrier, strict=True):
            poses.append((T_world_base if carrier < 0 else poses[carrier]) @ T)
        return {link.name: T for link, T in zip(self.links, poses, strict=True)}

    def motor_steps(self, step: Array) -> dict[str, float]:
        """Return the travel of each motor that moves the joints by a step (joints,)."""
        return dict(zip(self.motors, np.linalg.solve(self.effect, step).tolist(), strict=True))

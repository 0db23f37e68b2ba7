"""The arm among its surroundings: which configurations are free of contact.

Links, hands and obstacles are boxes. The part is one box as well (its CAD bounding box): around
the fingers, where that is too coarse, the grips have been checked against the mesh instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from controller.cad import inverse_pose
from drivers.umi_scara.kinematics import forward, inverse

from ..boxes import BoolArray, lowest_z, overlap, stack
from ..layout import Box, CellLayout, FloatArray, IntArray, Jaw

HEADINGS_RAD = np.radians(np.arange(-180.0, 180.0, 30.0))  # tried where the hand points down
# a hand this close to straight down is taken as straight down: its heading would be noise
VERTICAL = 2e-3
SELF_MARGIN_MM = 3.0  # links know each other's place better than the world's


def inverse_rows(
    layout: CellLayout, T_world_tip: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return all legal configurations of tip poses (n, 4, 4): index (m,), branch (m,), q (m, 6).

    The branch number means the same for all poses of one orientation (elbow sign, wrist branch or
    heading), so that a straight line keeps its branch.
    """
    T = inverse_pose(layout.T_world_arm) @ T_world_tip
    down = np.hypot(T[:, 0, 0], T[:, 1, 0]) < VERTICAL
    if down.any():
        T[down, :3, :3] = _straightened(T[down, :3, :3])
    index, branch, rows = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros((0, 6))]
    for members in (np.flatnonzero(down), np.flatnonzero(~down)):
        if len(members):
            headings = HEADINGS_RAD if down[members[0]] else HEADINGS_RAD[:1]
            q, legal = inverse(T[members], layout.arm, heading_rad=headings)
            i, k = np.nonzero(legal)
            index.append(members[i])
            branch.append(k)
            rows.append(q[i, k])
    order = np.argsort(np.concatenate(index), kind="stable")
    return (
        np.concatenate(index)[order],
        np.concatenate(branch)[order],
        np.concatenate(rows)[order],
    )


def _straightened(R: FloatArray) -> FloatArray:
    out = np.zeros_like(R)
    out[:, 2, 0] = np.sign(R[:, 2, 0])
    y = R[:, :, 1].copy()
    y[:, 2] = 0.0
    out[:, :, 1] = y / np.linalg.norm(y, axis=1, keepdims=True)
    out[:, :, 2] = np.cross(out[:, :, 0], out[:, :, 1])
    return out


def tip_pose(layout: CellLayout, q: FloatArray) -> FloatArray:
    """Return T_world_tip (..., 4, 4) of configurations (..., 6)."""
    return np.asarray(layout.T_world_arm @ forward(q, layout.arm))


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What the arm may not touch just now, and what it carries.

    Attributes
    ----------
    hand_opening_mm, fixture_opening_mm : of the two jaws
    carried : the part as a box in the tip frame, or None
    standing : boxes in the world beside the layout's own, for instance the part in the fixture
    """

    layout: CellLayout
    hand_opening_mm: float
    fixture_opening_mm: float
    carried: Box | None = None
    standing: tuple[Box, ...] = ()
    ignore: frozenset[str] = field(default_factory=frozenset)

    def with_carried(self, carried: Box | None) -> Scene:
        """Return the scene with something else in the hand."""
        return replace(self, carried=carried)

    def statics(self) -> list[tuple[str, Box]]:
        """Return the world boxes by name."""
        layout = self.layout
        named = [(name, box) for name, box in layout.obstacles.items()]
        if (fixture := layout.fixture) is not None:
            named += self._fixture(fixture)
        named += [("part in the fixture", b) for b in self.standing]
        return [(name, box) for name, box in named if name not in self.ignore]

    def _fixture(self, fixture: Jaw) -> list[tuple[str, Box]]:
        T = self.layout.T_world_fixture
        fingers = fixture.fingers(self.fixture_opening_mm)
        return [
            *(("fixture", b.placed(T)) for b in fixture.body),
            *(("fixture fingers", b.placed(T)) for b in fingers),
        ]

    def free(
        self,
        q: FloatArray,
        margin_mm: float = 10.0,
        table_margin_mm: float | None = None,
        hand: tuple[FloatArray, FloatArray] | None = None,
    ) -> BoolArray:
        """Tell which configurations (n, 6) keep the margins: (n,) bool."""
        return np.asarray(self.contacts(q, margin_mm, table_margin_mm, hand) < 0)

    def contacts(
        self,
        q: FloatArray,
        margin_mm: float = 10.0,
        table_margin_mm: float | None = None,
        hand: tuple[FloatArray, FloatArray] | None = None,
    ) -> IntArray:
        """Return per configuration (n, 6) the index of the first contact in `names`, -1 if free.

        `hand` replaces body, fingers and part by boxes of its own per row, in the tip frame:
        poses (n, m, 4, 4) and half edges (n, m, 3), the hand's body first.
        """
        n = len(q)
        layout = self.layout
        if n == 0:
            return np.zeros(0, dtype=np.int64)
        T_links, half_links = self._links(q)
        if hand is None:
            in_tip = [*layout.hand.body, *layout.hand.fingers(self.hand_opening_mm)]
            if self.carried is not None:
                in_tip.append(self.carried)
            T_box, half_box = stack(in_tip)
        else:
            T_box, half_box = hand
        T_hand = tip_pose(layout, q)[:, None] @ T_box
        m = T_hand.shape[1]
        T_all = np.concatenate([T_links, T_hand], axis=1)  # carriage, upper, fore, hand..., part
        half_all = np.concatenate(
            [np.broadcast_to(half_links, (n, 3, 3)), np.broadcast_to(half_box, (n, m, 3))], axis=1
        )
        moving = 3 + m
        body_n = len(layout.hand.body)
        first = np.full(n, -1)

        floor = margin_mm if table_margin_mm is None else table_margin_mm
        low = lowest_z(T_all[:, 2:], half_all[:, 2:]).min(axis=1)
        first[low < floor] = 0

        statics = self.statics()
        T_static, half_static = stack([b for _, b in statics])
        grown = half_all + margin_mm
        pairs = [(i, j) for i in range(moving) for j in range(len(statics))]
        touching = _pairs(T_all, grown, T_static[None], half_static[None], pairs)
        for column, (_, j) in enumerate(pairs):
            first[(first < 0) & touching[:, column]] = 1 + j

        # neighbours along the chain are kept apart by the joint limits, not by these coarse boxes:
        # the palm beside the forearm's end, the neck inside it
        own = [(i, j) for i in range(3, moving) for j in (0, 1)]
        own += [(i, 2) for i in range(3 + body_n, moving)]
        touching = _pairs(T_all, half_all + SELF_MARGIN_MM, T_all, half_all, own)
        first[(first < 0) & touching.any(axis=1)] = 1 + len(statics)

        behind = [(i, 0) for i in range(2, moving)]
        T_column, half_column = stack([layout.column])
        touching = _pairs(T_all, grown, T_column[None], half_column[None], behind)
        first[(first < 0) & touching.any(axis=1)] = 2 + len(statics)
        return first

    def names(self) -> tuple[str, ...]:
        """Return what the indices of `contacts` stand for."""
        return ("table", *(name for name, _ in self.statics()), "the arm itself", "column")

    def _links(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        layout = self.layout
        n = len(q)
        T = np.zeros((n, 3, 4, 4))
        T[:, :, 3, 3] = 1.0
        T[:, :, 2, 2] = 1.0
        T[:, :, 2, 3] = (layout.arm.wrist_height_mm + q[:, 3])[:, None]
        for link, angle in enumerate((np.zeros(n), q[:, 0], q[:, 0] + q[:, 1])):
            c, s = np.cos(angle), np.sin(angle)
            T[:, link, 0, 0], T[:, link, 0, 1] = c, -s
            T[:, link, 1, 0], T[:, link, 1, 1] = s, c
        T[:, 2, 0, 3] = layout.arm.upper_mm * np.cos(q[:, 0])
        T[:, 2, 1, 3] = layout.arm.upper_mm * np.sin(q[:, 0])
        T_box, half = stack([layout.carriage, layout.upper, layout.fore])
        return np.asarray(layout.T_world_arm @ T @ T_box), half

    def arm_boxes(self, q: FloatArray) -> list[Box]:
        """Return the world boxes of the links and the open or closed hand at one q (6,)."""
        T_links, half = self._links(q[None])
        boxes = [Box(T, h) for T, h in zip(T_links[0], half, strict=True)]
        T_tip = tip_pose(self.layout, q)
        hand = [*self.layout.hand.body, *self.layout.hand.fingers(self.hand_opening_mm)]
        return boxes + [b.placed(T_tip) for b in hand]


def _pairs(
    T_a: FloatArray,
    half_a: FloatArray,
    T_b: FloatArray,
    half_b: FloatArray,
    pairs: Sequence[tuple[int, int]],
) -> BoolArray:
    """Return (n, pairs) contacts of boxes a (n, a, 4, 4), (n, a, 3) with b (n or 1, b, ...)."""
    n, m = len(T_a), len(pairs)
    result = np.zeros((n, m), dtype=bool)
    if n == 0 or m == 0:
        return result
    i, j = np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])
    # spheres first: most pairs are far apart and need no copy of their poses
    radius = np.linalg.norm(half_a, axis=2)[:, i] + np.linalg.norm(half_b, axis=2)[:, j]
    offset = T_b[:, j][..., :3, 3] - T_a[:, i][..., :3, 3]
    near = np.einsum("nmk,nmk->nm", offset, offset) <= radius**2
    row, column = np.nonzero(near)
    if len(row):
        a, b = i[column], j[column]
        other = row if len(T_b) > 1 else np.zeros_like(row)
        result[row, column] = overlap(T_a[row, a], half_a[row, a], T_b[other, b], half_b[other, b])
    return result

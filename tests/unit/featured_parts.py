"""Parts of many kinds, made in code: each has features that a drawing would dimension."""

from __future__ import annotations

from collections.abc import Callable

import manifold3d
import numpy as np
from cad_solids import Body, box, prism, rod
from manifold3d import CrossSection


def collar(cross_mm: float = 6.0, up_mm: float = 0.0) -> Body:
    """A collar with a cross hole through one wall, and a keyway along its bore."""
    body = rod(20, 24, 192) - rod(10, 40, 128) - box(6, 10, 40).translate((0, -8.5, 0))
    hole = rod(cross_mm / 2, 30, 96).rotate((90, 0, 0)).translate((0, 20, up_mm))
    return body - hole


def shaft() -> Body:
    """A stepped shaft with a centre hole, a flat and a keyway with round ends."""
    body = rod(12, 30, 128) + rod(9, 30, 128).translate((0, 0, 28)) + rod(15, 8, 128)
    key = Body.hull(
        rod(2.5, 6, 64).translate((0, 0, 0)) + rod(2.5, 6, 64).translate((12, 0, 0))
    ).rotate((0, 90, 0))
    body = body - key.translate((9 - 0.5, 0, 36)) - box(6, 30, 8).translate((13, 0, -11))
    return body - rod(2, 10, 64).translate((0, 0, 42))


def standing_shaft() -> Body:
    """A stepped shaft with a cross hole along x, and a keyway above it on the side of +x."""
    body = rod(15, 26, 192).translate((0, 0, 13)) + rod(10, 34, 128).translate((0, 0, 43))
    hole = rod(3, 60, 64).rotate((0, 90, 0)).translate((0, 0, 13))
    return body - hole - box(10, 6, 20).translate((11.5, 0, 42))


def plate() -> Body:
    """A plate with two rectangular openings, one with rounded corners, and a pocket."""
    body = box(80, 50, 10) - box(16, 12, 20).translate((-25, 8, 0))
    rounded = CrossSection.square((14, 10), True).offset(3, manifold3d.JoinType.Round, 2.0, 64)
    body = body - rounded.extrude(30).translate((10, 5, -15))
    return body - box(18, 8, 10).translate((5, -16, 5))


def wedge() -> Body:
    """A wedge with a hole square to its foot, whose upper rim lies in the slope."""
    body = prism([(0, 0), (50, 0), (50, 26), (0, 8)], 36).rotate((90, 0, 0)).translate((0, 18, 0))
    return body - rod(5, 80, 128).translate((22, 3, 0)) - rod(3, 80, 96).translate((40, -8, 0))


def sunk_plate() -> Body:
    """A plate with countersunk and counterbored holes, chamfers along its upper edges."""
    body = box(60, 40, 12)
    for x in (-20, 0, 20):
        body = body - rod(2.5, 40, 64).translate((x, 0, 0))
    body = body - Body.cylinder(3, 2.5, 5.5, 64).translate((-20, 0, 3))
    body = body - rod(5, 8, 64).translate((20, 0, 6))
    cut = box(80, 8, 8).rotate((45, 0, 0))
    lift = 4 * np.sqrt(2) - 1.5
    return body - cut.translate((0, 20, 6 + lift)) - cut.translate((0, -20, 6 + lift))


def bracket() -> Body:
    """An angle with a rib, a hole in each leg, and a fillet in its corner."""
    body = box(60, 40, 8).translate((0, 0, 4)) + box(8, 40, 46).translate((-26, 0, 23))
    corner = box(7, 40, 7).translate((-18.5, 0, 11.5)) - rod(6, 60, 96).rotate(
        (90, 0, 0)
    ).translate((-16, 0, 14))
    body = body + corner - rod(4, 40, 64).translate((12, 8, 4))
    return body - rod(3.5, 80, 64).rotate((0, 90, 0)).translate((-26, 5, 34))


def ring_with_pins() -> Body:
    """A ring with three bosses on its face and a groove round none of them."""
    body = rod(30, 8, 192) - rod(15, 20, 128)
    for i in range(3):
        turn = 2 * np.pi * i / 3
        body = body + rod(4, 10, 64).translate((22 * np.cos(turn), 22 * np.sin(turn), 8))
    return body - box(5, 80, 4).translate((0, 0, -4))


def hexagon_socket() -> Body:
    """A round head with a hexagon socket and a blind thread hole in its foot."""
    head = rod(12, 18, 128)
    hexagon = CrossSection([[(6 * np.cos(a), 6 * np.sin(a)) for a in np.arange(6) * np.pi / 3]])
    return head - hexagon.extrude(20).translate((0, 0, 2)) - rod(3, 8, 64).translate((0, 0, -9))


def engraved() -> Body:
    """A plate with shallow marks, a slot with round ends, and holes of two sizes."""
    slot = Body.hull(rod(4, 30, 64).translate((-9, 0, 0)) + rod(4, 30, 64).translate((9, 0, 0)))
    body = box(70, 45, 9) - slot.translate((0, 10, 0)) - rod(0.4, 30, 32).translate((28, -16, 0))
    for x in (-24, -12, 0, 12):
        body = body - box(2, 6, 0.6).translate((x, -12, 4.5))
    return body - rod(6, 30, 64).translate((26, 8, 0))


def block_with_crossing_bores() -> Body:
    """A block in which two bores of one size meet, and a third ends in one of them."""
    body = box(50, 40, 30) - rod(6, 80, 96)
    body = body - rod(6, 80, 96).rotate((0, 90, 0))
    return body - rod(2.5, 30, 64).rotate((90, 0, 0)).translate((0, 16, 8))


def elbow() -> Body:
    """A tube cut off at 30 degrees, with a flange at its square end."""
    tube = rod(11, 50, 128) - rod(8, 80, 128)
    flange = rod(22, 6, 160).translate((0, 0, -22)) - rod(8, 80, 128)
    body = tube + flange
    for i in range(4):
        turn = np.pi / 4 + np.pi * i / 2
        body = body - rod(2.2, 80, 48).translate((17 * np.cos(turn), 17 * np.sin(turn), -22))
    return body - box(80, 60, 40).rotate((0, 30, 0)).translate((8, 0, 32))


def tee_slots() -> Body:
    """A rail with a T slot along it, cross slots over it, and a notch in its end."""
    body = box(70, 40, 24) - box(90, 8, 16).translate((0, 0, 8)) - box(90, 18, 6)
    for x in (-22, 22):
        body = body - box(6, 60, 6).translate((x, 0, 12))
    return body - box(10, 8, 60).translate((33, -14, 0))


def dome() -> Body:
    """A disc with a domed top and a hole off its middle, whose rim lies on the dome."""
    body = rod(24, 10, 192) + (
        Body.sphere(40, 192).translate((0, 0, -27)) ^ rod(24, 30, 192).translate((0, 0, 15))
    )
    return body - rod(3, 60, 96).translate((11, 4, 0)) - rod(5, 7, 96).translate((0, 0, -5))


def cone_with_side_hole() -> Body:
    """A cone frustum with a hole across it."""
    body = Body.cylinder(36, 20, 12, 160)
    return body - rod(4, 80, 96).rotate((90, 0, 0)).translate((0, 0, 16))


def clevis() -> Body:
    """A fork with a pin hole through both its arms and a threaded stem."""
    body = box(24, 28, 36).translate((0, 0, 18)) - box(40, 12, 24).translate((0, 0, 26))
    body = body + rod(8, 22, 128).translate((0, 0, -10))
    return body - rod(4, 80, 96).rotate((90, 0, 0)).translate((0, 0, 26))


def box_lid() -> Body:
    """A lid: hollow below, a rounded pocket above, a window in one wall."""
    outline = CrossSection.square((50, 30), True).offset(5, manifold3d.JoinType.Round, 2.0, 64)
    body = outline.extrude(18) - box(52, 32, 28).translate((0, 0, 0))
    return body - box(12, 60, 5).translate((4, 20, 9))


def small_parts_of_all() -> Body:
    """A block 30 mm long with features below what general tolerances begin with."""
    body = box(30, 20, 12) - box(1.4, 40, 1.2).translate((4, 0, 6))
    body = body - rod(0.9, 3, 48).translate((-8, 4, 6)) - box(2, 2, 40).translate((10, -5, 0))
    return body + rod(1.2, 1, 48).translate((-8, -4, 6.3))


PARTS: dict[str, Callable[[], Body]] = {
    make.__name__: make
    for make in (
        collar, shaft, plate, wedge, sunk_plate, bracket, ring_with_pins, hexagon_socket, engraved,
        block_with_crossing_bores, elbow, tee_slots, dome, cone_with_side_hole, clevis, box_lid,
        small_parts_of_all,
    )
}  # fmt: skip

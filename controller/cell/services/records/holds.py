"""The grippers' holds of the part, as rows of the journal, and grasps from those rows."""

from dataclasses import fields
from typing import Literal

import numpy as np

from controller.arrays import FloatArray
from controller.cell.journal import rows
from controller.planning import Grasp

from .part import PartInGripper


def arm_hold_row(hold: PartInGripper, *, is_expected: bool = False) -> rows.HoldNoted:
    """Return the row of a hold of the arm gripper.

    Parameters
    ----------
    hold : hold, present or intended
    is_expected : the jaws have not closed yet
    """
    return rows.HoldNoted(
        gripper="arm",
        grasp=_grasp_fields(hold.grasp),
        T_part_tcp=matrix(hold.T_part_tcp),
        opening_mm=float(hold.opening_mm),
        is_measured=hold.is_measured,
        is_expected=is_expected,
        number=hold.number,
    )


def fixed_hold_row(grasp: Grasp, opening_mm: float) -> rows.HoldNoted:
    """Return the row of the fixed gripper's grasp; its pose follows from the arm's.

    Parameters
    ----------
    grasp : its grasp
    opening_mm : opening of its jaws on the part
    """
    return rows.HoldNoted(
        gripper="fixed",
        grasp=_grasp_fields(grasp),
        T_part_tcp=matrix(grasp.T_part_tcp),
        opening_mm=float(opening_mm),
    )


def grasp_of(found: rows.GraspFields) -> Grasp:
    """Return the grasp in a row."""
    holder: Literal["arm", "fixture"] = "arm" if found.holder == "arm" else "fixture"
    return Grasp(
        id=found.id,
        T_part_tcp=np.array(found.T_part_tcp),
        opening_mm=found.opening_mm,
        pre_open_mm=found.pre_open_mm,
        contact_mm2=found.contact_mm2,
        load=found.load,
        score=found.score,
        holder=holder,
        margin=found.margin,
        is_inner=found.is_inner,
        on_table=found.on_table,
    )


def matrix(T: FloatArray) -> rows.Matrix:
    """Return a matrix row by row, to the last bit."""
    return tuple(tuple(float(x) for x in row) for row in T)


def _grasp_fields(grasp: Grasp) -> rows.GraspFields:
    plain = {one.name: getattr(grasp, one.name) for one in fields(grasp)}
    plain["T_part_tcp"] = matrix(grasp.T_part_tcp)
    numbers = ("opening_mm", "pre_open_mm", "contact_mm2", "load", "score", "margin")
    plain |= {name: float(plain[name]) for name in numbers}
    return rows.GraspFields(**plain)

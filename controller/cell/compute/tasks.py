"""Views as the inspection judges them, from the cell file and the recipe."""

from collections.abc import Sequence

from controller import inspection as inspecting
from controller.arrays import FloatArray
from controller.setup.optics import build_lamps, panel_corners, table_corners

from ..devices.lamps import STATION_PANEL
from .job import Context, inspection_limits


def held_task(
    c: Context,
    view_id: str,
    T_world_part: FloatArray,
    holder: tuple[inspecting.WorldBox, ...],
    lamps: Sequence[str],
    *,
    is_hold_measured: bool,
    facts: inspecting.PartFacts = inspecting.NO_FACTS,
) -> inspecting.ViewTask:
    """Return a view of the part in the arm gripper, before the inspection camera.

    Parameters
    ----------
    c : recipe, cell and part
    view_id : id of the view
    T_world_part : (4, 4) expected pose of the part
    holder : objects of the cell that may be in the picture
    lamps : names of the lamps of its lit pictures
    is_hold_measured : an earlier view has confirmed how the part is held
    facts : known of this part besides its CAD model
    """
    return inspecting.ViewTask(
        view_id=view_id,
        camera=c.inspection,
        T_world_part_expected=T_world_part,
        holder=holder,
        panel_mm=panel_corners(c.cell, STATION_PANEL),
        lamps=build_lamps(c.cell, tuple(lamps)),
        limits=inspection_limits(c.recipe),
        is_hold_measured=is_hold_measured,
        facts=facts,
    )


def table_task(
    c: Context,
    view_id: str,
    T_world_part: FloatArray,
    lamps: Sequence[str],
    facts: inspecting.PartFacts = inspecting.NO_FACTS,
) -> inspecting.ViewTask:
    """Return a view of the part where it lies, before the overhead camera; nothing hides it.

    Parameters
    ----------
    c, view_id, lamps, facts : see `held_task`
    T_world_part : (4, 4) pose of the part
    """
    return inspecting.ViewTask(
        view_id=view_id,
        camera=c.overhead,
        T_world_part_expected=T_world_part,
        holder=(),
        panel_mm=table_corners(c.cell),
        lamps=build_lamps(c.cell, tuple(lamps)),
        limits=inspection_limits(c.recipe),
        is_hold_measured=True,
        facts=facts,
    )

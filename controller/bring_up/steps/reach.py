"""Reach: the calibrated arm tried on all poses that recipes need, with the uncertainty as margin.

Nothing moves. Places that every recipe needs are tried first; then each recipe is planned as
`cellctl check` does, in a process of its own.
"""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.calibration.reach import unreached
from controller.config.calibration_reference import CalibrationName
from controller.config.calibrations import Calibration
from controller.planning.motion import Scene
from controller.processes import worker_pool

from ..bench import Bench
from ..proof import RecipeReach, check_reach

GRID: Final = 5  # places along either side of the drop area
LOW_MM: Final = 20.0  # height over the table at which the middle of a low part is grasped
MIN_PICKABLE: Final = 0.5  # least share of places and turns over the drop area that are reached


class ReachStep:
    """Checks that the calibrated arm reaches the places of the cell and the poses of recipes."""

    name = "reach"
    title = "reach of the calibrated arm for all recipes; nothing moves"
    needs: tuple[str, ...] = ("grippers", "trays")
    uses: tuple[CalibrationName, ...] = ("overhead", "inspection", "arm", "fixed_gripper", "trays")
    makes: tuple[CalibrationName, ...] = ()
    valid_days: int | None = None

    async def run(self, bench: Bench) -> Mapping[CalibrationName, Calibration]:
        """Try places and recipes; return nothing; unreachable ones are named in the evidence.

        Raises
        ------
        ConfigError : the cell file as commissioned cannot be read
        """
        layout = bench.layout
        scene = Scene(layout, layout.arm_gripper.max_mm, layout.fixed_open_mm)
        places = common_places(bench)
        missed = await asyncio.to_thread(unreached, layout, scene, places, layout.clearance_mm)
        for one in missed:
            bench.evidence.find(f"out of reach: {one.name}: {one.why}")
        bench.evidence.measure(
            f"places out of reach, of {len(places)} over drop area and trays", len(missed), high=0
        )
        if not bench.recipes:
            bench.evidence.find(
                "no recipe: none was given (--recipe FILE), and there is none beside the cell file"
            )
            return {}
        cell_file = bench.evidence.folder.parent.parent / "cell.yaml"
        with worker_pool(check_reach.__module__) as pool:
            loop = asyncio.get_running_loop()
            for recipe in bench.recipes:
                bench.evidence.show(f"planning {recipe.name} on the cell as calibrated")
                judge(
                    bench,
                    recipe,
                    await loop.run_in_executor(pool, check_reach, recipe, cell_file),
                )
        return {}


def common_places(bench: Bench) -> dict[str, FloatArray]:
    """Return places (3,) that any recipe needs, by name: over the drop area and over the trays."""
    area = bench.cell.table.drop_area
    found = {
        f"drop area at x {x:.0f} y {y:.0f} mm": np.array([x, y, LOW_MM])
        for x in np.linspace(*area.x, GRID)
        for y in np.linspace(*area.y, GRID)
    }
    for name, tray in bench.layout.trays.items():
        found[f"tray {name}"] = np.array([*tray.centre_mm, LOW_MM])
    return found


def judge(bench: Bench, recipe: Path, found: RecipeReach) -> None:
    """Judge the result of a recipe's check against limits.

    Parameters
    ----------
    bench : bench of the step
    recipe : its file
    found : measured properties of it
    """
    for problem in found.problems:
        bench.evidence.find(f"{recipe.name}: {problem}")
    measure = bench.evidence.measure
    measure(f"{recipe.name}: reasons against a run", len(found.problems), high=0)
    for pose in found.poses:
        name = f"{recipe.name}, stable pose {pose.index} ({pose.probability:.0%})"
        share = 100.0 * pose.pickable
        measure(
            (f"{name}: share of places from which it can be taken"),
            share,
            "%",
            low=100.0 * MIN_PICKABLE,
        )
        if pose.covered is not None:
            measure(f"{name}: surface in sight", 100.0 * pose.covered, "%")

"""Planner inputs for a part in a cell: one function for every command that plans.

`run`, `check`, `plan`, `plan --site` and `compile --cell` all call it, so that one recipe has one
plan, and every command makes the same assumptions and prints them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from controller.cad import counted_defect_mm
from controller.cad.compiled import CompiledPart
from controller.config import Cell, Recipe
from controller.config.recipe import GraspSection, InspectionSection
from controller.inspection import MIN_FACE_SHARE, needed_px_per_mm
from controller.planning import CellLayout, Jaw, Plan, PlanOptions

from .layout import build_layout

# Resolution of a planned view, in shares of what inspection needs to compare a surface: a tenth
# more, because the part is never held exactly as planned.
RESERVE = 1.1

DensityFrom = Literal["recipe", "command line", "CAD file", "assumed"]
_DENSITY_WORDS: dict[DensityFrom, str] = {
    "recipe": "{} g/cm3 (recipe)",
    "command line": "{} g/cm3 (command line)",
    "CAD file": "{} g/cm3 (CAD file)",
    "assumed": "{} g/cm3 (aluminium, assumed)",
}


@dataclass(frozen=True, slots=True, eq=False)
class PlannerSetup:
    """The planner's inputs for a part in a cell.

    Attributes
    ----------
    layout : the cell, with the force that its grippers press with
    options : targets of the plans
    density_g_cm3, density_from : density of the part, and the source of that figure
    counted_defect_mm : from which size on spots and defects show in a count of coverage; more than
        the smallest defect on a part too large for points as near as that
    has_recipe : the figures are from a recipe; otherwise they are the defaults of a recipe
    """

    layout: CellLayout
    options: PlanOptions
    density_g_cm3: float
    density_from: DensityFrom
    mass_g: float
    smallest_defect_mm: float
    counted_defect_mm: float
    force_n: float
    has_recipe: bool

    def as_json(self) -> dict[str, Any]:
        """Return all data besides part and cell file on which plans depend."""
        fixed_gripper = self.layout.fixed_gripper
        return {
            "density_g_cm3": self.density_g_cm3,
            "density_from": self.density_from,
            "mass_g": self.mass_g,
            "max_incidence_deg": self.options.max_incidence_deg,
            "smallest_defect_mm": self.smallest_defect_mm,
            "counted_defect_mm": self.counted_defect_mm,
            "least_gain": self.options.least_gain,
            "force_n": self.force_n,
            "arm_gripper_n": self.layout.arm_gripper.force_n,
            "fixed_gripper_n": None if fixed_gripper is None else fixed_gripper.force_n,
            "arm_pads": _pads_json(self.layout.arm_gripper),
            "fixed_pads": None if fixed_gripper is None else _pads_json(fixed_gripper),
            "width_tolerance_mm": self.options.opening_tolerance_mm,
            "from_recipe": self.has_recipe,
        }

    def heaviest_g_cm3(self, plan: Plan) -> float:
        """Return a density up to which the grasps of a plan hold the part.

        The share of the friction limit used by the weight grows no faster than the weight.
        """
        load = max(grasp.load for grasp in plan.grasps)
        return self.density_g_cm3 * self.options.rules.max_load / load

    @property
    def sentence(self) -> str:
        """Assumptions of the plans, in one sentence."""
        density = _DENSITY_WORDS[self.density_from].format(f"{self.density_g_cm3:g}")
        fixed_gripper, gain = self.layout.fixed_gripper, self.options.least_gain
        fixed = "" if fixed_gripper is None else f", {fixed_gripper.force_n:g} N (fixed gripper)"
        least = f"; each view adds {gain:.2%} of the surface or more" if gain else ""
        counted = ""
        if self.counted_defect_mm > self.smallest_defect_mm:
            counted = f", coverage counted for {self.counted_defect_mm:.2g} mm and more"
        pads = self.layout.arm_gripper.pads
        friction = "" if pads is None else f"; friction {pads.friction:g}"
        if pads and fixed_gripper and fixed_gripper.pads and fixed_gripper.pads != pads:
            friction += f" (arm gripper), {fixed_gripper.pads.friction:g} (fixed gripper)"
        words = (
            f"{density}, {self.mass_g:.0f} g; incidence up to "
            f"{self.options.max_incidence_deg:g} deg; smallest defect {self.smallest_defect_mm:g} "
            f"mm{counted}{least}; grasp force {self.layout.arm_gripper.force_n:g} N (arm gripper)"
            f"{fixed}{friction}; "
            f"opening tolerance {self.options.opening_tolerance_mm:g} mm"
        )
        return f"planned with {words}" if self.has_recipe else f"planned without a recipe: {words}"


def planner_setup(
    recipe: Recipe | None,
    cell: Cell,
    part: CompiledPart,
    density_g_cm3: float | None = None,
) -> PlannerSetup:
    """Return the planner's inputs for a part in a cell.

    Parameters
    ----------
    recipe : None for a recipe's default figures
    cell : the cell file
    part : the compiled part
    density_g_cm3 : density on the command line; without it the recipe's, else the CAD file's, else
        that of aluminium
    """
    wanted = InspectionSection() if recipe is None else recipe.inspection
    grasp = GraspSection() if recipe is None else recipe.grasp
    of_recipe = None if recipe is None else recipe.density_g_cm3
    source: DensityFrom = "assumed"
    if density_g_cm3 is not None:
        source = "command line"
    elif of_recipe is not None:
        source = "recipe"
    elif part.solid.density_g_cm3:
        source = "CAD file"
    density = part.density_g_cm3(density_g_cm3 or of_recipe)
    layout = build_layout(cell)
    fixed_gripper = layout.fixed_gripper
    layout = replace(
        layout,
        arm_gripper=_pressing(layout.arm_gripper, grasp),
        fixed_gripper=None if fixed_gripper is None else _pressing(fixed_gripper, grasp),
    )
    pixel_mm = layout.inspection.mm_per_px(layout.station_mm)
    needed = needed_px_per_mm(part.solid, wanted.smallest_defect_mm, pixel_mm)
    options = PlanOptions()
    options = replace(
        options,
        max_incidence_deg=wanted.max_incidence_deg,
        min_px_per_mm=tuple((RESERVE * needed).tolist()),
        least_gain=wanted.least_gain,
        face_share=MIN_FACE_SHARE,
        opening_tolerance_mm=grasp.width_tolerance_mm,
        rules=replace(options.rules, density_kg_mm3=density * 1e-6),
    )
    return PlannerSetup(
        layout=layout,
        options=options,
        density_g_cm3=density,
        density_from=source,
        mass_g=part.solid.volume_mm3 / 1000 * density,
        smallest_defect_mm=wanted.smallest_defect_mm,
        counted_defect_mm=counted_defect_mm(part.samples, wanted.smallest_defect_mm),
        force_n=grasp.force_n,
        has_recipe=recipe is not None,
    )


def _pressing(jaw: Jaw, grasp: GraspSection) -> Jaw:
    """Return a gripper of the cell as it holds a recipe's part."""
    pads = jaw.pads
    if pads is not None and grasp.friction is not None:
        pads = replace(pads, friction=grasp.friction)
    return replace(jaw, force_n=min(grasp.force_n, jaw.force_n), pads=pads)


def _pads_json(jaw: Jaw) -> dict[str, Any]:
    pads = jaw.pads
    return {
        "length_mm": jaw.pad_length_mm,
        "width_mm": jaw.finger_width_mm,
        "friction": None if pads is None else pads.friction,
        "compliance_mm": None if pads is None else pads.compliance_mm,
    }

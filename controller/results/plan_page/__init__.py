"""A plan as one HTML page for the process engineer: steps, coverage, times, reasons."""

from ._page import PlanFacts, render_plan, write_plan_page, write_step_pictures

__all__ = ["PlanFacts", "render_plan", "write_plan_page", "write_step_pictures"]

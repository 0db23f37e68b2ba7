"""A plan as one HTML page for the process engineer: each step drawn, coverage, time, reasons."""

from ._moments import Kind, Moment, moments
from ._page import PlanFacts, render_plan, write_plan_page

__all__ = ["Kind", "Moment", "PlanFacts", "moments", "render_plan", "write_plan_page"]

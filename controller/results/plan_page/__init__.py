"""A plan as one HTML page for the process engineer: each step drawn, coverage, time, reasons."""

from ._moments import Kind, Moment, moments, view_count
from ._page import PlanFacts, render_plan, write_plan_page

__all__ = ["Kind", "Moment", "PlanFacts", "moments", "render_plan", "view_count", "write_plan_page"]

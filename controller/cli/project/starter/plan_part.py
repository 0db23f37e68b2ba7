"""Plan how to show the part of this project; print the steps and the uncovered surface.

Run it with the Python that cellctl is installed in. It moves nothing and needs no device.
"""

from pathlib import Path

from controller.interface import plan_part

HERE = Path(__file__).parent

plan = plan_part(HERE / "parts" / "holder.stl", recipe=HERE / "recipe.yaml")
for label, seconds in plan.seconds_by_step:
    print(f"{seconds:6.1f} s  {label}")
print(f"{plan.forecast_s:.0f} s, {plan.covered_fraction:.1%} of the surface")
for face in plan.unseen:
    print(f"face {face.face_id}: {face.area_fraction:.2%} unseen, {face.reason}")

"""Plan how to show a part; print the steps, the forecast and what stays unseen."""

from controller.interface import plan_part, shipped_file

plan = plan_part(shipped_file("parts/holder.stl"), recipe=shipped_file("holder.yaml"))
for label, seconds in plan.seconds_by_step:
    print(f"{seconds:6.1f} s  {label}")
print(f"{plan.forecast_s:.0f} s, {plan.covered_fraction:.1%} of the surface")
for face in plan.unseen:
    print(f"face {face.face_id}: {face.area_fraction:.2%} unseen, {face.reason}")

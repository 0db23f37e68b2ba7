"""Find the figures of a cell file: the cameras as-built, and where things should stand.

Import each room by itself: `calibration` turns pictures of a board into a camera, `siting` compares
positions of the inspection camera and the fixed gripper.
"""

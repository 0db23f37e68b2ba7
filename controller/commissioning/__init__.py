"""Camera calibration and siting: the cameras as built, and the best places for the devices.

Import each room by itself: `calibration` turns pictures of a board into a camera, `siting` compares
positions of the inspection camera and the fixed gripper.
"""

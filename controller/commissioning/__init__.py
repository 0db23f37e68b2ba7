"""What makes a cell file true: what the cameras really are, and where things should stand.

Each room has a door of its own: `calibration` turns pictures of a board into a camera, `siting`
compares positions of the inspection camera and the fixed gripper.
"""

"""Calibration of cameras, arm, grippers and lamps: the cell as built, from pictures and touches.

Each room is imported by itself: `calibration` turns pictures of a board into a camera.
"""

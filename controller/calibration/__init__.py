"""Calibration of cameras, arm, grippers and lamps: the cell as built, from pictures and touches.

Each package is imported by itself: `camera` is one camera from pictures of a board, `kinematics`
the whole cell in one fit. Arrays and dataclasses; knows no device (`controller.bring_up` does).
"""

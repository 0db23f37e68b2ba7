"""The solid matter of the emulated cell: boxes and parts as bodies, grasps, pads, collisions."""

"""What is solid in the emulated cell: boxes and parts as bodies, grasps, pads, collisions."""

"""Gauges between the jaws: handed over, held through a shake, touched in the fixed gripper."""

"""Planes, cylinders, cones, spheres and tori: their formulas, and fits of them to points."""

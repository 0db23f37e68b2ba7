"""Visible edges of a solid, and how they are drawn."""

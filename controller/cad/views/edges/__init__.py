"""Which edges of a solid the eye sees, and how they are drawn."""

"""What follows from a CAD file alone."""

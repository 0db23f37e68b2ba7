"""What the cell must know about itself, measured."""

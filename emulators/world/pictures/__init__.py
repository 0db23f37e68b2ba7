"""What the cameras of the emulated cell see, drawn in a process of their own."""

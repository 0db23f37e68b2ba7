"""The controller of the inspection cell: everything that decides."""

"""Help of `cellctl compile`."""

import typer

from controller.loading import loading

from ..options import from_fields
from .arguments import PartsOptions


@from_fields
def compile_(options: PartsOptions) -> None:
    """Show what follows from a CAD file: poses, surfaces, edges.

    Prints features, stable poses and outlines too; with a cell, also grasps and plans.
    """
    with loading():
        from .compiling import compile_parts

    raise typer.Exit(compile_parts(options))

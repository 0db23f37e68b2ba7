"""Help of `cellctl recognise`."""

import typer

from controller.loading import loading

from ..options import from_fields
from .arguments import RecogniseOptions


@from_fields
def recognise(options: RecogniseOptions) -> None:
    """Recognise parts in stored pictures of the table.

    Prints part, stable pose and pose on the table of every object, or "unknown".
    """
    with loading():
        from .answers import recognise_images

    raise typer.Exit(recognise_images(options))

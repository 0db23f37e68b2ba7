"""The measurements and pictures of a step of commissioning, kept as they come."""

import asyncio
import hashlib
from collections.abc import Callable
from pathlib import Path

import cv2

from controller.arrays import Grey

from .procedure import GivenAnswer, StepFigure, StepPicture


class StepEvidence:
    """Figures, findings, pictures and answers of one run of a step.

    Parameters
    ----------
    folder : folder of this run's evidence; it exists
    show : printer of a line for the spectators
    """

    def __init__(self, folder: Path, show: Callable[[str], None]) -> None:
        self.folder = folder
        self.show = show
        self.figures: list[StepFigure] = []
        self.findings: list[str] = []
        self.pictures: list[StepPicture] = []
        self.answers: list[GivenAnswer] = []

    def measure(
        self,
        name: str,
        value: float,
        unit: str = "",
        *,
        uncertainty: float | None = None,
        low: float | None = None,
        high: float | None = None,
    ) -> StepFigure:
        """Store and print a measured value; return it.

        Parameters
        ----------
        name : name of its subject
        value, unit : measured
        uncertainty : standard uncertainty; None if nobody worked it out
        low, high : limits, None for none
        """
        figure = StepFigure(
            name=name,
            value=float(value),
            unit=unit,
            uncertainty=uncertainty,
            low=low,
            high=high,
        )
        self.figures.append(figure)
        self.show(("" if figure.is_within else "NOT ALLOWED: ") + figure.words)
        return figure

    def find(self, text: str) -> None:
        """Store and print a finding without a figure."""
        self.findings.append(text)
        self.show(text)

    async def keep(self, name: str, picture: Grey, caption: str) -> None:
        """Keep a picture.

        Parameters
        ----------
        name : name of its file, without suffix
        picture : (height, width)
        caption : caption of the picture

        Raises
        ------
        OSError : it cannot be written
        """
        path = self.folder / f"{name}.png"
        digest = await asyncio.to_thread(_write, path, picture)
        self.pictures.append(StepPicture(file=path.name, caption=caption, sha256=digest))


def _write(path: Path, picture: Grey) -> str:
    data = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
    path.write_bytes(data)
    return hashlib.sha256(data).hexdigest()

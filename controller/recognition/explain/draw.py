"""Lines and words on a colour picture, for the explanation.

Colours that mean different things are as far apart for people who do not tell red from green; the
picture below them is dimmed so that all of them stand out, before a bright table and a dark part.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from controller.arrays import FloatArray, Grey, Int32Array, Picture

Colour = tuple[int, int, int]

# Colours as blue, green, red, in OpenCV's order.
WHITE: Colour = (245, 245, 245)
SOFT: Colour = (160, 160, 160)
BLACK: Colour = (0, 0, 0)
PAPER: Colour = (28, 26, 25)
YELLOW: Colour = (0, 250, 255)
GREEN: Colour = (150, 255, 30)
RED: Colour = (70, 70, 255)
SKY: Colour = (250, 165, 80)
ORANGE: Colour = (0, 143, 250)
PINK: Colour = (166, 97, 255)

TONE_LOW, TONE_HIGH = 24.0, 150.0  # what the grey levels are drawn as
TONE_POWER = 0.5  # dark parts before a light table still show what is on them
SHIFT = 4  # bits below the pixel with which OpenCV draws
FONT = cv2.FONT_HERSHEY_SIMPLEX
SIZE = 0.45  # size of letters, for any size of picture
LINE_PX = 18  # distance from one line of words to the next


def toned(grey: Grey) -> Picture:
    """Return a grey picture (h, w) brightened where it is dark, dimmed where bright, in colour."""
    levels = np.arange(256) / 255.0
    table = TONE_LOW + (TONE_HIGH - TONE_LOW) * levels**TONE_POWER
    return np.asarray(
        cv2.cvtColor(cv2.LUT(grey, np.round(table).astype(np.uint8)), cv2.COLOR_GRAY2BGR), np.uint8
    )


@dataclass(frozen=True, eq=False, slots=True)
class Sheet:
    """A piece of canvas for a piece of the picture.

    Attributes
    ----------
    canvas : (h, w, 3) drawn on
    origin_px : (2,) origin of the picture's pixel that lies at the canvas' corner
    scale : (2,) canvas pixels to a picture's pixel, x before y
    """

    canvas: Picture
    origin_px: FloatArray
    scale: FloatArray

    def at(self, pixels: FloatArray) -> FloatArray:
        """Return the positions on the canvas of pixels (n, 2) of the picture."""
        return np.asarray((pixels - self.origin_px + 0.5) * self.scale - 0.5)

    def line(
        self, pixels: FloatArray, colour: Colour, width: int = 1, *, is_closed: bool = False
    ) -> None:
        """Draw a line through pixels of the picture.

        Parameters
        ----------
        pixels : (n, 2) x before y
        colour : blue, green, red
        width : in pixels of the canvas
        is_closed : the last point is joined to the first
        """
        polyline(self.canvas, self.at(pixels), colour, width, is_closed=is_closed)

    def strokes(self, begin: FloatArray, end: FloatArray, colour: Colour, width: int = 1) -> None:
        """Draw many short lines.

        Parameters
        ----------
        begin, end : (n, 2) pixels of the picture, x before y
        colour : blue, green, red
        width : in pixels of the canvas
        """
        if len(begin) == 0:
            return
        ends = np.stack([self.at(begin), self.at(end)], axis=1)
        cv2.polylines(self.canvas, list(_fixed(ends)), False, colour, width, cv2.LINE_AA, SHIFT)

    def dot(self, pixel: FloatArray, colour: Colour, radius: int = 4) -> None:
        """Draw a full disc with a dark rim.

        Parameters
        ----------
        pixel : (2,) pixel of the picture, x before y
        colour : blue, green, red
        radius : in pixels of the canvas
        """
        x, y = _fixed(self.at(pixel[None]))[0].tolist()
        for grown, drawn in ((1, BLACK), (0, colour)):
            size = (radius + grown) << SHIFT
            cv2.circle(self.canvas, (x, y), size, drawn, -1, cv2.LINE_AA, SHIFT)

    def words(
        self, text: str, pixel: FloatArray, colour: Colour, shift: tuple[int, int] = (0, 0)
    ) -> None:
        """Write words beside a pixel, kept on the canvas, on a dark ground.

        Parameters
        ----------
        text : one line
        pixel : (2,) pixel of the picture, x before y
        colour : colour of the letters: blue, green, red
        shift : (x, y) shift from the pixel to the upper left corner of the ground, in pixels of the
            canvas
        """
        x, y = np.round(self.at(pixel[None]))[0].astype(int).tolist()
        tag(self.canvas, text, (x + shift[0], y + shift[1]), colour)


def _fixed(points: FloatArray) -> Int32Array:
    """Return points in OpenCV's fixed-point numbers, kept within their range."""
    return np.round(np.clip(points, -16000, 16000) * (1 << SHIFT)).astype(np.int32)


def polyline(
    canvas: Picture, points: FloatArray, colour: Colour, width: int = 1, *, is_closed: bool = False
) -> None:
    """Draw a line through points of the canvas; none through no point.

    Parameters
    ----------
    canvas : (h, w, 3) drawn on
    points : (n, 2) x before y, fractions of a pixel count
    colour : blue, green, red
    width : in pixels
    is_closed : the last point is joined to the first
    """
    if len(points):
        cv2.polylines(canvas, [_fixed(points)], is_closed, colour, width, cv2.LINE_AA, SHIFT)


def text_width(text: str, size: float = SIZE) -> int:
    """Return the width of a text in pixels."""
    (width, _), _ = cv2.getTextSize(text, FONT, size, 1)
    return int(width)


def write(
    canvas: Picture, text: str, at: tuple[int, int], colour: Colour = WHITE, size: float = SIZE
) -> None:
    """Write a line of words.

    Parameters
    ----------
    canvas : (h, w, 3) drawn on
    text : one line; `plain` replaces what the font has not
    at : (x, y) position of the lower left corner
    colour : blue, green, red
    size : size of the letters, as OpenCV scales its font
    """
    cv2.putText(canvas, plain(text), at, FONT, size, colour, 1, cv2.LINE_AA)


def tag(canvas: Picture, text: str, at: tuple[int, int], colour: Colour) -> None:
    """Write words on a dark ground, moved so that all of them are on the canvas.

    Parameters
    ----------
    canvas : (h, w, 3) drawn on
    text : one line
    at : (x, y) position of the upper left corner of the ground, before it is moved
    colour : colour of the letters: blue, green, red
    """
    height, width = canvas.shape[:2]
    long = text_width(plain(text)) + 8
    x = int(np.clip(at[0], 0, max(width - long, 0)))
    y = int(np.clip(at[1], 0, max(height - LINE_PX, 0)))
    cv2.rectangle(canvas, (x, y), (x + long, y + LINE_PX), PAPER, cv2.FILLED)
    write(canvas, text, (x + 4, y + 13), colour)


def plain(text: str) -> str:
    """Return a text in the letters the font has."""
    return text.encode("ascii", "replace").decode()

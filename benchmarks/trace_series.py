"""Series of held parts with known truth, path-traced: many pieces of one part, shown alike.

    python benchmarks/trace_series.py FOLDER=SEED... [--good 12] [--defects 8] [--until 21:40]

Writes into each FOLDER what `trace_held.py` writes, piece by piece: s0001 up. The seed draws the
part, its material, camera, lamps, gripper, and the commanded views, which all pieces share. Each
piece is built anew within its tolerances, slips in the fingers by up to 0.8 mm and 1 degree, is
shown by an arm that errs by up to 0.3 mm and 0.25 degrees, and has a finish and dust of its own;
exposures are the first piece's. The first --good pieces are good, the others have one defect each,
of the kinds that surfaces show. `bench_learned.py` learns from the first and judges the rest.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from trace_held import (
    Array,
    Body,
    Folder,
    Specimen,
    draw_dust,
    draw_look,
    is_late,
    scaled,
    write_atomically,
)
from trace_held_defects import NoPlaceError, as_built, mesh_of, with_defect
from trace_held_hold import NoHoldError, View, disturbed
from trace_held_light import Seen
from trace_scene import NoTracerError, tracer

from controller.cad import CadError
from controller.config import ConfigError
from controller.planning import NoPlanError

KINDS = ("dent", "chip", "scratch", "burr", "stain", "pit", "hole_small", "hole_filled")
SLIP_MM, SLIP_DEG = 0.8, 1.0
ARM_MM, ARM_DEG = 0.3, 0.25
PLAY = 0.03  # share by which gloss and albedo differ from piece to piece
MAX_TRIES = 25


class Piece(Specimen):
    """One piece of a series: built, slipped and dusted by itself, shown as the series is."""

    def __init__(
        self,
        series: Specimen,
        number: int,
        cls: str,
        kind: str,
        gains: dict[str, float] | None,
    ) -> None:
        vars(self).update(vars(series))
        self.fixed = gains
        self.number, self.cls, self.kind = number, cls, kind
        self.rng = rng = np.random.default_rng([series.seed, 7, number])
        self.first = series
        for _ in range(MAX_TRIES):
            try:
                self.built = (
                    as_built(self.part, rng) if cls == "good" else with_defect(self.part, kind, rng)
                )
                break
            except NoPlaceError:
                continue
        else:
            raise NoPlaceError(f"{kind} on no place of {self.part.name}")
        self.body = scaled(mesh_of(self.built.body), self.built)
        # the same machining with another phase, gloss and albedo
        words = np.random.default_rng([series.seed, 8])
        look, self.material = draw_look(words, plain=False)
        roll = tuple(int(v) for v in rng.integers(0, look.albedo.shape[0], 2))
        material = {k: v * rng.uniform(1 - PLAY, 1 + PLAY) for k, v in look.material.items()}
        self.look = replace(
            look,
            material=material,
            albedo=np.roll(look.albedo, roll, (0, 1)),
            height=np.roll(look.height, roll, (0, 1)),
        )
        self.dust = draw_dust(self.body, rng)
        self.commanded = series.views
        middle = self.body.bounding_box.centroid
        self.slips = self.slipped(middle, rng)
        self.errors = []
        views = []
        for view in series.views:
            pivot = view.T[:3, :3] @ middle + view.T[:3, 3]
            error = self.erred(view, pivot, rng)
            self.errors.append(error)
            views.append(replace(view, T=error @ view.T @ self.slips[view.grasp]))
        self.views = views

    def erred(self, view: View, pivot: Array, rng: np.random.Generator) -> Array:
        """Return by how much the arm is off in a view, in the station."""
        return disturbed(np.eye(4), pivot, ARM_MM, ARM_DEG, rng)

    def slipped(self, middle: Array, rng: np.random.Generator) -> list[Array]:
        """Return how the part lies in the fingers, grasp by grasp, part's frame."""
        return [disturbed(np.eye(4), middle, SLIP_MM, SLIP_DEG, rng) for _ in self.grasps]

    def exposed(self, seen: Sequence[Seen]) -> dict[str, float]:
        """Return the first piece's gains, which all pieces have; this one's if it is the first."""
        return self.fixed or super().exposed(seen)

    def things(self, view: View, body: Body | None = None) -> list[Any]:
        """Return what stands before the camera: the part slipped in the fingers."""
        number = next(i for i, one in enumerate(self.views) if one is view)
        part, *rest = super().things(view, body)
        count = len(self.grasps[view.grasp].boxes)
        boxes = [
            replace(thing, T=self.errors[number] @ self.commanded[number].T @ box.T)
            for thing, box in zip(rest[:count], self.grasps[view.grasp].boxes, strict=True)
        ]
        return [part, *boxes, *rest[count:]]

    def expected(self) -> list[Any]:
        """Return the commanded pose of part and gripper's boxes, view by view."""
        return [
            (view.T, [view.T @ box.T for box in self.grasps[view.grasp].boxes])
            for view in self.commanded
        ]


Made = Callable[[Path, str, int], "Series"]


class Series(Folder):
    """A folder of one series."""

    first_kind = 0  # of `KINDS`, which the first defective piece has

    def __init__(self, path: Path, seed: int, good: int) -> None:
        super().__init__(path, seed)
        self.good = good
        self.base = self.begun()

    def begun(self) -> Specimen:
        """Return what all pieces share."""
        return Specimen(self.seed, "good", "as_built")

    def made(self, number: int, cls: str, kind: str, gains: dict[str, float] | None) -> Piece:
        """Return one piece."""
        return Piece(self.base, number, cls, kind, gains)

    def fill(self, count: int, until: str | None) -> None:
        """Make pieces up to a number of them, none begun later than HH:MM."""
        while self.next_number() < count and not is_late(until):
            self.add(self.next_number())

    def add(self, number: int) -> None:
        """Make one piece; all have the exposures of the first."""
        super().add(number)
        if "gains" not in self.truth:
            self.truth["gains"] = self.truth["specimens"][0]["gains"]
            write_atomically(self.file, json.dumps(self.truth))

    def specimen(self, number: int) -> Piece:
        """Return a piece; a defect that finds no place on the part is replaced by the next kind."""
        gains = self.truth.get("gains")
        if number < self.good:
            return self.made(number, "good", "as_built", gains)
        for turn in range(len(KINDS)):
            kind = KINDS[(self.first_kind + number - self.good + turn) % len(KINDS)]
            with suppress(NoPlaceError):
                return self.made(number, "defect", kind, gains)
        raise NoPlaceError(f"no defect finds a place on {self.base.part.name}")


def trace(doc: str, form: str, made: Made, argv: Sequence[str] | None, *, counts: str) -> int:
    """Parse, trace, and turn an error into one sentence.

    Parameters
    ----------
    doc, form : of the command; how a folder is named
    made : of a folder, what stands behind its "=", and the number of good pieces, its series
    argv : arguments
    counts : of good pieces and of those with a defect, usually
    """
    good, defects = counts.split()
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("folders", nargs="+", metavar=form, help="filled in turn")
    parser.add_argument("--good", type=int, default=int(good), help="good pieces a folder")
    parser.add_argument("--defects", type=int, default=int(defects), help="pieces with one defect")
    parser.add_argument("--until", help="HH:MM; no piece is begun later")
    args = parser.parse_args(argv)
    cv2.setNumThreads(1)
    try:
        tracer()
        for word in args.folders:
            path, _, rest = word.rpartition("=")
            one = made(Path(path), rest, args.good)
            print(f"{one.path.name}: {one.base.part.name}, {len(one.base.views)} views, "
                  f"{100 * one.base.coverage:.0f} % in sight", flush=True)  # fmt: skip
            one.fill(args.good + args.defects, args.until)
    except (
        NoTracerError, NoHoldError, NoPlaceError, NoPlanError, CadError, ConfigError, OSError,
        ValueError,
    ) as error:  # fmt: skip
        print(f"{Path(sys.argv[0]).stem}: {error}", file=sys.stderr)
        return 2
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    def series(path: Path, seed: str, good: int) -> Series:
        return Series(path, int(seed), good)

    return trace(__doc__ or "", "FOLDER=SEED", series, argv, counts="12 8")


if __name__ == "__main__":
    sys.exit(main())

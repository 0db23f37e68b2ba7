"""Diameter of a dark disc, in pixels: erf fit per ray against what OpenCV and others offer.

    python benchmarks/bench_edges.py [--count 30] [--seed 7] [--json]

Pictures come from a renderer of this file alone: coverage on a grid ten times as fine, a Gaussian
lens on that grid, the mean of each pixel, noise, rounding. Each row is a radius, a lens and a
noise; each method is given the same pictures, and the rays also a circle that is off by up to
half a pixel in place and radius. Printed: mean error of the diameter and its standard deviation
[px], and milliseconds a disc. Methods: `spline`, the project's; `raw`, the same without the term
of curvature; `remap`, the same with cv2.remap's cubic instead of the spline; `contour`,
cv2.findContours of the half level and cv2.fitEllipse; `canny`, cv2.Canny and cv2.fitEllipse;
`half`, points of the half level between pixels and cv2.fitEllipse; `moments`, area of what is
darker; `skimage`, find_contours and a circle, where it can be imported.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from controller.imaging import blur_shift_px, measure_edges, subpixel_contour
from controller.imaging import edges as edges_module

FINE = 10
DARK, BRIGHT = 40.0, 200.0
RADII = (8.0, 25.0, 60.0)
LIGHTS = ((0.6, 2.0), (0.8, 1.0), (0.8, 2.0), (0.8, 5.0), (1.0, 2.0), (1.2, 2.0), (1.4, 2.0))
REACHED = (25.0, 2.0, 0.01, 0.01)  # radius, noise, bias and sigma that are required


def disc(
    radius: float, psf: float, noise: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return a picture of a dark disc somewhere in its middle, and the centre."""
    size = int(2 * radius + 24)
    centre = size / 2 + rng.uniform(-0.5, 0.5, 2)
    fine = (np.arange(size * FINE) + 0.5) / FINE - 0.5
    far = np.hypot(fine[None, :] - centre[0], fine[:, None] - centre[1])
    # coverage of a fine cell to first order: its own edge is softened, not left as a stair
    cover = np.clip((radius - far) * FINE + 0.5, 0.0, 1.0)
    cover = cv2.GaussianBlur(cover, (0, 0), psf * FINE, borderType=cv2.BORDER_REPLICATE)
    pixels = cover.reshape(size, FINE, size, FINE).mean(axis=(1, 3))
    grey = BRIGHT + (DARK - BRIGHT) * pixels + rng.normal(0.0, noise, (size, size))
    return np.clip(np.round(grey), 0, 255).astype(np.uint8), centre


def circle(points: np.ndarray) -> float:
    """Return the radius of the circle nearest to points (n, 2), least squares."""
    centre, radius = points.mean(axis=0), 1.0
    for _ in range(10):
        away = points - centre
        far = np.linalg.norm(away, axis=1)
        design = np.column_stack([away / far[:, None], np.ones(len(points))])
        step = np.linalg.lstsq(design, far - radius, rcond=None)[0]
        centre, radius = centre + step[:2], radius + step[2]
    return float(radius)


def by_rays(picture: np.ndarray, guess: np.ndarray, radius: float, noise: float) -> tuple:
    angle = np.arange(0, 2 * np.pi, 1 / max(radius, 30.0))
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    fits = measure_edges(picture, guess + radius * out, out, 2.0, noise, rising=np.ones(len(out)))
    found = fits.is_found
    points = (guess + (radius + fits.offset_px[:, None]) * out)[found]
    return circle(points), float(np.median(fits.width_px[found]))


def spline(picture: np.ndarray, guess: np.ndarray, radius: float, noise: float) -> float:
    found, width = by_rays(picture, guess, radius, noise)
    return 2 * (found + float(blur_shift_px(width, 1 / found)))


def raw(picture: np.ndarray, guess: np.ndarray, radius: float, noise: float) -> float:
    return 2 * by_rays(picture, guess, radius, noise)[0]


def remap(picture: np.ndarray, guess: np.ndarray, radius: float, noise: float) -> float:
    def sampled(picture, origins, directions, offsets):  # noqa: ANN001, ANN202 - in place of another
        at = (origins[:, None] + offsets[None, :, None] * directions[:, None]).astype(np.float32)
        values = cv2.remap(picture.astype(np.float32), at[..., 0], at[..., 1], cv2.INTER_CUBIC)
        return values.astype(np.float64), np.ones(values.shape, dtype=bool)

    own, edges_module.sample_rays = edges_module.sample_rays, sampled
    try:
        return spline(picture, guess, radius, noise)
    finally:
        edges_module.sample_rays = own


def ellipse(points: np.ndarray) -> float:
    _, axes, _ = cv2.fitEllipse(points.astype(np.float32))
    return float(np.mean(axes))


def contour(picture: np.ndarray, guess: np.ndarray, radius: float, noise: float) -> float:
    mask = (picture < (DARK + BRIGHT) / 2).astype(np.uint8)
    found, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return ellipse(max(found, key=len).reshape(-1, 2))


def canny(picture: np.ndarray, guess: np.ndarray, radius: float, noise: float) -> float:
    y, x = np.nonzero(cv2.Canny(picture, 60, 150))
    return ellipse(np.column_stack([x, y]))


def half(picture: np.ndarray, guess: np.ndarray, radius: float, noise: float) -> float:
    return ellipse(subpixel_contour(picture, (DARK + BRIGHT) / 2).points_px)


def moments(picture: np.ndarray, guess: np.ndarray, radius: float, noise: float) -> float:
    share = (BRIGHT - picture.astype(np.float64)) / (BRIGHT - DARK)
    return 2 * float(np.sqrt(share.sum() / np.pi))


def by_skimage() -> Callable[..., float] | None:
    try:
        from skimage.measure import find_contours
    except ImportError:
        return None

    def skimage(picture: np.ndarray, guess: np.ndarray, radius: float, noise: float) -> float:
        return 2 * circle(max(find_contours(picture, (DARK + BRIGHT) / 2), key=len)[:, ::-1])

    return skimage


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    methods = [spline, raw, remap, contour, canny, half, moments]
    methods += [m for m in [by_skimage()] if m is not None]
    rows = []
    is_reached = True
    for radius in RADII:
        for psf, noise in LIGHTS:
            rng = np.random.default_rng([args.seed, int(radius), int(psf * 10), int(noise)])
            errors: dict[str, list[float]] = {m.__name__: [] for m in methods}
            spent = dict.fromkeys(errors, 0.0)
            for _ in range(args.count):
                picture, centre = disc(radius, psf, noise, rng)
                guess = centre + rng.uniform(-0.5, 0.5, 2)
                start = radius + rng.uniform(-0.5, 0.5)
                for method in methods:
                    begin = time.perf_counter()
                    value = method(picture, guess, start, noise)
                    spent[method.__name__] += time.perf_counter() - begin
                    errors[method.__name__].append(value - 2 * radius)
            row = {
                name: {
                    "bias_px": round(float(np.mean(off)), 5),
                    "sigma_px": round(float(np.std(off, ddof=1)), 5),
                    "ms": round(1000 * spent[name] / args.count, 2),
                }
                for name, off in errors.items()
            }
            rows.append({"radius_px": radius, "psf_px": psf, "noise": noise, "methods": row})
            if (radius, noise) == REACHED[:2]:
                own = row["spline"]
                is_reached &= abs(own["bias_px"]) <= REACHED[2] and own["sigma_px"] <= REACHED[3]
            if not args.json:
                cells = "  ".join(
                    f"{n} {r['bias_px']:+.4f}/{r['sigma_px']:.4f}" for n, r in row.items()
                )
                print(f"R {radius:4.0f} psf {psf:.1f} noise {noise:.0f}: {cells}", flush=True)
    if args.json:
        print(json.dumps({"count": args.count, "seed": args.seed, "rows": rows}, indent=1))
    else:
        spent = {n: np.mean([r["methods"][n]["ms"] for r in rows]) for n in rows[0]["methods"]}
        print("ms a disc: " + ", ".join(f"{n} {ms:.1f}" for n, ms in spent.items()))
        print(
            f"R {REACHED[0]:.0f}, noise {REACHED[1]:.0f}: bias and sigma within 0.01 px: "
            f"{is_reached}"
        )
    return 0 if is_reached else 1


if __name__ == "__main__":
    sys.exit(main())

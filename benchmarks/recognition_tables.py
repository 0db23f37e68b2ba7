"""The figures of `bench_recognition` as tables for people."""

from __future__ import annotations

from typing import Any

# issue 4: least rates, most errors (median, 95 %), most milliseconds of a picture with one part
TARGETS: dict[str, dict[str, Any]] = {
    "backlit": {
        "right_part": 0.99,
        "right_pose": 0.98,
        "position_mm": (0.05, 0.15),
        "angle_asymmetric_deg": (0.1, 0.3),
        "unknown_called_unknown": 0.95,
    },
    "front": {
        "right_part": 0.98,
        "right_pose": 0.97,
        "position_mm": (0.10, 0.30),
        "angle_asymmetric_deg": (0.15, 0.5),
        "unknown_called_unknown": 0.95,
    },
    "lo": {
        "right_part": 0.95,
        "right_pose": 0.93,
        "position_mm": (0.4, 1.0),
        "angle_asymmetric_deg": (0.5, 1.5),
        "unknown_called_unknown": 0.90,
    },
}
RATES = (
    ("right part", "right_part"),
    ("right pose", "right_pose"),
    ("  part, alternatives count", "right_part_with_alternatives"),
    ("  pose, alternatives count", "right_pose_with_alternatives"),
    ("unknown called unknown", "unknown_called_unknown"),
    ("known called unknown", "known_called_unknown"),
)
ERRORS = (
    ("position mm, median / p95", "position_mm", 3),
    ("angle deg, asymmetric", "angle_asymmetric_deg", 3),
    ("angle deg, all but round", "angle_deg", 3),
)
WIDTH = 17


def target_of(light: str) -> dict[str, Any]:
    return TARGETS["lo" if light.startswith("lo") else light]


def print_lights(lights: dict[str, Any]) -> None:
    """Print the issue's table, one column a light, and what is behind it."""
    _print_figures({light: by["cellctl"] for light, by in lights.items()})
    for aside in ("held_out", "others"):
        bodies = {light: by["cellctl"].get(aside) for light, by in lights.items()}
        if all(bodies.values()):
            print("-- " + aside.replace("_", " "))
            _print_figures(bodies)
    for light, by in lights.items():
        if light != "lo":
            _print_behind(light, by["cellctl"])


def _print_figures(bodies: dict[str, dict[str, Any]]) -> None:
    print(f"{'(! misses the target)':28}" + "".join(f"{light:>{WIDTH}}" for light in bodies))
    tally = "".join(f"{b['objects']:>{WIDTH - 5}} + {b['strangers']:2}" for b in bodies.values())
    print(f"{'objects + strangers':28}{tally}")
    for label, name in RATES:
        cells = [_rate(b[name], target_of(light).get(name)) for light, b in bodies.items()]
        print(f"{label:28}" + "".join(f"{cell:>{WIDTH}}" for cell in cells))
    for label, name, digits in ERRORS:
        cells = [_error(b[name], target_of(light).get(name), digits) for light, b in bodies.items()]
        print(f"{label:28}" + "".join(f"{cell:>{WIDTH}}" for cell in cells))
    if all("costs" in b for light, b in bodies.items() if light != "lo"):
        for label, name in (
            ("ms, one object: med / p95", "one_object_ms"),
            ("ms, any picture", "picture_ms"),
            ("wall ms, one object", "one_object_wall_ms"),
        ):
            cells = [_error(b.get("costs", {}).get(name), None, 0) for b in bodies.values()]
            print(f"{label:28}" + "".join(f"{cell:>{WIDTH}}" for cell in cells))
        cells = [
            f"{b['costs']['start_s']:.1f} / {b['costs']['peak_mb']:.0f}" if "costs" in b else "-"
            for b in bodies.values()
        ]
        print(f"{'start s / peak MB':28}" + "".join(f"{cell:>{WIDTH}}" for cell in cells))


def _rate(value: float | None, target: float | None) -> str:
    if value is None:
        return "-"
    return f"{100 * value:.1f} %" + ("!" if target is not None and value < target else " ")


def _error(value: dict[str, float] | None, target: tuple[float, float] | None, digits: int) -> str:
    if value is None:
        return "-"
    misses = target is not None and (value["median"] > target[0] or value["p95"] > target[1])
    text = f"{value['median']:.{digits}f} / {value['p95']:.{digits}f}"
    return text + ("!" if misses else " ")


def _print_behind(light: str, body: dict[str, Any]) -> None:
    print(f"-- {light}: {', '.join(f'{k} {n}' for k, n in body['tally'].items())}", end="")
    print(f"; {body['ambiguous_answers']} answers name alternatives")
    if body.get("costs", {}).get("error"):
        print(f"   STOPPED: {body['costs']['error']}")
    print("   answered as (only what is off the diagonal)")
    for row, cells in body["confusion"].items():
        wrong = {told: n for told, n in cells.items() if told != row}
        if wrong:
            right = cells.get(row, 0)
            print(
                f"   {row:22} {right:3} right; " + ", ".join(f"{k} {n}" for k, n in wrong.items())
            )
    told = body["reliability"]
    if told["bins"]:
        print(
            f"   score against share right: expected error {told['expected_error']:.3f}, "
            f"{told['expected_error_with_alternatives']:.3f} with alternatives"
        )
        for b in told["bins"]:
            print(
                f"   {b['from']:.2f} .. {b['to']:.2f}: {b['answers']:3} answers, mean score "
                f"{b['mean_score']:.3f}, right {b['right']:.3f}"
                f" ({b['right_with_alternatives']:.3f})"
            )
    for row in body["failures"]:
        score = "-" if row["score"] is None else f"{row['score']:.3f}"
        off = "" if row["distance_mm"] is None else f", {row['distance_mm']:.1f} mm away"
        also = " (among the alternatives)" if row["with_alternatives"] == "right" else ""
        reason = f"; {row['reason']}" if row["reason"] else ""
        print(
            f"   {row['image']}: {row['kind']}{also}: {row['truth'] or 'nothing'} answered as "
            f"{row['answer'] or 'nothing'}, score {score}{off}{reason}"
        )

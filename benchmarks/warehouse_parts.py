"""Standard parts of bd_warehouse as STEP files: parts nothing here was developed with.

python benchmarks/warehouse_parts.py FOLDER [--kit 4]

There are six kits of different parts: once what a kit showed has been mended, only the next one
still says how recognition does on parts that nobody looked at. Writes FOLDER/known and
FOLDER/strangers, each with the package's licence (Apache 2.0). The package is no dependency of the
project: pip install bd-warehouse==0.2.0 build123d==0.10.0 ocp_gordon==0.1.18. Threads are left out
(their `simple` form); assemblies are not taken.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from importlib.metadata import files
from pathlib import Path
from typing import Any

Make = Callable[[], Any]


def first_kit() -> tuple[dict[str, Make], dict[str, Make]]:
    """Return how each known part and each stranger of the first kit is made."""
    from bd_warehouse import fastener, flange, gear, open_builds, sprocket

    known: dict[str, Make] = {
        "hex_screw": lambda: fastener.HexHeadScrew("M16-2", 60, "iso4014", simple=True),
        "cap_screw": lambda: fastener.SocketHeadCapScrew("M16-2", 45, "iso4762", simple=True),
        "hex_nut": lambda: fastener.HexNut("M30-3.5", "iso4032", simple=True),
        "flange_nut": lambda: fastener.HexNutWithFlange("M20-2.5", "din1665", simple=True),
        "domed_nut": lambda: fastener.DomedCapNut("M24-3", "din1587", simple=True),
        "washer": lambda: fastener.PlainWasher("M30", "iso7093"),
        "blind_flange": lambda: flange.BlindFlange("1", 150),
        "slip_on_flange": lambda: flange.SlipOnFlange("1", 150),
        "weld_neck_flange": lambda: flange.WeldNeckFlange("1/2", 300),
        "sprocket_16": lambda: sprocket.Sprocket(16, 12.7, 7.9375, 0.0, 6.0, 40.0, 4, 4.5, 14.0),
        "sprocket_11": lambda: sprocket.Sprocket(11, 12.7, 7.9375, 0.0, 9.0, 24.0, 3, 3.4, 10.0),
        "spur_gear": lambda: gear.SpurGear(2.5, 22, 20, thickness=14),
        "rail_20x40": lambda: open_builds.VSlotLinearRail("20x40", 70),
        "rail_20x60": lambda: open_builds.VSlotLinearRail("20x60", 45),
        "c_beam": lambda: open_builds.CBeamLinearRail(40),
    }
    strangers: dict[str, Make] = {
        "button_screw": lambda: fastener.ButtonHeadScrew("M16-2", 50, "iso7380_1", simple=True),
        "lapped_flange": lambda: flange.LappedFlange("1", 150),
        "spur_gear_25": lambda: gear.SpurGear(2.5, 25, 20, thickness=12),
        "rail_20x80": lambda: open_builds.VSlotLinearRail("20x80", 40),
    }
    return known, strangers


def second_kit() -> tuple[dict[str, Make], dict[str, Make]]:
    """Return how each known part and each stranger of the second kit is made."""
    from bd_warehouse import fastener, flange, gear, open_builds, sprocket

    known: dict[str, Make] = {
        "countersunk_screw": lambda: fastener.CounterSunkScrew("M20-2.5", 50, simple=True),
        "flange_screw": lambda: fastener.HexHeadWithFlangeScrew("M16-2", 45, simple=True),
        "square_nut": lambda: fastener.SquareNut("M16-2", simple=True),
        "thin_nut": lambda: fastener.HexNut("M42-4.5", "iso4035", simple=True),
        "tall_nut": lambda: fastener.HexNut("M30-3.5", "iso4033", simple=True),
        "set_screw": lambda: fastener.SetScrew("M24-3", 40, simple=True),
        "lock_washer": lambda: fastener.InternalToothLockWasher("M30", "din6797"),
        "spacer_block": open_builds.SpacerBlock,
        "end_mount": open_builds.CBeamEndMount,
        "riser_plate": open_builds.CBeamRiserPlate,
        "nut_block": open_builds.AcmeAntiBacklashNutBlock8mm,
        "v_wheel": open_builds.XtremeSolidVWheel,
        "coupler": lambda: open_builds.FlexibleCoupler("8mm"),
        "gear_18": lambda: gear.SpurGear(3.0, 18, 20, thickness=16),
        "rail_40x40": lambda: open_builds.VSlotLinearRail("40x40", 55),
    }
    strangers: dict[str, Make] = {
        "collar_screw": lambda: fastener.ButtonHeadWithCollarScrew("M16-2", 45, simple=True),
        "weld_neck_small": lambda: flange.WeldNeckFlange("3/4", 300),
        "gear_20": lambda: gear.SpurGear(3.0, 20, 20, thickness=14),
        "sprocket_9": lambda: sprocket.Sprocket(9, 12.7, 7.9375, 0.0, 8.0, 20.0, 3, 3.0, 12.0),
        "gantry_plate": open_builds.CBeamGantryPlate,
    }
    return known, strangers


def third_kit() -> tuple[dict[str, Make], dict[str, Make]]:
    """Return how each known part and each stranger of the third kit is made."""
    from bd_warehouse import fastener, gear, open_builds, sprocket

    known: dict[str, Make] = {
        "cheese_screw": lambda: fastener.CheeseHeadScrew("M8-1.25", 45, simple=True),
        "pan_screw": lambda: fastener.PanHeadScrew("M10-1.5", 40, simple=True),
        "long_hex_screw": lambda: fastener.HexHeadScrew("M12-1.75", 80, "iso4014", simple=True),
        "long_set_screw": lambda: fastener.SetScrew("M20-2.5", 55, simple=True),
        "thick_nut": lambda: fastener.HexNut("M24-3", "iso4032", simple=True),
        "flange_nut_16": lambda: fastener.HexNutWithFlange("M16-2", "din1665", simple=True),
        "chamfered_washer": lambda: fastener.ChamferedWasher("M30", "iso7090"),
        "coupler_quarter": lambda: open_builds.FlexibleCoupler("1/4in"),
        "spacer_40": lambda: open_builds.AluminumSpacer("40mm"),
        "eccentric": lambda: open_builds.EccentricSpacer("1/4in"),
        "rail_20x20": lambda: open_builds.VSlotLinearRail("20x20", 60),
        "rail_20x80": lambda: open_builds.VSlotLinearRail("20x80", 55),
        "c_beam_60": lambda: open_builds.CBeamLinearRail(60),
        "gear_30": lambda: gear.SpurGear(2.0, 30, 20, thickness=10),
        "sprocket_13": lambda: sprocket.Sprocket(13, 12.7, 7.9375, 0.0, 8.0, 28.0, 3, 4.5, 12.0),
    }
    strangers: dict[str, Make] = {
        "raised_screw": lambda: fastener.RaisedCheeseHeadScrew("M10-1.5", 40, simple=True),
        "small_cap_screw": lambda: fastener.SocketHeadCapScrew(
            "M12-1.75", 45, "iso4762", simple=True
        ),
        "rail_20x40_50": lambda: open_builds.VSlotLinearRail("20x40", 50),
        "spacer_35": lambda: open_builds.AluminumSpacer("35mm"),
        "square_nut_20": lambda: fastener.SquareNut("M10-1.5", simple=True),
    }
    return known, strangers


def fourth_kit() -> tuple[dict[str, Make], dict[str, Make]]:
    """Return how each known part and each stranger of the fourth kit is made."""
    from bd_warehouse import bearing, fastener, flange, gear, open_builds, pipe, sprocket
    from build123d import Compound, Edge, Solid

    def ring(whole: Compound, number: int) -> Solid:
        return sorted(whole.solids(), key=lambda solid: -solid.volume)[number]

    def tube(size: str, length_mm: float) -> Compound:
        return pipe.Pipe(size, "steel", "40", Edge.make_line((0, 0, 0), (0, 0, length_mm)))

    tapered = bearing.SingleRowTaperedRollerBearing
    known: dict[str, Make] = {
        "oval_screw": lambda: fastener.RaisedCounterSunkOvalHeadScrew("M10-1.5", 45, simple=True),
        "long_cap_screw": lambda: fastener.SocketHeadCapScrew("M12-1.75", 60, simple=True),
        "cup_30": lambda: ring(tapered("M30-62-25"), 0),
        "inner_ring_25": lambda: ring(tapered("M25-62-25.25"), 1),
        "washer_20": lambda: fastener.PlainWasher("M20", "iso7089"),
        "washer_12": lambda: fastener.PlainWasher("M12", "iso7093"),
        "cheese_washer": lambda: fastener.CheeseHeadWasher("M20"),
        "square_nut_12": lambda: fastener.SquareNut("M12-1.75", simple=True),
        "domed_nut_16": lambda: fastener.DomedCapNut("M16-2", "din1587", simple=True),
        "socket_flange": lambda: flange.SocketWeldFlange("1/2", 300),
        "lapped_stub": lambda: flange.LappedFlangeStub("1", "steel", "40", 50),
        "pipe_1": lambda: tube("1", 55),
        "gear_24": lambda: gear.SpurGear(2.5, 24, 20, thickness=18),
        "sprocket_10": lambda: sprocket.Sprocket(10, 12.7, 7.9375, 0.0, 10.0, 0.0, 0, 0.0, 0.0),
        "spindle_face": lambda: ring(open_builds.RouterSpindleMount(), 1),
    }
    strangers: dict[str, Make] = {
        "cup_25": lambda: ring(tapered("M25-52-16.25"), 0),
        "washer_16": lambda: fastener.PlainWasher("M16", "iso7093"),
        "pipe_1_40": lambda: tube("1", 40),
        "flange_screw_12": lambda: fastener.HexHeadWithFlangeScrew("M12-1.75", 50, simple=True),
        "lapped_half": lambda: flange.LappedFlange("1/2", 300),
    }
    return known, strangers


def fifth_kit() -> tuple[dict[str, Make], dict[str, Make]]:
    """Return how each known part and each stranger of the fifth kit is made.

    Washers, flanges and rings of one size that differ by their holes or by a step are among them.
    """
    from bd_warehouse import bearing, fastener, flange, gear, open_builds, pipe, sprocket
    from build123d import Compound, Edge, Solid

    def ring(whole: Compound, number: int) -> Solid:
        return sorted(whole.solids(), key=lambda solid: -solid.volume)[number]

    def tube(size: str, length_mm: float) -> Compound:
        return pipe.Pipe(size, "steel", "40", Edge.make_line((0, 0, 0), (0, 0, length_mm)))

    known: dict[str, Make] = {
        "collar_screw_12": lambda: fastener.ButtonHeadWithCollarScrew("M12-1.75", 40, simple=True),
        "cap_screw_10": lambda: fastener.SocketHeadCapScrew("M10-1.5", 55, simple=True),
        "sunk_screw_12": lambda: fastener.CounterSunkScrew("M12-1.75", 50, simple=True),
        "nut_20": lambda: fastener.HexNut("M20-2.5", "iso4032", simple=True),
        "flange_nut_14": lambda: fastener.HexNutWithFlange("M14-2", "din1665", simple=True),
        "washer_24": lambda: fastener.PlainWasher("M24", "iso7089"),
        "washer_14": lambda: fastener.PlainWasher("M14", "iso7093"),
        "cheese_washer_24": lambda: fastener.CheeseHeadWasher("M24"),
        "slip_on_three_quarters": lambda: flange.SlipOnFlange("3/4", 300),
        "blind_half": lambda: flange.BlindFlange("1/2", 300),
        "outer_ring": lambda: ring(bearing.SingleRowDeepGrooveBallBearing("M10-35-11"), 0),
        "pipe_half": lambda: tube("1/2", 50),
        "gear_28": lambda: gear.SpurGear(2.0, 28, 20, thickness=15),
        "sprocket_12": lambda: sprocket.Sprocket(12, 12.7, 7.9375, 0.0, 12.0, 0.0, 0, 0.0, 0.0),
        "rail_20x20_45": lambda: open_builds.VSlotLinearRail("20x20", 45),
    }
    strangers: dict[str, Make] = {
        "washer_22": lambda: fastener.PlainWasher("M22", "iso7089"),
        "blind_three_quarters": lambda: flange.BlindFlange("3/4", 300),
        "lapped_three_quarters": lambda: flange.LappedFlange("3/4", 300),
        "cap_screw_8": lambda: fastener.SocketHeadCapScrew("M8-1.25", 50, simple=True),
        "outer_ring_30": lambda: ring(bearing.SingleRowDeepGrooveBallBearing("M10-30-9"), 0),
    }
    return known, strangers


def sixth_kit() -> tuple[dict[str, Make], dict[str, Make]]:
    """Return how each known part and each stranger of the sixth kit is made.

    Screws, nuts, rings, flanges, gears and rails in about the shares that the others have.
    """
    from bd_warehouse import bearing, fastener, flange, gear, open_builds, pipe, sprocket
    from build123d import Compound, Edge, Solid

    def ring(whole: Compound, number: int) -> Solid:
        return sorted(whole.solids(), key=lambda solid: -solid.volume)[number]

    def tube(size: str, length_mm: float) -> Compound:
        return pipe.Pipe(size, "steel", "80", Edge.make_line((0, 0, 0), (0, 0, length_mm)))

    known: dict[str, Make] = {
        "hex_screw_14": lambda: fastener.HexHeadScrew("M14-2", 50, "iso4017", simple=True),
        "sunk_screw_16": lambda: fastener.CounterSunkScrew("M16-2", 45, simple=True),
        "flange_screw_14": lambda: fastener.HexHeadWithFlangeScrew("M14-2", 40, simple=True),
        "set_screw_16": lambda: fastener.SetScrew("M16-2", 50, simple=True),
        "nut_36": lambda: fastener.HexNut("M36-4", "iso4035", simple=True),
        "square_nut_16": lambda: fastener.SquareNut("M16-2", simple=True),
        "domed_nut_20": lambda: fastener.DomedCapNut("M20-2.5", "din1587", simple=True),
        "chamfered_washer_36": lambda: fastener.ChamferedWasher("M36", "iso7090"),
        "roller_ring": lambda: ring(bearing.SingleRowCylindricalRollerBearing("M20-47-14"), 0),
        "weld_neck_one": lambda: flange.WeldNeckFlange("1", 150),
        "slip_on_half": lambda: flange.SlipOnFlange("1/2", 300),
        "pipe_three_quarters": lambda: tube("3/4", 45),
        "gear_16": lambda: gear.SpurGear(3.5, 16, 20, thickness=20),
        "sprocket_15": lambda: sprocket.Sprocket(15, 9.525, 6.35, 0.0, 8.0, 26.0, 4, 3.4, 10.0),
        "rail_20x40_55": lambda: open_builds.VSlotLinearRail("20x40", 55),
    }
    strangers: dict[str, Make] = {
        "pan_screw_8": lambda: fastener.PanHeadWithCollarScrew("M8-1.25", 45, simple=True),
        "nut_30_thin": lambda: fastener.HexNut("M30-3.5", "iso4035", simple=True),
        "lapped_one_quarter": lambda: flange.LappedFlange("1 1/4", 150),
        "gear_17": lambda: gear.SpurGear(3.5, 17, 20, thickness=16),
        "spacer_38": lambda: open_builds.AluminumSpacer("1-1/2in"),
    }
    return known, strangers


KITS = {
    1: first_kit,
    2: second_kit,
    3: third_kit,
    4: fourth_kit,
    5: fifth_kit,
    6: sixth_kit,
}


def licence() -> str:
    """Return the package's licence."""
    found = [f for f in files("bd_warehouse") or [] if f.name.upper().startswith("LICENSE")]
    return found[0].read_text() if found else ""


def main() -> int:
    """Write the parts, and say which could not be made."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kit", type=int, choices=tuple(KITS), default=1)
    args = parser.parse_args()
    try:
        from build123d import Compound, export_step

        kinds = KITS[args.kit]()
    except ImportError as error:
        print(f"warehouse_parts: {error}; pip install bd-warehouse==0.2.0", file=sys.stderr)
        return 2
    failed = 0
    for name, parts in zip(("known", "strangers"), kinds, strict=True):
        into = args.folder / name
        into.mkdir(parents=True, exist_ok=True)
        (into / "LICENSE-bd_warehouse").write_text(licence())
        for part, make in parts.items():
            try:
                solids = make().solids()
                if len(solids) != 1:
                    raise ValueError(f"{len(solids)} solids")
                export_step(Compound(children=[solids[0]]), into / f"{part}.step")
                size = solids[0].bounding_box().size
                print(f"{name} {part}: {size.X:.1f} x {size.Y:.1f} x {size.Z:.1f} mm")
            except Exception as error:  # noqa: BLE001  the package's own errors are of many kinds
                failed += 1
                print(f"{name} {part}: {error}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

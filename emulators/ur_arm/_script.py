"""The part of URScript that the emulated controller runs; universal_robots.md 5.

A program is either one line or all from ``def NAME():`` (``sec NAME():`` beside a running one) to
its ``end``. Everything else is refused with the text that the controller's compiler gives.

Sections (§) are those of universal_robots.md.
"""

import ast
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from ._facts import Joints6

PROGRAM_BYTES_MAX: Final = 1 << 20
# No angle, length, time, speed or acceleration of an arm is larger than this or, where it has to be
# above zero, smaller; beyond, floats overflow or vanish. Any unit.
LARGEST: Final = 1e6
SMALLEST: Final = 1e-6
_OPENING: Final = ("def", "sec", "thread", "if", "while", "for")
DEFAULT_ACCELERATION_RAD_PER_S2: Final = 1.4  # of movej, §5.2
DEFAULT_SPEED_RAD_PER_S: Final = 1.05  # of movej, §5.2


class ScriptError(Exception):
    """A program is refused.

    Attributes
    ----------
    line, column : where, from 1
    text : as the controller words it
    """

    def __init__(self, line: int, column: int, text: str) -> None:
        super().__init__(text)
        self.line, self.column, self.text = line, column, text


@dataclass(frozen=True, slots=True)
class Pose:
    """A pose vector ``p[...]`` of a script (m, rad)."""

    values: Joints6


@dataclass(frozen=True, slots=True)
class MoveJ:
    """movej to joint positions or a pose; speed and acceleration of the leading joint.

    Attributes
    ----------
    goal : joint positions [rad] or the pose of the TCP
    duration_s : 0 where speed and acceleration count
    blend_m : how near to the goal a next move may begin; 0: the arm stops there
    """

    goal: Joints6 | Pose
    acceleration_rad_per_s2: float
    speed_rad_per_s: float
    duration_s: float
    blend_m: float = 0.0


@dataclass(frozen=True, slots=True)
class StopJ:
    """stopj: the joints slow down together."""

    deceleration_rad_per_s2: float


@dataclass(frozen=True, slots=True)
class SetOutput:
    """A digital output, by its number in actual_digital_output_bits."""

    number: int
    is_on: bool


@dataclass(frozen=True, slots=True)
class SetPayload:
    """Mass, centre of mass and inertia of what the flange carries."""

    mass_kg: float
    centre_m: tuple[float, float, float] | None
    inertia_kg_m2: Joints6 | None


@dataclass(frozen=True, slots=True)
class SetTcp:
    """The TCP's pose on the flange."""

    pose: Pose


@dataclass(frozen=True, slots=True)
class TextMessage:
    """A line for the log."""

    text: str


@dataclass(frozen=True, slots=True)
class Sleep:
    """A pause of the program."""

    duration_s: float


@dataclass(frozen=True, slots=True)
class Freedrive:
    """freedrive_mode and end_freedrive_mode: the arm yields to hands, or holds again."""

    is_on: bool


Statement = MoveJ | StopJ | SetOutput | SetPayload | SetTcp | TextMessage | Sleep | Freedrive


@dataclass(frozen=True, slots=True)
class Program:
    """A program that was understood.

    Attributes
    ----------
    steps : its statements, each with its line
    is_secondary : runs beside another one, and takes no time
    """

    name: str
    steps: tuple[tuple[int, Statement], ...]
    is_secondary: bool = False


class ScriptReader:
    """Takes programs out of what a client sends."""

    def __init__(self) -> None:
        self._rest = b""
        self._lines: list[str] = []
        self._depth = 0

    def feed(self, data: bytes) -> list[Program | ScriptError]:
        """Return the programs that are complete now, or why they are refused."""
        self._rest += data
        found: list[Program | ScriptError] = []
        while (cut := self._rest.find(b"\n")) >= 0:
            line, self._rest = self._rest[:cut], self._rest[cut + 1 :]
            text = line.decode("utf-8", "replace").rstrip("\r")
            if not self._lines and not _code(text):
                continue
            self._lines.append(text)
            self._depth += _depth_of(text)
            if self._depth <= 0:
                found.append(_parsed(self._lines))
                self._lines, self._depth = [], 0
        if len(self._rest) + sum(len(line) for line in self._lines) > PROGRAM_BYTES_MAX:
            self._rest, self._lines, self._depth = b"", [], 0
            found.append(ScriptError(1, 1, "program_too_long"))
        return found


def _code(line: str) -> str:
    """Return a line without its comment and outer blanks."""
    quoted = False
    for place, letter in enumerate(line):
        if letter == '"':
            quoted = not quoted
        elif letter == "#" and not quoted:
            return line[:place].strip()
    return line.strip()


def _depth_of(line: str) -> int:
    word = _code(line).partition(" ")[0].partition("(")[0].rstrip(":")
    if word == "end":
        return -1
    return 1 if word in _OPENING else 0


def _parsed(lines: list[str]) -> Program | ScriptError:
    try:
        return _program(lines)
    except ScriptError as error:
        return error


def _program(lines: list[str]) -> Program:
    first = _code(lines[0])
    kind, _, head = first.partition(" ")
    if kind not in ("def", "sec"):
        return Program("unnamed", ((1, _statement(first, 1)),))
    name = head.strip().removesuffix(":").strip()
    if not (name.endswith("()") and name[:-2].isidentifier() and head.rstrip().endswith(":")):
        raise ScriptError(1, 1, f"syntax_error_on_line:1:{first}:")
    body = [(number, _code(line)) for number, line in enumerate(lines[1:-1], start=2)]
    steps = tuple((number, _statement(text, number)) for number, text in body if text)
    is_secondary = kind == "sec"
    for number, one in steps:
        if is_secondary and isinstance(one, MoveJ | StopJ | Sleep | Freedrive):
            raise ScriptError(number, 1, f"secondary_program_takes_time:{type(one).__name__}:")
    return Program(name[:-2], steps, is_secondary)


def _statement(text: str, line: int) -> Statement:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a script's odd escapes are no concern of Python's
            tree = ast.parse(text, mode="exec").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise ScriptError(line, 1, f"syntax_error_on_line:{line}:{text:.200}:") from error
    if len(tree) != 1:
        raise ScriptError(line, 1, f"syntax_error_on_line:{line}:{text:.200}:")
    (node,) = tree
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        return _call(node.value, line)
    if isinstance(node, ast.Assign) and len(node.targets) == 1:
        return _assignment(node, line)
    raise ScriptError(line, 1, f"syntax_error_on_line:{line}:{text:.200}:")


def _assignment(node: ast.Assign, line: int) -> Statement:
    """Return ``digital_out[N] = LEVEL``, the only assignment there is."""
    target = node.targets[0]
    is_output = (
        isinstance(target, ast.Subscript)
        and isinstance(target.value, ast.Name)
        and target.value.id == "digital_out"
    )
    if not is_output:
        raise ScriptError(line, 1, f"compile_error_name_not_found:{ast.unparse(target)}:")
    assert isinstance(target, ast.Subscript)
    return _output(0, 8, _value(target.slice, line), _value(node.value, line), line)


# Of each function: its parameters in order, with what stands in for one that is left out.
_NEEDED: Final = object()
_SIGNATURES: Final[Mapping[str, Mapping[str, Any]]] = {
    "movej": {
        "q": _NEEDED,
        "a": DEFAULT_ACCELERATION_RAD_PER_S2,
        "v": DEFAULT_SPEED_RAD_PER_S,
        "t": 0.0,
        "r": 0.0,
    },
    "stopj": {"a": _NEEDED},
    "set_digital_out": {"n": _NEEDED, "b": _NEEDED},
    "set_standard_digital_out": {"n": _NEEDED, "b": _NEEDED},
    "set_configurable_digital_out": {"n": _NEEDED, "b": _NEEDED},
    "set_tool_digital_out": {"n": _NEEDED, "b": _NEEDED},
    "set_payload": {"m": _NEEDED, "cog": None},
    "set_target_payload": {"m": _NEEDED, "cog": None, "inertia": None, "transition_time": 0.0},
    "set_tcp": {"pose": _NEEDED},
    "textmsg": {"s1": _NEEDED, "s2": ""},
    "sleep": {"t": _NEEDED},
    "freedrive_mode": {"freeAxes": None, "feature": None},
    "end_freedrive_mode": {},
}


def _call(node: ast.Call, line: int) -> Statement:
    name = node.func.id if isinstance(node.func, ast.Name) else ast.unparse(node.func)
    signature = _SIGNATURES.get(name)
    if signature is None:
        raise ScriptError(line, 1, f"compile_error_name_not_found:{name}:")
    given = dict(zip(signature, (_value(one, line) for one in node.args), strict=False))
    named = {word.arg or "": _value(word.value, line) for word in node.keywords}
    values = {**signature, **given, **named}
    too_many = len(node.args) > len(signature) or set(given) & set(named)
    if too_many or set(values) - set(signature) or _NEEDED in values.values():
        wanted = ", ".join(signature)
        raise ScriptError(line, 1, f"compile_error_function_parameters:{name}({wanted}):")
    return _BUILDERS[name](values, line)


def _value(node: ast.expr, line: int) -> Any:  # noqa: ANN401  (a literal of the script)
    match node:
        case ast.Constant(value=bool() | int() | float() | str() as value):
            return value
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=ast.Constant(value=number)):
            if isinstance(number, int | float) and not isinstance(number, bool):
                return -number if isinstance(sign, ast.USub) else number
        case ast.List(elts=items) | ast.Tuple(elts=items):
            return [_value(item, line) for item in items]
        case ast.Subscript(value=ast.Name(id="p"), slice=ast.Tuple(elts=items)):
            return Pose(_six([_value(item, line) for item in items], "p[...]", line))
        case ast.Name(id=name):
            raise ScriptError(line, 1, f"compile_error_name_not_found:{name}:")
    raise ScriptError(line, 1, f"syntax_error_on_line:{line}:{ast.unparse(node):.200}:")


def _number(value: object, name: str, line: int, least: float, most: float = LARGEST) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ScriptError(line, 1, f"type_error_number_expected:{name}:")
    if not least <= value <= most:  # a comparison takes integers of any size
        raise ScriptError(line, 1, f"value_out_of_range:{name}={value!s:.40}:")
    return float(value)


def _positive(value: object, name: str, line: int) -> float:
    return _number(value, name, line, SMALLEST)


def _numbers(value: object, count: int, name: str, line: int) -> list[float]:
    if not isinstance(value, list) or len(value) != count:
        raise ScriptError(line, 1, f"type_error_list_of_{count}_numbers_expected:{name}:")
    return [_number(one, name, line, -LARGEST) for one in value]


def _six(value: object, name: str, line: int) -> Joints6:
    one, two, three, four, five, six = _numbers(value, 6, name, line)
    return one, two, three, four, five, six


def _pose(value: object, name: str, line: int) -> Pose:
    if not isinstance(value, Pose):
        raise ScriptError(line, 1, f"type_error_pose_expected:{name}:")
    return value


def _movej(given: Mapping[str, Any], line: int) -> Statement:
    goal = given["q"] if isinstance(given["q"], Pose) else _six(given["q"], "q", line)
    return MoveJ(
        goal,
        _positive(given["a"], "a", line),
        _positive(given["v"], "v", line),
        _number(given["t"], "t", line, 0.0),
        _number(given["r"], "r", line, 0.0),
    )


def _stopj(given: Mapping[str, Any], line: int) -> Statement:
    return StopJ(_positive(given["a"], "a", line))


def _output(first: int, count: int, number: object, level: object, line: int) -> SetOutput:
    which = int(_number(number, "n", line, 0.0, count - 1))
    if not isinstance(level, bool):
        raise ScriptError(line, 1, "type_error_boolean_expected:b:")
    return SetOutput(first + which, level)


def _output_of(first: int, count: int) -> Callable[[Mapping[str, Any], int], Statement]:
    return lambda given, line: _output(first, count, given["n"], given["b"], line)


def _payload(given: Mapping[str, Any], line: int) -> Statement:
    centre, inertia = given["cog"], given.get("inertia")
    x_y_z = None
    if centre is not None:
        x, y, z = _numbers(centre, 3, "cog", line)
        x_y_z = (x, y, z)
    return SetPayload(
        _number(given["m"], "m", line, 0.0),
        x_y_z,
        None if inertia is None else _six(inertia, "inertia", line),
    )


def _tcp(given: Mapping[str, Any], line: int) -> Statement:
    return SetTcp(_pose(given["pose"], "pose", line))


def _textmsg(given: Mapping[str, Any], _: int) -> Statement:
    return TextMessage("".join(_shown(given[name]) for name in ("s1", "s2")))


def _shown(value: object) -> str:
    if isinstance(value, Pose):
        return f"p{list(value.values)}"
    return str(value)


def _sleep(given: Mapping[str, Any], line: int) -> Statement:
    return Sleep(_number(given["t"], "t", line, 0.0))


def _freedrive(given: Mapping[str, Any], line: int) -> Statement:
    if any(one is not None for one in given.values()):
        raise ScriptError(line, 1, "compile_error_function_parameters:freedrive_mode():")
    return Freedrive(is_on=True)


_BUILDERS: Final[Mapping[str, Callable[[Mapping[str, Any], int], Statement]]] = {
    "movej": _movej,
    "stopj": _stopj,
    "set_digital_out": _output_of(0, 8),
    "set_standard_digital_out": _output_of(0, 8),
    "set_configurable_digital_out": _output_of(8, 8),
    "set_tool_digital_out": _output_of(16, 2),
    "set_payload": _payload,
    "set_target_payload": _payload,
    "set_tcp": _tcp,
    "textmsg": _textmsg,
    "sleep": _sleep,
    "freedrive_mode": _freedrive,
    "end_freedrive_mode": lambda given, line: Freedrive(is_on=False),
}

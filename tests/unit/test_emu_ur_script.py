import pytest
from emu_ur_bench import programs, run, running_arm
from hypothesis import given
from hypothesis import strategies as st

from emulators.ur_arm import Program, ScriptError, ScriptReader

HOME = "[0, -1.5, 1.5, -1.5, -1.5, 0]"


def refusal(text: str) -> ScriptError:
    (found,) = programs(text)
    assert isinstance(found, ScriptError), found
    return found


@pytest.mark.parametrize(
    "line",
    [
        f"movej({HOME})",
        f"movej({HOME}, a=1.2, v=0.3, t=0, r=0)",
        f"  movej({HOME}, 1.2, 0.3) # half-way",
        "movej(p[0.3, -0.2, 0.4, 0, 3.14, 0], a=1.2, v=0.3)",
        "stopj(2.0)",
        "set_digital_out(7, False)",
        "set_standard_digital_out(0, True)",
        "set_configurable_digital_out(7, True)",
        "set_tool_digital_out(1, True)",
        "digital_out[2]=True",
        "set_payload(1.2)",
        "set_payload(1.2, [0, 0, 0.05])",
        "set_payload(1.2, (0,0,0.05))",
        "set_target_payload(1.2, [0, 0, 0.05], [0, 0, 0, 0, 0, 0])",
        "set_tcp(p[0, 0, 0.15, 0, 0, 0])",
        'textmsg("held # not a comment")',
        "sleep(0.5)",
    ],
)
def test_a_line_of_the_subset_is_a_program(line: str) -> None:
    (program,) = programs(line)
    assert isinstance(program, Program), program
    assert len(program.steps) == 1


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("movel(p[0,0,0,0,0,0])", "compile_error_name_not_found:movel:"),
        ("movej(home)", "compile_error_name_not_found:home:"),
        ("q = [1, 2]", "compile_error_name_not_found:q:"),
        ("set sim", "syntax_error_on_line:1:set sim:"),
        ("movej([0, 1, 2", "syntax_error_on_line:1:movej([0, 1, 2:"),
        ("end", "syntax_error_on_line:1:end:"),
        ("movej([0, 1, 2])", "type_error_list_of_6_numbers_expected:q:"),
        (f"movej({HOME}, x=1)", "compile_error_function_parameters:movej(q, a, v, t, r):"),
        (
            f"movej({HOME}, 1, 1, 0, 0, 0)",
            "compile_error_function_parameters:movej(q, a, v, t, r):",
        ),
        (f"movej({HOME}, 1, a=1)", "compile_error_function_parameters:movej(q, a, v, t, r):"),
        ("stopj()", "compile_error_function_parameters:stopj(a):"),
        (f"movej({HOME}, a=0)", "value_out_of_range:a=0:"),
        (f"movej({HOME}, v=-1)", "value_out_of_range:v=-1:"),
        (f"movej({HOME}, v=1e400)", "value_out_of_range:v=inf:"),
        ("set_digital_out(8, True)", "value_out_of_range:n=8:"),
        ("set_digital_out(0, 1)", "type_error_boolean_expected:b:"),
        ("set_payload(True)", "type_error_number_expected:m:"),
        ("set_tcp([0,0,0,0,0,0])", "type_error_pose_expected:pose:"),
        (
            "__import__('os').system('true')",
            "compile_error_name_not_found:__import__('os').system:",
        ),
    ],
)
def test_anything_else_is_refused_by_name(line: str, text: str) -> None:
    assert refusal(line).text == text


@pytest.mark.parametrize(
    "line",
    [
        f"sleep({10**400})",
        f"sleep({'9' * 5000})",
        f"movej({HOME}, a=1e-320)",
        f"movej({HOME}, t=1e300)",
        "movej(p[1e300, 0, 0, 1e300, 0, 0])",
        "stopj(1e-300)",
    ],
)
def test_numbers_that_no_arm_has_are_refused(line: str) -> None:
    assert refusal(line).text.startswith(("value_out_of_range", "syntax_error"))


PIECES = (
    *("def f():\n", "sec g():\n", "while True:\n", "end\n", "\n", "movej(", "stopj(2)\n", "sleep("),
    *("p[", "[0,-1,1,0,1,0]", ")", "]", ",", "a=", "1.2", "-", '"', "#", "\\d", "True", " ", "\0"),
)
SCRIPT_PIECES = st.sampled_from(PIECES)


@given(st.lists(st.one_of(SCRIPT_PIECES.map(str.encode), st.binary(max_size=6)), max_size=40))
def test_whatever_arrives_is_a_program_or_a_refusal(pieces: list[bytes]) -> None:
    reader = ScriptReader()
    for piece in pieces:
        for found in reader.feed(piece):
            assert isinstance(found, Program | ScriptError)


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=6),
    st.booleans(),
    st.floats(1e-6, 1e6),
    st.floats(1e-6, 1e6),
    st.floats(0, 1e6),
)
def test_whatever_a_move_asks_for_the_joints_stay_within_their_limits(
    goal: list[float], is_pose: bool, a: float, v: float, t: float
) -> None:
    arm = running_arm()
    run(arm, f"movej({'p' * is_pose}{goal}, a={a}, v={v}, t={t})")
    for _ in range(20):
        arm.advance(0.05)
        for q, limit in zip(arm.q_rad, arm.facts.limits_rad, strict=True):
            assert abs(q) <= limit + 1e-9
        for qd, limit in zip(arm.target.qd, arm.facts.speed_limits_rad_per_s, strict=True):
            assert abs(qd) <= limit + 1e-9


def test_a_def_is_one_program_up_to_its_end() -> None:
    (program,) = programs(f"def work():\n  movej({HOME})\n\n  # wait\n  sleep(1)\nend")
    assert isinstance(program, Program)
    assert program.name == "work"
    assert [line for line, _ in program.steps] == [2, 5]


def test_a_program_may_come_in_pieces_and_several_in_one() -> None:
    reader = ScriptReader()
    assert reader.feed(b"def work():\n set_digital_out(0, ") == []
    found = reader.feed(b"True)\nend\r\nstopj(1)\n")
    assert [one.name for one in found if isinstance(one, Program)] == ["work", "unnamed"]


def test_a_block_that_is_not_emulated_refuses_the_whole_program_and_nothing_behind_it() -> None:
    found = programs("def f():\n while True:\n  sync()\n end\nend\nstopj(2)")
    assert isinstance(found[0], ScriptError)
    assert found[0].line == 2
    assert isinstance(found[1], Program)
    assert len(found) == 2


def test_a_secondary_program_may_not_take_time() -> None:
    assert refusal("sec f():\n sleep(1)\nend").text == "secondary_program_takes_time:Sleep:"
    (program,) = programs("sec f():\n set_digital_out(0, True)\nend")
    assert isinstance(program, Program)
    assert program.is_secondary


def test_an_endless_program_is_thrown_away() -> None:
    reader = ScriptReader()
    reader.feed(b"def f():\n")
    found = [one for _ in range(20) for one in reader.feed(b" sleep(1)\n" * 10_000)]
    assert isinstance(found[0], ScriptError)
    assert found[0].text == "program_too_long"


def test_an_arm_in_freedrive_takes_no_motion_and_holds_behind_its_end() -> None:
    arm = running_arm()
    run(arm, "def led():\n freedrive_mode()\n sleep(5)\nend")
    arm.advance(0.1)
    assert arm.yields
    before = arm.q_rad
    arm.lead([0.0, 0.1, 0.0, 0.0, 0.0, 0.0])
    assert arm.q_rad[1] == pytest.approx(before[1] + 0.1)
    arm.advance(6.0)
    assert not arm.yields
    arm.lead([0.0, 0.1, 0.0, 0.0, 0.0, 0.0])
    assert arm.q_rad[1] == pytest.approx(before[1] + 0.1)
    run(arm, f"def f():\n freedrive_mode()\n movej({HOME})\nend")
    arm.advance(0.5)
    assert arm.q_rad[1] == pytest.approx(before[1] + 0.1)
    assert not arm.is_program_running


def test_freedrive_along_some_axes_is_not_emulated() -> None:
    assert "freedrive_mode" in refusal("freedrive_mode([1, 0, 0, 0, 0, 0])").text

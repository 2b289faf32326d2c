"""The evaluator of launch files: arithmetic as Python has it, and nothing else, whatever the text."""

from __future__ import annotations

import ast
import operator
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evis.config.expression import ExpressionError, UnknownName, evaluate, names_in, substitute

NAMES = {"a": 3, "b": 0.5, "s": "text", "l": ["x", "y"], "t": True, "n": None}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2 * 3", 7),
        ("(1 + 2) * 3", 9),
        ("a * b", 1.5),
        ("7 // 2 + 7 % 4", 6),
        ("-a", -3),
        ("a > 2 and b < 1", True),
        ("not t or a == 3", True),
        ("1 < a < 3", False),
        ("'x' in l", True),
        ("'z' not in l", True),
        ("'fast' if t else 'slow'", "fast"),
        ("n is null", True),
        ("n or 0", 0),
        ("s + '!'", "text!"),
        ("true", True),
        ("['x', a]", ["x", 3]),
    ],
)
def test_values(text: str, value: object) -> None:
    result = evaluate(text, NAMES)
    assert result == value and type(result) is type(value)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "().__class__",
        "s.upper()",
        "l[0]",
        "[x for x in l]",
        "lambda: 1",
        "2 ** 64 ** 64",
        "2 ** 3",
        "1 << 900",
        "'x' * 100000",
        "l * 1000",
        "f'{a}'",
        "(a := 4)",
        "{1: 2}",
        "*l",
        "open",
        "a; b",
        "import os",
        "",
        "1 +",
        "1 / 0",
        "1 // 0",
        "a + s",
        "a < s",
        "9" * 200,
        "1e308 * 10",
        "-" * 490 + "1e400",
        "(" * 300 + ")" * 300,
        "1j",
        "b'x'",
        "...",
        "a if",
        "x" * 600,
    ],
)
def test_everything_else_is_refused(text: str) -> None:
    with pytest.raises(ExpressionError):
        evaluate(text, NAMES)


@pytest.mark.parametrize("text", ["-" * 490 + "1", "1" + " + 1" * 120, "not " * 120 + "t"])
def test_nesting_is_refused_long_before_python_runs_out_of_frames(text: str) -> None:
    with pytest.raises(ExpressionError, match="operators within each other"):
        evaluate(text, NAMES)


@pytest.mark.parametrize(("text", "value"), [("1if t else 2", 1), (r"'\d'", r"\d"), ("[0 is null, 3]", [False, 3])])
def test_pythons_advice_is_not_for_users(text: str, value: object, recwarn: pytest.WarningsRecorder) -> None:
    """How an expression is written is nobody's concern while it is one: Python would print a line of its own."""
    assert evaluate(text, NAMES) == value and names_in(f"${{{text}}}") <= {"t", "null"}
    assert not recwarn.list


def test_a_long_sum_is_none_the_worse_for_the_limit_of_nesting() -> None:
    assert evaluate("1" + " + 1" * 90, NAMES) == 91


def test_an_unknown_name_is_named() -> None:
    with pytest.raises(UnknownName) as error:
        evaluate("omega * 2", NAMES)
    assert error.value.name == "omega"


@given(st.text(max_size=120))
@settings(max_examples=300, deadline=None)
def test_any_text_gives_a_plain_bounded_value_or_an_expression_error(text: str) -> None:
    try:
        value = evaluate(text, NAMES)
    except ExpressionError:
        return
    assert isinstance(value, (bool, int, float, str, list, type(None)))
    assert len(repr(value)) < 2000


PIECES = (
    "a b s l 1 2.5 'x' + - * / // % ** < == and or not in if else ( ) [ ] . , __class__ lambda : for await { }"
).split()


@given(st.lists(st.sampled_from(PIECES), max_size=14).map(" ".join))
@settings(max_examples=400, deadline=None)
def test_any_arrangement_of_tokens_never_escapes(text: str) -> None:
    started = time.thread_time()
    try:
        value = evaluate(text, NAMES)
    except ExpressionError:
        value = None
    assert isinstance(value, (bool, int, float, str, list, type(None)))
    # Of this thread: what other programs take of the machine meanwhile is no cost of the expression.
    assert time.thread_time() - started < 1.0, "an expression may cost no time"


def _reference(node: ast.expr) -> float:
    """Independent truth: fold the tree with Python's own operators."""
    table = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul}
    if isinstance(node, ast.BinOp):
        return table[type(node.op)](_reference(node.left), _reference(node.right))
    assert isinstance(node, ast.Constant)
    return node.value


@given(st.recursive(st.integers(0, 9).map(str), lambda x: st.tuples(x, st.sampled_from("+-*"), x).map(
    lambda t: f"({t[0]} {t[1]} {t[2]})"), max_leaves=8))  # fmt: skip
def test_arithmetic_is_pythons(text: str) -> None:
    assert evaluate(text, {}) == _reference(ast.parse(text, mode="eval").body)


def test_substitution_keeps_types_and_fills_texts() -> None:
    arguments = {"k": 8, "rate": 30.0, "on": False, "cams": ["a", "b"], "none": None}
    assert substitute("${k}", arguments) == 8
    assert substitute("${rate * k}", arguments) == 240.0
    assert substitute("x${k}y${on}z${cams}${none}", arguments) == "x8yfalseza,b"
    assert substitute({"a": ["${cams}", 1]}, arguments) == {"a": [["a", "b"], 1]}


def test_a_value_is_not_evaluated_again() -> None:
    assert substitute("<${x}>", {"x": "${y}", "y": 1}) == "<${y}>"


def test_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EVIS_TEST_WORD", "here")
    monkeypatch.delenv("EVIS_TEST_GONE", raising=False)
    assert substitute("${env:EVIS_TEST_WORD}/x", {}) == "here/x"
    assert substitute("${env:EVIS_TEST_GONE:-there}", {}) == "there"
    with pytest.raises(ExpressionError, match="EVIS_TEST_GONE is not set"):
        substitute("${env:EVIS_TEST_GONE}", {})


def test_an_unclosed_hole_is_an_error() -> None:
    with pytest.raises(ExpressionError, match="without its"):
        substitute("a${k", {"k": 1})

"""Small YAML files that ask for much: refused at their line, in a child that may have 1 GB of address space."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from limited import each_refused, refused_by

from evis.config.document import MAX_BYTES, MAX_TEXT, MAX_VALUES, LaunchError, parse, parse_value, read
from evis.config.expression import MAX_ITEMS, ExpressionError, names_in, substitute
from evis.config.expression import MAX_TEXT as MAX_FILLED
from evis.launch.expand import expand
from evis.launch.files import load
from evis.launch.recorded import recorded

GB = 1_000_000_000
READ = "import sys; from pathlib import Path; from evis.config.document import read; read(Path(sys.argv[1]))"


def nested_aliases() -> str:
    """Nine levels of nine aliases, 306 bytes that stand for 9^9 values."""
    pairs = zip("abcdefgh", "bcdefghi")
    return "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(f"{n}: &{n} [{','.join([f'*{o}'] * 9)}]\n" for o, n in pairs)


HOSTILE = [
    (nested_aliases(), 6, "more than 524288 values"),
    ("a: " + ":".join(["59"] * 300_000), 1, "a value of 899999 characters; the most is 10000"),
    ("b: 1\na: " + ":".join(["59"] * 3000), 2, "a whole number of more than 1023 bits"),
    ("b: 1\na: 0x" + "f" * 9000, 2, "a whole number of more than 1023 bits"),
    ("a: 1:" + ":".join(["59"] * 3000) + ".5", 1, "cannot be read as the number"),
    ("a: " + "9" * 9000, 1, "cannot be read as the number"),
    ("a: " + "[" * 400_000, 1, "deeper than 32 levels"),
    ("a: " + "{a: " * 200_000, 1, "deeper than 32 levels"),
    ("\n".join(" " * i + "a:" for i in range(1400)), 33, "deeper than 32 levels"),
    ("b: 1\n? " + "k" * 20_000 + "\n: 1", 2, "a value of 20000 characters"),
    ("b: 1\na: !!python/object/apply:os.system [x]", 2, "has no meaning here"),
    ("a: !!python/name:os.system x", 1, "could not determine a constructor"),
    ("a: !!bool perhaps", 1, "cannot be read as"),
    ("a: &x [1, &y [*x]]", 1, "an alias refers to itself"),
    ("b: 1\na: *x", 2, "no anchor '&x' stands before"),
    ("a: 1\n---\nb: 1", 2, "a second document"),
]


@pytest.mark.parametrize("what", ["launch", "scene"])
def test_a_hostile_file_is_refused_at_its_line(tmp_path: Path, what: str) -> None:
    """One child reads them all."""
    code = "from evis.config.document import read; from pathlib import Path; read(Path(argument))"
    if what == "scene":
        code = "from evis.scene import load_scene; load_scene(argument)"
    paths = [tmp_path / f"h{i}.yaml" for i in range(len(HOSTILE))]
    for path, (text, _, _) in zip(paths, HOSTILE):
        path.write_text(text)
    for path, told, (_, line, words) in zip(paths, each_refused(code, paths, memory=GB), HOSTILE):
        assert f"{path.name}:{line}: " in told and words in told and "\n" not in told and len(told) < 400


def test_what_a_megabyte_may_hold_is_read() -> None:
    """Values written out never meet the limit on values; of aliases a sane number is used."""
    assert len(parse("a: [" + "1," * 50_000 + "]", "x")["a"]) == 50_000 and MAX_VALUES == MAX_BYTES // len("1,")
    table = parse("base: &b {x: [1, 2]}\n" + "".join(f"k{i}: *b\n" for i in range(1000)), "x")
    assert len(table) == 1001 and all(table[f"k{i}"] == {"x": [1, 2]} for i in range(1000))
    assert table["k7"].lines == {"x": 1} and table.lines["k7"] == 9
    assert parse("a: " + "x" * MAX_TEXT, "x")["a"] == "x" * MAX_TEXT


def test_aliases_count_as_what_they_stand_for() -> None:
    """A list of a million values by 1,100 aliases to 1,000: one value too many is the first that is refused."""
    head = "a: &a [" + "1," * 999 + "]\n"  # 1 map, 1 key, 1 list, 999 items
    each = 1000
    fits = (MAX_VALUES - 1002 - 2) // each  # the second key and its list
    assert parse(head + "b: [" + "*a," * fits + "]", "x")["b"][fits - 1] == [1] * 999
    with pytest.raises(LaunchError, match=r"x:2: more than 524288 values"):
        parse(head + "b: [" + "*a," * (fits + 1) + "]", "x")


def test_plain_words_mean_what_they_meant() -> None:
    """YAML 1.1 as PyYAML reads it; dates stay text."""
    text = "{i: 12, h: 0x1F, f: 1.5e+3, t: yes, n: ~, s: '12', d: 2020-01-02, m: 1:30, x: !!str 5, e: .inf}"
    assert parse(text, "x") == {
        "i": 12, "h": 31, "f": 1500.0, "t": True, "n": None, "s": "12", "d": "2020-01-02", "m": 90, "x": "5",
        "e": float("inf"),
    }  # fmt: skip


@pytest.mark.parametrize("text", ["=", "<<", "2026-13-45", "2026-01-31 25:61:00", "0000-00-00"])
def test_what_only_looks_like_something_else_is_text(text: str) -> None:
    """Alone, in a list and in a map: a sign between two names, or the name of a recording."""
    assert parse_value(f"a: {text}\nb: [{text}, '{text}']", "x") == {"a": text, "b": [text, text]}


def test_powers_of_ten_are_numbers_as_in_yaml_1_2() -> None:
    """PyYAML takes them for text but for 1.0e+6; what is quoted or goes on stays text."""
    text = "{a: 1e6, b: 1.0e6, c: -1e-3, d: .5E2, e: +2.e1, q: '1e6', n: e6, m: 1e6 mm, x: !!str 1e6, l: [3e0]}"
    assert parse(text, "x") == {
        "a": 1e6, "b": 1e6, "c": -1e-3, "d": 50.0, "e": 20.0, "q": "1e6", "n": "e6", "m": "1e6 mm", "x": "1e6",
        "l": [3.0],
    }  # fmt: skip


def test_a_long_file_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "long.yaml"
    with path.open("wb") as file:
        file.truncate(100 * GB)
    assert "longer than 1048576 bytes" in refused_by(READ, path, memory=GB)
    find = "import sys; from evis.config.paths import find_launch; from evis.launch.files import load"
    assert "longer than" in refused_by(f"{find}; load(find_launch(sys.argv[1])[0])", path, memory=GB)


def test_arguments_in_a_bag_are_read_by_the_same_reader(monkeypatch: pytest.MonkeyPatch) -> None:
    """They come from a file that anybody may have made."""
    stored = {"arg.a": "['cam0', 2]", "arg.b": "None", "arg.c": "0.2", "arg.d": "3"}
    monkeypatch.setattr("evis.launch.recorded._stored", lambda bag, where: stored)
    entry = parse("bag: b.mcap\nexcept: [d]", "x")
    assert recorded(entry, dict.fromkeys("abcd"), {}) == {"a": ["cam0", 2], "c": 0.2}
    stored["arg.a"] = nested_aliases()
    with pytest.raises(LaunchError, match=r"b\.mcap, argument a:6: more than 524288 values"):
        recorded(entry, dict.fromkeys("abcd"), {})
    with pytest.raises(LaunchError, match="longer than"):
        parse_value(" " * (2 << 20), "x")


def test_a_large_scene_file_is_read() -> None:
    """30,000 faces of three numbers, a quarter of what a file may hold, in a child that may have 1 GB."""
    code = (
        "from evis.scene.yaml.tessellate import read_shape; from evis.scene.yaml.reader import Fields;"
        "from evis.config.document import parse; t = parse('shape: mesh\\nvertices: [[0,0,0],[1,0,0],[0,1,0]]\\n'"
        "+ 'faces: [' + '[0,1,2],' * 30000 + ']', 'x');"
        "raise ValueError(read_shape(Fields(t, 'x', {})).faces.shape)"
    )
    assert refused_by(code, memory=GB) == "(30000, 3)"


def test_includes_that_multiply_are_refused(tmp_path: Path) -> None:
    """Ten files of ten includes each stand for 10^9 files."""
    for i in range(9):
        rows = f"  - {{file: f{i + 1}.yaml}}\n" * 10
        (tmp_path / f"f{i}.yaml").write_text(f"include:\n{rows}")
    (tmp_path / "f9.yaml").write_text("nodes: {}\n")
    with pytest.raises(LaunchError, match=r"f\d\.yaml:\d+: more than 100 files"):
        load(tmp_path / "f0.yaml")


def test_loops_that_multiply_are_refused(tmp_path: Path) -> None:
    """Three of a hundred turns each stand for a million nodes."""
    path = tmp_path / "g.yaml"
    loops = ", ".join(f"{v}: [{', '.join(map(str, range(100)))}]" for v in "abc")
    path.write_text(f"nodes:\n  x:\n    type: t\n    foreach: {{{loops}}}\n")
    with pytest.raises(LaunchError, match=r"g\.yaml:4: makes 10000 nodes; the most is 1000"):
        expand(load(path), {}, {})
    path.write_text("nodes:\n" + "".join(f"  x{i}: {{type: t, if: false}}\n" for i in range(1001)))
    with pytest.raises(LaunchError, match=r"g\.yaml:1002: more than 1000 nodes"):
        expand(load(path), {}, {})


LONG = "args:\n  a: {default: " + "x" * 9990 + "}\n  l: {type: list, default: [" + "1," * 9000 + "1]}\n"
NODE = "nodes:\n  n:\n    type: t\n"
MULTIPLIED = {
    "a list": LONG + NODE + "    params: {p: [" + "'${a}y', " * 50_000 + "]}\n",
    "parameters": LONG + NODE + "    params:\n" + "".join(f"      p{i}: '${{a}}y'\n" for i in range(30_000)),
    "loops": LONG
    + NODE
    + f"    foreach: {{i: [{','.join(map(str, range(1000)))}]}}\n    params:\n"
    + "".join(f"      p{i}: '${{a}}y'\n" for i in range(300)),
    "arguments": LONG + "".join(f"  p{i}: {{default: '${{a}}y'}}\n" for i in range(20_000)) + "nodes: {}\n",
    "lists": LONG + NODE + "    params:\n" + "".join(f"      p{i}: ['${{[l]}}']\n" for i in range(20_000)),
}


@pytest.mark.parametrize("what", MULTIPLIED)
def test_a_short_file_that_makes_a_long_one_is_refused(tmp_path: Path, what: str) -> None:
    """`"${a}y"` takes 9 bytes and makes 10,000 of them: 20 kB asked for 3 GB."""
    path = tmp_path / "g.yaml"
    path.write_text(MULTIPLIED[what])
    code = (
        "import sys; from pathlib import Path; from evis.launch.expand import expand; "
        "from evis.launch.files import load; expand(load(Path(sys.argv[1])), {}, {})"
    )
    told = refused_by(code, path, memory=GB)
    kind = "values" if what == "lists" else "characters"
    assert re.search(rf"g\.yaml:\d+: '.*': up to here .* makes more than \d+ {kind} of the file$", told), told


def test_what_is_made_of_included_files_counts_together(tmp_path: Path) -> None:
    part = LONG + NODE + "    params:\n" + "".join(f"      p{i}: '${{a}}y'\n" for i in range(500))
    for k in range(2):
        (tmp_path / f"part{k}.yaml").write_text(part)
        expand(load(tmp_path / f"part{k}.yaml"), {}, {})
    includes = "".join(f"  - {{file: part{k}.yaml, namespace: n{k}}}\n" for k in range(2))
    (tmp_path / "whole.yaml").write_text("include:\n" + includes)
    expand(load(tmp_path / "whole.yaml"), {}, {})
    (tmp_path / "whole.yaml").write_text("include:\n" + includes * 2)
    with pytest.raises(LaunchError, match=r"part1\.yaml:\d+: '\$\{a\}y': up to here"):
        expand(load(tmp_path / "whole.yaml"), {}, {})


@pytest.mark.parametrize(
    "text",
    [
        "9**9**9", "'a' * 10 ** 9", "'%999999999d' % 1", "[0] * 10 ** 9", "1 << 10 ** 9", "(lambda: 1)()", "'a'.x",
        "l[0]", "[" * 240 + "]" * 240, "9" * 499, "99999999999 * 99999999999", "1e308 * 10", "b'a'", "(a := 1)",
        "1 + " * 5000 + "1",
    ],
)  # fmt: skip
def test_hostile_expressions_are_refused(text: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        substitute("${" + text + "}", {"l": [1]})
    assert len(str(caught.value)) < 700


def test_deep_expressions_have_their_value_or_are_refused() -> None:
    for text, value in (("(" * 200 + "1" + ")" * 200, 1), ("-" * 480 + "1", 1), ("1 + " * 100 + "1", 101)):
        try:
            assert substitute("${" + text + "}", {}) == value
        except ExpressionError:
            pass  # an older Python's parser gives up earlier
    assert names_in("${" + "a + " * 100_000 + "a}") == set()


def test_values_made_of_values_stay_bounded() -> None:
    """Each step holds the one before many times over, as `let` of a scene's copies and arguments of includes can."""
    with pytest.raises(ExpressionError, match=f"more than {MAX_FILLED} characters"):
        substitute("${a}" * 20, {"a": "x" * 1000})
    with pytest.raises(ExpressionError, match=f"more than {MAX_ITEMS} values"):
        substitute(["${a}"] * 200, {"a": [1] * 100})
    with pytest.raises(ExpressionError, match=f"more than {MAX_ITEMS} values"):
        substitute("${" + ", ".join("a" * 100) + "}", {"a": [[]] * 200})
    value: list[object] = []
    with pytest.raises(ExpressionError, match="32 levels of lists"):
        for _ in range(100):
            value = substitute(["${a}"], {"a": value})
    assert substitute(["${a}"] * 9, {"a": [1] * 1000}) == [[1] * 1000] * 9
    assert substitute([1] * 50_000, {}) == [1] * 50_000


def test_reading_leaves_the_text_of_an_error_short(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("a: !!int " + "x" * 9000)
    with pytest.raises(LaunchError) as caught:
        read(path)
    assert len(str(caught.value)) < 400

"""`evis doctor` says what is true of an installation: its packages, its optional parts, libusb from the wheel."""

from __future__ import annotations

import re
import sys
import tomllib
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace

import pytest

from evis.cli.machine import doctor_checks

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
OPTIONAL = PROJECT["optional-dependencies"]


def finding(name: str) -> doctor_checks.Finding:
    return next(f for f in doctor_checks.check() if f.name == name)


@pytest.fixture
def declared(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the installation says it needs: as pyproject.toml, and what a test adds."""
    lines = [*PROJECT["dependencies"]]
    lines += [f"{line}; extra == '{name}'" for name, extra in OPTIONAL.items() for line in extra]
    monkeypatch.setattr(metadata, "requires", lambda name: lines)
    return lines


def test_every_dependency_is_looked_for(declared: list[str]) -> None:
    wanted = {re.split(r"[<>=]", line)[0] for line in PROJECT["dependencies"]}
    assert {part.split()[0] for part in finding("packages").text.split(", ")} == wanted
    declared.append("no-such-package>=1,<2")
    found = finding("packages")
    assert found.level == "fail" and found.text == "missing: no-such-package; install evis again"


def test_what_is_optional_is_a_note(declared: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        doctor_checks,
        "_version",
        lambda package: "1.0" if package in ("av", "opencv-python-headless", "rosbags") else None,
    )
    found = finding("extras")
    assert found.level == "note" and found.text.startswith("video; not installed: bench (plots), files (")
    assert "ros (" in found.text, "one of its two packages is not enough"
    monkeypatch.setattr(doctor_checks, "_version", lambda package: "1.0")
    assert finding("extras") == doctor_checks.Finding(
        "extras", "ok", "video, bench, files, ros, gpu, gym, rl, layouts, cluster"
    )


def test_every_extra_is_known_and_on_the_first_page() -> None:
    """Those that a user may want, with no others."""
    wanted = OPTIONAL.keys() - {"dev", "test-extras"}
    assert doctor_checks.EXTRAS.keys() | {"usb"} == wanted
    text = (ROOT / "README.md").read_text()
    table = text[text.index("| NAME | what it adds |") :].split("\n\n")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", table, re.M)) == wanted


def test_no_page_or_message_names_an_extra_that_is_not_there() -> None:
    files = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    files += [path for folder in ("evis", "nodes", "bench", "msgs") for path in (ROOT / folder).rglob("*.py")]
    named = {name for path in files for name in re.findall(r"evis\[(\w+)\]", path.read_text())}
    assert named - {"NAME"} <= OPTIONAL.keys() and len(named) > 3


def test_libusb_of_the_wheel_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the camera drivers find it; without wheel and system library there is a remedy."""
    import usb.backend.libusb1

    monkeypatch.setattr(usb.backend.libusb1, "get_backend", lambda: None)
    monkeypatch.setitem(sys.modules, "libusb_package", None)
    found = finding("libusb")
    assert found.level == "note" and "pip install 'evis[usb]'" in found.text
    monkeypatch.setitem(sys.modules, "libusb_package", SimpleNamespace(get_libusb1_backend=object))
    assert finding("libusb").level == "ok"

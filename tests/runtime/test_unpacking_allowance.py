"""How much may be unpacked for what was read."""

import pytest

from evis.files.allowance import BASE, CAP, RATIO, Allowance, AllowanceError


@pytest.fixture(autouse=True)
def _no_limit_set(monkeypatch):
    monkeypatch.delenv("EVIS_UNPACK_LIMIT", raising=False)


def test_a_small_file_may_unpack_to_the_base_and_a_large_one_in_proportion():
    assert Allowance(1000).limit == BASE + 1000 * RATIO
    assert Allowance(10**12).limit == CAP


def test_what_was_taken_counts():
    allowance = Allowance(0, base=100)
    allowance.take(60)
    allowance.check(40)
    with pytest.raises(AllowanceError, match=r"0 bytes would unpack to 101 bytes or more, over the limit of 100 bytes"):
        allowance.take(41)
    allowance.take(40)


def test_the_refusal_names_a_limit_that_would_do(monkeypatch):
    with pytest.raises(AllowanceError, match="set EVIS_UNPACK_LIMIT=4G") as refused:
        Allowance(65_000).take(2_100_000_000)
    monkeypatch.setenv("EVIS_UNPACK_LIMIT", str(refused.value).rpartition("=")[2])
    Allowance(65_000).take(2_100_000_000)


@pytest.mark.parametrize("text, size", [("500", 500), ("3K", 3 << 10), ("2m", 2 << 20), ("64G", 64 << 30)])
def test_the_limit_can_be_set(monkeypatch, text, size):
    monkeypatch.setenv("EVIS_UNPACK_LIMIT", text)
    assert Allowance(1).limit == size


@pytest.mark.parametrize("text", ["much", "-1", "1.5G", "G", "²"])
def test_a_limit_that_is_no_number_is_named(monkeypatch, text):
    monkeypatch.setenv("EVIS_UNPACK_LIMIT", text)
    with pytest.raises(AllowanceError, match="EVIS_UNPACK_LIMIT is"):
        Allowance(1).check(1)

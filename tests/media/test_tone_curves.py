"""Curves of a high dynamic range: values that standards print, and the inverse of how they code."""

from __future__ import annotations

import numpy as np
import pytest

from evis.media.frames.tone import Tone


@pytest.mark.parametrize(("code", "nits"), [(0.0, 0), (0.508078, 100), (0.580689, 203), (0.751827, 1000), (1.0, 10000)])
def test_pq_is_that_of_the_standards(code, nits):
    """ITU-R BT.2408, table 1 and annex 1: 203 cd/m2 are 58 %, 1,000 are 75 %; full scale is 10,000."""
    assert Tone("pq", white=10_000).decode(np.array(code)) == pytest.approx(nits, rel=2e-5, abs=1e-12)


def test_pq_inverts_its_coding():
    """Forth by the inverse EOTF of SMPTE ST 2084, in its own fractions."""
    light = np.geomspace(1e-7, 1, 200)
    power = light ** (2610 / 4096 / 4)
    code = ((3424 / 4096 + 2413 / 4096 * 32 * power) / (1 + 2392 / 4096 * 32 * power)) ** (2523 / 4096 * 128)
    np.testing.assert_allclose(Tone("pq").decode(code), light, rtol=1e-9)


def test_hlg_inverts_its_coding():
    """Forth by the OETF of ITU-R BT.2100, table 5; reference white of 75 % is 26.5 % of the light (BT.2408)."""
    light = np.linspace(0, 1, 200)
    bright = 0.17883277 * np.log(np.maximum(12 * light - 0.28466892, 1e-9)) + 0.55991073
    code = np.where(light <= 1 / 12, np.sqrt(3 * light), bright)
    np.testing.assert_allclose(Tone("hlg").decode(code), light, rtol=0, atol=2e-8)
    assert Tone("hlg", white=2).decode(np.array(0.75)) == pytest.approx(2 * 0.265, rel=1e-3)

"""Dual binning, transposed readouts and the Mini's inertial packets, from words and bytes written by hand."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from evis.events.codecs.decoder import decoder_for
from evis.events.codecs.inivation.dvxplorer_mini_imu import MiniImu, message_of

BOTH = pytest.mark.parametrize("backend", ["numpy", "warp"])
G = 9.80665


def decode(encoding, words, backend, size=(0, 0), **attributes):
    decoder = decoder_for(encoding, *size, backend=backend)
    for name, value in attributes.items():
        setattr(decoder, name, value)
    decoder.reset()
    events = decoder.decode(np.array(words, decoder.word).tobytes())
    t, x, y, p = ((events.t // 1000).tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist())
    return list(zip(t, x, y, p)), decoder.counts


@BOTH
def test_binned_readouts(backend):
    """320x240; a flipped axis is read from half of the sensor on: column 320 is 0, row 240 (group 30) is 0."""
    words = [0x8005, 0x1800 | 4, 0x4000 | 1 << 6 | 2, 0x3001, 0x2002]
    words += [0x1000 | 320, 0x4000 | 30, 0x3001, 0x1000 | 639, 0x4000 | 59, 0x3080, 0x4800 | 30 << 6 | 31, 0x2101]
    got, counts = decode("dvxplorer", words, backend, (320, 240), binned=True)
    assert got == [(5, 4, 16, 1), (5, 4, 25, 1), (5, 0, 0, 1), (5, 319, 239, 1), (5, 319, 8, 0)]
    assert counts == {}
    assert decode("dvxplorer", words, backend, (320, 240))[1] == {"outside": 3}


@BOTH
def test_binned_mini(backend):
    """As above; that columns rise within a readout is seen on the wire's addresses."""
    words = [
        1 << 27 | 3,
        1 << 26 | 1 << 21 | 7 << 11 | 319,
        1 << 31 | 30 << 18 | 1,
        1 << 26 | 320,
        1 << 31 | 59 << 18 | 0x80,
    ]
    got, counts = decode("dvxplorer_mini", words, backend, (320, 240), binned=True)
    assert got == [(3007, 319, 0, 1), (3007, 0, 239, 1)]
    assert counts == {}


@BOTH
def test_transposed_readouts(backend):
    """A sensor that reads its columns as rows: the row word of a DAVIS346 goes up to 345, and is x."""
    got, counts = decode(
        "davis346", [0x8009, 0x1000 | 345, 0x3000 | 259, 0x2000 | 260, 0x1000 | 346, 0x3000], backend, transposed=True
    )
    assert got == [(9, 345, 259, 1)]
    assert counts == {"outside": 2}
    got, counts = decode(
        "dvxplorer", [0x8009, 0x1000 | 479, 0x4000 | 79 % 64, 0x3001, 0x1000 | 480, 0x3001], backend, transposed=True
    )
    assert got == [(9, 15 * 8, 479, 1)]
    assert counts == {"outside": 1}


def packet(flags, *values):
    return struct.pack("<BB7h", 1, flags, *values)


def test_mini_packets_by_hand():
    """Firmware before 10 sends gz gy gx az ay ax T, later ones gx gy gz ax ay az T; ranges as the BMI160 has them."""
    values = (100, 200, 300, 8192, -4096, 1024, 512)
    old = MiniImu().sample(packet(0xE0 | 1 << 3 | 2, *values))  # +-4 g, +-500 deg/s
    np.testing.assert_allclose(old[:3], np.array([0.125, -0.5, 1.0]) * G)
    np.testing.assert_allclose(old[3:6], np.radians(np.array([300, 200, 100]) * 500 / 32768))
    assert old[6] == 24.0
    new = MiniImu(straight=True).sample(packet(0xE0 | 1 << 3 | 2, *values))
    np.testing.assert_allclose(new[:3], np.array([1.0, -0.5, 0.125]) * G)
    np.testing.assert_allclose(new[3:6], np.radians(np.array([100, 200, 300]) * 500 / 32768))
    turned = MiniImu(orientation=0b101).sample(packet(0xE0 | 1 << 3 | 2, *values))
    np.testing.assert_allclose(turned[:6], old[:6] * [-1, 1, -1, -1, 1, -1])


def test_mini_packets_with_parts_only():
    """What the byte of kinds does not name is absent, whatever its bytes hold."""
    sample = MiniImu().sample(packet(0x40 | 4, 1, 2, 3, 4, 5, 6, 7))
    assert np.isnan(sample[[0, 1, 2, 6]]).all()
    np.testing.assert_allclose(sample[3:6], np.radians(np.array([3, 2, 1]) * 125 / 32768))
    assert np.isnan(MiniImu().sample(packet(0x20, *[512] * 7))[:6]).all()


@pytest.mark.parametrize(
    "data", [b"", b"\x01", packet(0xE0, *[0] * 7)[:15], packet(0, *[0] * 7), packet(0xE5, *[0] * 7)]
)
def test_mini_packets_that_are_no_samples(data):
    """Cut, without kinds, with a range that the chip has not."""
    assert MiniImu().sample(data) is None
    assert message_of(data) is None


def test_mini_messages():
    """A packet of kind 0 is a text of the firmware, which ends at its first zero."""
    data = b"\x00\x07" + struct.pack("<I", 99) + b"I2C failed\0\0\xff"
    assert message_of(data) == "I2C failed (code 7)"
    assert MiniImu().sample(data) is None


@pytest.mark.parametrize("straight", [False, True])
def test_mini_packets_round_trip(straight):
    """To half a count of the finest range that holds them."""
    imu = MiniImu(straight)
    for acceleration, rate, temperature in (
        ([1.0, -2, 9.81], [0.1, 0.2, -2], 31.5),
        ([60.0, 0, 5], [30.0, 1, 0], 20.0),
    ):
        got = imu.sample(imu.packet(np.array(acceleration), np.array(rate), temperature))
        g, dps = (2, 125) if temperature == 31.5 else (8, 2000)
        np.testing.assert_allclose(got[:3], acceleration, atol=0.51 * g * G / 32768)
        np.testing.assert_allclose(got[3:6], rate, atol=0.51 * np.radians(dps) / 32768)
        assert got[6] == temperature
    with pytest.raises(ValueError, match="beyond 16 g"):
        imu.packet(np.array([200.0, 0, 0]), np.zeros(3), 20.0)

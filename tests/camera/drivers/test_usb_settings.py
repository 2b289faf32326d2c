"""What settings write into the registers, against values that the makers' public descriptions state."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from usb_rig import silent

from nodes.camera.inivation.davis346 import BIASES, bias_word, current_pa, nearest_bias
from nodes.camera.interface.settings import describe, parse_settings
from nodes.camera.treuzell.gen31 import code_of
from nodes.camera.treuzell.protocol import Board, TreuzellError
from nodes.camera.treuzell.sensor import sequences, span_words
from nodes.camera.usb.models import MODELS
from nodes.camera.usb.udev import rules


def configured(name: str, **settings):
    """The emulated device after configure and start."""
    driver = silent(name)
    driver.open()
    driver.configure(driver.settings_type().of({"decoder": "numpy", **settings}))
    driver.start()
    device = driver.emulated
    device.feed.end()
    registers = dict(getattr(device, "registers", {}))
    biases = getattr(device, "biases", b"")
    driver.stop()
    driver.close()
    return registers or biases


class Wire:
    """A device that keeps the bytes of commands and gives prepared answers."""

    def __init__(self, *answers: bytes) -> None:
        self.sent: list[bytes] = []
        self.answers = list(answers)

    def write(self, endpoint, data, timeout):
        assert endpoint == 0x02
        self.sent.append(bytes(data))

    def read(self, endpoint, size, timeout):
        assert endpoint == 0x82
        return self.answers.pop(0)


def test_a_register_write_on_the_wire():
    """The frame of the protocol's description: 02 01 01 40 | 0C 00 00 00 | device | address | value."""
    wire = Wire(bytes.fromhex("02010140 08000000 00000000 00b00000"))
    Board(wire).write(0, 0xB000, 0x2F9)
    assert wire.sent == [bytes.fromhex("02010140 0c000000 00000000 00b00000 f9020000")]


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (struct.pack("<II", 0x8000_0000, 0), "not known to the board's firmware"),
        (struct.pack("<IIIII", 0xC001_0102 | 0x4000_0000, 12, 0, 0xB000, 13), "failed: Permission denied"),
        (b"\x01\x02", "2 bytes, a frame has at least 8"),
        (struct.pack("<II", 0x72, 0), "answer 0x72"),
        (struct.pack("<II", 0x4001_0102, 900) + b"abc", "3 of 900 bytes"),
    ],
)
def test_answers_that_are_wrong(answer, text):
    """Each is one clear line."""
    with pytest.raises(TreuzellError, match=text):
        Board(Wire(answer)).write(0, 0xB000, 1)


def test_start_lists():
    """Lengths as the descriptions state them, and spot values."""
    assert len(sequences("imx636")["init"]) == 81
    assert len(sequences("gen31")["init"]) == 82
    assert len(sequences("gen41")["init"]) == 862
    assert len(sequences("genx320es")["init"]) == 129
    assert len(sequences("genx320mp")["init"]) == 35
    last = sequences("imx636")["init"][-1]
    assert (last.kind, last.address, last.value) == ("write", 0x9000, 0x200)


@pytest.mark.parametrize(("millivolt", "code"), [(221, 0x1E), (384, 0x35), (299, 0x29)])
def test_gen31_voltage_codes(millivolt, code):
    """The codes of the standard voltages are those in the start list's words."""
    assert code_of("voltage", millivolt) == code
    words = {o.address: o.value for o in sequences("gen31")["init"]}
    assert code in {words[a] & 0xFF for a in (0x34C, 0x350, 0x354)}


@pytest.mark.parametrize(
    ("table", "millivolt", "address"), [("fo", 1477, 0x358), ("pr", 1250, 0x35C), ("refr", 1500, 0x360)]
)
def test_gen31_current_codes(table, millivolt, address):
    """As above for the currents, in bits 8 to 20."""
    words = {o.address: o.value for o in sequences("gen31")["init"]}
    assert code_of(table, millivolt) == words[address] >> 8 & 0x1FFF


def test_gen31_biases_in_the_registers():
    """Only the code field changes; what is not given stays as the start list has it."""
    r = configured("silkyevcam", bias_diff_on=400, bias_fo=1500, trigger_in=True)
    assert r[0x350] == 0x7912_5C00 | 55
    assert r[0x358] & ~0x1F_FF00 == 0x7100_3DD6 & ~0x1F_FF00 and r[0x358] >> 8 & 0x1FFF == code_of("fo", 1500)
    assert r[0x34C] == 0x7900_571E and r[0x1A0] & 1


def test_imx636_biases_are_offsets_to_the_factory_code():
    """Register word = 0x11A1_0000 | code."""
    r = configured("evk4", bias_diff_on=20, bias_fo=-10)
    assert r[0x1010] == 0x11A1_0000 | (0x66 + 20) and r[0x1004] == 0x11A1_0000 | (0x53 - 10)
    assert r[0x1018] == 0x11A1_0000 | 0x49
    with pytest.raises(ValueError, match=r"bias_refr is -21 .*must be -20 to 235"):
        configured("evk4", bias_refr=-21)


def test_imx636_rate_limit_and_trigger():
    """20 Mev/s are 4000 events in each period of 200 us."""
    r = configured("evk4", event_rate_limit=20e6, trigger_in=True)
    assert (r[0x6008], r[0x600C], r[0x6000], r[0x6004] & 1, r[0x6028] & 1) == (200, 4000, 0x155401, 1, 1)
    assert r[0x6800] == r[0x6800 + 4 * 229] == 0x0808_0808 and r[0x6400 + 4 * 255] == 511 << 16 | 510
    assert r[0x7004] >> 10 & 1
    assert configured("evk4", event_rate_limit=5000.0)[0x600C] == 1
    for name in ("evk4", "evk3_gen41"):
        with pytest.raises(ValueError, match=r"event_rate_limit is 4999 1/s; .* give 5000 or more, or 0 for all"):
            configured(name, event_rate_limit=4999.0)
    off = configured("evk4")
    assert 0x600C not in off and not off[0x7004] >> 10 & 1


def test_imx636_region_of_interest():
    """Columns 100..131 and rows 10..19 let through; rows count from the bottom."""
    r = configured("evk4", roi_x=100, roi_y=10, roi_width=32, roi_height=10)
    x = sum(r[0x2000 + 4 * i] << 32 * i for i in range(40))
    y = sum(r[0x4000 + 4 * i] << 32 * i for i in range(23))
    assert x == (2**32 - 1) << 100 and y == (2**10 - 1) << 720 - 20 and r[4] >> 5 & 1
    with pytest.raises(ValueError, match="does not lie inside 1280x720"):
        configured("evk4", roi_x=1000, roi_width=500)


def test_span_words():
    """Bits of the words, counted."""
    bits = span_words(31, 3, 3)
    assert bits == [1 << 31, 0b11, 0] and sum(bin(w).count("1") for w in span_words(5, 600, 20)) == 600


def test_davis_bias_words():
    """Every default is the word that the description lists (a few of them here), and survives its current in pA."""
    listed = {"diffbn": 0x427F, "onbn": 0x5FFF, "offbn": 0x401F, "prbp": 0x23AD, "prsfbp": 0x110D, "refrbp": 0x419D,
              "padfollbn": 0x7D7E, "biasbuffer": 0x5FEF, "localbufbn": 0x5A4F, "aepuybp": 0x798D}  # fmt: skip
    r = configured("davis346")
    for name, word in listed.items():
        parameter, coarse, fine, kind = BIASES[name]
        assert bias_word(coarse, fine, kind) == word == r[5, parameter], name
        assert nearest_bias(current_pa(coarse, fine)) == (coarse, fine)
    assert current_pa(5, 255) == 387_500
    assert r[5, 35] == r[5, 36] == 16 | 33 << 10


def test_davis_settings_in_the_registers():
    """Exposure in cycles of the ADC's clock (30 MHz here), filters in units of 250 us, the region as corners."""
    r = configured(
        "davis346", exposure_us=2000.0, background_filter_us=5000.0, roi_x=10, roi_width=100, trigger_in=True
    )
    assert r[2, 12] == 60_000 and r[2, 13] == 1_200_000
    assert (r[1, 31], r[1, 32], r[1, 33]) == (1, 20, 0)
    assert [r[1, p] for p in (41, 42, 43, 44)] == [10, 0, 109, 259]
    assert (r[4, 0], r[4, 1], r[4, 2], r[9, 1]) == (1, 1, 1, 80_000)
    quiet = configured("davis346", frames=False, imu=False)
    assert (quiet[2, 4], quiet[3, 2], quiet[3, 3]) == (0, 0, 0)


@pytest.mark.parametrize("name", ["dvxplorer", "dvxplorer_mini"])
def test_dvxplorer_sensitivity_and_cropping(name):
    """Presets of the chip, and columns 8..17, rows 3..20 in the cropper's groups of eight rows."""
    r = configured(name, sensitivity="high", roi_x=8, roi_width=10, roi_y=3, roi_height=18)
    assert [r[5, a] for a in (0x0B, 0x12, 0x1C, 0x1E)] == [4, 127, 5, 3]
    assert [r[5, 0x3300 + i] for i in range(9)] == [0, 0, 0b11111000, 2, 0b00011111, 0, 8, 0, 17]
    with pytest.raises(ValueError, match="sensitivity is 'loud', must be one of very_low"):
        configured(name, sensitivity="loud")


def test_dvs128_biases_on_the_wire():
    """Twelve numbers of three bytes, the most significant first, in the camera's order."""
    sent = configured("dvs128", bias_diffon=300_000)
    values = [int.from_bytes(sent[i : i + 3], "big") for i in range(0, 36, 3)]
    assert values == [1992, 1108364, 16777215, 8159221, 132, 309590, 969, 16777215, 300000, 13125, 271, 217]


@pytest.mark.parametrize("name", MODELS)
def test_every_setting_says_what_it_is(name):
    """Help, and for numbers a unit and a range that holds the default."""
    with silent(name) as driver:
        settings = describe(driver.settings_type())
    for key, facts in settings.items():
        assert facts["help"], key
        if isinstance(facts["default"], (int, float)) and not isinstance(facts["default"], bool):
            assert facts["minimum"] <= facts["default"] <= facts["maximum"], key


def test_settings_from_texts():
    """Types of the fields; what cannot be is named."""
    with silent("evk4") as driver:
        kind = driver.settings_type()
    assert parse_settings(kind, ["bias_fo=3", "trigger_in=yes", "event_rate_limit=2e7"]) == {
        "bias_fo": 3, "trigger_in": True, "event_rate_limit": 2e7
    }  # fmt: skip
    for text, message in (("bias_fo", "name=value"), ("bias_fo=x", "a whole number"), ("raw=perhaps", "true or false")):
        with pytest.raises(ValueError, match=message):
            parse_settings(kind, [text])
    with pytest.raises(ValueError, match="no setting 'bias_foo'; did you mean 'bias_fo'"):
        kind.of(parse_settings(kind, ["bias_foo=1"]))


def test_gen41_thresholds_keep_their_distance():
    """ON and OFF at least 15 codes from the reference."""
    with pytest.raises(ValueError, match="at least 15 codes"):
        configured("evk3_gen41", bias_diff_off=0x50)


def test_udev_rules_name_every_camera():
    """One rule per pair of ids, all of the table."""
    text = rules()
    pairs = {ids for m in MODELS.values() for ids in m.ids}
    for vendor, product in pairs:
        assert f'ATTR{{idVendor}}=="{vendor:04x}", ATTR{{idProduct}}=="{product:04x}"' in text
    assert text.count("SUBSYSTEM") == len(pairs) == text.count('TAG+="uaccess"')
    assert text.count('MODE="0660"') == len(pairs)  # the group may write, or nobody but root opens it
    assert np.all([line.startswith(("#", "SUBSYSTEM")) for line in text.splitlines()])

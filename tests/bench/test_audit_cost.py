"""The audit's benchmark measures runs and audits of them, one row for each number of pixels."""

from bench.interpolation import audit
from bench.interpolation.light import CASES


def test_a_row_has_cost_and_interval():
    """By default alone, and with all numbers of pixels."""
    setting = (32, 24, 30.0, 8)
    path = str(CASES / "matte_box.yaml")
    (row,) = audit.rows("box", path, setting, 0.2, True)
    assert row["by default"] == "yes" and row["run [s/s]"] > 0 and row["share [%]"] > 0
    assert 0 <= row["error"] <= 1 and 0 <= row["width"] <= 1
    rows = list(audit.rows("box", path, setting, 0.2, False))
    assert rows[0]["pixels"] == row["pixels"] and {16, 32, 64} <= {each["pixels"] for each in rows}

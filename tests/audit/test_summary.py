"""What the summary says of audits: too few pixels, several cameras, none at all."""

from typing import Any

from evis.runtime.plan import NodePlan, Plan
from evis.supervisor.audits import joined, lines


def plan(*cameras: str) -> Plan:
    """A plan with an audit of each camera."""
    nodes = {
        f"audit_{name}": NodePlan(f"audit_{name}", "audit", {}, "sensor", outputs={"audit": f"/{name}/audit"})
        for name in cameras
    }
    return Plan("test", "run", "", nodes=nodes)


def counters(vp: float, low: float, high: float, pixels: int = 16, events: float = 100.0) -> dict[str, Any]:
    numbers = {"audit_pixels": pixels, "audit_events": events, "vp": vp, "vp_low": low, "vp_high": high}
    return {"counters": numbers | {"events_wrong": vp / 2}}


def said(audit: Any, events: int = 1000, **more: Any) -> list[str]:
    """Lines of a summary of 2 s in 1 s."""
    about = {"sim_s": 2.0, "wall_s": 1.0, "events": events, "args": {}, "left_out": []} | more
    return lines(about | ({} if audit is None else {"audit": audit}))


def test_an_interval_is_told_as_wide_as_it_is() -> None:
    for numbers, wanted in (
        ((0.5, 0.45, 0.56), "error 0.50 +- 0.06 (audit of 16 pixels), run time 0.5 s per s"),
        ((0.1, 0.02, 0.31), "error 0.10, 0.02 to 0.31 (audit of 16 pixels), run time 0.5 s per s"),
    ):
        made = joined({"audit_cam0": counters(*numbers)}, plan("cam0"))
        assert said(made) == [wanted] and made is not None and "cameras" not in made


def test_what_single_pixels_between_frames_bought_is_told() -> None:
    left, right = counters(0.05, 0.03, 0.08, events=300.0), counters(0.1, 0.05, 0.2, events=100.0)
    left["counters"]["vp_frames"], right["counters"]["vp_frames"] = 0.5, 0.3
    (line,) = said(joined({"audit_left": left}, plan("left")))
    assert line.startswith("error 0.05 +- 0.03 (audit of 16 pixels, 0.50 by the frames alone), run time")
    made = joined({"audit_left": left, "audit_right": right}, plan("left", "right"))
    assert made is not None and made["vp_frames"] == 0.45
    assert "0.30 by the frames alone" in said(made)[2]
    assert "vp_frames" not in (joined({"audit_left": counters(0.5, 0.4, 0.6)}, plan("left")) or {})


def test_what_lowers_a_high_error_of_frames_alone_is_told() -> None:
    high, low = (joined({"audit_cam0": counters(*n)}, plan("cam0")) for n in ((0.5, 0.4, 0.6), (0.15, 0.05, 0.2)))
    frames = {"interpolator": "rigid", "time_tolerance": 0.0, "upsampling": 8, "bounces": 0}
    assert said(high, args=frames)[0].endswith("; time_tolerance:=0.0003 lowers it, at a longer run time")
    others = ({"time_tolerance": 0.0001}, {"interpolator": "splat"}, {"bounces": 2}, {"upsampling": 1})
    for audit, args in ((low, frames), (high, {}), *((high, frames | other) for other in others)):
        assert said(audit, args=args)[0].endswith("run time 0.5 s per s")


def test_too_few_pixels_are_told_and_how_many_would_do() -> None:
    for pixels, wanted in ((4, "4 pixels are too few for it (0.00 to 1.00), audit:=64"), (32, "audit:=128 would do")):
        (line,) = said(joined({"audit_cam0": counters(0.12, 0.0, 1.0, pixels)}, plan("cam0")))
        assert line.startswith("error unknown: ") and wanted in line and "+-" not in line
    none = {"counters": {"audit_pixels": 2, "audit_events": 0.0}}
    assert "audit of 2 pixels; audit:=64 may have some" in said(joined({"audit_cam0": none}, plan("cam0")))[0]
    assert "may" not in said(joined({"audit_cam0": none}, plan("cam0")), events=0)[0]


def test_each_of_several_cameras_is_told() -> None:
    nodes = {"audit_left": counters(0.5, 0.4, 0.6, events=300.0), "audit_right": counters(0.1, 0.0, 0.9)}
    made = joined(nodes, plan("left", "right"))
    assert made is not None and made["pixels"] == 32 and made["vp"] == 0.4
    assert {name: each["vp"] for name, each in made["cameras"].items()} == {"left": 0.5, "right": 0.1}
    whole, left, right = said(made)
    assert whole.startswith("error 0.40 +- 0.21 (audit of 32 pixels), run time")
    assert left == "  left: error 0.50 +- 0.10 (audit of 16 pixels)" and right.startswith("  right: error unknown")


def test_an_audit_that_is_left_out_is_told() -> None:
    out = [{"what": "imu", "why": "nobody reads it"}, {"what": "audit_left", "why": "nothing moves"}]
    assert said(None, left_out=out) == ["no error to tell: the audit is left out, for nothing moves"]
    assert said(None, left_out=out, args={"audit": 0}) == [] == said(None)

"""Names the causes of an audit's error, in words."""

from __future__ import annotations

from evis.scene.model import WORLD, Scene
from nodes.audit.report import AuditReport

OWN = 0.5
"""Share of a pixel's change from which on it counts as what one thing shows, not as things that come and go."""


def is_still(scene: Scene, body: int) -> bool:
    """Tells whether a body never moves."""
    trajectory = None if body == WORLD else scene.bodies[body].trajectory
    return body == WORLD or (trajectory is not None and trajectory.is_static())


def cause_of(scene: Scene, camera: str, report: AuditReport, source: str = "frames") -> str:
    """Gives what most of the error is about, and what makes it smaller; "" where nothing is off.

    source: what the sensor gets, `keyframe`, `frames` between them, or also `samples` of single pixels between those.
    """
    if report.instance < 0:
        return ""
    instance = scene.instances[report.instance]
    still = is_still(scene, instance.body) and is_still(scene, scene.body_index(camera))
    if report.own < OWN:
        what = f"things come before '{instance.name}' and go within a step"
    elif still:
        what = f"light or shadow on '{instance.name}', which stands still before the camera, changes between frames"
    else:
        what = f"what is seen of '{instance.name}' changes otherwise than its keyframes tell"
    return f"{what}; {_REMEDIES[source]}"


_REMEDIES = {
    "keyframe": "a higher upsampling or a higher keyframe_rate makes it less",
    "frames": "time_tolerance:=0.0001 (with rigid), a higher upsampling or a higher keyframe_rate makes it less, "
    "interpolator:=none reuses nothing",
    "samples": "a smaller time_tolerance or a higher keyframe_rate makes it less, interpolator:=none reuses nothing",
}
"""What the sensor gets -> what makes the error less."""


def nothing_changes(scene: Scene) -> bool:
    """Tells whether every picture of a scene is the same: nothing moves, and no light flickers."""
    moves = any(not is_still(scene, n) for n in range(len(scene.bodies)))
    return not moves and not any(light.waveform is not None for light in scene.lights)

"""Declares the physics node: its parameters and topics, and what a launch can tell of it from the scene."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any, ClassVar

from evis.config.params import Param
from evis.runtime.clock import times_slower
from evis.runtime.declaration import Declaration, Input, Output
from evis.scene.load import drawn_places, is_dynamic, may_be_driven, parse_args, starts_at_random
from evis.scene.parameters import SCENE


class PhysicsDeclaration(Declaration):
    """Declares what moves the world."""

    SOURCE: ClassVar[bool] = True
    PARAMS: ClassVar[Mapping[str, Param]] = {
        **SCENE,
        "seed": Param(
            int, 0, "seed of what the scene draws and of where free bodies start; environment k has seed + k", "", 0,
            2**63 - 1,
        ),
        "envs": Param(int, 1, "parallel environments", "", 1, 65536),
        "threads": Param(
            int, 0, "CPU threads, which share environments of a MuJoCo model; 0 = one per core", minimum=0, maximum=256
        ),
        "device": Param(str, "cpu", "where kernels run: cpu, cuda, cuda:1"),
        "engine": Param(
            str, "mujoco", "what moves a MuJoCo model: MuJoCo, or MuJoCo Warp, all environments at once on the device",
            choices=("mujoco", "mujoco_warp"),
        ),
        "keyframe_rate": Param(float, 30.0, "rendered keyframes per second", "Hz", 1e-3, 1e6),
        "action_rate": Param(
            float, None,
            "actions per second of a controller that closes the loop, a whole fraction of keyframe_rate; each is held "
            "until the next; not given = keyframe_rate",
            "Hz", 1e-6, 1e6, optional=True,
        ),
        "duration": Param(float, 0.0, "simulated time, 0 = until stopped", "s", 0.0, optional=True),
        "timestep": Param(
            float, None, "sub-step of the dynamics; the model's own, at most 1 ms, if not given", "s", 1e-7, 1e-3,
            optional=True,
        ),
        "physics_tolerance": Param(
            list, [], "METRES,RADIANS of error that a body may gather in a second: dynamics are integrated with RK4, "
            "each step in as many parts as that takes; not given = steps are whole, and the summary says what is wrong",
        ),
        "contacts": Param(bool, False, "publish contacts and their forces"),
        "joints": Param(bool, False, "publish joint positions and velocities (MuJoCo's qpos and qvel) in /state"),
        "accelerations": Param(bool, False, "publish accelerations of the bodies"),
        "speed_limit": Param(
            float, 1000.0, "speed of a body beyond which the simulation has diverged", "m/s", 1e-3, 1e9
        ),
    }  # fmt: skip
    INPUTS: ClassVar[Mapping[str, Input]] = {
        "action": Input("/action", join=False, delayed=True, outside=True),
        "reset": Input("/reset", join=False, optional=True, outside=True),
    }
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"state": Output("/state"), "error": Output("/physics_error")}

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Raises ValueError for contacts or joints in a scene that has none."""
        scene = params.get("scene")
        asked = [name for name in ("contacts", "joints") if params[name]]
        if asked and scene:
            with contextlib.suppress(OSError):  # who loads it says so
                if not is_dynamic(scene):
                    raise ValueError(f"scene {scene} moves in closed form and has no {asked[0]}; leave {asked[0]} out")
        return frozenset(cls.INPUTS)

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names the parameters of integration, where motion is in closed form."""
        scene = params.get("scene")
        with contextlib.suppress(OSError, ValueError):  # who loads it says so
            if scene and not is_dynamic(scene):
                why = f"all motion of scene {scene} is in closed form, and exact"
                return {"physics_tolerance": why, "timestep": why, "engine": why, "speed_limit": why}
        return {}

    @classmethod
    def moved_from_outside(cls, params: Mapping[str, Any]) -> bool:
        """Says whether there may be actuators."""
        scene = params.get("scene")
        with contextlib.suppress(OSError, ValueError):  # who loads it says so
            return not scene or may_be_driven(scene)
        return True

    @classmethod
    def on_gpu(cls, params: Mapping[str, Any]) -> bool:
        """Says no where MuJoCo takes the steps: a process of its own keeps the interpreter from nobody else."""
        scene = params.get("scene")
        with contextlib.suppress(OSError, ValueError):  # who loads it says so
            if params["engine"] == "mujoco" and scene and is_dynamic(scene):
                return False
        return super().on_gpu(params)

    @classmethod
    def imports(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names MuJoCo as spared where all motion is prescribed."""
        scene = params.get("scene")
        if scene and not is_dynamic(scene):
            return {"mujoco": f"all motion of scene {scene} is prescribed in closed form"}
        return {}

    @classmethod
    def random(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Names what is random of the world: what the scene draws, and where bodies and joints start at random."""
        scene = params.get("scene")
        found: list[str] = []
        with contextlib.suppress(OSError, ValueError):  # who loads it says so
            if scene:
                found += [f"start of {what}" for what in starts_at_random(scene)]
                found += drawn_places(scene, parse_args(params.get("scene_args")))
        return tuple(found)

    @classmethod
    def divides(cls, params: Mapping[str, Any]) -> int:
        """Counts the steps for which an action is held. Raises ValueError where that is no whole number."""
        rate, wanted = params["keyframe_rate"], params["action_rate"]
        try:
            return times_slower(rate, rate if wanted is None else wanted)
        except ValueError as error:
            raise ValueError(f"action_rate: {error}") from None

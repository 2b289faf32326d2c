"""Reads worlds, a small YAML file each, or any MJCF, into one Scene.

`load.py` finds the file; `yaml/` reads it and gives its arguments values, and with `mjcf/`, `mesh/` and `images/` makes
of what it names a Scene (`model.py`), whose prescribed motion is `motion.py`. Where a scene draws values, the seed of
an environment decides them (`draws.py`), and a node holds the worlds of its environments (`worlds.py`,
`parameters.py`).
"""

from evis.scene.errors import SceneError
from evis.scene.load import is_dynamic, load_scene, scene_args
from evis.scene.model import WORLD, Body, Camera, Instance, Light, Material, Mesh, Scene, Trajectory

__all__ = [
    "WORLD",
    "Body",
    "Camera",
    "Instance",
    "Light",
    "Material",
    "Mesh",
    "Scene",
    "SceneError",
    "Trajectory",
    "is_dynamic",
    "load_scene",
    "scene_args",
]

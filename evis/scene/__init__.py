"""Reads worlds, a small YAML file each, or any MJCF, into one Scene."""

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

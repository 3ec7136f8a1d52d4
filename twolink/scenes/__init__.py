"""Scenes: a robot, an initial state, and the effects it calls for."""

from twolink.scenes.file import bundled_scenes, load_scene
from twolink.scenes.scene import Scene

__all__ = ["Scene", "bundled_scenes", "load_scene"]

"""Scenes: a robot, an initial state and the effects it calls for; their file format; the bundled scenes.

In: a robot and effects, or a TOML or JSON file. Out: a frozen `Scene`. This room does not know how a scene is solved.
"""

from twolink.scenes.file import bundled_scenes, load_scene, scenes
from twolink.scenes.scene import Scene

__all__ = ["Scene", "bundled_scenes", "load_scene", "scenes"]

"""The list of effects is complete, and each stands in a scene file: its keys, what is left out, unknown keys."""

import importlib
import math
import pkgutil
from pathlib import Path

import pytest

import twolink as tl
from tests.effects.cases import E
from twolink.effects import TYPES, USUAL_TYPES, effect_class
from twolink.effects.effect import Effect
from twolink.effects.loops import Loop
from twolink.errors import SceneError
from twolink.io.text import kebab_case
from twolink.scenes.file import scene_from_data, scene_tables


def test_every_effect_is_listed_and_completed() -> None:
    """The classes that others are built on, and what holds a contact or a torque, are no effects to choose.

    A controller in Python is none of a scene file, nor is a network in a file of its own.
    """
    modules = [importlib.import_module(f"twolink.effects.{m.name}") for m in pkgutil.iter_modules(tl.effects.__path__)]
    classes = [value for module in modules for value in vars(module).values() if isinstance(value, type)]
    defined = {value for value in classes if issubclass(value, Effect)}
    others = {"Touching", "DofTorques", "HeldTorques", "HeldPositions", "Controller", "Policy", "_Asking"}
    chosen = {value for value in defined if value.__name__ not in others}
    bases = {base for value in chosen for base in value.__mro__[1:]}
    assert set(TYPES.values()) == {value.__name__ for value in chosen - bases}
    assert set(TYPES.values()) | {"Polynomial", "Bezier", "Sine", "Sampled"} <= set(dir(tl.effects))
    assert all(getattr(tl.effects, name).__name__ == name for name in dir(tl.effects))


def test_types_of_scene_files() -> None:
    assert TYPES["joint-pd"] == "JointPD"
    assert effect_class("joint-pd") is tl.effects.JointPD
    assert "sampled" not in TYPES  # an input, no effect
    with pytest.raises(AttributeError, match="no attribute 'Gravty'"):
        tl.effects.Gravty  # noqa: B018


@pytest.mark.parametrize(("name", "meant"), [("CoulombFriction", "DryFriction"), ("PD", "JointPD"),
                                             ("Spring", "JointSpring"), ("Limits", "JointStops")])  # fmt: skip
def test_the_usual_names_of_others_are_hinted_at(name: str, meant: str) -> None:
    with pytest.raises(AttributeError, match=f"did you mean '{meant}'"):
        getattr(tl.effects, name)
    with pytest.raises(SceneError, match=f"did you mean '{kebab_case(meant)}'"):
        scene_from_data(scene_tables({"robot": "arm", "effects": [{"type": kebab_case(name)}]}), tl.load_robot)
    assert set(USUAL_TYPES.values()) <= set(TYPES)


def test_a_star_import_gives_what_is_listed() -> None:
    names: dict[str, object] = {}
    exec("from twolink.effects import *", names)  # as a user writes it
    assert set(dir(tl.effects)) <= set(names)


FILES = {
    "air-drag": ('frame = "tip"\narea = 0.2\nwind = [1, 0.0, {kind = "sine", amplitude = 1.0, frequency = 2.0}]',
                 E.AirDrag("tip", 0.2, wind=(1.0, 0.0, E.Sine(1.0, 2.0)))),
    "computed-torque": ('kp = 16\nkd = 8.0\neffort = "urdf"\npath = {shoulder = 0.5, elbow = {kind = "sampled", '
                        'times = [0, 1, 2], values = [0, 1, 0.5], interpolation = "cubic"}}',
                        E.ComputedTorque({"shoulder": 0.5, "elbow": E.Sampled((0.0, 1.0, 2.0), (0.0, 1.0, 0.5),
                                         interpolation="cubic")}, 16.0, 8.0, "urdf")),
    "contact": ('pairs = ["ground", ["tip", {kind = "plane", height = -9}]]\nfriction = 0.5\n'
                'shapes = {tip = [{kind = "sphere", radius = 0.1}]}',
                E.Contact(("ground", ("tip", E.Plane(height=-9.0))), 0.5, shapes={"tip": (E.Sphere(0.1),)})),
    "frame-wrench": ('frame = "tip"\naxes = "frame"\nforce = [0, 0, {kind = "polynomial", coefficients = [1, 2]}]',
                     E.FrameWrench("tip", (0.0, 0.0, E.Polynomial((1.0, 2.0))), axes="frame")),
    "actuator-lag": ('time = {elbow = 0.1}\nof = {type = "torque", inputs = {elbow = 2}}',
                     E.ActuatorLag(E.Torque({"elbow": 2.0}), {"elbow": 0.1})),
    "backlash": ('stiffness = {elbow = 9}\ninertia = {elbow = 1}\ngap = {elbow = 0.1}\n'
                 'of = {type = "torque", inputs = {elbow = 2}}',
                 E.Backlash(E.Torque({"elbow": 2.0}), {"elbow": 9.0}, {"elbow": 1.0}, gap={"elbow": 0.1})),
    "dc-motor": ('resistance = {elbow = 1}\ninductance = {elbow = 0.1}\nconstant = {elbow = 0.2}\n'
                 'voltage = {elbow = {kind = "sine", amplitude = 12, frequency = 2}}\n'
                 'winding = {capacity = 9, cooling = 1}',
                 E.DCMotor(None, {"elbow": 1.0}, {"elbow": 0.1}, {"elbow": 0.2}, {"elbow": E.Sine(12.0, 2.0)},
                           winding=E.Winding(9.0, 1.0))),
    "elastic-joint": ('stiffness = {elbow = 9}\ninertia = {elbow = 1}\ncubic = {elbow = 5}\n'
                      'of = {type = "gear", ratio = {elbow = 9}, of = {type = "torque", inputs = {elbow = 2}}}',
                      E.ElasticJoint(E.Gear(E.Torque({"elbow": 2.0}), {"elbow": 9.0}), {"elbow": 9.0}, {"elbow": 1.0},
                                     {"elbow": 5.0})),
    "gear": ('ratio = {elbow = -9}\nefficiency = {elbow = 0.8}\nof = {type = "torque", inputs = {elbow = 2}}',
             E.Gear(E.Torque({"elbow": 2.0}), {"elbow": -9.0}, {"elbow": 0.8})),
    "lu-gre-friction": ("stiffness = {elbow = 1e3}\ncoulomb = {elbow = 1}",
                        E.LuGreFriction({"elbow": 1e3}, {"elbow": 1.0})),
    "muscle": ('name = "biceps"\narm = {elbow = 0.03}\nforce = 800\nlength = 0.1\nexcitation = 0.5',
               E.Muscle("biceps", {"elbow": 0.03}, 800.0, 0.1, 0.5)),
    "pid": ('target = {elbow = 1}\nkp = {elbow = 10}\nki = {elbow = 1}\nside = "motor"',
            E.PID({"elbow": 1.0}, {"elbow": 10.0}, {"elbow": 1.0}, side="motor")),
    "gravity": ("field = [0, 0, -1.62]", E.Gravity((0.0, 0.0, -1.62))),
    "gravity-compensation": ('joints = ["elbow"]\neffort = {elbow = 5}',
                             E.GravityCompensation(("elbow",), {"elbow": 5.0})),
    "joint-damping": ("damping = {elbow = 0.5}", E.JointDamping({"elbow": 0.5})),
    "detent": ('joint = "elbow"\ntorque = 2\npositions = [0, 0.5]\nspeed = 0.1',
               E.Detent("elbow", 2.0, (0.0, 0.5), 0.1)),
    "dry-friction": ("kinetic = {elbow = 1}\nstatic = {elbow = 2}", E.DryFriction({"elbow": 1.0}, {"elbow": 2.0})),
    "joint-stops": ("limits = {elbow = [-1, inf]}\nrestitution = 0.5",
                    E.JointStops({"elbow": (-1.0, math.inf)}, 0.5)),
    "plane-contact": ('frame = "tip"\nradius = 0.1\nheight = -9\nfriction = 0.5',
                      E.PlaneContact("tip", radius=0.1, height=-9.0, friction=0.5)),
    "compliant-contact": ('frame = "tip"\nstiffness = 1e4\nradii = [0.1, 0.2, 0.1]\nheight = -9\nfriction = 0.5',
                          E.CompliantContact("tip", 1e4, radii=(0.1, 0.2, 0.1), height=-9.0, friction=0.5)),
    "engage": ('when = {kind = "joint-reaches", joint = "elbow", value = 0.5}\n'
               'of = {type = "joint-damping", damping = {elbow = 2}}',
               E.Engage(E.JointDamping({"elbow": 2.0}), when=E.JointReaches("elbow", 0.5))),
    "release": ('at = 0.5\nof = {type = "payload", frame = "tip", mass = 2}', E.Release(E.Payload("tip", 2.0), 0.5)),
    "watch": ('name = "high"\nstop = true\nwhen = {kind = "frame-reaches", frame = "tip", value = 3, of = "velocity"}',
              E.Watch("high", when=E.FrameReaches("tip", 3.0, of="velocity"), stop=True)),
    "joint-pd": ("target = {elbow = 1}\nkp = {elbow = 10}\nkd = {elbow = 1}",
                 E.JointPD({"elbow": 1.0}, {"elbow": 10.0}, {"elbow": 1.0})),
    "joint-spring": ("stiffness = {elbow = 3}\nrest = {elbow = 0.1}", E.JointSpring({"elbow": 3.0}, {"elbow": 0.1})),
    "constants": ('values = {"forearm.mass" = 1.5, "elbow.armature" = 0.1}',
                  E.Constants({"forearm.mass": 1.5, "elbow.armature": 0.1})),
    "payload": ('frame = "tip"\nmass = 2\ncom = [0.1, 0, 0]', E.Payload("tip", 2.0, (0.1, 0.0, 0.0))),
    "rotor": ("inertia = {elbow = 0.001}\nratio = {elbow = 50}", E.Rotor({"elbow": 0.001}, {"elbow": 50.0})),
    "smooth-friction": ("friction = {elbow = 2}\nscale = 0.1", E.SmoothFriction({"elbow": 2.0}, 0.1)),
    "spring-between": ('first = "universe"\nsecond = "tip"\nstiffness = 10\nfirst_point = [0, 0, 1]',
                       E.SpringBetween("universe", "tip", 10.0, first_point=(0.0, 0.0, 1.0))),
    "state-feedback": ('target = [0.5, 1]\ngain = {elbow = [1, 2, 3, 4]}\ntorque = {elbow = 0.5}\neffort = {elbow = 9}',
                       E.StateFeedback({"elbow": (1.0, 2.0, 3.0, 4.0)}, (0.5, 1.0), {"elbow": 0.5}, {"elbow": 9.0})),
    "encoder": ('joints = ["elbow"]\nperiod = 0.002\nquantum = 0.01\nseed = 3',
                E.Encoder(("elbow",), period=0.002, quantum=0.01, seed=3)),
    "force-torque": ('joint = "elbow"\nnoise = 0.1', E.ForceTorque("elbow", noise=0.1)),
    "imu": ('link = "tip"\nname = "nose"\nwalk = 0.1', E.Imu("tip", name="nose", walk=0.1)),
    "pose-sensor": ('link = "tip"\ndelay = 0.1', E.PoseSensor("tip", delay=0.1)),
    "state-sensor": ('names = []\ndelay = 0.1', E.StateSensor((), delay=0.1)),
    "tachometer": ('joints = ["elbow"]\nbias = 0.1', E.Tachometer(("elbow",), bias=0.1)),
    "torque-sensor": ('joints = ["elbow"]\noffset = 0.1', E.TorqueSensor(("elbow",), offset=0.1)),
    "touch-sensor": ('link = "tip"', E.TouchSensor("tip")),
    "torque": ('inputs = {elbow = {kind = "sampled", file = "FOLDER/tau.csv", beyond = "zero"}}',
               E.Torque({"elbow": E.Sampled((0.0, 1.0), (2.0, 3.0), beyond="zero")})),
}  # fmt: skip


def scene_of(text: str, folder: Path) -> tl.Scene:
    (folder / "tau.csv").write_text("0,2\n1,3\n")
    path = folder / "my.toml"
    path.write_text('robot = "two_link"\n[[effects]]\n' + text.replace("FOLDER", str(folder)))
    return tl.load_scene(path)


def test_there_is_a_file_for_every_effect() -> None:
    loops = {kind for kind in TYPES if issubclass(effect_class(kind), Loop)}  # tested elsewhere
    assert set(FILES) == set(TYPES) - loops


@pytest.mark.parametrize("kind", FILES)
def test_effects_from_files_and_saved_again(kind: str, tmp_path: Path) -> None:
    """Samples that came from a file are written out."""
    text, expected = FILES[kind]
    scene = scene_of(f'type = "{kind}"\n{text}', tmp_path)
    (tmp_path / "tau.csv").unlink()
    assert scene.effects == tl.load_scene(scene.save(tmp_path / "again.toml")).effects == (expected,)


@pytest.mark.parametrize("kind", FILES)
def test_unknown_keys(kind: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"my.toml: effects\[0\]: .*unknown field `colour`"):
        scene_of(f'type = "{kind}"\ncolour = 1\n{FILES[kind][0]}', tmp_path)


@pytest.mark.parametrize(("text", "parts"), [
    ('type = "joint-dampin"', ["effects[0]", "did you mean 'joint-damping'"]),
    ('type = "air-drag"\nframe = "tpi"\narea = 1', ["effects[0].frame", "did you mean 'tip'"]),
    ('type = "air-drag"\narea = 1', ["effects[0]", "missing required field `frame`"]),
    ('type = "payload"\nframe = "tip"\nmass = "heavy"', ["effects[0].mass", "float"]),
    ('type = "torque"\ninputs = {elbow = {kind = "sampeld"}}', ["effects[0].inputs", "sampeld"]),
    ('type = "torque"\ninputs = {elbow = {kind = "sampled", file = "none.csv"}}',
     ["effects[0].inputs", "No such file"]),
    ('type = "torque"\ninputs = {elbow = {kind = "sampled", knots = [1]}}', ["effects[0].inputs", "`knots`"]),
    ('type = "joint-spring"\nstiffness = {elbow = nan}', ["effects[0].stiffness.elbow", "nan"]),
    ('type = "spring-between"\nfirst = "world"\nsecond = "tip"', ["effects[0].first", "'world'"]),
])  # fmt: skip
def test_errors_name_the_place(text: str, parts: list[str], tmp_path: Path) -> None:
    with pytest.raises(SceneError) as caught:
        scene_of(text, tmp_path)
    for part in parts:
        assert part in str(caught.value)

"""Trajectory: the result of simulating a scene."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics import Robot
from twolink.dynamics.arguments import Names, array, instance
from twolink.errors import SceneError, ShowError, import_extra
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.solution import UNSTABLE, Event, estimated_since
from twolink.io.files import path_to_write
from twolink.io.text import facts_html
from twolink.scenes import Scene
from twolink.show.figure import Plotted
from twolink.simulation import trajectory_tables as tables
from twolink.simulation.certificate import Certificate
from twolink.simulation.contact_forces import ContactForces
from twolink.simulation.cost import Cost
from twolink.simulation.recording import log, log_skipped, save_run
from twolink.simulation.text import BaseResult, as_data

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from twolink.contact.spliced import Solved
    from twolink.show.playback import InlinePage

Skipped = Callable[[list[str]], None] | None
SHOWN_EVENTS = 5  # in notebooks


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(BaseResult, Plotted):
    """A motion and how far it can be trusted.

    Parameters
    ----------
    robot : Robot
    t : ndarray (n,)
        Times of the samples, s.
    q : ndarray (n, nq)
        Configurations, rad or m.
    v : ndarray (n, nv)
        Velocities, rad/s or m/s; at an event those after it, as of `at`, `tau` and forces.
    error : ndarray (n,) or None
        Bound on the global error at each sample, max |difference(q, q_exact)|, rad or m; None: not verified.
    cost : Cost or None
        What it took; None for a loaded trajectory.
    events : sequence of Event
        What happened on the way, by time.
    interrupted : bool
        Ctrl-C ended it early; the samples so far are kept.
    accuracy : float or None
        The accuracy asked for, rad or m.
    precise : ndarray of decimal.Decimal (n, nq + nv + states) or None
        The states with more digits than a double has, of runs in higher precision.
    robots : sequence of (Robot, int)
        The robot of each segment of a motion in which payloads are released, and how many samples the segment has.
    solution : DenseOutput, SteppedSolution, SplicedSolution or None
        The solution between the samples; None for a loaded trajectory.
    recorded_energy : ndarray (n,) or None
        The energy as it was saved, J; None: it is computed.
    title : str
        The scene's title.
    estimated : bool
        The error is an estimate and no bound: contacts were stepped; where there is an event "stepped" from there on.
    recorded_contacts : mapping of str to (ndarray (n, k, 3), ndarray (n, k, 3)), or None
        Contact points, m, and forces, N, by pair, of a run without its solution: they are shown.
    recorded_wrenches : as recorded_contacts
        Those of effects on links, by effect and link, with the moments about the points, N m.
    certificate : Certificate or None
        The laws checked along a run with located events, up to an event "stepped": what, worst value, when. None for a
        smooth, a stepped or a loaded one.
    scene : Scene or None
        What was simulated; None for a loaded trajectory.
    states : mapping of str to ndarray (n,)
        The states of effects at the samples, by name, such as "elbow.current"; in the units that the effects say.
    recorded_tau : ndarray (n, nv) or None
        The torques as they were saved, N m or N; None: they are computed.
    """

    robot: Robot
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    error: np.ndarray | None
    cost: Cost | None
    events: Sequence[Event] = ()
    interrupted: bool = False
    accuracy: float | None = None
    precise: Any = None
    robots: Sequence[tuple[Robot, int]] = ()
    solution: Solved | None = None
    recorded_energy: np.ndarray | None = None
    title: str = ""
    estimated: bool = False
    recorded_contacts: tables.Marks | None = None
    recorded_wrenches: tables.Marks | None = None
    certificate: Certificate | None = None
    scene: Scene | None = None
    states: Mapping[str, np.ndarray] = field(default_factory=dict)
    recorded_tau: np.ndarray | None = None

    @functools.cached_property
    def sensors(self) -> dict[str, Any]:
        """The `Readings` of the scene's sensors by name: the times t (n,) of measuring, s, and the values (n, m).

        Raises SceneError (code "no-equations") for a loaded trajectory.
        """
        from twolink.simulation.sensor_readings import readings_of  # which other runs do not load

        return readings_of(self.scene, self._solution("sensors"))

    @functools.cached_property
    def energy(self) -> np.ndarray:
        """Kinetic and potential energy at each sample (n,), J; that of a payload counts until it is released."""
        if self.recorded_energy is not None:
            return self.recorded_energy
        robots = self.robots or ((self.robot, len(self.t)),)
        ends = np.cumsum([count for _, count in robots])
        return np.concatenate([np.add(*robot.energy(self.q[end - n : end], self.v[end - n : end]))
                               for (robot, n), end in zip(robots, ends, strict=True)])  # fmt: skip

    @property
    def bound(self) -> Literal["verified", "estimated", ""]:
        """Kind of error: "verified" by a more accurate solution, "estimated" from steps of half the size, or ""."""
        return "" if self.error is None else "estimated" if self.estimated else "verified"

    @property
    def end(self) -> float:
        """End of the run, s: at its duration, at an event, or at Ctrl-C."""
        return float(self.t[-1] if self.solution is None else self.solution.t[-1])

    @property
    def trusted_until(self) -> float | None:
        """The last sample's time [s] up to which the error bar is below the accuracy asked for; None: unknown."""
        if self.error is None or self.accuracy is None:
            return None
        beyond = self.error > self.accuracy
        return float(self.t[max(0, int(np.argmax(beyond)) - 1)] if beyond.any() else self.t[-1])

    def at(self, t: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """The state at any time of the run, as exact as at the samples.

        Parameters
        ----------
        t : float or array_like (...)
            Times from the start of the run to its end, s. At an event the state after it is returned.

        Returns
        -------
        q : ndarray (nq,) or (..., nq)
            Configurations, rad or m.
        v : ndarray (nv,) or (..., nv)
            Velocities, rad/s or m/s.

        Raises
        ------
        SceneError
            A time is outside the run (code "outside-run"), or the trajectory was loaded (code "no-equations").

        Notes
        -----
        The state is computed from the last sample before t, by steps of the run's own method and setting. Where
        contacts were stepped it is interpolated between the samples.
        """
        solution = self._solution("at")
        times = array("t", t, None, finite=False)
        flat = times.ravel()
        start, end = float(solution.t[0]), float(solution.t[-1])
        outside = ~((flat >= start) & (flat <= end))
        if outside.any():
            raise SceneError(f"{flat[outside][0]:g} s is not within {start:g} and {end:g} s", argument="t",
                             remedy="ask for times of the run, or simulate for longer", code="outside-run",
                             start=start, end=end)  # fmt: skip
        q, v = solution.segments[0].equations.space.rows(solution.states(flat))
        return q.reshape(*times.shape, self.robot.nq), v.reshape(*times.shape, self.robot.nv)

    @property
    def acceleration(self) -> np.ndarray:
        """Accelerations at the samples (n, nv), rad/s^2 or m/s^2; at an event those after it.

        Raises SceneError (code "no-equations") for a loaded trajectory.
        """
        self._solution("acceleration")
        return self._accelerations_and_torques[0]

    @property
    def tau(self) -> np.ndarray:
        """Joint torques and forces that effects apply, at the samples (n, nv), N m or N; at an event those after it.

        Controllers, friction, springs and stops count. Without external wrenches and loops tau = RNEA(q, v, a).
        Raises SceneError (code "no-equations") for a trajectory that was loaded from a file without torques.
        """
        return self._accelerations_and_torques[1] if self.recorded_tau is None else self.recorded_tau

    @functools.cached_property
    def contact_forces(self) -> ContactForces:
        """The forces between bodies that touch at a sample, by pair: on the first of the two (n, 3), world's axes, N.

        A pair is named "LINK - LINK" or "LINK - ground"; `contact_forces.on(LINK)` is the sum on one body. A pair that
        touches at several points has the sum; several planes of a `Contact` have numbers. Located: at an event the
        force after it, without impulses of impacts. Stepped: the mean over the step before the sample, with impulses.
        `contact_forces.slips` has the slips of the points of each pair, m/s, `contact_forces.impulses` the impulses of
        impacts, N s; see `ContactForces`.
        Raises SceneError (code "no-equations") for a trajectory that was loaded from a file without contacts.
        """
        if self.recorded_contacts is None:
            self._solution("contact_forces")
        return ContactForces(self)

    @functools.cached_property
    def contacts(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Points [m] and forces [N] by pair, (n, k, 3) each, NaN where it is apart."""
        return self._at_samples("contacts", self.recorded_contacts)

    @property
    def forces_on_links(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Points [m] and forces [N] of effects by effect and link, (n, k, 3) each, NaN where none acts."""
        return {name: (points, forces) for name, (points, forces, _) in self.wrenches_on_links.items()}

    @functools.cached_property
    def wrenches_on_links(self) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """As `forces_on_links`, with the moments about the points [N m], along the world's axes like the forces."""
        return self._at_samples("wrenches_on_links", self.recorded_wrenches)

    def _at_samples(self, what: Any, recorded: tables.Marks | None) -> dict[str, Any]:
        if self.solution is None:
            return dict(recorded or {})
        kept = np.searchsorted(self.solution.t, self.t)
        return {name: tuple(one[kept] for one in rows) for name, rows in self.solution.marks(what).items()}

    @functools.cached_property
    def _accelerations_and_torques(self) -> tuple[np.ndarray, np.ndarray]:
        solution = self._solution("tau")
        kept, (a, tau) = np.searchsorted(solution.t, self.t), solution.accelerations_and_torques()
        return a[kept], tau[kept]

    def _solution(self, name: str) -> Solved:
        if self.solution is None:
            raise SceneError("a loaded trajectory has no equations of motion", where=f"Trajectory.{name}",
                             remedy="simulate it again with its scene", code="no-equations")  # fmt: skip
        return self.solution

    def columns(self) -> dict[str, np.ndarray]:
        """The samples by name: t, q.JOINT, v.JOINT, tau.JOINT (numbered for joints of several), z.STATE, energy, error.

        Torques are not among those of a trajectory that was loaded from a file without them.
        """
        is_solved = self.solution is not None and bool(np.isin(self.t, self.solution.t).all())  # t may be replaced
        return tables.columns(self, self.tau if is_solved else self.recorded_tau)

    def to_xarray(self) -> Any:
        """The samples as an xarray.Dataset.

        Returns
        -------
        xarray.Dataset
            Variables q, v, energy and error over time; the coordinates q_name and v_name are joint names. Each has its
            units as an attribute.

        Raises
        ------
        MissingExtraError
            xarray is not installed.
        """
        known = {} if self.accuracy is None else {"accuracy": self.accuracy}
        attributes: dict[str, Any] = {"robot": self.robot.name, **known}
        if self.cost is not None:
            attributes |= {"method": self.cost.method, "setting": self.cost.setting}
        return tables.as_dataset(self, attributes)

    def to_pandas(self) -> Any:
        """The samples as a pandas.DataFrame: the columns of `columns()`, with t as the index.

        Raises MissingExtraError where pandas is not installed.
        """
        return import_extra("pandas", tables.EXTRA).DataFrame(self.columns()).set_index("t")

    def to_dict(self) -> dict[str, Any]:
        """The summary of the run for JSON; its samples are in `columns()`.

        Returns
        -------
        dict
            scene, robot, joints (names); duration [s], samples (a count); error (the largest error bar, rad or m; None
            when the run is not verified), bound ("verified", "estimated" or ""), accuracy,
            trusted_until [s]; energy_drift: the range of the energy along the run [J]; q, v at the end;
            cost: the fields of `Cost`, or None; events: dictionaries with the fields of `Event`; interrupted.
            states: those of effects at the end, by name, where there are some.
            contacts: of stepped contacts `Trajectory.contact_record`. contact_forces: of runs with contacts the forces
            at the end by pair, on the first body, N.
            q_precise, v_precise: q and v at the end as texts with all digits, of runs in higher precision only.
        """
        record = {
            "scene": self.title, "robot": self.robot.name, "joints": list(self.robot.joint_names),
            "duration": self.end, "samples": len(self.t), "error": None if self.error is None else self.error.max(),
            "bound": self.bound, "accuracy": self.accuracy, "trusted_until": self.trusted_until,
            "energy_drift": np.ptp(tables.drawn_curves(self, whole=True)[1][1]), "q": self.q[-1], "v": self.v[-1],
            "cost": self.cost, "events": self.events, "interrupted": self.interrupted,
        }  # fmt: skip
        if self.states:
            record["states"] = {name: values[-1] for name, values in self.states.items()}
        if self.contact_record is not None:
            record["contacts"] = self.contact_record
        if self.contacts:
            record["contact_forces"] = {pair: force[-1] for pair, force in self.contact_forces.items()}
        if self.precise is not None:  # as texts, because readers of JSON take numbers as doubles
            digits = [str(x) for x in self.precise[-1]]
            record |= {"q_precise": digits[: self.robot.nq], "v_precise": digits[self.robot.nq :][: self.robot.nv]}
        return {name: as_data(value) for name, value in record.items()}

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the samples to a file, by its ending. Returns the path.

        .csv, .parquet, .npz, MATLAB's .mat
            Every digit, torques too. All but .csv keep the robot's name, the events and the accuracy asked for;
            .parquet and .npz contacts and forces on links too. A .mat file has t, energy, and q (n, nq), v (n, nv) and
            tau (n, nv) with q_names, v_names and tau_names.
        .mcap, .db3
            Messages of ROS 2 (pip install 'twolink[mcap]'): /joint_states with torques, /tf of all links,
            /robot_description (the URDF), /odometry of free bodies (velocities along their own axes), /contacts and
            /forces (wrenches about the world's origin), /error_bar, /energy, /states of effects, events in /rosout.
            Times are rounded to 1 ns. `load` does not read torques, contacts and forces from them. Raises SceneError
            for planar and ball joints (code "not-in-format").
        .rrd
            A recording of Rerun (pip install 'twolink[rerun]'): the robot's surfaces on its links, and curves. It is
            not read again.
        .html; .mp4, .webm, .gif
            What `playback` and `video` make.
        """
        return save_run(self, path_to_write(path))

    @classmethod
    def load(cls, path: str | os.PathLike[str], robot: Robot | None = None) -> Trajectory:
        """Read a saved trajectory.

        Parameters
        ----------
        path : path-like
            A .npz, .parquet, .mat, .csv, .mcap or .db3 file, or a rosbag2 folder, also of joint states that another
            program recorded.
        robot : Robot, optional
            Its robot. A .csv or another program's log needs it. All others name their robot: one of the catalogue is
            loaded again as it was then; any other one must be passed.

        Returns
        -------
        Trajectory
            Without cost and solution; from a .csv also without events and accuracy, from a bag without torques, from
            all but .npz and .parquet without contacts and forces on links.

        Raises
        ------
        SceneError
            The robot is another one, or the file is not a trajectory.
        """
        run: Trajectory = tables.read_run(path_to_write(path), robot, cls)
        return run

    @overload
    def plot(self, *, joints: Names = ...) -> Figure: ...

    @overload
    def plot(self, path: str | os.PathLike[str], *, joints: Names = ...) -> Path: ...

    def plot(self, path: str | os.PathLike[str] | None = None, *, joints: Names = ()) -> Path | Figure:
        """Draw coordinates, velocities, energy and the error bar over time, with the events.

        Parameters
        ----------
        path : str or path, optional
            A .png, .svg or .pdf file.
        joints : str or sequence of str
            Which joints: names or patterns, such as "LF_*" for a limb. By default those that move the most, the base of
            a free robot among them.

        Returns
        -------
        Path or matplotlib.figure.Figure
            The path; without one the figure, which notebooks show. The style is matplotlib's "twolink.show.twolink".

        Raises
        ------
        ShowError
            No joint fits, the file's ending is another one, or it cannot be written.
        """
        return self._drawn(path, joints=joints)

    def _figure(self, joints: Names = ()) -> Figure:
        from twolink.show.motion_plots import plot_trajectory

        curves, energy = tables.drawn_curves(self)
        events = [(event.t, event.kind) for event in self.events if event.t > 0.0]
        return plot_trajectory(self.robot, self.title or f"{self.robot.name}: {self.end:g} s", curves, energy,
                               (self.t, self.error), estimated=self.estimated, events=events,
                               note=f"error of q: {self.error_text}", asked=self.accuracy, joints=joints)  # fmt: skip

    @overload
    def playback(self, *, speed: float | None = ..., trails: Names | None = ...,
                 beside: Trajectory | None = ..., on_skipped: Skipped = ...) -> InlinePage: ...  # fmt: skip

    @overload
    def playback(self, path: str | os.PathLike[str], *, speed: float | None = ..., trails: Names | None = ...,
                 beside: Trajectory | None = ..., on_skipped: Skipped = ...) -> Path: ...  # fmt: skip

    def playback(
        self, path: str | os.PathLike[str] | None = None, *, speed: float | None = None,
        trails: Names | None = None, beside: Trajectory | None = None, on_skipped: Skipped = None,
    ) -> Path | InlinePage:  # fmt: skip
        """Make a standalone page that plays the motion in 3D in any browser, offline.

        It has a time line with the run's events, and shows at will trails and frames of links, the centre of mass, and
        contact points and forces on links.

        Parameters
        ----------
        path : str or path, optional
            A .html file.
        speed : float, optional
            Simulated seconds per second of playing; by default 1, and less for a motion below 1 s.
        trails : str or sequence of str, optional
            Links that draw a trail at first; by default the last one of a robot with one tip.
        beside : Trajectory, optional
            Another run, laid over this one as a ghost.
        on_skipped : callable, optional
            Called with the names of the shapes that cannot be drawn, if any; the page names them too.

        Returns
        -------
        Path or InlinePage
            The path; without one the page, which notebooks show.

        Raises
        ------
        ShowError
            The file's ending is another one, it cannot be written, or the motion cannot be shown.
        """
        from twolink.show.playback import InlinePage, playback_page, write_playback

        options = {"speed": self._speed(speed), "trails": trails, "on_skipped": on_skipped, **self._told}
        if beside is not None:
            other = instance(beside, Trajectory, "beside", ShowError)
            options |= {"beside": other._motion, "beside_title": other.title or other.robot.name}
        if path is None:
            return InlinePage(playback_page(*self._motion, **options))
        return write_playback(*self._motion, path_to_write(path), **options)

    @property
    def _motion(self) -> tuple[Any, Any, np.ndarray, np.ndarray]:
        """The robot, and where it is drawn, between few samples too."""
        t, q, _ = tables.states(self)
        return self.robot.model, (self.scene or self.robot).visual_model(tree=False), t, q

    @property
    def _told(self) -> dict[str, Any]:
        """Contents of a page about the run beside its motion."""
        events = [(event.t, f"{event.kind} {event.text}") for event in self.events or ()]
        return {"title": self.title or self.robot.name, "events": events, **tables.drawn_marks(self)}

    def video(
        self, path: str | os.PathLike[str], *, curves: Names = (), speed: float | None = None,
        contacts: bool = True, forces: bool = False, **options: Any,
    ) -> Path:  # fmt: skip
        """Write a film (.mp4 .webm .gif), or a picture of a moment (.png), without a display.

        Parameters
        ----------
        path : str or path
            The file; .mp4 and .webm need pip install "twolink[video]".
        curves : str or sequence of str
            Columns of `columns()` to draw beside it, such as "q.elbow" or "energy".
        speed : float, optional
            As of `playback`.
        contacts, forces : bool
            Whether arrows show the forces of contacts, and those of effects on links.
        **options
            size=(960, 720), pixels; rate=30, pictures a second; at, the time of a .png, s; direction (3,), from the
            robot to the camera; progress, called with the pictures done, all, and a label; on_skipped, as of
            `playback`.

        Returns
        -------
        Path
            The path.

        Raises
        ------
        ShowError, SceneError
            An option does not fit, a column is unknown, or the file cannot be written.
        MissingExtraError
            imageio-ffmpeg is not installed.
        """
        from twolink.show.video import write_video

        motion, marks = self._motion, tables.drawn_marks(self)
        options |= {"curves": tables.chosen_columns(self.columns(), curves, motion[2]) if curves else None}
        options |= {"contacts": marks["contacts"] if contacts else None, "forces": marks["forces"] if forces else None}
        options |= {"touches": bool(marks["contacts"]) or any(event.kind == "impact" for event in self.events)}
        return write_video(*motion, path_to_write(path), speed=self._speed(speed), **options)

    def play(
        self,
        *,
        speed: float | None = None,
        open_browser: bool = True,
        on_url: Callable[[str], None] | None = None,
        on_skipped: Skipped = None,
    ) -> None:
        """Play the motion live in the browser, at true speed times `speed`; returns when it has ended.

        speed: by default 1, and less for a motion below 1 s.

        on_url, on_skipped: called with the page's address, and with the names of the shapes that cannot be drawn, if
        any; both are logged (logger "twolink") unless given.
        """
        from twolink.show.playback import play_live

        play_live(*self._motion, **self._told, speed=self._speed(speed), open_browser=open_browser,
                  on_url=on_url or functools.partial(log.info, "playing at %s"),
                  on_skipped=on_skipped or log_skipped)  # fmt: skip

    def _speed(self, speed: float | None) -> float:
        from twolink.show.viewer_data import usual_speed

        return usual_speed(float(self.t[-1] - self.t[0])) if speed is None else speed

    @property
    def contact_record(self) -> dict[str, Any] | None:
        """Of stepped contacts how the steps obey the laws; None otherwise.

        overlap: the largest of bodies at a sample, m. feasibility: the largest approach and excess of friction, m/s.
        complementarity: the largest product of impulse and opening or slip that must vanish, J. steps: their number.
        halved: those that were taken as two, because the laws were not reached, or points of a pair bounced one after
        the other. softened: impacts with less than their restitution, with which they would have created energy.
        solvers: how many steps each one solved.
        """
        if self.solution is None or isinstance(self.solution, DenseOutput):
            return None
        return {"overlap": self.solution.overlap, **asdict(self.solution.record)}

    @property
    def error_text(self) -> str:
        """The largest error in words."""
        return tables.largest_error(self.error, self.robot, estimated_since(self.events) if self.estimated else None)

    def __repr__(self) -> str:
        sign = "estimated at" if self.estimated else "<="
        error = "not verified" if self.error is None else f"error {sign} {self.error.max():.1e}"
        events = f", {len(self.events)} events" if self.events else ""
        ended = estimated_since(self.events) + ", interrupted" * self.interrupted
        ended += "".join(f", unstable loop from {event.t:g} s" for event in self.events if event.kind == UNSTABLE)
        return f"<Trajectory of {self.robot.name!r}: {self.end:g} s, {len(self.t)} samples{events}, {error}{ended}>"

    def _repr_html_(self) -> str:
        from twolink.show.figure import figure_html

        more = len(self.events) - SHOWN_EVENTS
        facts: dict[str, Sequence[object]] = {
            "robot": [self.robot.name],
            "time": [f"{self.end:g} s, {len(self.t)} samples" + (", interrupted" if self.interrupted else "")],
            "error": [self.error_text],
            "energy": [f"changes by {np.ptp(self.energy):.1e} J"],
            "events": [*self.events[:SHOWN_EVENTS], *([f"and {more} more"] if more > 0 else [])] or ["none"],
            "cost": [] if self.cost is None else repr(self.cost).splitlines(),
        }
        return facts_html(self.title or "Trajectory", facts) + figure_html(self.plot())

"""What the service keeps of a run for its pages: events and contacts."""

from pathlib import Path

import numpy as np

import twolink as tl
from twolink.integrate.event import Event
from twolink.service.run_marks import with_marks, write_marks


def test_events_and_contacts_are_kept(tmp_path: Path) -> None:
    robot, t = tl.load_robot("two_link"), np.array([0.0, 1.0])
    points = np.array([[[0.5, 0.0, 1.0]], [[np.nan] * 3]])
    contacts = {"tip - ../wall": (points, 2.0 * points)}
    events = [Event(0.5, "impact", "tip", "with the wall", 0.25)]
    samples = robot, t, np.zeros((2, 2)), np.zeros((2, 2)), None, None
    write_marks(tl.Trajectory(*samples, events=events, recorded_contacts=contacts), tmp_path, 1e6)
    plain = tl.Trajectory(*samples)
    run = with_marks(plain, tmp_path)
    assert run.events == events
    np.testing.assert_array_equal(run.contacts["tip - ../wall"], contacts["tip - ../wall"])
    write_marks(run, tmp_path, 10.0)  # bytes
    assert with_marks(plain, tmp_path).contacts == {}
    assert with_marks(plain, tmp_path / "older").events == ()

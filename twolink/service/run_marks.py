"""What a page shows of a run beside its samples: events, contact points and forces, in a file of their own."""

import dataclasses
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from twolink.integrate.event import Event
from twolink.simulation.trajectory import Trajectory

FILE = "marks.npz"
_EVENTS, _PAIR = "events", "contact "  # names in the file; the latter stands before that of a pair


def write_marks(run: Trajectory, folder: Path, most_bytes: float) -> None:
    """Write the events and contacts of a run. Contacts of more than so many bytes are left out."""
    pairs: dict[str, Any] = {_PAIR + pair: np.stack(both).astype(np.float32) for pair, both in run.contacts.items()}
    if sum(values.nbytes for values in pairs.values()) > most_bytes:
        pairs = {}
    pairs[_EVENTS] = np.frombuffer(msgspec.json.encode(list(run.events), enc_hook=np.generic.item), np.uint8)
    with (folder / FILE).open("wb") as file:
        np.savez_compressed(file, **pairs)


def with_marks(run: Trajectory, folder: Path) -> Trajectory:
    """The run with its events and contacts, where the folder has them."""
    if not (folder / FILE).exists():
        return run
    with np.load(folder / FILE) as content:
        events = msgspec.json.decode(content[_EVENTS].tobytes(), type=list[Event])
        contacts = {name.removeprefix(_PAIR): tuple(content[name]) for name in content.files if name != _EVENTS}
    return dataclasses.replace(run, events=events, recorded_contacts=contacts)

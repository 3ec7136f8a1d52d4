"""The report of `peers`: a table for each scene, the cheapest way to each error, and the figure."""

from collections.abc import Iterable
from dataclasses import astuple, dataclass
from itertools import groupby
from pathlib import Path

from scripts.runner import Table
from twolink.show.figure import COLOURS, new_figure, save_figure

PLAIN, VERIFIED, SAMPLED = "twolink", "twolink, verified", "twolink, 200 samples/s"
LEVELS = (1e-3, 1e-6, 1e-9, 1e-12)  # rad
BARS = {
    "arm-swing": {1e-3: 20.0, 1e-6: 40.0, 1e-9: 50.0, 1e-12: 60.0},
    "ur5": {1e-6: 10.0, 1e-9: 15.0, 1e-12: 20.0},
    "panda": {1e-6: 10.0, 1e-9: 15.0, 1e-12: 20.0},
    "talos": {1e-6: 5.0},
}
"""How many times faster than the cheapest peer twolink is to be, unverified."""
VERIFY_BAR = 3.0  # times the seconds, with the error bar
HEADS = "scene <10 | contestant <24 | setting <18 | error_rad >10.1e | seconds >10.6f | evaluations >12 | calls >6"
MARKERS = "os^Dxv"


@dataclass(frozen=True)
class Entry:
    """A contestant at one setting: its error [rad], median seconds of `calls` calls, evaluations of the dynamics."""

    scene: str
    contestant: str
    setting: str
    error_rad: float
    seconds: float
    evaluations: int | None
    calls: int

    @property
    def ours(self) -> bool:
        """Whether this is twolink."""
        return self.contestant in (PLAIN, VERIFIED, SAMPLED)


def print_scene(entries: list[Entry], doubt: float) -> None:
    """All entries of one scene, then who is cheapest for each error, and the cost of verifying."""
    table = Table(HEADS)
    for e in entries:
        table.add(*astuple(e))
    print()
    table = Table("error <7.0e | cheapest peer <38 | ms >9.3f | twolink <15 | ours, ms >9.3f | ratio >6.1f | bar <4")
    for level in LEVELS:
        peer = _cheapest((e for e in entries if not e.ours), level)
        ours = _cheapest((e for e in entries if e.contestant == PLAIN), level)
        bar = _verdict(peer, ours, BARS.get(entries[0].scene, {}).get(level))
        table.add(level, f"{peer.contestant}, {peer.setting}" if peer else "none gets there",
                  peer and 1e3 * peer.seconds, ours.setting if ours else "none", ours and 1e3 * ours.seconds,
                  peer.seconds / ours.seconds if peer and ours else None,
                  bar if doubt <= level / 10 else "the reference is too coarse")  # fmt: skip
    _print_verifying(entries)


def _cheapest(entries: Iterable[Entry], level: float) -> Entry | None:
    return min((e for e in entries if e.error_rad <= level), key=lambda e: e.seconds, default=None)


def _verdict(peer: Entry | None, ours: Entry | None, bar: float | None) -> str:
    if bar is None:
        return "none set"
    if ours is None:
        return f"{bar:g}x missed"
    if peer is None:
        return f"{bar:g}x met: no peer gets there"
    return f"{bar:g}x {'met' if peer.seconds >= bar * ours.seconds else 'missed'}"


def _print_verifying(entries: list[Entry]) -> None:
    plain = {e.setting: e.seconds for e in entries if e.contestant == PLAIN}
    ratios = {e.setting: e.seconds / plain[e.setting] for e in entries
              if e.contestant == VERIFIED and e.setting in plain}  # fmt: skip
    if not ratios:
        print("  verified, times the seconds: nothing to compare")
        return
    shown = ", ".join(f"{setting.split()[-1]} {r:.2f}" for setting, r in ratios.items())
    met = "met" if max(ratios.values()) <= VERIFY_BAR else "missed"
    print(f"  verified, times the seconds: {shown}; bar {VERIFY_BAR:g}x {met}")


def _unbeaten(entries: Iterable[Entry]) -> list[Entry]:
    """The entries to which no cheaper one has a smaller error, cheap ones first."""
    kept: list[Entry] = []
    for entry in sorted(entries, key=lambda e: e.seconds):
        if not kept or entry.error_rad < kept[-1].error_rad:
            kept.append(entry)
    return kept


def picture(entries: list[Entry], path: Path) -> None:
    """Seconds against error, one panel a scene, a line a contestant, without settings that its others beat.

    A colour for each package, a marker for each of its methods, and thick lines for twolink.
    """
    scenes, names = (list(dict.fromkeys(x)) for x in ([e.scene for e in entries], [e.contestant for e in entries]))
    figure, axes = new_figure(1, len(scenes), size=(4.6 * len(scenes) + 1.8, 5.2), sharey=True)
    packages = groupby(names, key=lambda name: name.replace(",", " ").split()[0])
    styles = {name: (colour, marker) for colour, (_, methods) in zip(COLOURS, packages, strict=False)
              for marker, name in zip(MARKERS, methods, strict=False)}  # fmt: skip
    for axis, scene in zip(axes[0], scenes, strict=True):
        for name, (colour, marker) in styles.items():
            best = _unbeaten(e for e in entries if e.scene == scene and e.contestant == name)
            axis.plot([e.error_rad for e in best], [e.seconds for e in best], label=name, color=colour, marker=marker,
                      linewidth=2.4 if name in (PLAIN, VERIFIED, SAMPLED) else 0.9, markersize=4)  # fmt: skip
        for level in LEVELS:
            axis.axvline(level, color="0.6", linewidth=0.8, linestyle=":", zorder=1)
        axis.set(xscale="log", yscale="log", xlim=(0.3, 1e-14), xlabel="error: max |q - reference| (rad)")
        axis.set_title(scene, fontsize=10)
    axes[0, 0].set_ylabel("seconds")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right upper", fontsize=8, frameon=False)
    figure.suptitle("The same motion, one thread: below is faster, to the right is more accurate", fontsize=11)
    save_figure(figure, path)

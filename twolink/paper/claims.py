"""The paper's statements about the motion (section 3), each answered with the number that decides it."""

from dataclasses import dataclass

import numpy as np

from twolink.paper.beyond import FirstSwing
from twolink.paper.motions import MASSES, ArmMotion, by_hand, cycle_time, recurrence, sign_changes

NEAR = 0.1  # rad: an angle is at -pi/2, or link 1 at its ends
HALF = -np.pi / 2


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, where it stands, whether it holds (None: an opinion), and the numbers that decide."""

    text: str
    holds: bool | None
    found: str
    where: str = ""


def motion_claims(hand: ArmMotion, slow: ArmMotion, fast: ArmMotion, period: float) -> tuple[Claim, ...]:
    """All of section 3 but the swing beyond -pi. hand: links of 1 m; slow, fast: cycles of 3 s and 0.75 s."""
    return (*angle_claims(hand, period), *speed_claims(hand), *phase_claims(hand), *energy_claims(hand),
            *cycle_claims(slow, fast), *mass_claims(hand))  # fmt: skip


def angle_claims(motion: ArmMotion, period: float) -> list[Claim]:
    """The claims about the angles over time."""
    first, second = motion.theta.T
    top, bottom = first.max(), first.min()
    swings = abs(top) < 0.05 and abs(bottom + np.pi) < 0.05
    at_change = first[sign_changes(second)]
    per_cycle = len(at_change) / (motion.t[-1] / period)
    changes = np.abs(at_change - HALF).max() < NEAR and abs(per_cycle - 2) < 0.2
    where = f"{per_cycle:.2f} times a cycle, at theta1 between {at_change.min():.3f} and {at_change.max():.3f} rad"
    extremes = f"from {bottom:.4f} (-pi is {-np.pi:.4f}) to {top:.2e} rad"
    sweep = f"theta2 goes from {second.min():.3f} to {second.max():.3f} rad: only theta1 stays below zero"
    clockwise = bool(motion.dtheta[1, 0] < 0)
    return [
        Claim("theta1 swings between 0 and -pi", bool(swings), extremes, "Fig. 6"),
        Claim("theta1 stays below zero", bool(top <= 1e-9), f"highest {top:.2e} rad, the start itself", "Fig. 6"),
        Claim("theta2 stays below zero", bool(second.max() <= 1e-9), sweep, "Fig. 7"),
        Claim("gravity turns link one clockwise from the start", clockwise,
              f"theta1' = {motion.dtheta[1, 0]:.2g} rad/s after {motion.t[1]:.2g} s", "Fig. 10"),
        Claim("theta2 changes sign when theta1 = -pi/2, twice a cycle", bool(changes), where, "Fig. 7"),
    ]  # fmt: skip


def speed_claims(motion: ArmMotion) -> list[Claim]:
    """The claims about the speeds over time."""
    w1, w2 = motion.dtheta.T
    moving = (np.abs(w1) > 0.01 * np.abs(w1).max()) & (np.abs(w2) > 0.01 * np.abs(w2).max())
    opposed = float(np.mean(w1[moving] * w2[moving] < 0))
    share = f"they have opposite signs {100 * opposed:.0f} % of the time"
    against = float(np.mean(np.diff(w1) * np.diff(w2) < 0))
    changes = f"one rises while the other falls {100 * against:.0f} % of the time"
    fastest = float(motion.theta[np.argmax(np.abs(w2)), 0])
    at_turning = float(np.abs(w2[sign_changes(w1)]).max() / np.abs(w2).max())
    turning = f"where theta1 turns, at most {100 * at_turning:.1f} % of its largest"
    return [
        Claim("the links' velocities oppose each other", opposed > 0.95, share, "Figs. 8, 9"),
        Claim("when link one's velocity increases, link two's decreases", against > 0.95, changes, "Figs. 8, 9"),
        Claim("theta2's speed is largest at theta1 = -pi/2", abs(fastest - HALF) < NEAR,
              f"largest at theta1 = {fastest:.3f} rad", "Figs. 12, 13"),
        Claim("theta2's speed is small at theta1 = 0 and -pi (below 10 % of its largest)", at_turning < 0.1, turning,
              "Figs. 12, 13"),
    ]  # fmt: skip


def phase_claims(motion: ArmMotion) -> list[Claim]:
    """The claims about Figs. 10 and 11, link one's speed against its angle."""
    theta1, w1 = motion.theta[:, 0], np.abs(motion.dtheta[:, 0])
    middle = _crossings(theta1 - HALF)
    there, turned = w1[middle] / w1.max(), theta1[sign_changes(motion.dtheta[:, 0])]
    ends = np.minimum(np.abs(turned), np.abs(turned + np.pi))
    slow = f"it is {100 * there.min():.0f} to {100 * there.max():.0f} % of its largest, {w1.max():.3f} rad/s"
    turns = f"it turns {len(turned)} times, each within {ends.max():.3f} rad of 0 or -pi"
    return [
        Claim("link one's speed falls to zero at theta1 = -pi/2", bool(there.max() < 0.1), slow, "Fig. 10"),
        Claim("link one's speed is zero at -pi and 0, where it swings back", bool(ends.max() < NEAR), turns, "Fig. 10"),
    ]


def energy_claims(motion: ArmMotion) -> list[Claim]:
    """The claims about the energies of both links at theta1 = 0, -pi and -pi/2."""
    kinetic, potential = motion.link_energies()
    turned, middle = sign_changes(motion.dtheta[:, 0]), _crossings(motion.theta[:, 0] - HALF)
    low, high = potential[:, 1].min(), potential[:, 1].max()
    at_ends, highest = (potential[turned, 1].min() - low) / (high - low), motion.theta[np.argmax(potential[:, 1]), 0]
    shares = [kinetic[middle, i] / kinetic[:, i].max() for i in (0, 1)]
    one, two = (f"{100 * share.min():.0f} to {100 * share.max():.0f} %" for share in shares)
    least = kinetic[turned, 0].max() / kinetic[:, 0].max()
    peaks = motion.theta[np.argmax(kinetic, axis=0), 0]
    height = (f"highest, {high:.2g} J, at theta1 = {highest:.3f} rad; where link one turns at least "
              f"{100 * at_ends:.0f} % of the way there from its lowest, {low:.3g} J")  # fmt: skip
    is_end = min(abs(highest), abs(highest + np.pi)) < NEAR
    return [
        Claim("at theta1 = 0 and -pi link two has its highest potential energy", bool(is_end), height,
              "Figs. 12, 13"),
        Claim("at theta1 = 0 and -pi link one has its lowest kinetic energy", bool(least < 0.01),
              f"at most {100 * least:.1g} % of its largest, {kinetic[:, 0].max():.3g} J", "Figs. 12, 13"),
        Claim("at theta1 = -pi/2 link one has its highest kinetic energy", bool(abs(peaks[0] - HALF) < NEAR),
              f"{one} of its largest: a minimum between two peaks, the largest at theta1 = {peaks[0]:.2f} rad",
              "Figs. 12, 13"),
        Claim("at theta1 = -pi/2 link two has its highest kinetic energy", bool(abs(peaks[1] - HALF) < NEAR),
              f"{two} of its largest, {kinetic[:, 1].max():.3g} J, which it has at theta1 = {peaks[1]:.3f} rad",
              "Figs. 12, 13"),
    ]  # fmt: skip


def cycle_claims(slow: ArmMotion, fast: ArmMotion) -> list[Claim]:
    """The claims about the times of a cycle, and how the two models' curves differ."""
    claims = []
    for paper_time, model, motion in ((3.0, "computerised", slow), (0.75, "links oriented", fast)):
        time = cycle_time(motion)
        answer = f"{time:.4f} s with links of {motion.length:.4f} m: the paper's models differ in their parameters"
        claims.append(Claim(f"one cycle takes {paper_time:g} s ({model})", abs(time / paper_time - 1) < 1e-3, answer,
                            "Figs. 6 to 9"))  # fmt: skip
    scale = np.sqrt(slow.length / fast.length)
    apart = float(np.abs(slow.theta - fast.theta).max())
    speeds = float(np.abs(slow.dtheta - fast.dtheta / scale).max())
    again = recurrence(slow)
    return [
        *claims,
        Claim("the next cycles repeat the first one", again < 0.05,
              f"angles and speeds come back to within {100 * again:.1f} % of their sweep", "Figs. 6 to 9"),
        Claim("the curves are identical but for frequency", apart < 1e-6,
              f"over t/sqrt(l) the angles differ by {apart:.0e} rad, the speeds, times sqrt(l), by {speeds:.0e} rad/s: "
              "gravity and the length set the time alone", "Figs. 6 to 9"),
        Claim("the curves differ in amplitude", apart > 1e-6,
              f"not the angles, where proportions are the same; the speeds by {scale:.2f} = sqrt(l/l'). Other "
              "proportions change the angles too: see Fig. 6's jump", "Figs. 6 to 9"),
        Claim("the phase plots differ slightly in scale", scale < 1.2,
              f"by {scale:.2f} along the speed, and not at all along the angle", "Figs. 10 to 13"),
    ]  # fmt: skip


def mass_claims(hand: ArmMotion) -> list[Claim]:
    """Claims on what the paper leaves open: the masses and the C matrix that its figures can come from."""
    seconds = float(hand.t[-1])
    equal, printed = by_hand(1.0, seconds, (1.0, 1.0)), by_hand(1.0, seconds, variant="printed")
    near, far = recurrence(hand), recurrence(equal)
    right, wrong = (float(np.ptp(motion.theta[:, 1])) for motion in (hand, printed))
    back = "angles and speeds come back to within"
    sweep = f"the elbow then sweeps {wrong:.1f} rad instead of {right:.1f}: the figures come from the right matrix"
    unequal, even = "the motion nearly repeats with m1 : m2 = 3 : 1", "the motion nearly repeats with m1 : m2 = 1 : 1"
    return [
        Claim(unequal, near < 0.05, f"{back} {100 * near:.0f} % of their sweep", "not said"),
        Claim(even, far < 0.05, f"{back} {100 * far:.0f} % of their sweep at best", "not said"),
        Claim("the C matrix as printed gives this motion", abs(wrong / right - 1) < 0.1, sweep, "eqs. 16 to 18"),
    ]


def beyond_claims(swing: FirstSwing, example: ArmMotion) -> list[Claim]:
    """The claim about Fig. 6: link one swings beyond -pi and comes back as a positive angle."""
    ratio = MASSES[0] / MASSES[1]
    low, high = swing.range_of_lengths(ratio)
    share, lowest = float(swing.passes.mean()), float(example.theta[:, 0].min())
    here = f"with m1 : m2 = {example.masses[0]:g} : {example.masses[1]:g} and l2 = {example.ratio:g} l1 it reaches "
    found = (f"{here}{lowest:.3f} rad, which is {lowest + 2 * np.pi:.3f} rad wrapped, and repeats to "
             f"{100 * recurrence(example):.1f} %; with {ratio:g} : 1 it passes for l2/l1 from {low:.2f} to {high:.2f}; "
             f"{100 * share:.0f} % of the proportions tried do")  # fmt: skip
    return [Claim("link one swings beyond -pi, and its angle changes suddenly", bool(lowest < -np.pi), found, "Fig. 6")]


def _crossings(values: np.ndarray) -> np.ndarray:
    """Indices of the samples nearest to where the values cross zero."""
    before = np.flatnonzero(values[:-1] * values[1:] < 0)
    return np.asarray(before + (np.abs(values[before + 1]) < np.abs(values[before])))

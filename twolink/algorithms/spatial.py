"""Spatial algebra over plain arithmetic: entries are floats, NumPy arrays or symbolic expressions.

Notation: Featherstone 2008, "Rigid Body Dynamics Algorithms", chapter 2, in Pinocchio's order: a motion is
(linear, angular), a force is (force, moment), each a pair of 3-vectors, at the origin of the frame they are
written in. A pose (R, r) places a child frame in its parent: x_parent = R x_child + r. R is kept as the product
of a few turns where applying them one by one is cheaper than applying their product.

Constants are Python floats. A product with the constant 0, 1 or -1, or a sum with the constant 0, leaves no
operation behind: what a mechanism does not have costs nothing once its equations are traced.
"""

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

from twolink.errors import SceneError

Scalar = Any  # float, np.ndarray or expression: anything with + - * /
Vec = tuple[Scalar, Scalar, Scalar]
Mat = tuple[Vec, Vec, Vec]
Sym = tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]  # xx, xy, xz, yy, yz, zz
Scalars = Sequence[Scalar]
Matrix = list[list[Scalar]]  # rows
Spatial = tuple[Vec, Vec]


class Pose(NamedTuple):
    """x_parent = R x_child + origin, with R the product of the turns, the outermost first."""

    turns: tuple[Mat, ...]
    origin: Vec


ZERO: Vec = (0.0, 0.0, 0.0)
IDENTITY: Mat = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
AT_PARENT = Pose((IDENTITY,), ZERO)
ENTRIES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))  # of a Sym


def constant(x: Scalar) -> bool:
    """True if x is a constant to fold. A np.float64 is not: it may be one state's value."""
    return type(x) is float


def is_zero(x: Scalar) -> bool:
    """True if x is the constant 0, which leaves no operation."""
    return type(x) is float and x == 0.0


def times(a: Scalar, b: Scalar) -> Scalar:
    """a b, folded where a factor is the constant 0, 1 or -1."""
    if type(a) is float:
        if a == 0.0:
            return 0.0
        if abs(a) == 1.0:
            return b if a > 0.0 else negative(b)
    if type(b) is float:
        if b == 0.0:
            return 0.0
        if abs(b) == 1.0:
            return a if b > 0.0 else negative(a)
    return a * b


def plus(*terms: Scalar) -> Scalar:
    """The sum of the terms, folded where one is the constant 0."""
    total: Scalar = 0.0
    for term in terms:
        if type(total) is float and total == 0.0:
            total = term
        elif type(term) is not float or term != 0.0:
            total = total + term
    return total


def minus(a: Scalar, b: Scalar) -> Scalar:
    """a - b, folded where one is the constant 0."""
    if is_zero(b):
        return a
    return negative(b) if is_zero(a) else a - b


def reciprocal(a: Scalar, xp: Any) -> Scalar:
    """1 / a. A namespace may have its own, such as that of numbers with derivatives."""
    return xp.reciprocal(a) if hasattr(xp, "reciprocal") and not constant(a) else 1.0 / a


def negative(a: Scalar) -> Scalar:
    """-a; the constant 0 stays +0."""
    return 0.0 if is_zero(a) else -a


def add(*vectors: Vec) -> Vec:
    """The sum of 3-vectors."""
    x, y, z = zip(*vectors, strict=True)
    return plus(*x), plus(*y), plus(*z)


def scale(s: Scalar, a: Vec) -> Vec:
    """s a."""
    return times(s, a[0]), times(s, a[1]), times(s, a[2])


def dot(a: Vec, b: Vec) -> Scalar:
    """a . b."""
    return plus(times(a[0], b[0]), times(a[1], b[1]), times(a[2], b[2]))


def cross(a: Vec, b: Vec) -> Vec:
    """a x b."""
    return (
        minus(times(a[1], b[2]), times(a[2], b[1])),
        minus(times(a[2], b[0]), times(a[0], b[2])),
        minus(times(a[0], b[1]), times(a[1], b[0])),
    )


def mat_add(*terms: Mat) -> Mat:
    """The sum of matrices."""
    x, y, z = (add(*rows) for rows in zip(*terms, strict=True))
    return x, y, z


def transpose(m: Mat) -> Mat:
    """m^T."""
    x, y, z = zip(*m, strict=True)
    return x, y, z


def rotate(m: Mat, a: Vec) -> Vec:
    """m a."""
    return dot(m[0], a), dot(m[1], a), dot(m[2], a)


def product(m: Mat, n: Mat) -> Mat:
    """The matrix product m n."""
    columns = transpose(n)
    return rotate(columns, m[0]), rotate(columns, m[1]), rotate(columns, m[2])


def full(s: Sym) -> Mat:
    """A symmetric matrix written out."""
    return (s[0], s[1], s[2]), (s[1], s[3], s[4]), (s[2], s[4], s[5])


def congruence(m: Mat, n: Mat) -> Mat:
    """m n m^T for a rotation m.

    A turn about a coordinate axis, by the angle with cosine a and sine b, moves the block ((p, q), (r, s)) of n to
    ((p + b u, a u - r), (a u - q, s - b u)) with u = a (q + r) - b (p - s), since a^2 + b^2 = 1: 4 products, not 12.
    """
    fixed = _fixed_axis(m)
    if fixed is None:
        return product(product(m, n), transpose(m))
    i, j, sign = fixed
    (i1, i2), (j1, j2) = _AROUND[i], _AROUND[j]
    a, b = m[i1][j1], m[i1][j2]
    u = minus(times(a, plus(n[j1][j2], n[j2][j1])), times(b, minus(n[j1][j1], n[j2][j2])))
    out: Matrix = [[0.0] * 3 for _ in range(3)]
    out[i][i] = n[j][j]
    out[i1][i1], out[i2][i2] = plus(n[j1][j1], times(b, u)), minus(n[j2][j2], times(b, u))
    out[i1][i2] = times(sign, minus(times(a, u), n[j2][j1]))
    out[i2][i1] = times(sign, minus(times(a, u), n[j1][j2]))
    for k in (i1, i2):
        out[k][i] = times(sign, plus(times(m[k][j1], n[j1][j]), times(m[k][j2], n[j2][j])))
        out[i][k] = times(sign, plus(times(m[k][j1], n[j][j1]), times(m[k][j2], n[j][j2])))
    x, y, z = ((row[0], row[1], row[2]) for row in out)
    return x, y, z


_AROUND = ((1, 2), (2, 0), (0, 1))  # the axes around each axis


def _fixed_axis(m: Mat) -> tuple[int, int, float] | None:
    """(i, j, sign) where a rotation moves axis j to the axis i, or against it, and turns the axes around by an angle.

    None where there is no such axis, or where all axes stay coordinate axes. A cosine of 1 is not enough: a file's
    1.57079632679 for a right angle leaves sines of 5e-12 beside it.
    """
    for i, j in itertools.product(range(3), repeat=2):
        around = [m[k][n] for k in _AROUND[i] for n in _AROUND[j]]
        beside = [*(m[i][n] for n in _AROUND[j]), *(m[k][j] for k in _AROUND[i])]
        if constant(m[i][j]) and abs(m[i][j]) == 1.0 and all(map(is_zero, beside)) and not any(map(is_zero, around)):
            return i, j, m[i][j]
    return None


def upper(m: Mat) -> Sym:
    """The entries of a symmetric matrix."""
    return m[0][0], m[0][1], m[0][2], m[1][1], m[1][2], m[2][2]


def skew(a: Vec) -> Mat:
    """The matrix of a x."""
    return (0.0, negative(a[2]), a[1]), (a[2], 0.0, negative(a[0])), (negative(a[1]), a[0], 0.0)


def sym_add(*terms: Sym) -> Sym:
    """The sum of symmetric matrices."""
    xx, xy, xz, yy, yz, zz = (plus(*entries) for entries in zip(*terms, strict=True))
    return xx, xy, xz, yy, yz, zz


def outward(pose: Pose, a: Vec) -> Vec:
    """R a: a child's vector along the parent's axes."""
    for turn in reversed(pose.turns):
        a = rotate(turn, a)
    return a


def inward(pose: Pose, a: Vec) -> Vec:
    """R^T a: a parent's vector along the child's axes."""
    for turn in pose.turns:
        a = rotate(transpose(turn), a)
    return a


def compose(outer: Pose, inner: Pose) -> Pose:
    """The pose of a grandchild: outer, then inner.

    Turns are multiplied unless the product is fuller than both: a turn about x and one about z take 12 operations,
    their product 13 and those that make it.
    """
    turns = list(outer.turns)
    for turn in inner.turns:
        both = product(turns[-1], turn)
        if _entries(both) > max(_entries(turns[-1]), _entries(turn)):
            turns.append(turn)
        else:
            turns[-1] = both
    return Pose(tuple(turns), add(outer.origin, outward(outer, inner.origin)))


def _entries(m: Mat) -> int:
    return sum(not is_zero(x) for row in m for x in row)


def single_turn(pose: Pose) -> Pose:
    """The pose with its turns multiplied into one."""
    turn = pose.turns[0]
    for other in pose.turns[1:]:
        turn = product(turn, other)
    return Pose((turn,), pose.origin)


def motion_to_child(pose: Pose, m: Spatial) -> Spatial:
    """A parent's motion in the child's frame: (R^T (v + w x r), R^T w)."""
    return inward(pose, add(m[0], cross(m[1], pose.origin))), inward(pose, m[1])


def force_to_parent(pose: Pose, f: Spatial) -> Spatial:
    """A child's force in the parent's frame: (R f, R n + r x R f)."""
    force = outward(pose, f[0])
    return force, add(outward(pose, f[1]), cross(pose.origin, force))


def spatial_add(*terms: Spatial) -> Spatial:
    """The sum of motions, or of forces."""
    return add(*(t[0] for t in terms)), add(*(t[1] for t in terms))


def spatial_scale(s: Scalar, m: Spatial) -> Spatial:
    """s m."""
    return scale(s, m[0]), scale(s, m[1])


def spatial_dot(m: Spatial, f: Spatial) -> Scalar:
    """The power m . f of a force on a motion."""
    return plus(dot(m[0], f[0]), dot(m[1], f[1]))


class Inertia(NamedTuple):
    """A rigid body's ten parameters, about its frame's origin.

    mass m, first moment h = m c, and second moment Sigma = integral of x x^T dm. The rotational inertia is
    tr(Sigma) 1 - Sigma. All ten add up when bodies are joined, and Sigma transforms with fewer operations.
    """

    mass: Scalar
    first: Vec
    second: Sym


NO_INERTIA = Inertia(0.0, ZERO, (0.0,) * 6)


def second_moment(mass: Scalar, com: Vec, rotational: Sym) -> Sym:
    """Sigma about the origin, from the rotational inertia about the centre of mass: tr(I)/2 1 - I + m c c^T."""
    half = times(0.5, plus(rotational[0], rotational[3], rotational[5]))
    weighted = scale(mass, com)
    xx, xy, xz, yy, yz, zz = (
        plus(minus(half if i == j else 0.0, rotational[k]), times(weighted[i], com[j]))
        for k, (i, j) in enumerate(ENTRIES)
    )
    return xx, xy, xz, yy, yz, zz


def rotational_inertia(second: Sym) -> Sym:
    """tr(Sigma) 1 - Sigma, about the frame's origin."""
    xx, xy, xz, yy, yz, zz = second
    return plus(yy, zz), negative(xy), negative(xz), plus(xx, zz), negative(yz), plus(xx, yy)


def inertia_add(a: Inertia, b: Inertia) -> Inertia:
    """Two bodies joined into one."""
    return Inertia(plus(a.mass, b.mass), add(a.first, b.first), sym_add(a.second, b.second))


def inertia_to_parent(pose: Pose, body: Inertia) -> Inertia:
    """A child's inertia in the parent's frame.

    With k = R h: (m, k + m r, R Sigma R^T + r (k + m r)^T + k r^T).
    """
    turned, r, second = outward(pose, body.first), pose.origin, body.second
    first = add(turned, scale(body.mass, r))
    for turn in reversed(pose.turns):
        second = upper(congruence(turn, full(second)))
    xx, xy, xz, yy, yz, zz = (
        plus(second[k], times(r[i], first[j]), times(turned[i], r[j])) for k, (i, j) in enumerate(ENTRIES)
    )
    return Inertia(body.mass, first, (xx, xy, xz, yy, yz, zz))


def inertia_times(body: Inertia, m: Spatial) -> Spatial:
    """I m: (m v + w x h, I w + h x v)."""
    force = add(scale(body.mass, m[0]), cross(m[1], body.first))
    return force, add(rotate(full(rotational_inertia(body.second)), m[1]), cross(body.first, m[0]))


def acceleration_gradient(w: Vec, alpha: Vec) -> Mat:
    """U = [alpha x] + [w x]^2: a body's point x has the acceleration a + U x when its origin has a."""
    ww, wxy, wxz, wyz = [times(c, c) for c in w], times(w[0], w[1]), times(w[0], w[2]), times(w[1], w[2])
    return (
        (negative(plus(ww[1], ww[2])), minus(wxy, alpha[2]), plus(wxz, alpha[1])),
        (plus(wxy, alpha[2]), negative(plus(ww[0], ww[2])), minus(wyz, alpha[0])),
        (minus(wxz, alpha[1]), plus(wyz, alpha[0]), negative(plus(ww[0], ww[1]))),
    )


def inertial_force(body: Inertia, a: Vec, u: Mat) -> Spatial:
    """The force that gives the body's points x the accelerations a + U x.

    force = m a + U h, moment = h x a + integral of x x (U x) dm, whose x entry is (U Sigma)_zy - (U Sigma)_yz. This
    is Featherstone's I a + v x* I v, the equation of motion, with fewer products and without the linear velocity.
    """
    force = add(scale(body.mass, a), rotate(u, body.first))
    sigma = full(body.second)
    turned = (
        minus(dot(u[2], sigma[1]), dot(u[1], sigma[2])),
        minus(dot(u[0], sigma[2]), dot(u[2], sigma[0])),
        minus(dot(u[1], sigma[0]), dot(u[0], sigma[1])),
    )
    return force, add(cross(body.first, a), turned)


def vec(values: Any) -> Vec:
    """Three floats, which formulas fold as constants."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def unit(direction: Vec, field: str) -> Vec:
    """A direction scaled to length 1. Raises SceneError where it has no length."""
    length = sum(float(x) ** 2 for x in direction) ** 0.5
    if not length > 0:
        raise SceneError(f"expected a direction, got {direction!r:.60}", where=field, remedy="such as (0, 0, 1)")
    x, y, z = (float(c) / length for c in direction)
    return x, y, z


def across(axis: Vec) -> tuple[Vec, Vec]:
    """Two unit vectors across a unit vector and each other."""
    k = min(range(3), key=lambda i: abs(axis[i]))
    first = unit(cross(axis, (float(k == 0), float(k == 1), float(k == 2))), "axis")
    return first, cross(axis, first)

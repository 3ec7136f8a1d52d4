"""The law of contact and Coulomb friction as a projection: p = proj(p - r u), of forces or impulses p and rates u.

    p_n = max(z_n, 0)
    p_t = z_t  where |z_t| <= static p_n,  else  kinetic p_n z_t / |z_t|

p obeys the laws where it is the projection of z = p - r u for some r > 0, and then for each: normal 0 <= p_n, 0 <= u_n,
p_n u_n = 0; tangent u_t = 0 with |p_t| <= static p_n, or p_t = -kinetic p_n u_t / |u_t|.
Source: Alart, Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991) 353-375.
"""

import numpy as np

from twolink.algorithms.namespaces import Array


def onto_cone(z: Array, kinetic: Array, static: Array | None = None) -> Array:
    """The projection of z.

    Parameters
    ----------
    z : ndarray (n, 3)
        The two tangents, then the normal.
    kinetic, static : ndarray (n,)
        Coefficients of friction in motion and at rest; by default the same.

    Returns
    -------
    ndarray (n, 3)
    """
    normal = np.maximum(z[:, 2], 0.0)
    shares, _ = _shares(z, normal, kinetic, static)
    out = z * shares[:, None]
    out[:, 2] = normal
    return out


def cone_derivative(z: Array, kinetic: Array, static: Array | None = None) -> Array:
    """The derivative (n, 3, 3) of the projection by z, of points that press, z_n > 0."""
    shares, slips = _shares(z, z[:, 2], kinetic, static)
    length = np.hypot(z[:, 0], z[:, 1])
    d, c = z[:, :2] * (slips / np.where(slips, length, 1.0))[:, None], np.zeros((len(z), 3, 3))
    c[:, :2, :2] = shares[:, None, None] * (np.eye(2) - d[:, :, None] * d[:, None, :])
    c[:, :2, 2] = kinetic[:, None] * d
    c[:, 2, 2] = 1.0
    return c


def _shares(z: Array, normal: Array, kinetic: Array, static: Array | None) -> tuple[Array, Array]:
    """The share (n,) of the tangents that is left, and where they are beyond the friction at rest (n,)."""
    length = np.hypot(z[:, 0], z[:, 1])
    slips = length > (kinetic if static is None else static) * normal
    return np.where(slips, kinetic * normal / np.where(slips, length, 1.0), 1.0), slips

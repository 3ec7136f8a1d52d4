"""Results as text."""

import html

import numpy as np


class ShownAsText:
    """A result that notebooks show as the text of its `repr`."""

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(repr(self))}</pre>"


class ContactForces(dict[str, np.ndarray]):
    """Forces (n, 3) [N] by pair of bodies, on the first of the two, along the world's axes."""

    def __repr__(self) -> str:
        if not self:
            return "<no contact forces>"
        width = max(map(len, self))
        return "\n".join(f"{pair:<{width}}  {len(force)} x 3, up to {np.linalg.norm(force, axis=1).max():.4g} N"
                         for pair, force in self.items())  # fmt: skip

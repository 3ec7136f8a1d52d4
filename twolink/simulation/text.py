"""Results as text in notebooks."""

import html


class ShownAsText:
    """A result that notebooks show as the text of its `repr`."""

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(repr(self))}</pre>"

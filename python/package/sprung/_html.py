"""Pages in notebooks."""

from __future__ import annotations

import html


def framed(page: str, height: int) -> str:
    """A page in a frame, which isolates its styles and scripts."""
    return (
        f'<iframe srcdoc="{html.escape(page, quote=True)}" width="100%" height="{height}" '
        'style="border:0" loading="lazy"></iframe>'
    )

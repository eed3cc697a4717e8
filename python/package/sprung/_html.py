"""Whole pages inside a notebook."""

from __future__ import annotations

import html


def framed(page: str, height: int) -> str:
    """A page in a frame of its own, so that its styles and scripts touch nothing else."""
    return (
        f'<iframe srcdoc="{html.escape(page, quote=True)}" width="100%" height="{height}" '
        'style="border:0" loading="lazy"></iframe>'
    )

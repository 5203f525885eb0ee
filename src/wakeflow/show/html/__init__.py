"""report.html: one file that opens offline, prints on A4 and needs no library; the answer first."""

from __future__ import annotations

from .pages import render, write_html

__all__ = ["render", "write_html"]

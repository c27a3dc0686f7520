"""Text of users and files as a page shows it: never as markup."""

from __future__ import annotations

import html
import re


def plain_text(text: str) -> str:
    """Text that neither HTML nor Markdown, nor what viser's Markdown reads as code, takes for more than its letters."""
    return re.sub(r"[\\`*_{}\[\]()#+!|~$]", lambda sign: f"&#{ord(sign[0])};", html.escape(text, quote=True))

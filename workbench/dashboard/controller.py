"""The session's one speed controller: a page takes over what another has set, and says what it has set itself.

settings = taken_over("loop")    what another page has set since this one last did; None where nothing is new
said("loop", settings)           after the page's own controls have been drawn
present()                        the controller as it stands, None before any page has set one
"""

from __future__ import annotations

from workbench.control import PiSettings
from workbench.dashboard import session

_NOW, _SEEN = "controller now", "controller seen by "


def present() -> PiSettings | None:
    """The controller as any page has set it last."""
    now = session.get(_NOW, tuple, ())
    return now[0] if now else None


def taken_over(page: str) -> PiSettings | None:
    """What another page has set since `page` was drawn last."""
    now = present()
    if now is None or session.get(_SEEN + page, tuple, ()) == (now,):
        return None
    return now


def said(page: str, settings: PiSettings) -> None:
    """The page's controls stand at these settings, which all pages now share."""
    session.put(_NOW, (settings,))
    session.put(_SEEN + page, (settings,))

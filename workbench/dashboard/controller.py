"""The session's one controller: a page takes over what another has set, and says what it has set itself.

settings = taken_over("loop")    what another page has set since this one last did; None where nothing is new
said("loop", settings)           after the page's own controls have been drawn
present()                        the controller as it stands, None before any page has set one

of: whose it is. All hoists share one speed controller; each axis, by `owner(machine)`, has a cascade of its own.
"""

from __future__ import annotations

from workbench.control import Settings
from workbench.dashboard import session
from workbench.kinds import kind_of
from workbench.machine import Axis, Hoist

_NOW, _SEEN = "controller now", "controller seen by "


def owner(machine: Hoist | Axis) -> str:
    """Whose controller it is that a machine runs under."""
    kind = kind_of(machine)
    return "" if kind.payload else f" {kind.name} {machine.name}"


def present(of: str = "") -> Settings | None:
    """The controller as any page has set it last."""
    now = session.get(_NOW + of, tuple, ())
    return now[0] if now else None


def taken_over(page: str, of: str = "") -> Settings | None:
    """What another page has set since `page` was drawn last."""
    now = present(of)
    if now is None or session.get(_SEEN + page + of, tuple, ()) == (now,):
        return None
    return now


def said(page: str, settings: Settings, of: str = "") -> None:
    """The page's controls stand at these settings, which all pages now share."""
    session.put(_NOW + of, (settings,))
    session.put(_SEEN + page + of, (settings,))

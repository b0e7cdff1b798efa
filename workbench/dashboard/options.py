"""How the dashboard's server is set up; .streamlit/config.toml says the same for `streamlit run app.py`."""

from __future__ import annotations

from collections.abc import Sequence

Value = str | int | bool | list[str]

OPTIONS: dict[str, Value] = {
    "server.address": "127.0.0.1",
    # A page from elsewhere whose name is made to mean this computer (DNS rebinding) is refused.
    "server.allowedHosts": ["localhost", "127.0.0.1", "::1"],
    "server.headless": True,  # the command opens the browser itself; streamlit would ask for an e-mail address
    "server.fileWatcherType": "none",  # the sources do not change under a server
    "server.maxUploadSize": 64,
    "server.enableXsrfProtection": True,
    "browser.gatherUsageStats": False,
    "client.showErrorDetails": "type",
    "client.toolbarMode": "viewer",
    "theme.light.primaryColor": "#0072B2",
    "theme.light.backgroundColor": "#FFFFFF",
    "theme.light.secondaryBackgroundColor": "#F3F5F8",
    "theme.light.textColor": "#222222",
    "theme.dark.primaryColor": "#56B4E9",
    "theme.dark.backgroundColor": "#0E1117",
    "theme.dark.secondaryBackgroundColor": "#1D2330",
    "theme.dark.textColor": "#E8E8E8",
}


def flags(changes: dict[str, Value]) -> list[str]:
    """The options, with changes, as streamlit's command line takes them."""
    return [
        f"--{key}={str(item).lower() if isinstance(item, bool) else item}"
        for key, value in (OPTIONS | changes).items()
        for item in (value if isinstance(value, list) else [value])
    ]


def hosts_allowed(address: str, names: Sequence[str]) -> list[str]:
    """The hosts that a browser may call the server by. names: those that its owner gives it, as behind a proxy.

    Who lets others reach it without naming it has it reached by any name: which ones there are, nobody can know.
    """
    own = OPTIONS["server.allowedHosts"]
    assert isinstance(own, list)
    return [*own, *(names or ([] if address in own else ["*"]))]

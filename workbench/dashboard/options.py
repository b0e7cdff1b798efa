"""How the dashboard's server is set up; .streamlit/config.toml says the same for `streamlit run app.py`."""

from __future__ import annotations

OPTIONS: dict[str, str | int | bool] = {
    "server.address": "127.0.0.1",
    "server.headless": True,  # the command opens the browser itself; streamlit would ask for an e-mail address
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


def flags(changes: dict[str, str | int | bool]) -> list[str]:
    """The options, with changes, as streamlit's command line takes them."""
    return [f"--{key}={str(value).lower() if isinstance(value, bool) else value}"
            for key, value in (OPTIONS | changes).items()]  # fmt: skip

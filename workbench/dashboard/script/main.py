"""The script that streamlit runs."""

from workbench.dashboard.shell import run

run()

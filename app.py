"""`streamlit run app.py`: the dashboard. `workbench app` starts the same."""

from workbench.dashboard.shell import run
from workbench.dashboard.warm import warm

warm()
run()

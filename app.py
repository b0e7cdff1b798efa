"""`streamlit run app.py`: the dashboard. `workbench app` starts the same."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as cli/app.py sets it, before NumPy is imported

from streamlit.starlette import App

from workbench.dashboard.server import SCRIPT, middleware, routes

app = App(SCRIPT, routes=routes(), middleware=middleware())

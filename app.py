"""`streamlit run app.py`: the dashboard. `workbench app` starts the same."""

from streamlit.starlette import App

from workbench.dashboard.server import SCRIPT, middleware, routes

app = App(SCRIPT, routes=routes(), middleware=middleware())

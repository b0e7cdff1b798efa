"""The script that streamlit runs. It has a folder of its own: streamlit takes a folder `pages` beside it for pages."""

"""The dashboard: Streamlit pages on the library. No physics lives here."""

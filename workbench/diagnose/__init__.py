"""The sim-to-real gap: where it lies, which unmodelled effect causes it, how far it shrinks.

`diagnose.diagnose` runs the steps in order and returns a `records.Diagnosis`. The rooms:

readiness     whether the runs can be diagnosed at all, and how fit they are
hypotheses    what may be turned, the residuals it acts on, fits, and the search through them
verdict       what is left, what speaks for whom, how likely; its numbers are in calibration.json
location      the gap, and where it lies
isolation     what these runs can tell apart, and which run would decide what is open
unexplained   an unknown cause as a table over what explains it best

Each room's records stand in its `records.py`. Beside the rooms: candidates (rows of the report), machines (a fit as
machine.yaml), shrink, words.
"""

from workbench.verb import make_callable

make_callable(__name__)

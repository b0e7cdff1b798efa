"""The sim-to-real gap: its location, the unmodelled effect that causes it, its reduction.

`diagnose.diagnose` runs the steps in order and returns a `records.Diagnosis`. The packages:

readiness     whether the runs can be diagnosed, and the condition of their logs
hypotheses    parameters, residuals, fits, and the search among the effects
verdict       remaining residual, evidence, probabilities; the numbers are in calibration.json
location      the gap, and where it lies
isolation     which effects the runs can tell apart, and which run would decide
unexplained   an unknown cause as a table over the variable that explains it best

Each package has its records in `records.py`. Beside them: candidates (rows of the report), machines (a fit as
machine.yaml), shrink, words.
"""

from workbench.core.verb import make_callable

make_callable(__name__)

"""The sim-to-real gap: its location, the unmodelled effect that causes it, its reduction.

`diagnose.diagnose` runs the steps in order and returns a `diagnose.Diagnosis`. The packages:

readiness     whether the runs can be diagnosed, and the condition of their logs
hypotheses    parameters, residuals, fits, and the search among the effects
verdict       remaining residual, evidence, probabilities; the numbers are in hypotheses/settings.py
location      where the gap lies
isolation     which run would decide between open hypotheses

Beside them: gap (its size and reduction), isolability (which effects these runs can discriminate), candidates (rows of
the report), machines (a fit as machine.yaml), unknown and law (a cause that no effect explains), saved.
"""

from workbench.core.verb import make_callable

make_callable(__name__)

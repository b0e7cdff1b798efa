"""How well `workbench diagnose` names what is hidden in simulated machines: run, calibrate, score."""

"""How the EMPS records, a real ball-screw axis, are read as a campaign."""

RUNS = """\
columns:
  time_s: t
  position_m: qm
  position_reference_m: qg
  force_n: {column: vir, scale: 35.1507}
runs:
- {name: train, file: runs/DATA_EMPS.mat, start_time_s: 0.0}
- {name: pulses, file: runs/DATA_EMPS_PULSES.mat, start_time_s: 60.0}
"""

"""A machine watched by its logs: each cycle's estimates, and when they leave the machine's identified self.

estimate.py   a cycle's parameters with standard errors, from its torque balance
change.py     the sequential test and its threshold, by simulation
judge.py      cycle after cycle: baseline, events that are not the machine, alarms with their likeliest cause
trend.py      how an alarm's parameter goes on, and when it meets a limit
store.py      what is known, on disk: every cycle once, whole or not at all
arrivals.py   logs in a folder: which are complete, and what is said of them
watch.py      the loop: what has arrived, estimate, judge, diagnose, store, tell
"""

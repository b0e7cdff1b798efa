"""A machine watched by its logs: each cycle's estimates, and when they leave the machine's identified self.

estimate.py   a cycle's parameters with standard errors, from its torque balance
change.py     the sequential test and its threshold, by simulation
judge.py      cycle after cycle: baseline, events that are not the machine, alarms with their likeliest cause
trend.py      how an alarm's parameter goes on, and when it meets a limit
store.py      what is known, on disk: every cycle once, whole or not at all
diagnosed.py  the diagnosis of an alarm's cycles
told_apart.py causes that a diagnosis cannot tell apart, told apart beside the healthy cycles
arrivals.py   logs in a folder: which are complete, and what is said of them
stream/       cycles cut out of a server's stream, written as logs
watch.py      the loop: what has arrived, estimate, judge, diagnose, store, tell
"""

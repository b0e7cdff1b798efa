"""A machine watched by its logs: each cycle's estimates, and when they leave the machine's identified self.

estimate.py  a cycle's parameters with standard errors, the healthy baseline, the threshold of the sequential test
judge.py     cycle after cycle: baseline, events that are not the machine, alarms with their likeliest cause, trends
cause.py     the diagnosis of an alarm's cycles, beside the healthy cycles and beside what earlier alarms found
store.py     the state on disk: every cycle once, whole or not at all, and its copies
arrivals.py  logs in a folder: which are complete, and their descriptions
stream.py    cycles cut out of a stream of values, written as logs
opcua.py     an OPC UA server's stream
watch.py     the loop: what has arrived, estimate, judge, diagnose, store, tell
fleet.py     many machines at once
"""

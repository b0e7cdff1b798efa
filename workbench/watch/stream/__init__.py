"""Cycles cut out of a stream of values, each written as a log, so that the watch takes it like any other.

cut.py      where a cycle begins and ends in a stream, and what spoils one
logged.py   a cycle's series on one time grid, as a log with what is said of it
nodes.py    which nodes of a server are which signals
line.py     a subscription to a server, for ever: reconnects, and hands on what comes
"""

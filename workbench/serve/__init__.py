"""A plant that answers in real time, for a controller or PLC at the other end of a line.

live.py      a machine, one compiled step at a time, with numbers that may be set between two steps
plant.py     the machines that are served: hoist with drive, brake and faults, axis with its input alone
points.py    what a client may read and write: name, unit, meaning
session.py   commands in, signals out: the client's latest torque, watchdog, faults, counts
pace.py      steps at a fixed rate: catching up, overruns, jitter
udp.py, modbus.py, opcua.py   a protocol each: what comes in becomes a command, what goes out is a signal
"""

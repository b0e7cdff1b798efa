"""A plant that answers in real time, for a controller or PLC at the other end of a line.

plant.py     a machine, one compiled step at a time, with numbers and faults that may be set between two steps
session.py   what a client may read and write; commands in, signals out: who controls, watchdog, counts, pace
udp.py, tcp.py   the protocols: UDP; Modbus and OPC UA behind one gate
serve.py     all of it, from first to last
"""

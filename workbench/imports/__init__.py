"""Logs as drives write them, made a campaign: channels with units, a proposed mapping to signals, the folder.

source.py    the channels of a file, whatever its format
units.py     units as drives write them, to SI
propose.py   which column is which signal
campaign.py  the folder: logs as Parquet over one time, runs.yaml with the mapping
"""

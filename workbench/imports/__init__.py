"""Logs as drives write them, made a campaign: a proposed mapping to signals (propose.py), the folder (campaign.py)."""

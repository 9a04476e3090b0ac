"""Logs of robots in the field: the twin that is identified from one, and how near it comes."""

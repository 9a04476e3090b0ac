"""The report: one self-contained page a person wants to read."""

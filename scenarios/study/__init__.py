"""Studies: many runs over factors, in one ledger that survives a kill and says the same on one core or a cluster."""

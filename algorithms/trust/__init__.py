"""How far a measurement can be trusted: detection, uncertainty, repeatability, coverage, and what the trade states."""

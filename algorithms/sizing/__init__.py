"""Sizing: the local background, a blind threshold, and each defect's extent and depth."""

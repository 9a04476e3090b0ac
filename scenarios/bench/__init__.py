"""Benches: registration methods against each other, on frames and on scans."""

"""Playing a run: what really happened, as one page that opens offline."""

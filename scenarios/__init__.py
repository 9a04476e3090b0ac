"""THE BENCH: scenario files, run, score, report, command line."""

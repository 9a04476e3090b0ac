"""The field side: logs of robots, the twin identified from one, and what inspectors and roboticists open of a run."""

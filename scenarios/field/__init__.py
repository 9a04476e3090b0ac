"""The field side: what inspectors and roboticists open of a run, and runs held against each other and a reference."""

"""The field side: a robot's own logs in, what inspectors and roboticists open out."""

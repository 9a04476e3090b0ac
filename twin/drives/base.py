"""What every drive may raise."""


class DriveFailed(RuntimeError):
    """The robot did not get where it was sent; the message says why and where."""

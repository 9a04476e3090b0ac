"""What every drive may raise."""


class DriveFailed(RuntimeError):  # noqa: N818  it names what happened
    """The robot did not get where it was sent; the message says why and where."""

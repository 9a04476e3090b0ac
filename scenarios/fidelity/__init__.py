"""How far the cheap fidelity may be trusted: its noise measured in pictures, and the two compared score by score."""

"""What a deployment asks for in, what to promise of it out: from a study whose size it chooses."""

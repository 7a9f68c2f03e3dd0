"""States and terms of a robot beside those of another engine."""

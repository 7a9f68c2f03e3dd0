"""A workspace's scene in the compiled core: arrays across the border, answers back."""

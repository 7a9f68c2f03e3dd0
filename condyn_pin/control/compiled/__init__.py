"""A controller's tick in the compiled core: arrays across the border, answers back."""

"""How the rows of constraints change with q and v, and their forces with them."""

"""States that satisfy the constraints: closing loops, and what is known of them."""

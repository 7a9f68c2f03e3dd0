"""What accuracy costs: studies, their tables, and what they answer."""

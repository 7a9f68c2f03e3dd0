"""Motors: which joints have them, what they can do, and what they feel."""

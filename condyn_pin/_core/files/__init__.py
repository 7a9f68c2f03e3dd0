"""Files: what is written appears whole or not at all; what is read is measured first."""

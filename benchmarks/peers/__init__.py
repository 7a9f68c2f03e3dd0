"""condyn_pin beside what users would pick instead; `README.md` has the method."""

"""Contact that opens, sticks and slides, beside other engines: `benchmarks/contact_peers.py`."""

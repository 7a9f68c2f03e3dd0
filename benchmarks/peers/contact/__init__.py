"""Contact that opens, sticks and slides, beside other engines: `contact_peers.py motions`."""

"""What may let go: contacts with friction, stops and dry friction of joints, one file a kind."""

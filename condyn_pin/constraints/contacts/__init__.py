"""Contacts that may open: friction, stops and dry friction of joints, one file for each kind."""

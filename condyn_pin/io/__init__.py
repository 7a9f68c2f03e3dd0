"""Robot descriptions: readers of files."""
